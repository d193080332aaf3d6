// Laws of the page's modules that need no browser.
import assert from "node:assert/strict";
import path from "node:path";
import { pathToFileURL } from "node:url";

/** Laws as [name, test]; the modules lie in a directory whose package.json says that they are modules. */
export async function laws(page) {
  const load = (name) => import(pathToFileURL(path.join(path.resolve(page), name)));
  const { command, condition, quoted } = await load("command.js");
  const { decode, encode, parts } = await load("link.js");
  const { number } = await load("format.js");
  const { axes, lens, neared, ray, turned } = await load("camera.js");
  const { fresh, State } = await load("state.js");
  const { standIns, Tree } = await load("tree.js");
  const { limitsOf } = await load("look.js");

  const SET = { dims: [257, 257, 257], macrocube: [64, 64, 64], spacing: [1, 1, 1], cap: false };
  const BOX = { low: [0, 0, 0], high: [256, 256, 256] };

  // A whole tree of levels 0 to 2 over 4 x 4 x 4 blocks, as /tree.bin has it.
  function words() {
    const nodes = [];
    for (const level of [2, 1, 0]) {
      const n = 4 >> level;
      for (let i = 0; i < n ** 3; i++) nodes.push({ level, x: i % n, y: Math.floor(i / n) % n, z: Math.floor(i / n / n) });
    }
    // children have to follow each other: order each level by parent
    const order = [nodes[0], ...nodes.filter((n) => n.level === 1)];
    for (const p of order.filter((n) => n.level === 1)) order.push(...nodes.filter((n) => n.level === 0 && [n.x >> 1, n.y >> 1, n.z >> 1].join() === [p.x, p.y, p.z].join()));
    const out = new Uint32Array(4 + 10 * order.length);
    const real = new Float32Array(out.buffer);
    out[2] = order.length;
    order.forEach((n, i) => {
      const at = 4 + 10 * i;
      out.set([n.level, n.x, n.y, n.z, 1000, 9000], at);
      real[at + 6] = [0, 0.5, 4][n.level];
      out.set(n.level === 2 ? [1, 8] : n.level === 1 ? [9 + 8 * (i - 1), 8] : [0, 0], at + 7);
      out[at + 9] = 1;
    });
    return out;
  }

  function view(camera, height = 800) {
    return Object.assign(lens({ ...fresh().camera, ...camera }, { width: height * 1.5, height, box: BOX, mirrored: false }), { spacing: [1, 1, 1] });
  }

  const near = (a, b, slack = 1e-9) => a.every((x, k) => Math.abs(x - b[k]) <= slack);

  return [
    ["a link keeps every bit", () => {
      const state = fresh();
      state.camera = { target: [0.1, 1 / 3, -2e-300], distance: Math.PI, azimuth: 1.1, elevation: -0.3, flat: true };
      state.rules.cells = [{ do: "leave", ids: [1, 2, 3, 9, 200000] }, { do: "paint", where: "volume > 0.1 and not (id == 4)", colour: "#e69f00" }];
      state.colour.cells = { by: "column", column: "volume", map: "magma", log: true, low: 0.1, high: null, count: 7 };
      state.clip = { on: true, axis: "free", normal: [0.6, 0, 0.8], at: 0.7, flip: true, slice: "none" };
      assert.deepEqual(decode(encode(state)), state);
    }],
    ["a bad link is no link, and brings nothing in", () => {
      for (const text of ["", "x", "e30", btoa("{\"v\":1}"), btoa("{\"v\":1,\"c\":[0,0,0,-1,0,0,0]}")]) assert.equal(decode(text), null, text);
      const evil = { v: 1, c: [0, 0, 0, 1, 0, 0, 0], k: "__proto__", o: { cells: { by: "x", column: "a b", map: "jet", count: -1 } },
        r: { cells: [{ do: "paint", ids: "1", colour: "url(x)" }, { do: "rm", ids: "1" }, { do: "mark", ids: "1+999999999" }] }, s: { axis: "w", normal: [0, 0, 0] } };
      assert.deepEqual({ ...decode(btoa(JSON.stringify(evil))), camera: 0 }, { ...fresh(), camera: 0 });
      assert.deepEqual(parts("#0123456789abcdef0123456789abcdef&abc"), { token: "0123456789abcdef0123456789abcdef", text: "abc" });
      assert.equal(parts("#zz").token, "");
    }],
    ["undo and redo give the same state", () => {
      const state = new State(fresh());
      const seen = [state.now];
      state.addRule({ do: "leave", ids: [1] });
      seen.push(state.now);
      state.setClip({ on: true });
      state.setClip({ at: 1 }, "drag");
      state.setClip({ at: 2 }, "drag");
      const last = state.now;
      state.undo();
      assert.equal(state.now.clip.at, 0);
      state.undo();
      assert.deepEqual(state.now, seen[1]);
      state.undo();
      assert.deepEqual(state.now, seen[0]);
      for (let i = 0; i < 5; i++) state.redo();
      assert.deepEqual(state.now, last);
    }],
    ["shells see one word", () => {
      assert.equal(quoted("a-b/c.d:1"), "a-b/c.d:1");
      assert.equal(quoted("it's $HOME"), "'it'\\''s $HOME'");
      assert.equal(condition({ ids: [1, 4, 5, 7, 8, 9] }), "id == 1 or id == 4 or id == 5 or (id >= 7 and id <= 9)");
      const state = fresh();
      state.rules.cells = [{ do: "leave", where: "touches_border" }, { do: "leave", ids: [3] }, { do: "paint", ids: [5], colour: "#e69f00" }];
      const scale = { by: "column", column: { name: "volume" }, map: "magma", low: 0.01, high: 1, log: true };
      assert.equal(command(state, "'my foam'", { scale, marked: new Set(), painted: new Map() }),
        "alvis select 'my foam' PART --where '(not (touches_border)) and not (id == 3)' --colour-by 'log10(volume)' --range=-2:0 --map magma --paint 'id == 5=#e69f00'");
    }],
    ["what a movement holds stays in its place", () => {
      const camera = { target: [10, 20, 30], distance: 50, azimuth: 0.3, elevation: 0.2, flat: false };
      const about = [14, 18, 33];
      const at = (c) => {
        const { eye, right, up, back } = axes(c);
        const off = about.map((x, k) => x - eye[k]);
        return [right, up, back].map((v) => v.reduce((s, x, k) => s + x * off[k], 0));
      };
      assert(near(at(camera), at(turned(camera, about, 0.4, 0.3))));
      const [a, b] = [at(camera), at(neared(camera, about, 0.5, 1e-3))];
      assert(near([a[0] / a[2], a[1] / a[2]], [b[0] / b[2], b[1] / b[2]]));
      const line = ray(view(camera), 0.5, 0.5);
      assert(near(line.along, axes(camera).back.map((x) => -x)));
    }],
    ["a part of a picture is that part", () => {
      for (const flat of [false, true]) {
        const camera = { target: [100, 100, 100], distance: 400, azimuth: 0.4, elevation: 0.5, flat };
        const make = (part) => lens(camera, { width: 600, height: 400, box: BOX, mirrored: false, part });
        const [whole, part] = [make([0, 0, 1, 1]), make([0.25, 0.5, 0.75, 1])];
        const clip = ({ rows, eye }, p) => {
          const q = [...p.map((x, k) => x - eye[k]), 1];
          const [x, y, , w] = rows.map((r) => r.reduce((s, a, k) => s + a * q[k], 0));
          return [x / w, y / w];
        };
        const [a, b] = [clip(whole, [120, 90, 60]), clip(part, [120, 90, 60])];
        assert(near([(a[0] + 1) / 2, (a[1] + 1) / 2], [0.25 + ((b[0] + 1) / 2) * 0.5, 0.5 + ((b[1] + 1) / 2) * 0.5]));
      }
    }],
    ["every cut of the tree covers what is in view once", () => {
      const tree = new Tree(words(), SET);
      assert.equal(tree.roots.length, 1);
      for (const [distance, triangles] of [[2000, 1e9], [400, 1e9], [100, 1e9], [100, 9000], [100, 30000], [100, 500]]) {
        const { wanted, left } = tree.cut(view({ target: [128, 128, 128], distance, azimuth: 0.7, elevation: 0.4 }), null, { triangles, bytes: 1e12 });
        assert.equal(left.length, 0);
        assert(wanted.length * 1000 <= Math.max(triangles, 1000), `${wanted.length} blocks`);
        const nodes = wanted.map((i) => i.node);
        for (const n of nodes) for (let p = n.parent; p; p = p.parent) assert(!nodes.includes(p));
        if (distance === 2000) assert.equal(nodes.length < 64, true);
        if (distance === 100 && triangles === 1e9) assert(nodes.some((n) => n.level === 0));
      }
    }],
    ["coarse blocks stand in, never beside their children, never a hole", () => {
      const tree = new Tree(words(), SET);
      const wanted = tree.leaves.map((node) => ({ node, near: 0 }));
      const [root] = tree.roots;
      assert.equal(standIns(wanted, () => false).bare.length, 64);
      assert.deepEqual(standIns(wanted, (n) => n === root).drawn, [root]);
      const some = (n) => n.level > 0 || n.x > 1;
      const { drawn, bare } = standIns(wanted, some);
      assert.equal(bare.length, 0);
      for (const leaf of tree.leaves) {
        let covers = 0;
        for (let n = leaf; n; n = n.parent) covers += drawn.includes(n) ? 1 : 0;
        assert.equal(covers, 1);
      }
      const inside = (n) => n.level === 0 || n === root;
      assert.equal(standIns(wanted.slice(0, 8), inside).drawn.length, 8);
    }],
    ["what is cut off is not in the cut", () => {
      const tree = new Tree(words(), SET);
      const { wanted } = tree.cut(view({ target: [128, 128, 128], distance: 100 }), { normal: [1, 0, 0], at: 64 }, { triangles: 1e9, bytes: 1e12 });
      assert(wanted.length > 0 && wanted.every((i) => i.node.low[0] < 64));
    }],
    ["scales have two ends, whatever the values", () => {
      for (const values of [[], [NaN, NaN, NaN], [5, 5, 5], [-1, 0, 3], [0, 0, 0]]) {
        for (const log of [false, true]) {
          const { low, high } = limitsOf(values, { log, low: null, high: null });
          assert(Number.isFinite(low) && Number.isFinite(high) && low < high && (!log || low > 0), `${values} ${log}: ${low} ${high}`);
        }
      }
      assert.deepEqual([0.1234567, 1e-7, 12345678, 3, NaN, 0.5].map((x) => number(x)), ["0.1235", "1e-7", "12345678", "3", "–", "0.5"]);
    }],
  ];
}
