// Looks at tile sets with `alvis view` in headless Chromium, and holds what it shows against the tiles.
//
//     node run.mjs ALVIS WORK NPM [NAME]...
//
// ALVIS is the command, WORK a directory for tile sets, NPM where ../clients/package.json is installed. With names, only
// parts of these names run. Pictures are drawn by the processor (SwiftShader), the same on every machine; without WebGL2
// all fails. Prints what a page of three.js with the same tiles takes, which is not judged. Ends with a line
// `N passed, N failed`.
import fs from "node:fs";
import path from "node:path";
import { spawnSync } from "node:child_process";
import { fileURLToPath } from "node:url";
import { start } from "../clients/chromium.mjs";
import { laws } from "./checks.mjs";
import { LEVELS } from "./levels.mjs";
import { PANELS } from "./panels.mjs";
import { PARTS } from "./parts.mjs";
import { serve, Session } from "./session.mjs";
import { answerThree, compare } from "./three.mjs";

const [alvis, work, npm, ...only] = process.argv.slice(2);
const here = path.dirname(fileURLToPath(import.meta.url));
const VIEWPORT = { width: 1000, height: 640 };

let [passed, failed] = [0, 0];

async function check(name, test) {
  const began = Date.now();
  try {
    await test();
    passed++;
    console.log(`ok ${name} (${((Date.now() - began) / 1000).toFixed(1)} s)`);
  } catch (error) {
    failed++;
    const at = error.stack?.split("\n").find((l) => /(parts|levels|panels).mjs/.test(l) || l.includes("checks.mjs")) ?? "";
    console.log(`FAILED ${name}: ${String(error.message).slice(0, 800)} ${at.trim()}`);
  }
}

function run(...words) {
  const done = spawnSync(alvis, words, { encoding: "utf8", maxBuffer: 1 << 28 });
  if (done.status !== 0) throw new Error(`alvis ${words.join(" ")}: ${done.stderr}`);
  return done.stdout;
}

// The sets that are looked at.
function make() {
  fs.rmSync(work, { recursive: true, force: true });
  fs.mkdirSync(work, { recursive: true });
  const at = (name) => path.join(work, name);
  run("phantom", "foam", at("foam.mhd"), "--dims", "96,96,80", "--spacing", "0.05,0.05,0.06", "--unit", "mm");
  const convert = (volume, out, ...options) => run("convert", at(volume), at(out), "--quiet", ...options);
  convert("foam.mhd", "blender", "--threshold", "127.5", "--macrocube", "32");
  run("repack", at("blender"), at("meshlab"), "--for", "meshlab", "--quiet");
  run("repack", at("blender"), at("quantized"), "--encoding", "quantized", "--quiet");
  run("repack", at("blender"), at("web"), "--for", "web", "--quiet");
  convert("foam.mhd", "capped", "--threshold", "127.5", "--macrocube", "32", "--cap");
  convert("foam.mhd", "many", "--threshold", "127.5", "--macrocube", "3");
  run("phantom", "noise", at("noise.mhd"), "--dims", "40,40,40");
  convert("noise.mhd", "noise", "--threshold", "127.5", "--macrocube", "20");
  const far = fs.readFileSync(at("foam.mhd"), "utf8").replace(/^Offset = .*\n/m, "").replace("NDims = 3\n", "NDims = 3\nOffset = 123456.789 -98765.4321 0\n");
  fs.writeFileSync(at("far.mhd"), far);
  convert("far.mhd", "far", "--threshold", "127.5", "--macrocube", "32");
  // hollows in a solid block
  const [n, samples] = [48, new Uint8Array(48 ** 3).fill(200)];
  for (let i = 0; i < samples.length; i++) {
    const [x, y, z] = [i % n, Math.floor(i / n) % n, Math.floor(i / n / n)].map((c) => (c % 24) - 11.5);
    if (x * x + y * y + z * z < 49) samples[i] = 20;
  }
  fs.writeFileSync(at("cast.raw"), samples);
  convert("cast.raw", "cast", "--dims", `${n},${n},${n}`, "--dtype", "u8", "--threshold", "110", "--macrocube", "16");
  run("phantom", "sphere", at("sphere.mhd"), "--dims", "24,24,24");
  convert("sphere.mhd", "empty", "--threshold", "250");
  for (const name of ["damaged", "changed", "renamed", "cut", "levels"]) fs.cpSync(at("blender"), at(name), { recursive: true });
  run("lod", at("levels"), "--quiet");
  const tile = path.join(at("damaged"), "tiles/z0001/y0001_x0001.glb");
  const bytes = fs.readFileSync(tile);
  bytes[bytes.length - 1000] ^= 0x55;
  fs.writeFileSync(tile, bytes);
  const table = fs.readFileSync(path.join(at("blender"), "cells.csv"), "utf8");
  fs.writeFileSync(path.join(at("renamed"), "cells.csv"), table.replace("volume [", "mine ["));
  fs.writeFileSync(path.join(at("cut"), "cells.csv"), table.slice(0, table.length / 2));
  convert("foam.mhd", "parquet", "--threshold", "127.5", "--macrocube", "32", "--tables", "csv,parquet");
  fs.truncateSync(path.join(at("parquet"), "cells.parquet"), 100);
  return at;
}

const at = make();
const page = path.join(work, "page");
fs.cpSync(path.join(here, "../../../src/view/page"), page, { recursive: true });
fs.writeFileSync(path.join(page, "package.json"), "{\"type\": \"module\"}");
for (const [name, test] of await laws(page)) await check(name, test);

const { context, site, end } = await start(npm, VIEWPORT, answerThree(npm, at("blender")));
const servers = new Map();
try {
  await context.grantPermissions(["clipboard-read", "clipboard-write"]);
  const open = async (name, { options = [], fragment = "", ...more } = {}) => {
    const key = [name, ...options].join(" ");
    if (!servers.has(key)) servers.set(key, await serve(alvis, at(name), options));
    return Session.open(context, servers.get(key).address + fragment, more);
  };
  const tools = { alvis, run, at, open, context, servers };
  for (const [name, test] of [...PARTS, ...LEVELS, ...PANELS]) {
    if (only.length > 0 && !only.some((o) => name.includes(o))) continue;
    await check(name, () => test(tools));
  }
  if (only.length === 0) await check("a page of three.js beside it", () => compare(context, site, servers.get("blender").address));
} finally {
  await end();
  for (const server of servers.values()) server.end();
}
console.log(`${passed} passed, ${failed} failed`);
process.exitCode = failed === 0 ? 0 : 1;
