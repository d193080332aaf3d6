// Loads tile sets in a program in headless Chromium: node browser.mjs PROGRAM NPM ROOT JOB OUT.
// NPM is where package.json is installed, ROOT holds all tiles; JOB and OUT are those of desktop.py.
import fs from "node:fs";
import http from "node:http";
import os from "node:os";
import path from "node:path";
import { createRequire } from "node:module";
import { fileURLToPath } from "node:url";

const [program, npm, root, job, out] = process.argv.slice(2);
const here = path.dirname(fileURLToPath(import.meta.url));
const require = createRequire(path.join(path.resolve(npm), "x.js"));
const { chromium } = require("playwright-core");
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
  const inside = (base, name) => {
    const file = path.join(base, name);
    if (!path.resolve(file).startsWith(path.resolve(base) + path.sep)) throw new Error("outside");
    return fs.readFileSync(file);
  };
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

const server = http.createServer((request, response) => {
  try {
    const [type, body] = answer(decodeURIComponent(request.url.split("?")[0]));
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
  viewport: { width: 256, height: 256 },
  args: ["--headless", "--no-sandbox", "--disable-gpu", "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader", "--disable-quic", "--no-first-run", "--disable-background-networking"],
});
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
      await tab.goto(`http://127.0.0.1:${server.address().port}/`);
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
  await context.close();
  server.close();
  fs.rmSync(profile, { recursive: true, force: true });
}
