// Levels of detail in viewers of 3D Tiles: CesiumJS and 3d-tiles-renderer (three.js) in headless Chromium.
//
//     node run.mjs ALVIS WORK NPM [VALIDATOR]
//
// ALVIS is the command, WORK a directory for tile sets, NPM where ../clients/package.json is installed, VALIDATOR where
// 3d-tiles-validator is, the official one; without it that part says that it skips. At three error targets each viewer
// shows the root, the level below it and the tiles: their files, triangles and requests are those of the index, six
// picks are what rays through the exact tiles meet, and a cell is coloured on every level. Ends with a line
// `N passed, N failed`.
import assert from "node:assert/strict";
import fs from "node:fs";
import path from "node:path";
import { spawnSync } from "node:child_process";
import { createRequire } from "node:module";
import { fileURLToPath } from "node:url";
import { inside, start } from "../clients/chromium.mjs";
import { Rays } from "../view/rays.mjs";

const [alvis, work, npm, validator] = process.argv.slice(2);
const here = path.dirname(fileURLToPath(import.meta.url));
const esbuild = createRequire(path.join(path.resolve(npm), "x.js"))("esbuild");
const SIDE = 256;
const ANGLE = Math.PI / 3;

let [passed, failed] = [0, 0];

async function check(name, test) {
  try {
    await test();
    passed++;
    console.log(`ok ${name}`);
  } catch (error) {
    failed++;
    console.log(`FAILED ${name}: ${String(error.message).slice(0, 600)}`);
  }
}

function run(...words) {
  const done = spawnSync(alvis, [...words, "--quiet"], { encoding: "utf8" });
  if (done.status !== 0) throw new Error(`alvis ${words.join(" ")}: ${done.stderr}`);
}

function make() {
  fs.rmSync(work, { recursive: true, force: true });
  fs.mkdirSync(work, { recursive: true });
  const at = (name) => path.join(work, name);
  run("phantom", "foam", at("foam.mhd"), "--dims", "128,128,128", "--spacing", "0.05,0.05,0.05", "--unit", "mm");
  run("convert", at("foam.mhd"), at("exact"), "--threshold", "127.5", "--macrocube", "32");
  run("repack", at("exact"), at("set"), "--for", "web");
  run("lod", at("set"));
  run("verify", at("set"));
}

const json = (name) => JSON.parse(fs.readFileSync(path.join(work, "set", name), "utf8"));

/** Files of each level with their triangles, and those of the strip before any is left out, the tiles first. */
function levels() {
  const tiles = json("index.json").layers.flatMap((l) => json(l.path).tiles);
  const all = [new Map(tiles.map((t) => [t.path, { triangles: t.triangles, strip: t.indices - 2 }]))];
  for (const level of json("lod/index.json").levels) {
    const nodes = level.layers.flatMap((l) => json(l.path).nodes);
    all.push(new Map(nodes.map((n) => [n.path, { triangles: n.triangles + n.fin_triangles, strip: n.indices - 2 }])));
  }
  return all;
}

const minus = (a, b) => a.map((x, k) => x - b[k]);
const plus = (a, b, s) => a.map((x, k) => x + s * b[k]);
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => a.map((x) => x / Math.hypot(...a));

/** A camera that sees all of the set: metres, Z up. */
function camera(tileset) {
  const box = tileset.root.boundingVolume.box;
  const centre = box.slice(0, 3);
  const radius = Math.hypot(...box.slice(3));
  const direction = unit([1, 0.8, -0.6]);
  const right = unit(cross(direction, [0, 0, 1]));
  const eye = plus(centre, direction, -2.2 * radius);
  return { eye, direction, right, up: cross(right, direction), angle: ANGLE, near: radius / 50, far: 20 * radius };
}

/** What a ray through the middle of a pixel meets in the exact tiles: the cell, or null. */
function cellAt(rays, view, voxel, [x, y]) {
  const wide = Math.tan(ANGLE / 2);
  const [u, v] = [((x + 0.5) / SIDE) * 2 - 1, 1 - ((y + 0.5) / SIDE) * 2];
  const along = plus(plus(view.direction, view.right, u * wide), view.up, v * wide);
  const scale = (p) => p.map((c, k) => (c / voxel) * rays.manifest.spacing[k]);
  const hit = rays.first({ from: scale(view.eye), along: scale(along) });
  return hit === null ? null : Number(hit.ids.cells ?? hit.ids.cell);
}

/** Six pixels amid others of the same cell. */
function pixels(rays, view, voxel) {
  const found = [];
  const known = new Map();
  const cell = (p) => {
    if (!known.has(`${p}`)) known.set(`${p}`, cellAt(rays, view, voxel, p));
    return known.get(`${p}`);
  };
  const near = [-2, 0, 2].flatMap((dx) => [-2, 0, 2].map((dy) => [dx, dy]));
  for (let n = 0; n < 4000 && found.length < 6; n++) {
    const at = [60 + ((n * 37) % 137), 60 + ((n * 61) % 131)];
    const own = cell(at);
    const is = own > 0 && near.every(([dx, dy]) => cell([at[0] + dx, at[1] + dy]) === own);
    if (is && found.every((f) => f.cell !== own)) found.push({ at, cell: own });
  }
  assert.equal(found.length, 6, "too few pixels amid others of their cell");
  return found;
}

const PROGRAMS = ["cesium", "three"];
/** Pixels of error that lead to the root, to the level below it, and to the tiles. */
function targets(tileset, view) {
  const far = Math.hypot(...minus(view.eye, tileset.root.boundingVolume.box.slice(0, 3)));
  const pixels = (error) => (error * SIDE) / (far * 2 * Math.tan(ANGLE / 2));
  const child = Math.max(...tileset.root.children.map((c) => c.geometricError));
  const between = (a, b) => Math.sqrt(pixels(a) * pixels(b));
  // of a tileset whose own error is small on the screen nothing is shown
  return [0.9 * pixels(tileset.geometricError), between(tileset.root.geometricError, child), 1e-6];
}

async function show(program, targets, view, picks, all) {
  const bundle = await esbuild.build({
    entryPoints: [path.join(here, "page", `${program}.js`)],
    bundle: true, format: "esm", write: false, logLevel: "error",
    nodePaths: [path.join(path.resolve(npm), "node_modules")],
  });
  const page = `<!doctype html><meta charset="utf-8"><body style="margin:0"><div id="view" style="width:256px;height:256px">
    </div><script>window.CESIUM_BASE_URL = "/cesium/";</script><script type="module" src="/page.js"></script>`;
  let requested = [];
  const answer = (url) => {
    if (url === "/") return ["text/html", page];
    if (url === "/page.js") return ["text/javascript", Buffer.from(bundle.outputFiles[0].contents)];
    if (url.startsWith("/cesium/")) {
      const type = url.endsWith(".wasm") ? "application/wasm" : url.endsWith(".js") ? "text/javascript" : "application/json";
      return [type, inside(path.join(npm, "node_modules/cesium/Build/Cesium"), url.slice(8))];
    }
    const name = url.slice("/set/".length);
    if (name.endsWith(".glb")) requested.push(name);
    return [name.endsWith(".json") ? "application/json" : "model/gltf-binary", inside(path.join(work, "set"), name)];
  };
  const { context, site, end } = await start(npm, { width: SIDE, height: SIDE }, answer);
  try {
    for (const [i, target] of targets.entries()) {
      const level = all.length - 1 - i;
      await check(`${program}, level ${level} at a target of ${target.toPrecision(3)} pixels`, async () => {
        const tab = await context.newPage();
        const broken = new Promise((_, reject) => tab.on("pageerror", reject));
        broken.catch(() => {});
        await tab.goto(`${site}/`);
        await Promise.race([broken, tab.waitForFunction("window.ready", null, { timeout: 60000 })]);
        requested = [];
        const job = { url: `${site}/set/tileset.json`, target, view, points: picks.map((p) => p.at), cell: picks[0].cell };
        const found = await Promise.race([broken, tab.evaluate((job) => window.run(job), job)]);
        await tab.close();
        assert.equal(found.failed, null);
        const files = found.files.map((f) => f.replace(/.*\/set\//, "").replace(/\?.*/, "")).sort();
        assert.deepEqual(files, [...all[level].keys()].sort(), "files that are shown");
        const count = program === "cesium" ? "strip" : "triangles";
        assert.equal(found.triangles, [...all[level].values()].reduce((a, b) => a + b[count], 0), "triangles");
        const above = all.slice(level).flatMap((l) => [...l.keys()]).sort();
        assert.deepEqual(requested.sort(), above, "requests");
        const right = picks.filter((p, k) => Number(found.picks[k]) === p.cell).length;
        // a coarse outline is not the exact one
        assert.ok(right >= (level < 2 ? 6 : 5), `picked ${found.picks}, expected ${picks.map((p) => p.cell)}`);
        assert.ok(found.lit > 4000 && found.red > 10 && found.red < found.lit / 2, `${found.red} red of ${found.lit} lit`);
      });
    }
  } finally {
    await end();
  }
}

/** The pages in examples/viewers, with the packages that they name from NPM: a click on a cell tells what is known. */
async function pages() {
  const type = { ".html": "text/html", ".js": "text/javascript", ".css": "text/css", ".json": "application/json",
    ".wasm": "application/wasm", ".glb": "model/gltf-binary" };
  const answer = (url) => {
    const base = url.endsWith(".html") ? path.join(here, "../../../examples/viewers") : work;
    return [type[path.extname(url)] ?? "application/octet-stream", inside(base, url.slice(1))];
  };
  const { context, site, end } = await start(npm, { width: SIDE, height: SIDE }, answer);
  await context.route("https://cdn.jsdelivr.net/npm/**", (route) => {
    const name = new URL(route.request().url()).pathname.replace("/npm/", "").replace(/^([^@]+)@[^/]+/, "$1");
    const body = inside(path.join(npm, "node_modules"), name);
    route.fulfill({ body, contentType: type[path.extname(name)] ?? "application/octet-stream",
      headers: { "access-control-allow-origin": "*" } });
  });
  try {
    for (const program of PROGRAMS) {
      await check(`examples/viewers/${program}.html`, async () => {
        const tab = await context.newPage();
        const wrong = [];
        tab.on("pageerror", (e) => wrong.push(e.message));
        await tab.goto(`${site}/${program}.html?set=set`);
        const said = (word) => tab.waitForFunction((w) => document.querySelector("p").textContent.includes(w), word, { timeout: 60000 });
        await said("Click").catch(() => assert.fail(`not ready: ${wrong}`));
        await tab.waitForTimeout(3000);
        for (let n = 0; n < 20 && !(await tab.textContent("p")).includes("surface"); n++) {
          await tab.mouse.click(100 + 3 * n, 140);
          await tab.waitForTimeout(200);
        }
        await said("surface").catch(() => assert.fail(`nothing was picked: ${wrong}`));
        assert.deepEqual(wrong, []);
        await tab.close();
      });
    }
  } finally {
    await end();
  }
}

/** The official validator over the tree and all that it names. */
function validate() {
  const main = path.join(path.resolve(validator), "node_modules/3d-tiles-validator/build/main");
  const report = path.join(work, "report.json");
  const words = [main, "--tilesetFile", path.join(work, "set/tileset.json"), "--reportFile", report];
  const done = spawnSync("node", words, { encoding: "utf8" });
  assert.equal(done.status, 0, done.stderr);
  const { numErrors, numWarnings, issues } = JSON.parse(fs.readFileSync(report, "utf8"));
  const serious = issues.filter((i) => i.severity !== "INFO");
  assert.deepEqual([numErrors, numWarnings], [0, 0], JSON.stringify(serious).slice(0, 400));
}

make();
if (validator && fs.existsSync(path.join(validator, "node_modules/3d-tiles-validator"))) {
  await check("3d-tiles-validator", validate);
} else {
  console.log("SKIPPED 3d-tiles-validator: it could not be had");
}
const tileset = json("tileset.json");
const view = camera(tileset);
const voxel = tileset.extras.alvis.voxel_metres;
const rays = new Rays(path.join(work, "exact"));
const picks = pixels(rays, view, voxel);
const all = levels();
assert.equal(all.length, 3, "levels");
for (const program of PROGRAMS) await show(program, targets(tileset, view), view, picks, all);
await pages();
console.log(`${passed} passed, ${failed} failed`);
process.exitCode = failed === 0 ? 0 : 1;
