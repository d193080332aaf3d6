// What is asked of sets with levels of detail: far away blocks of coarser levels stand for the tiles, and show the same.
import assert from "node:assert/strict";
import fs from "node:fs";
import path from "node:path";
import { follow, linkOf, raysOf, shareOfRays } from "./look.mjs";
import { decode } from "./session.mjs";
import { manifestOf, middles } from "./set.mjs";

const VOXEL = 0.05;

function levelsOf(set) {
  return JSON.parse(fs.readFileSync(path.join(set, "lod/index.json"), "utf8")).levels;
}

// From afar few triangles are drawn, and what is picked is what rays meet in the exact tiles; from near the tiles are.
async function distances({ open, at }) {
  const { totals } = manifestOf(at("levels"));
  const levels = levelsOf(at("levels"));
  const session = await open("levels");
  const { camera } = await session.get("state");
  const set = raysOf(at, "blender");
  let before = 0;
  for (const [share, most] of [[30, levels.at(-1).triangles * 1.2], [3, totals.triangles * 0.2], [0.9, totals.triangles * 0.9]]) {
    await follow(session, { ...camera, distance: camera.distance * share });
    const triangles = await session.get("triangles");
    console.log(`   at ${share} of the distance: ${await session.get("draws")} blocks, ${triangles} triangles`);
    assert(triangles > before && triangles <= most, `${triangles} triangles, at most ${most}`);
    assert.equal(await session.get("draws"), await session.get("visible"));
    before = triangles;
    if (share > 3) continue;
    const agreed = await shareOfRays(session, set, { slack: 2 * VOXEL, part: 0.8 / share });
    assert(agreed > 0.97, `${agreed} of the pixels agree`);
  }
  // and from inside a cell
  const [target] = middles(at("blender"), 1);
  await follow(session, { target, distance: 0.02, azimuth: 1, elevation: 0.3 });
  assert.equal(await shareOfRays(session, set, { slack: 0.2 * VOXEL }), 1);
  await session.close();
}

// A first picture of all takes the coarsest block, which is asked for first; a second turn asks for nothing.
async function order({ context, servers, open, at }) {
  await (await open("levels")).close();
  const asked = [];
  const tab = await context.newPage();
  tab.on("request", (r) => r.url().includes("/tile/") && asked.push(new URL(r.url()).pathname));
  await tab.goto(servers.get("levels").address);
  for (let i = 0; i < 200 && (await tab.evaluate(() => window.alvis?.phase)) !== "complete"; i++) await new Promise((r) => setTimeout(r, 50));
  const top = levelsOf(at("levels")).at(-1);
  assert.equal(asked[0], `/tile/${top.level}/0/0/0`);
  assert.equal(new Set(asked).size, asked.length, "a block is asked for twice");
  await tab.close();
  const session = await open("levels");
  const { camera } = await session.get("state");
  const round = async () => {
    for (let i = 0; i < 6; i++) await follow(session, { ...camera, distance: camera.distance / 2.5, azimuth: camera.azimuth + (i * Math.PI) / 3 });
    return session.get("requests");
  };
  const first = await round();
  assert.equal(await round(), first, "the second turn asks for blocks again");
  await session.close();
}

// Sections, colours and what is left out are those of the tiles.
async function same({ open, at }) {
  const pictures = [];
  for (const name of ["blender", "levels"]) {
    const session = await open(name);
    const { camera } = await session.get("state");
    await follow(session, { ...camera, distance: 2.5 * camera.distance });
    await session.radio("By value").click();
    await session.settle(400);
    const taken = [await decode(session.tab, await session.pixels())];
    await session.key("c");
    taken.push(await decode(session.tab, await session.pixels()));
    if (name === "levels") {
      const { clip } = await session.get("state");
      const s = clip.flip ? -1 : 1;
      const cut = { normal: clip.normal.map((n) => s * n), at: s * clip.at };
      const agreed = await shareOfRays(session, raysOf(at, "blender"), { cut, slack: 2 * VOXEL, part: 0.3 });
      assert(agreed > 0.97, `${agreed} of the pixels agree in the section`);
    }
    await session.chooseWhere("touches_border");
    await session.key("h", 400);
    taken.push(await decode(session.tab, await session.pixels()));
    pictures.push({ taken, things: await session.get("things"), triangles: await session.get("triangles") });
    await session.close();
  }
  const [exact, coarse] = pictures;
  assert(coarse.triangles < exact.triangles / 2);
  assert.equal(coarse.things, exact.things);
  exact.taken.forEach(({ data }, n) => {
    let far = 0;
    for (let i = 0; i < data.length; i += 4) {
      if ([0, 1, 2].some((k) => Math.abs(data[i + k] - coarse.taken[n].data[i + k]) > 40)) far++;
    }
    assert(far / (data.length / 4) < 0.02, `picture ${n}: ${far} of ${data.length / 4} pixels are others`);
  });
}

// Where there is not room for all, coarse blocks stand in, and nothing stands as a box.
async function room({ open, at }) {
  const session = await open("levels", { options: ["--gpu-memory", "600KiB"] });
  assert(await session.get("onCard") <= 600 << 10, `${await session.get("onCard")} bytes are on the card`);
  assert.equal(await session.get("draws"), await session.get("visible"), await session.tab.textContent("#status"));
  assert(!/stand as boxes/.test(await session.tab.textContent("#status")));
  await session.close();
  const { totals } = manifestOf(at("levels"));
  const far = await open("levels", { fragment: `&${linkOf({ target: [2.4, 2.4, 2.4], distance: 60, azimuth: 1, elevation: 0.4 })}` });
  assert(await far.get("bytes") < 3 * totals.triangles, `${await far.get("bytes")} bytes for a picture from afar`);
  await far.close();
}

/** [name, test]. */
export const LEVELS = [
  ["levels: coarse from afar, exact from near, picked as rays meet", distances],
  ["levels: the coarsest block comes first, and nothing twice", order],
  ["levels: sections, colours and what is left out are those of the tiles", same],
  ["levels: where there is little room, coarse blocks stand in", room],
];
