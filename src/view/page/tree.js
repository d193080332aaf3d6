// The blocks of the set, coarse ones above fine ones where there are levels, and which of them a view needs.
import { pixel } from "./camera.js";
import { dot, mix, scale, sub } from "./vector.js";

/** Bytes of a triangle on the card, where a block does not tell its own. */
const BYTES = 9;

export class Tree {
  /** `words` is /tree.bin; `set` is /set.json. */
  constructor(words, set) {
    const count = words[2];
    const real = new Float32Array(words.buffer);
    this.nodes = [];
    const kin = [];
    for (let i = 0; i < count; i++) {
      const at = 4 + 10 * i;
      const node = {
        index: i,
        level: words[at] & 255,
        x: words[at + 1], y: words[at + 2], z: words[at + 3],
        triangles: words[at + 4],
        bytes: words[at + 5] || BYTES * words[at + 4],
        error: real[at + 6],
        children: [],
        parent: null,
        content: (words[at + 9] & 1) === 1,
      };
      Object.assign(node, this.box(node, set));
      this.nodes.push(node);
      kin.push({ first: words[at + 7], count: words[at + 8] });
    }
    for (const node of this.nodes) {
      const { first, count: children } = kin[node.index];
      node.children = this.nodes.slice(first, first + children);
      for (const c of node.children) c.parent = node;
    }
    this.roots = this.nodes.filter((n) => n.parent === null);
  }

  // Lengths along the axes of what lies in a block; a cap lies half a voxel outside of the grid.
  box(node, { dims, macrocube, spacing, cap }) {
    const out = cap ? 0.5 : 0;
    const low = [];
    const high = [];
    [node.x, node.y, node.z].forEach((n, k) => {
      const size = macrocube[k] * 2 ** node.level;
      const [a, b] = [n * size, Math.min((n + 1) * size, dims[k] - 1)];
      low.push((a - (n === 0 ? out : 0)) * spacing[k]);
      high.push((b + (b === dims[k] - 1 ? out : 0)) * spacing[k]);
    });
    return { low, high };
  }

  /** What a view sees of the coarsest blocks, whatever the limits: {view, clip, seen}, nearest first. */
  sight(view, clip) {
    const seen = this.roots.filter((n) => n.content && inView(n, view, clip)).map((n) => placed(n, view));
    return { view, clip, seen: seen.sort(nearer) };
  }

  /**
   * The blocks that a sight wants, nearest first, within limits of triangles and bytes: [{node, near}]. Where there are
   * levels, the block with the largest error in pixels makes way for its children as long as they fit; `left` is what
   * is in the view and does not fit at any level.
   */
  cut({ view, clip, seen }, { triangles, bytes }) {
    const wanted = new Map();
    const left = [];
    const room = { triangles, bytes };
    for (const item of seen) {
      // the nearest is drawn however large it is
      if (wanted.size > 0 && !fits(item.node, room)) left.push(item);
      else {
        take(item.node, room);
        wanted.set(item.node, item);
      }
    }
    const refined = this.refine(wanted, view, clip, room);
    return { wanted: refined ? [...wanted.values()].sort(nearer) : [...wanted.values()], left };
  }

  // True if anything was.
  refine(wanted, view, clip, room) {
    let refined = false;
    const rough = (i) => i.node.children.length > 0 && i.pixels > 1;
    const heap = [...wanted.values()].filter(rough);
    const worst = () => {
      let best = -1;
      heap.forEach((h, k) => {
        if (best < 0 || h.pixels > heap[best].pixels) best = k;
      });
      return heap.splice(best, 1)[0];
    };
    while (heap.length > 0) {
      const item = worst();
      const children = item.node.children.filter((c) => c.content && inView(c, view, clip));
      const more = children.reduce((s, c) => s + c.triangles, 0) - item.node.triangles;
      // the coarsest stays on the card
      const bytes = children.reduce((s, c) => s + c.bytes, 0) - (item.node.parent ? item.node.bytes : 0);
      if (more > room.triangles || bytes > room.bytes) continue;
      room.triangles -= more;
      room.bytes -= bytes;
      wanted.delete(item.node);
      refined = true;
      for (const c of children) {
        const next = placed(c, view);
        wanted.set(c, next);
        if (rough(next)) heap.push(next);
      }
    }
    return refined;
  }
}

/**
 * What is drawn of what is wanted: where a block is not there yet, the nearest coarser one that is, in place of all
 * that it covers. Never both, never a hole if any is there. `bare` are those for which there is nothing.
 */
export function standIns(wanted, isThere) {
  const chosen = new Map();
  const bare = [];
  for (const item of wanted) {
    let node = item.node;
    while (node && !isThere(node)) node = node.parent;
    if (node) chosen.set(node, item);
    else bare.push(item);
  }
  const covered = (node) => {
    for (let n = node.parent; n; n = n.parent) if (chosen.has(n)) return true;
    return false;
  };
  return { drawn: [...chosen.keys()].filter((n) => !covered(n)), bare };
}

const nearer = (a, b) => a.near - b.near || a.middle - b.middle || a.node.index - b.node.index;

function fits(node, room) {
  return node.triangles <= room.triangles && node.bytes <= room.bytes;
}

function take(node, room) {
  room.triangles -= node.triangles;
  room.bytes -= node.bytes;
}

// How far a block is from the eye, or from the plane through it, and how large its error shows.
function placed(node, view) {
  const off = sub(mix(node.low, node.high, 0.5), view.eye);
  const reach = scale(sub(node.high, node.low), 0.5);
  const middle = view.camera.flat ? -dot(off, view.back) : Math.hypot(...off);
  const near = view.camera.flat
    ? middle - reach.reduce((s, r, k) => s + r * Math.abs(view.back[k]), 0)
    : Math.hypot(...off.map((x, k) => Math.max(Math.abs(x) - reach[k], 0)));
  const step = Math.max(...view.spacing);
  return { node, near, middle, pixels: (node.error * step) / pixel(view, Math.max(near, view.near)) };
}

/** Whether a box shows in the picture at all: it is in the frustum, and not all of it is cut off. */
export function inView({ low, high }, view, clip) {
  for (const [a, b, c, d] of view.planes) {
    const x = (a > 0 ? high[0] : low[0]) - view.eye[0];
    const y = (b > 0 ? high[1] : low[1]) - view.eye[1];
    const z = (c > 0 ? high[2] : low[2]) - view.eye[2];
    if (a * x + b * y + c * z + d < 0) return false;
  }
  if (!clip) return true;
  const least = [0, 1, 2].reduce((s, k) => s + clip.normal[k] * (clip.normal[k] > 0 ? low[k] : high[k]), 0);
  return least < clip.at;
}
