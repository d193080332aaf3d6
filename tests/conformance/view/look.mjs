// What parts of the test have in common: points of the picture, what rays meet there, where the camera stands.
import assert from "node:assert/strict";
import { Rays, sight } from "./rays.mjs";
import { decode } from "./session.mjs";

// Points of the picture over all of it, in the middles of pixels.
export function points({ width, height }, across = 15, down = 9) {
  const out = [];
  for (let j = 1; j < down; j++) {
    for (let i = 1; i < across; i++) out.push([Math.round((i * width) / across), Math.round((j * height) / down)]);
  }
  return out;
}

const rays = new Map();

export function raysOf(at, name) {
  if (!rays.has(name)) rays.set(name, new Rays(at(name)));
  return rays.get(name);
}

/**
 * Holds what is picked at many pixels against rays. Where a pixel's corners see different things, rounding decides, and
 * nothing is said. Returns how many agreed.
 */
export async function holdAgainstRays(session, set, { cut = null, across, down } = {}) {
  const { camera, kind } = await session.get("state");
  const size = await session.size();
  let [agreed, empty] = [0, 0];
  for (const [x, y] of points(size, across, down)) {
    const seen = [[0.5, 0.5], [0.1, 0.1], [0.9, 0.1], [0.1, 0.9], [0.9, 0.9]].map(([u, v]) => set.first(sight(camera, size, x + u, y + v), cut));
    const name = (s) => (s === null ? "nothing" : `${s.ids[kind]} ${s.front}`);
    if (seen.some((s) => name(s) !== name(seen[0]))) continue;
    const found = await session.pick(x, y);
    const told = `pixel ${x}, ${y}: picked ${JSON.stringify(found)}, the ray meets ${JSON.stringify(seen[0])}`;
    if (seen[0] === null) {
      assert.equal(found, null, told);
      empty++;
      continue;
    }
    const expected = seen[0].front || kind === "objects" ? seen[0].ids[kind] : 0;
    assert(found !== null && found.id === expected && found.material === !seen[0].front, told);
    const far = Math.hypot(...found.place.map((p, k) => p - seen[0].place[k]));
    assert(far < 0.2, `${told}: ${far} apart`);
    agreed++;
  }
  assert(agreed + empty > 30, `${agreed} pixels agree, ${empty} are empty`);
  return agreed;
}

/**
 * The share of pixels at which what is picked is what rays meet in the exact tiles, though a coarser surface is drawn, that
 * may lie `slack` apart from them; of pixels beside which rays meet other things nothing is said. `part` is the share of the
 * picture around its middle in which pixels are taken.
 */
export async function shareOfRays(session, set, { cut = null, slack, part = 1 }) {
  const { camera, kind } = await session.get("state");
  const size = await session.size();
  const name = (s) => (s === null ? "nothing" : `${s.ids[kind]} ${s.front}`);
  let [agreed, all] = [0, 0];
  for (const at of points(size, 24, 16)) {
    const [x, y] = [size.width, size.height].map((n, k) => Math.round(n / 2 + part * (at[k] - n / 2)));
    const around = [[0, 0], [-2, -2], [2, -2], [-2, 2], [2, 2]];
    const seen = around.map(([u, v]) => set.first(sight(camera, size, x + 0.5 + u, y + 0.5 + v), cut));
    if (seen[0] === null || seen.some((s) => name(s) !== name(seen[0]))) continue;
    all++;
    const found = await session.pick(x, y);
    const expected = seen[0].front || kind === "objects" ? seen[0].ids[kind] : 0;
    if (found?.id !== expected || found.material !== !seen[0].front) continue;
    // a cut face hides how far behind it the surface is
    if (!seen[0].front || Math.hypot(...found.place.map((p, k) => p - seen[0].place[k])) < slack) agreed++;
  }
  assert(all > 25, `${all} pixels are compared`);
  return agreed / all;
}

export async function variance(session) {
  const { data } = await decode(session.tab, await session.pixels());
  let [sum, squares] = [0, 0];
  for (let i = 0; i < data.length; i += 4) {
    sum += data[i];
    squares += data[i] ** 2;
  }
  const n = data.length / 4;
  return squares / n - (sum / n) ** 2;
}

// Puts the link of a camera into the address.
export async function follow(session, camera) {
  const token = (await session.get("link")).slice(0, 33);
  await session.tab.evaluate((link) => {
    location.hash = link;
  }, `${token}&${linkOf(camera)}`);
  await session.settle(200);
}

export function linkOf(c) {
  const brief = { v: 1, c: [...c.target, c.distance, c.azimuth, c.elevation, 0] };
  return Buffer.from(JSON.stringify(brief)).toString("base64url");
}
