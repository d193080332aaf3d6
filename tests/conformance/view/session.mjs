// `alvis view` on a set, a page of a browser that looks at it, and what tests do with both.
import { spawn } from "node:child_process";

const nap = (ms) => new Promise((resolve) => setTimeout(resolve, ms));

/** Starts the server and waits for its address. */
export async function serve(alvis, set, options = []) {
  const child = spawn(alvis, ["view", set, "--no-open", "--quiet", ...options], { stdio: ["ignore", "pipe", "pipe"] });
  let said = "";
  const address = await new Promise((resolve, reject) => {
    const hear = (data) => {
      said += data;
      const found = /http:\/\/127\.0\.0\.1:\d+\/#[0-9a-f]{32}/.exec(said);
      if (found) resolve(found[0]);
    };
    child.stdout.on("data", hear);
    child.stderr.on("data", hear);
    child.on("exit", () => reject(new Error(`alvis view ended: ${said}`)));
  });
  return { address, end: () => child.kill() };
}

/** A page with what it complains of. */
export class Session {
  constructor(tab) {
    this.tab = tab;
    this.complaints = [];
    tab.on("pageerror", (error) => this.complaints.push(error.message));
  }

  static async open(context, address, { dark = true, settle = true } = {}) {
    const tab = await context.newPage();
    await tab.emulateMedia({ reducedMotion: "reduce", colorScheme: dark ? "dark" : "light" });
    const session = new Session(tab);
    await tab.goto(address);
    if (settle) await session.settle();
    return session;
  }

  /** Waits until all is drawn. Evaluated again and again: the page's policy forbids what waits inside of it. */
  async settle(least = 0) {
    await nap(least);
    for (let i = 0; i < 1200; i++) {
      const state = await this.tab.evaluate(() => ({ phase: window.alvis?.phase, covered: !document.getElementById("cover").hidden }));
      if (state.phase === "complete" && !state.covered) return;
      await nap(50);
    }
    throw new Error(`the picture is not complete: ${await this.get("phase")} ${this.complaints.join(" ")}`);
  }

  /** Waits until something holds. */
  async until(run, argument) {
    for (let i = 0; i < 400; i++) {
      const value = await this.tab.evaluate(run, argument);
      if (value) return value;
      await nap(50);
    }
    throw new Error(`never: ${run} ${this.complaints.join(" ")}`);
  }

  get(name) {
    return this.tab.evaluate((n) => window.alvis[n], name);
  }

  pick(x, y) {
    return this.tab.evaluate(([a, b]) => window.alvis.pick(a, b), [x, y]);
  }

  size() {
    return this.tab.evaluate(() => {
      const { clientWidth: width, clientHeight: height } = document.getElementById("picture");
      return { width, height };
    });
  }

  /** The picture as the screen shows it, without what stands over it. */
  async pixels() {
    await this.tab.evaluate(() => {
      document.getElementById("furniture").hidden = true;
    });
    const picture = await this.tab.locator("#picture").screenshot();
    await this.tab.evaluate(() => {
      document.getElementById("furniture").hidden = false;
    });
    return picture;
  }

  async key(key, least = 250) {
    await this.tab.evaluate(() => document.activeElement?.blur());
    await this.tab.keyboard.press(key);
    await this.settle(least);
  }

  button(name) {
    return this.tab.getByRole("button", { name, exact: true });
  }

  radio(name) {
    return this.tab.getByRole("radio", { name, exact: true });
  }

  /** Types a condition, and chooses what it keeps. */
  async chooseWhere(condition) {
    await this.tab.fill("#list input[type=search]", condition);
    await nap(700);
    await this.button("Choose listed").click();
    await nap(300);
  }

  close() {
    return this.tab.close();
  }
}

/** Pixels of a PNG of a browser: decoded by the browser, bytes red, green, blue, alpha. */
export async function decode(tab, png) {
  const text = await tab.evaluate(async (base64) => {
    const bytes = Uint8Array.from(atob(base64), (c) => c.charCodeAt(0));
    const image = await createImageBitmap(new Blob([bytes], { type: "image/png" }));
    const canvas = new OffscreenCanvas(image.width, image.height);
    const context = canvas.getContext("2d");
    context.drawImage(image, 0, 0);
    const { data } = context.getImageData(0, 0, image.width, image.height);
    let out = "";
    for (let i = 0; i < data.length; i += 8192) out += String.fromCharCode(...data.subarray(i, i + 8192));
    return { width: image.width, height: image.height, data: btoa(out) };
  }, png.toString("base64"));
  return { ...text, data: Buffer.from(text.data, "base64") };
}
