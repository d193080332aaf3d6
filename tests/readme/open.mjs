// Opens a page of the README in headless Chromium: node open.mjs NPM ROOT PAGE.
// ROOT is served as by a small server on this machine. What the page takes of three.js from the network comes from NPM,
// where tests/conformance/clients/package.json is installed, so its version there must be the one that the page names.
// Passes if the page loads all cells, draws them, and says of one that is clicked what it is.
import fs from "node:fs";
import http from "node:http";
import os from "node:os";
import path from "node:path";
import { createRequire } from "node:module";

const [npm, root, name] = process.argv.slice(2).map((a, i) => (i < 2 ? path.resolve(a) : a));
const require = createRequire(path.join(npm, "x.js"));
const { chromium } = require("playwright-core");
const three = JSON.parse(fs.readFileSync(path.join(npm, "node_modules/three/package.json"), "utf8")).version;
const prefix = `https://cdn.jsdelivr.net/npm/three@${three}/`;
const types = { ".html": "text/html", ".json": "application/json", ".glb": "model/gltf-binary", ".js": "text/javascript" };

function read(base, file) {
  const full = path.resolve(path.join(base, decodeURIComponent(file)));
  if (!full.startsWith(base + path.sep)) throw new Error(`${file} is outside`);
  return { type: types[path.extname(full)] ?? "application/octet-stream", body: fs.readFileSync(full) };
}

const server = http.createServer((request, response) => {
  try {
    const { type, body } = read(root, request.url.split("?")[0]);
    response.setHeader("content-type", type);
    response.end(body);
  } catch {
    response.statusCode = 404;
    response.end();
  }
});
await new Promise((resolve) => server.listen(0, "127.0.0.1", resolve));

const profile = fs.mkdtempSync(path.join(os.tmpdir(), "alvis-chromium-"));
const context = await chromium.launchPersistentContext(profile, {
  executablePath: "/usr/bin/chromium",
  headless: true,
  viewport: { width: 400, height: 300 },
  args: ["--headless", "--no-sandbox", "--disable-gpu", "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader", "--disable-quic", "--no-first-run", "--disable-background-networking"],
});
try {
  const tab = await context.newPage();
  const complaints = [];
  tab.on("pageerror", (error) => complaints.push(error.message));
  tab.on("console", (text) => text.type() === "error" && complaints.push(text.text()));
  await context.route((url) => url.hostname !== "127.0.0.1", (route) => {
    const url = route.request().url();
    if (!url.startsWith(prefix)) return route.abort();
    const { type, body } = read(path.join(npm, "node_modules/three"), url.slice(prefix.length));
    return route.fulfill({ contentType: type, body });
  });
  try {
    await tab.goto(`http://127.0.0.1:${server.address().port}/${name}`);
    await tab.waitForFunction("/cells/.test(document.querySelector('p').textContent)", null, { timeout: 240000 });
    const said = await tab.textContent("p");
    const picture = await tab.screenshot({ path: path.join(root, `${name}.png`) });
    // a picture of one colour is packed to less
    if (picture.length < 10000) throw new Error(`the picture has ${picture.length} bytes`);
    await tab.mouse.click(200, 150);
    await tab.waitForFunction("/volume/.test(document.querySelector('p').textContent)", null, { timeout: 60000 });
    console.log(`${name}: "${said}", then "${await tab.textContent("p")}"`);
  } catch (error) {
    console.error(`${error.message} ${complaints.join(" ")}`.slice(0, 500));
    process.exitCode = 1;
  }
} finally {
  await context.close();
  server.close();
  fs.rmSync(profile, { recursive: true, force: true });
}
