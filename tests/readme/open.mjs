// Opens a page of the README in headless Chromium: node open.mjs NPM ROOT PAGE.
// ROOT is served as by a small server on this machine. What the page takes of three.js from the network comes from NPM,
// where tests/conformance/clients/package.json is installed, so its version there must be the one that the page names.
// Passes if the page loads all cells, draws them, and says of one that is clicked what it is.
import fs from "node:fs";
import path from "node:path";
import { inside, start } from "../conformance/clients/chromium.mjs";

const [npm, root, name] = process.argv.slice(2).map((a, i) => (i < 2 ? path.resolve(a) : a));
const three = JSON.parse(fs.readFileSync(path.join(npm, "node_modules/three/package.json"), "utf8")).version;
const prefix = `https://cdn.jsdelivr.net/npm/three@${three}/`;
const types = { ".html": "text/html", ".json": "application/json", ".glb": "model/gltf-binary", ".js": "text/javascript" };

const typed = (base, file) => [types[path.extname(file)] ?? "application/octet-stream", inside(base, file)];

const { context, site, end } = await start(npm, { width: 400, height: 300 }, (url) => typed(root, url));
try {
  const tab = await context.newPage();
  const complaints = [];
  tab.on("pageerror", (error) => complaints.push(error.message));
  tab.on("console", (text) => text.type() === "error" && complaints.push(text.text()));
  await context.route((url) => url.hostname !== "127.0.0.1", (route) => {
    const url = route.request().url();
    if (!url.startsWith(prefix)) return route.abort();
    const [type, body] = typed(path.join(npm, "node_modules/three"), decodeURIComponent(url.slice(prefix.length)));
    return route.fulfill({ contentType: type, body });
  });
  try {
    await tab.goto(`${site}/${name}`);
    await tab.waitForFunction("/cells/.test(document.querySelector('p').textContent)", null, { timeout: 240000 });
    const said = await tab.textContent("p", { timeout: 240000 });
    const picture = await tab.screenshot({ path: path.join(root, `${name}.png`) });
    // a picture of one colour is packed to less
    if (picture.length < 10000) throw new Error(`the picture has ${picture.length} bytes`);
    await tab.mouse.click(200, 150);
    await tab.waitForFunction("/volume/.test(document.querySelector('p').textContent)", null, { timeout: 60000 });
    console.log(`${name}: "${said}", then "${await tab.textContent("p", { timeout: 240000 })}"`);
  } catch (error) {
    console.error(`${error.message} ${complaints.join(" ")}`.slice(0, 500));
    process.exitCode = 1;
  }
} finally {
  await end();
}
