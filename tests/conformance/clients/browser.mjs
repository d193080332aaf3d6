// Loads tile sets in a program in headless Chromium: node browser.mjs PROGRAM NPM ROOT JOB OUT.
// NPM is where package.json is installed, ROOT holds all tiles; JOB and OUT are those of desktop.py.
import fs from "node:fs";
import path from "node:path";
import { createRequire } from "node:module";
import { fileURLToPath } from "node:url";
import { inside, start } from "./chromium.mjs";

const [program, npm, root, job, out] = process.argv.slice(2);
const here = path.dirname(fileURLToPath(import.meta.url));
const require = createRequire(path.join(path.resolve(npm), "x.js"));
const esbuild = require("esbuild");

const bundle = await esbuild.build({
  entryPoints: [path.join(here, "page", `${program}.js`)],
  bundle: true,
  format: "esm",
  write: false,
  nodePaths: [path.join(path.resolve(npm), "node_modules")],
  logLevel: "error",
});
const page = `<!doctype html><meta charset="utf-8">
<body style="margin:0"><div id="view" style="width:256px;height:256px"></div>
<script>window.CESIUM_BASE_URL = "/cesium/";</script><script type="module" src="/page.js"></script>`;

function answer(url) {
  if (url === "/") return ["text/html", page];
  if (url === "/page.js") return ["text/javascript", bundle.outputFiles[0].contents];
  if (url === "/meshopt_decoder.js") {
    return ["text/javascript", inside(npm, "node_modules/meshoptimizer/meshopt_decoder.cjs")];
  }
  if (url.startsWith("/cesium/")) {
    const type = url.endsWith(".wasm") ? "application/wasm" : url.endsWith(".js") ? "text/javascript" : "application/json";
    return [type, inside(path.join(npm, "node_modules/cesium/Build/Cesium"), url.slice(8))];
  }
  return ["model/gltf-binary", inside(root, url.slice(1))];
}

const { context, site, end } = await start(npm, { width: 256, height: 256 }, answer);
const sets = {};
let version = "";
try {
  for (const [name, files] of Object.entries(JSON.parse(fs.readFileSync(job, "utf8")))) {
    const tab = await context.newPage();
    const complaints = [];
    const broken = new Promise((_, reject) => tab.on("pageerror", reject));
    broken.catch(() => {});
    tab.on("console", (text) => text.type() === "error" && complaints.push(text.text()));
    try {
      await tab.goto(`${site}/`);
      await Promise.race([broken, tab.waitForFunction("window.ready", null, { timeout: 60000 })]);
      version = await tab.evaluate(() => window.version);
      await tab.evaluate(() => window.begin());
      for (const file of files) {
        await Promise.race([broken, tab.evaluate((url) => window.add(url), "/" + path.relative(root, file))]);
      }
      sets[name] = await tab.evaluate(() => window.end());
    } catch (error) {
      sets[name] = { error: `${error.message} ${complaints.join(" ")}`.slice(0, 300) };
    }
    await tab.close();
  }
  fs.writeFileSync(out, JSON.stringify({ version, sets }));
} finally {
  await end();
}
