// Decides what is drawn when. While the camera moves, a picture has to be there at once: only what fits a budget that
// the time of a frame steers. 100 ms after the last movement the rest is added, nearest first, until all that is in
// the view is there or the limit is reached. (Interactive and completion phase of the original system.)
import { boxOf, lens, pixel } from "./camera.js";
import { inView, standIns } from "./tree.js";
import { clamp, dot, scale } from "./vector.js";

const REST = 100;
/** Triangles that are drawn at most, and when the camera moves for the first time. */
export const MOST = 8e6;
const AT_FIRST = MOST / 4;
const LEAST = 2e5;
/** Milliseconds for which fine blocks are collected. */
const TOGETHER = 300;
/** Milliseconds between two pictures while blocks come, at least and at most. */
const BETWEEN = 150;
const LONGEST = 1500;
/** Blocks that stand as boxes, at most. */
const BOXES = 600;

/** The plane of a section, facing away from what stays; null for none. */
export function clipOf({ on, flip, normal, at }) {
  if (!on) return null;
  const s = flip ? -1 : 1;
  return { normal: scale(normal, s), at: s * at };
}

/** What drawing a picture of a size needs; `part` is the share of it to draw. */
export function viewOf(camera, set, [width, height], part) {
  const view = lens(camera, { width, height, box: boxOf(set), mirrored: set.mirrored, part });
  return Object.assign(view, { spacing: set.spacing });
}

export class Director {
  /** `drawn(view, moving)` is called for each picture; `known()` tells whether it is known what is shown. */
  constructor({ picture, tree, blocks, state, set, drawn, known }) {
    Object.assign(this, { picture, tree, blocks, state, set, drawn, known });
    this.moving = { triangles: AT_FIRST, bytes: blocks.limit };
    this.most = { triangles: MOST, bytes: blocks.limit };
    this.phase = "waiting";
    this.lastInput = -Infinity;
    this.lastFrame = 0;
    this.started = 0;
    this.opened = performance.now();
    this.lit = null;
    this.shown = new Set();
    this.stale = true;
    this.asked = false;
    this.alarmAt = Infinity;
    this.ready = new Promise((resolve) => {
      this.resolveReady = resolve;
    });
    this.seen = { wanted: [], left: [], bare: [] };
  }

  /** The camera moved, by hand or in flight. */
  moved() {
    this.lastInput = performance.now();
    this.renew();
  }

  /** The card has lost everything. */
  forget() {
    this.shown = new Set();
    this.lit = null;
    this.renew();
  }

  /** Blocks have to be drawn anew: another view, section, kind, or something is left out. */
  renew() {
    this.stale = true;
    this.redraw();
  }

  /** The picture has to be lit anew, or blocks have come. */
  redraw() {
    if (this.asked) return;
    this.asked = true;
    if (this.phase === "complete") this.phase = "drawing";
    requestAnimationFrame((time) => {
      this.asked = false;
      this.frame(time);
    });
  }

  clip() {
    return clipOf(this.state.now.clip);
  }

  view() {
    return viewOf(this.state.now.camera, this.set, this.picture.size);
  }

  // After so many milliseconds, unless it is to be sooner.
  wake(after) {
    const at = performance.now() + Math.max(after, 0) + 1;
    if (at >= this.alarmAt) return;
    clearTimeout(this.alarm);
    this.alarmAt = at;
    this.alarm = setTimeout(() => {
      this.alarmAt = Infinity;
      this.redraw();
    }, at - performance.now());
  }

  frame(time) {
    const { picture, blocks } = this;
    if (picture.gl.isContextLost() || !picture.table.texture) return;
    if (picture.fit()) this.stale = true;
    const moving = performance.now() - this.lastInput < REST;
    if (moving && this.phase === "moving") this.steer(time - this.lastFrame);
    this.lastFrame = time;
    const view = this.view();
    const clip = this.clip();
    const sight = this.tree.sight(view, clip);
    const full = this.tree.cut(sight, this.most);
    const now = moving ? this.tree.cut(sight, this.moving) : full;
    this.request(now.wanted, full.wanted);
    const { drawn, bare } = standIns(now.wanted, (n) => blocks.has(n));
    this.seen = { wanted: now.wanted, left: now.left, bare };
    const more = this.add(drawn, view, clip, moving);
    blocks.touch(this.shown);
    blocks.tidy();
    this.phase = moving ? "moving" : more ? "drawing" : this.pending() ? "loading" : "complete";
    const partial = this.phase === "loading" || this.phase === "drawing";
    const wait = partial ? this.untilLit() : 0;
    if (wait <= 0) {
      this.drawn(view, moving);
      this.lit = { at: performance.now(), blocks: this.shown.size, fence: partial ? picture.fence() : null, took: 0 };
    } else this.wake(wait);
    if (more) this.redraw();
    else if (moving) this.wake(REST - (performance.now() - this.lastInput));
    if (this.phase === "complete") this.resolveReady();
  }

  // Milliseconds until a picture is worth showing while blocks come: lighting each one takes as long as drawing a block.
  untilLit() {
    const now = performance.now();
    const { lit } = this;
    if (this.shown.size > 0 && !lit?.blocks) return 0;
    if (!lit) return this.opened + BETWEEN - now;
    if (lit.fence) {
      if (!this.picture.passed(lit.fence)) return REST / 2;
      lit.fence = null;
      lit.took = now - lit.at;
    }
    return lit.at + clamp(4 * lit.took, BETWEEN, LONGEST) - now;
  }

  pending() {
    return !this.known() || this.seen.bare.some((i) => !i.node.refused) || this.blocks.waiting > 0;
  }

  // What is missing is asked for in the order of nearness; where nothing stands in for it, the coarsest comes first.
  request(now, full) {
    const order = [];
    for (const { node } of now) {
      if (this.blocks.has(node)) continue;
      let top = node;
      while (top.parent && !this.blocks.has(top.parent)) top = top.parent;
      if (top !== node && top.parent === null) order.push(top);
      order.push(node);
    }
    this.blocks.want([...new Set(order)], new Set(full.map((i) => i.node)));
  }

  // Adds what is not there yet, a part of it if it is much. True if more is to come.
  add(drawn, view, clip, moving) {
    const { picture, state } = this;
    const keep = new Set(drawn);
    const replaced = [...this.shown].some((n) => !keep.has(n) || !n.card);
    // fine blocks take the place of coarse ones all together, not each with a picture of its own
    if (replaced && !this.stale && !moving && this.pending() && performance.now() - this.started < TOGETHER) {
      this.wake(TOGETHER);
      return false;
    }
    if (this.stale || replaced) {
      picture.start(view, clip, state.now.kind);
      this.shown = new Set();
      this.stale = false;
      this.started = performance.now();
    }
    const fresh = drawn.filter((n) => !this.shown.has(n));
    const part = [];
    let triangles = 0;
    for (const n of fresh) {
      if (part.length > 0 && triangles + n.card.triangles > this.moving.triangles && !moving) break;
      part.push(n);
      triangles += n.card.triangles;
    }
    if (part.length > 0) picture.add(part);
    for (const n of part) this.shown.add(n);
    return part.length < fresh.length;
  }

  // Frames that take long make the budget of the next smaller.
  steer(took) {
    if (took > 33) this.moving.triangles = Math.max(this.moving.triangles * 0.8, LEAST);
    else if (took < 20) this.moving.triangles = Math.min(this.moving.triangles * 1.1, MOST);
  }

  /** Blocks of the view that are not drawn, as boxes, nearest first. */
  missing() {
    return [...this.seen.bare, ...this.seen.left].slice(0, BOXES).map((i) => i.node);
  }

  /** What stands in the status line. */
  told() {
    const { wanted, left, bare } = this.seen;
    const sum = (list) => list.reduce((s, i) => s + i.node.triangles, 0);
    return {
      phase: this.phase,
      blocks: this.shown.size,
      coarse: [...this.shown].filter((n) => n.level > 0).length,
      waiting: bare.filter((i) => !i.node.refused).length,
      refused: bare.filter((i) => i.node.refused).length,
      drawn: this.picture.counts.triangles,
      inView: sum(wanted) + sum(left),
      left: left.length,
      visible: wanted.length + left.length,
    };
  }

  /** All blocks of the whole view that are there, for a picture to keep. */
  complete(view, clip) {
    const { wanted } = this.tree.cut(this.tree.sight(view, clip), this.most);
    return standIns(wanted, (n) => this.blocks.has(n)).drawn.filter((n) => inView(n, view, clip));
  }

  /** Whether the eye is within the volume, in the part of it that is not cut off. */
  inside() {
    const { camera, eye } = this.view();
    const { low, high } = boxOf(this.set);
    const clip = this.clip();
    const kept = !clip || dot(clip.normal, eye) < clip.at;
    return kept && !camera.flat && eye.every((x, k) => x > low[k] && x < high[k]);
  }

  /** Length of a pixel where the camera looks. */
  pixel() {
    return pixel(this.view(), this.state.now.camera.distance);
  }
}
