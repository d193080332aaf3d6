// What is asked of the page, one part after the other.
import assert from "node:assert/strict";
import fs from "node:fs";
import path from "node:path";
import { follow, holdAgainstRays, linkOf, points, raysOf, variance } from "./look.mjs";
import { decode } from "./session.mjs";
import { glb, manifestOf, middles, tilesOf } from "./set.mjs";

const KINDS = ["cells", "objects", "surfaces"];

export const nap = (ms) => new Promise((resolve) => setTimeout(resolve, ms));

async function firstPicture({ open, at }) {
  const session = await open("blender");
  const { tiles, triangles } = manifestOf(at("blender")).totals;
  const told = await session.tab.evaluate(() => {
    const gl = document.createElement("canvas").getContext("webgl2");
    const info = gl?.getExtension("WEBGL_debug_renderer_info");
    return gl && gl.getParameter(info ? info.UNMASKED_RENDERER_WEBGL : gl.RENDERER);
  });
  assert(told, "no WebGL2: nothing of this is tested");
  console.log(`   ${told}`);
  assert(await variance(session) > 100, "the picture is empty");
  // a list that has just come may have changed the room for the picture, which is drawn anew then
  await session.settle();
  assert.equal(await session.get("draws"), tiles);
  assert.equal(await session.get("visible"), tiles);
  assert.equal(await session.get("triangles"), triangles);
  const [requests, bytes, uploaded] = [await session.get("requests"), await session.get("bytes"), await session.get("uploaded")];
  console.log(`   ${requests} requests, ${(bytes / triangles).toFixed(2)} bytes a triangle on the way, ${(uploaded / triangles).toFixed(2)} on the card`);
  // the set, its tree, ids and columns of the table, the list
  assert(requests <= tiles + 8, `${requests} requests for ${tiles} tiles`);
  assert(bytes / triangles <= 11 && uploaded / triangles <= 11);
  assert.deepEqual(session.complaints, []);
  await session.close();
}

async function forms({ open, at }) {
  const set = raysOf(at, "blender");
  for (const form of ["blender", "meshlab", "quantized", "web"]) {
    const session = await open(form);
    const agreed = await holdAgainstRays(session, set);
    console.log(`   ${form}: ${agreed} pixels`);
    if (form === "web") {
      for (const kind of KINDS.slice(1)) {
        await session.tab.getByRole("radio", { name: new RegExp(kind, "i") }).click();
        await session.settle(400);
        await holdAgainstRays(session, set);
      }
    }
    await session.close();
  }
}

// From near, without perspective, along an axis, from inside.
async function cameras({ open, at }) {
  const session = await open("blender");
  const set = raysOf(at, "blender");
  for (const key of ["x", "Y", "z", "o"]) {
    await session.key(key);
    await holdAgainstRays(session, set);
  }
  await session.key("o");
  const { width, height } = await session.size();
  await session.tab.mouse.move(width / 2 + 30, height / 2 + 60);
  for (let i = 0; i < 14; i++) {
    await session.tab.mouse.wheel(0, -240);
    await nap(30);
  }
  await session.settle(300);
  await holdAgainstRays(session, set);
  await session.close();
}

async function turn({ open }) {
  const session = await open("blender");
  const { camera } = await session.get("state");
  const round = async () => {
    for (let i = 0; i < 12; i++) {
      await follow(session, { ...camera, distance: camera.distance / 2.5, azimuth: camera.azimuth + (i * Math.PI) / 6 });
      assert.equal(await session.get("draws"), await session.get("visible"));
    }
    return session.get("requests");
  };
  const first = await round();
  const second = await round();
  assert.equal(second, first, "the second turn asks for blocks again");
  console.log(`   ${first} requests after one turn and after two`);
  await session.close();
}

// All corners that tiles share lie at the same place to the last bit, and at an edge the front shows.
async function backFaces({ open, at }) {
  const session = await open("capped");
  const size = await session.size();
  const seen = () => session.tab.evaluate(() => window.alvis.backFaces());
  const { camera } = await session.get("state");
  for (const key of ["Home", "x", "Y", "Z", "o"]) {
    await session.key(key);
    assert.deepEqual(await seen(), [], `from outside, ${key}`);
  }
  for (let i = 0; i < 12; i++) {
    await follow(session, { ...camera, azimuth: 0.013 + (i * Math.PI) / 6, elevation: [-0.9, 0.1, 0.6][i % 3] });
    assert.deepEqual(await seen(), [], `from outside, ${i}`);
  }
  // from the middles of cells, to all sides
  for (const target of middles(at("capped"), 3)) {
    for (const [azimuth, elevation] of [[0, 0.2], [2, -0.4], [4, 1.3], [1, -1.4]]) {
      await follow(session, { target, distance: 0.02, azimuth, elevation });
      assert.equal((await session.get("state")).camera.azimuth, azimuth);
      assert.deepEqual(await seen(), [], `from inside, at ${target}`);
      assert((await session.pick(size.width / 2, size.height / 2)).id > 0);
    }
  }
  await session.key("Home");
  await session.key("c");
  assert((await seen()).length > 1000, "a section shows material that is cut");
  await session.close();
}

// Colours in the picture and in the list are those that `alvis select` paints tiles in.
async function colours({ open, run, at }) {
  const session = await open("blender");
  const size = await session.size();
  for (const mode of ["By value", "Best and worst"]) {
    await session.radio(mode).click();
    await session.settle(500);
    const copied = await copiedCommand(session);
    const painted = paintedBy(copied, { run, at, to: `painted_${mode.length}` });
    const { data } = await decode(session.tab, await session.pixels());
    let compared = 0;
    for (const [x, y] of points(size)) {
      const found = await session.pick(x, y);
      if (!found?.id) continue;
      const [r, g, b] = data.subarray(4 * (y * size.width + x), 4 * (y * size.width + x) + 3);
      const [p, q] = [[r, g, b], painted.get(found.id) ?? [150, 153, 158]];
      const cosine = p.reduce((s, c, k) => s + c * q[k], 0) / Math.hypot(...p) / Math.hypot(...q);
      assert(cosine > 0.96, `cell ${found.id} at ${x}, ${y} is ${p}, painted ${q}`);
      compared++;
    }
    assert(compared > 15, `${compared} pixels`);
    for (const row of await rows(session)) {
      const q = painted.get(row.id) ?? [150, 153, 158];
      assert(row.colour.every((c, k) => Math.abs(c - q[k]) <= 4), `row ${row.id} is ${row.colour}, painted ${q}`);
    }
  }
  assert.equal(await session.get("requests") < 100, true);
  await session.close();
}

/** The command that the page makes of what it shows. */
export async function copiedCommand(session) {
  await session.button("Share").click();
  await session.button("Copy as command").click();
  await nap(200);
  return session.tab.evaluate(() => navigator.clipboard.readText());
}

// Rows of the list that show: id, colour, classes.
export function rows(session) {
  return session.tab.evaluate(() => [...document.querySelectorAll(".grid-row")].map((row) => ({
    id: Number(row.dataset.id),
    colour: getComputedStyle(row.firstChild).backgroundColor.match(/\d+/g).map(Number),
    classes: row.className,
    text: row.innerText,
  })));
}

/** Runs a command that the page made; the tile set that it makes. */
export function selectedBy(copied, { run, at, to }) {
  const words = copied.match(/'(?:[^']|'\\'')*'|[^ ]+/g).map((w) => w.replace(/^'|'$/g, "").replaceAll("'\\''", "'"));
  assert.deepEqual(words.slice(0, 2), ["alvis", "select"]);
  const out = at(to);
  run("select", words[2], out, "--quiet", "--force", ...words.slice(4));
  return out;
}

// Runs a command that the page made, and reads the colours of cells from its tiles.
export function paintedBy(copied, { run, at, to }) {
  const out = selectedBy(copied, { run, at, to });
  const colours = new Map();
  for (const { path: file } of tilesOf(out)) {
    const { doc } = glb(path.join(out, file));
    for (const node of doc.nodes.slice(1)) {
      const material = doc.materials[doc.meshes[node.mesh].primitives[0].material];
      const factor = material?.pbrMetallicRoughness?.baseColorFactor;
      // glTF has linear colours
      if (factor && material.name !== "surface") colours.set(node.extras.cell, factor.slice(0, 3).map((c) => Math.round(255 * (c <= 0.0031308 ? 12.92 * c : 1.055 * c ** (1 / 2.4) - 0.055))));
    }
  }
  assert(colours.size > 0, copied);
  return colours;
}

export function count(run, set, where) {
  return JSON.parse(run("cells", set, "--where", where, "--json")).cells.length;
}

async function leaving({ open, run, at }) {
  const session = await open("blender");
  const all = await session.get("things");
  const condition = "volume > 0.2 and not touches_border";
  await session.chooseWhere(condition);
  const expected = count(run, at("blender"), condition);
  assert.equal((await session.get("chosen")).length, expected);
  const before = await session.get("triangles");
  await session.key("h", 400);
  assert.equal(await session.get("things"), all - expected);
  assert.equal(await session.get("triangles"), before, "the same blocks are drawn");
  await session.key("Control+z", 400);
  assert.equal(await session.get("things"), all);
  await session.key("Control+Z", 400);
  assert.equal(await session.get("things"), all - expected);
  await session.key("Alt+h", 400);
  assert.equal(await session.get("things"), all);
  // one that is seen is not seen any more
  const { x, y, id } = await seen(session);
  await session.tab.mouse.click(...(await onScreen(session, x, y)));
  assert.deepEqual(await session.get("chosen"), [id]);
  await session.key("h", 400);
  assert.notEqual((await session.pick(x, y))?.id, id);
  assert.equal(await session.get("things"), all - 1);
  // and the only one that is shown is in the middle
  await session.key("Control+z", 400);
  await session.tab.mouse.click(...(await onScreen(session, x, y)));
  await session.key("f", 400);
  await session.key("H", 400);
  assert.equal(await session.get("things"), 1);
  const size = await session.size();
  assert.equal((await session.pick(size.width / 2, size.height / 2)).id, id);
  await session.close();
}

// A pixel with a cell whose neighbours are the same cell.
export async function seen(session) {
  for (const [x, y] of points(await session.size())) {
    const found = await session.pick(x, y);
    if (!found?.id) continue;
    const around = await Promise.all([[-8, 0], [8, 0], [0, -8], [0, 8]].map(([dx, dy]) => session.pick(x + dx, y + dy)));
    if (around.every((f) => f?.id === found.id)) return { x, y, id: found.id };
  }
  throw new Error("no cell is seen");
}

export async function onScreen(session, x, y) {
  const box = await session.tab.locator("#picture").boundingBox();
  return [box.x + x, box.y + y];
}

async function rowAndPicture({ open, at }) {
  const session = await open("blender");
  const { x, y, id } = await seen(session);
  await session.tab.mouse.dblclick(...(await onScreen(session, x, y)));
  const card = await session.until(() => !document.getElementById("info").hidden && document.getElementById("info").innerText);
  assert(card.startsWith(`Cell ${id}`), card);
  const header = fs.readFileSync(path.join(at("blender"), "cells.csv"), "utf8").split("\n");
  const names = header[0].split(",");
  const row = header.find((l) => l.startsWith(`${id},`)).split(",");
  assert(card.includes(row[names.indexOf("voxels")]) && card.includes("mm³"), card);
  assert((await rows(session)).some((r) => r.id === id && r.classes.includes("chosen")), "the list does not show the row");
  // and back: a row is chosen, and shows in the picture
  await session.key("Escape");
  await session.key("Escape");
  await session.tab.fill("#list input[type=search]", `id == ${id}`);
  await session.until((n) => document.querySelectorAll(".grid-row").length === 1 && document.querySelector(".grid-row").dataset.id === String(n), id);
  const before = await decode(session.tab, await session.pixels());
  await session.tab.locator(".grid-row").click();
  await session.settle(300);
  assert.deepEqual(await session.get("chosen"), [id]);
  const after = await decode(session.tab, await session.pixels());
  const size = await session.size();
  const pixel = (p, a, b) => p.data.subarray(4 * (b * size.width + a), 4 * (b * size.width + a) + 3);
  assert.notDeepEqual([...pixel(before, x, y)], [...pixel(after, x, y)]);
  // a bad condition is told, and what was listed stays
  await session.tab.fill("#list input[type=search]", "volume >");
  const wrong = await session.until(() => !document.querySelector("#list .wrong-text").hidden && document.querySelector("#list .wrong-text").textContent);
  assert(wrong.length > 10 && (await rows(session)).length === 1, wrong);
  await session.close();
}

async function link({ open, servers }) {
  const session = await open("blender");
  await session.radio("By value").click();
  await session.chooseWhere("sphericity < 0.97");
  await session.key("m", 400);
  await session.chooseWhere("volume < 0.1");
  await session.key("h", 400);
  await session.key("c");
  await session.key("]");
  for (const key of ["ArrowLeft", "ArrowLeft", "ArrowDown", "+"]) await session.key(key);
  const fragment = await session.get("link");
  const [state, picture] = [await session.get("state"), await session.pixels()];
  const { address } = servers.get("blender");
  assert(fragment.startsWith(`#${address.split("#")[1]}&`));
  const other = await open("blender", { fragment: fragment.slice(33) });
  assert.deepEqual(await other.get("state"), state);
  assert(picture.equals(await other.pixels()), "the picture is another one");
  assert.equal(await other.get("link"), fragment);
  await other.close();
  await session.close();
}

async function section({ open, at }) {
  const session = await open("blender");
  await session.key("c");
  for (const axis of ["x", "y", "z"]) {
    await session.tab.locator("#section").getByRole("radio", { name: axis, exact: true }).click();
    await session.settle(400);
    const { clip } = await session.get("state");
    const s = clip.flip ? -1 : 1;
    await holdAgainstRays(session, raysOf(at, "blender"), { cut: { normal: clip.normal.map((n) => s * n), at: s * clip.at } });
    const left = await session.get("visible");
    assert(left < 27, `${left} blocks are drawn beside a section`);
  }
  const flat = await decode(session.tab, await session.pixels());
  await session.tab.selectOption("#section select", "whole");
  await session.settle(1200);
  const grey = await decode(session.tab, await session.pixels());
  let changed = 0;
  for (let i = 0; i < flat.data.length; i += 4) if (Math.abs(flat.data[i] - grey.data[i]) > 8) changed++;
  assert(changed > 5000, `the slice changes ${changed} pixels`);
  await session.close();
}

async function saved({ open }) {
  const session = await open("blender");
  await session.radio("By value").click();
  await session.settle(400);
  await session.key("s");
  const [download] = await Promise.all([session.tab.waitForEvent("download"), session.button("Save").click()]);
  const picture = await decode(session.tab, fs.readFileSync(await download.path()));
  const size = await session.size();
  assert.deepEqual([picture.width, picture.height], [2 * size.width, 2 * size.height]);
  await session.settle(300);
  const screen = await decode(session.tab, await session.pixels());
  // the same picture, but for what is drawn over it and for edges
  let [same, all] = [0, 0];
  for (let y = 70; y < size.height - 110; y += 7) {
    for (let x = 70; x < size.width - 110; x += 7) {
      const [a, b] = [4 * (y * size.width + x), 4 * (2 * y * picture.width + 2 * x)];
      const apart = Math.max(...[0, 1, 2].map((k) => Math.abs(screen.data[a + k] - picture.data[b + k])));
      if (apart <= 16) same++;
      all++;
    }
  }
  assert(same / all > 0.9, `${same} of ${all} points are the same`);
  await wholeBackground(session);
  await session.close();
}

// A picture that is drawn in several parts has one background: at its edges, where nothing else is, neither rows nor
// columns differ from those beside them by more than a step of the gradient.
async function wholeBackground(session) {
  await session.key("s");
  await session.tab.selectOption("#save select", "4");
  const [download] = await Promise.all([session.tab.waitForEvent("download"), session.button("Save").click()]);
  const { width, height, data } = await decode(session.tab, fs.readFileSync(await download.path()));
  assert(width > 1600 && height > 1600, `${width} x ${height} pixels`);
  const red = (x, y) => data[4 * (y * width + x)];
  for (let y = 1; y < height; y++) {
    assert(Math.abs(red(8, y) - red(8, y - 1)) <= 1, `row ${y} is ${red(8, y)}, the one above it ${red(8, y - 1)}`);
  }
  for (let x = 1; x < width; x++) {
    assert(Math.abs(red(x, 8) - red(x - 1, 8)) <= 1, `column ${x} is ${red(x, 8)}, the one before it ${red(x - 1, 8)}`);
  }
  assert(Math.abs(red(8, 0) - red(8, height - 1)) > 10, "there is no gradient");
}

// Blocks that are not wanted any more are given up; a small card keeps few, and that is told.
async function limits({ open, context, servers }) {
  const session = await open("blender", { options: ["--gpu-memory", "600KiB"] });
  const few = async () => {
    assert(await session.get("onCard") <= 600 << 10, `${await session.get("onCard")} bytes are on the card`);
    assert(await session.get("draws") < await session.get("visible"));
    const status = await session.tab.textContent("#status");
    assert(/stand as boxes/.test(status), status);
  };
  await few();
  for (const key of ["x", "Y", "Z"]) {
    await session.key(key);
    await few();
  }
  await session.close();
  const slow = await context.newPage();
  await slow.route(/\/tile\//, async (route) => {
    await nap(400);
    await route.continue().catch(() => {});
  });
  await slow.goto(servers.get("many").address);
  const get = (name) => slow.evaluate((n) => window.alvis?.[n], name);
  for (let i = 0; i < 200 && (await get("phase")) !== "loading"; i++) await nap(50);
  for (let i = 0; i < 60 && !(await get("aborted") > 0); i++) {
    await slow.keyboard.press(["+", "+", "x", "+", "Y", "z"][i % 6]);
    await nap(150);
  }
  assert(await get("aborted") > 0, "no request was given up");
  await slow.close();
}

// A server without a connection left is asked again.
async function busy({ context, servers }) {
  const tab = await context.newPage();
  const asked = new Map();
  await tab.route(/\/(tile|set\.json|tree\.bin)/, async (route) => {
    const url = route.request().url();
    asked.set(url, (asked.get(url) ?? 0) + 1);
    if (asked.get(url) < 3) await route.fulfill({ status: 503, contentType: "application/json", body: '{"error": "busy"}' });
    else await route.continue();
  });
  await tab.goto(servers.get("blender").address);
  const get = (name) => tab.evaluate((n) => window.alvis?.[n], name);
  for (let i = 0; i < 400 && (await get("phase")) !== "complete"; i++) await nap(50);
  assert.equal(await get("phase"), "complete");
  assert(asked.size > 20 && [...asked.values()].every((n) => n === 3), JSON.stringify([...asked]));
  assert.equal(await tab.locator(".message.bad").count(), 0);
  await tab.close();
}

// A set of thousands of blocks: one draw for each that is seen, and no more.
async function many({ open, at }) {
  const whole = manifestOf(at("many")).totals;
  assert(whole.tiles >= 10000, `${whole.tiles} blocks`);
  const first = await open("blender");
  const { camera } = await first.get("state");
  await first.close();
  const near = { ...camera, target: [0.3, 0.3, 0.3], distance: 1.2 };
  const session = await open("many", { fragment: `&${linkOf(near)}` });
  const [draws, visible] = [await session.get("draws"), await session.get("visible")];
  console.log(`   ${draws} of ${whole.tiles} blocks`);
  assert.equal(draws, visible);
  assert(draws > 50 && draws < whole.tiles / 2);
  await holdAgainstRays(session, raysOf(at, "blender"));
  await session.close();
}

async function noise({ open, at }) {
  const { totals } = manifestOf(at("noise"));
  const session = await open("noise");
  assert(await variance(session) > 100);
  assert.equal(await session.get("draws"), totals.tiles);
  assert.equal(await session.get("triangles"), totals.triangles);
  assert.equal(await session.get("things"), totals.cells);
  let found = 0;
  for (const [x, y] of points(await session.size())) if ((await session.pick(x, y))?.id > 0) found++;
  assert(found > 3, `${found} cells are picked`);
  await session.close();
}

async function troubles({ open, at, servers, context }) {
  const covered = () => !document.getElementById("cover").hidden && document.getElementById("cover").innerText;
  const message = () => document.querySelector(".message.bad")?.innerText;
  const empty = await open("empty", { settle: false });
  const told = await empty.until(() => window.alvis && !document.getElementById("cover").hidden && /surface/.test(document.getElementById("cover").innerText) && document.getElementById("cover").innerText);
  assert(/no surface/.test(told), told);
  await empty.close();
  const damaged = await open("damaged", { settle: false });
  const text = await damaged.until(message);
  assert(/y0001_x0001/.test(text), text);
  await damaged.settle();
  assert.equal(await damaged.get("draws"), 26);
  assert(/cannot be read/.test(await damaged.tab.textContent("#status")));
  await damaged.close();
  const changed = await open("changed");
  const file = path.join(at("changed"), "index.json");
  fs.writeFileSync(file, fs.readFileSync(file, "utf8").replace(/"threshold": [\d.]+/, "\"threshold\": 128"));
  const again = await open("changed", { settle: false });
  const said = await again.until(() => document.querySelector(".message.bad")?.innerText
    || (/changed|hange/.test(document.getElementById("cover").innerText) && document.getElementById("cover").innerText));
  assert(/changed/.test(said), said);
  await changed.close();
  await again.close();
  const tab = await context.newPage();
  await tab.goto(`${servers.get("blender").address.split("#")[0]}#${"0".repeat(32)}`);
  for (let i = 0; i < 60 && !/terminal|token|address/i.test(await tab.evaluate(covered) || ""); i++) await nap(50);
  assert(/terminal|token|address/i.test(await tab.evaluate(covered) || ""), await tab.evaluate(covered));
  await tab.close();
}

// Another size before the first picture is there: the same picture as when all of it had been.
async function resized({ open }) {
  const small = { width: 900, height: 560 };
  const late = await open("capped");
  await late.tab.setViewportSize(small);
  await late.settle(300);
  const link = (await late.get("link")).slice(33);
  const wanted = await late.pixels();
  await late.close();
  for (const wait of [0, 100, 300]) {
    const session = await open("capped", { fragment: link, settle: false });
    await nap(wait);
    await session.tab.setViewportSize(small);
    await session.settle(300);
    const found = await session.pixels();
    assert(wanted.equals(found), `the picture is another one where the size changed after ${wait} ms`);
    assert((await variance(session)) > 100, "the picture is empty");
    await session.close();
  }
}

async function lostCard({ open }) {
  const session = await open("blender");
  const before = await session.pixels();
  const lose = () => session.tab.evaluate(() => {
    window.lost = document.getElementById("picture").getContext("webgl2").getExtension("WEBGL_lose_context");
    window.lost.loseContext();
  });
  await lose();
  await session.until(() => /graphics card/.test(document.getElementById("messages").innerText));
  await session.tab.evaluate(() => window.lost.restoreContext());
  await session.until(() => document.querySelector(".message.bad") === null);
  await session.settle(300);
  assert(before.equals(await session.pixels()), "the picture is another one");
  await session.close();
}

/** [name, test]. */
export const PARTS = [
  ["first picture: not empty, draws, triangles, bytes", firstPicture],
  ["what is picked is what rays meet, in all forms", forms],
  ["what is picked is what rays meet, wherever one looks from", cameras],
  ["a second turn asks for nothing", turn],
  ["no back faces in a closed foam", backFaces],
  ["colours are those of alvis select", colours],
  ["what is left out is gone, and comes back", leaving],
  ["rows and picture are one", rowAndPicture],
  ["a link gives the same picture to the last bit", link],
  ["a section cuts what is drawn and picked, and shows the slice", section],
  ["a saved picture is the one on the screen", saved],
  ["thousands of blocks, of which those in view are drawn", many],
  ["a small card, and requests that are given up", limits],
  ["a server that is busy is asked again", busy],
  ["noise in merged tiles", noise],
  ["sets that are empty, damaged or changed, and a wrong address", troubles],
  ["a lost card comes back", lostCard],
  ["a window that changes its size while blocks come", resized],
];
