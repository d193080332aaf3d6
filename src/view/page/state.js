// What one sees, as one value: camera, colours, what is left out, marked and painted, the section. All that changes
// it goes through `State`, which remembers what was before. Nothing else of the page has to be kept in a link.

export const KINDS = ["cells", "objects", "surfaces"];
export const COLOURINGS = ["plain", "column", "best"];
export const RULES = ["leave", "only", "show", "mark", "unmark", "paint", "unpaint"];
export const AXES = ["x", "y", "z", "free"];

const each = (make) => Object.fromEntries(KINDS.map((k) => [k, make(k)]));

export function fresh() {
  return {
    camera: { target: [0, 0, 0], distance: 1, azimuth: -1.05, elevation: 0.5, flat: false },
    kind: "cells",
    colour: each(() => ({ by: "plain", column: "", map: "viridis", log: false, low: null, high: null, count: 100 })),
    rules: each(() => []),
    // `at` is how far the plane lies along its normal; what is beyond it is cut off
    clip: { on: false, axis: "z", normal: [0, 0, 1], at: 0, flip: false, slice: "none" },
  };
}

const UNDONE = ["kind", "colour", "rules", "clip"];

export class State {
  constructor(start) {
    this.now = start;
    this.past = [];
    this.future = [];
    this.listeners = [];
    this.open = null;
  }

  /** Calls `listener(now, before)` after each change. */
  onChange(listener) {
    this.listeners.push(listener);
  }

  /**
   * Replaces members. Changes of anything but the camera can be undone; those with the same `gesture` (a slider that
   * is being dragged) are undone together.
   */
  set(members, gesture = null) {
    const before = this.now;
    this.now = { ...before, ...members };
    if (UNDONE.some((k) => this.now[k] !== before[k])) {
      if (gesture === null || gesture !== this.open) this.past.push(before);
      if (this.past.length > 500) this.past.shift();
      this.future = [];
      this.open = gesture;
    }
    this.tell(before);
  }

  /** The next change is one of its own, whatever its gesture. */
  close() {
    this.open = null;
  }

  setColour(members, gesture) {
    const { kind, colour } = this.now;
    this.set({ colour: { ...colour, [kind]: { ...colour[kind], ...members } } }, gesture);
  }

  setClip(members, gesture) {
    this.set({ clip: { ...this.now.clip, ...members } }, gesture);
  }

  addRule(rule) {
    const { kind, rules } = this.now;
    this.set({ rules: { ...rules, [kind]: [...rules[kind], rule] } });
  }

  /** Everything is shown again; marks and colours stay. */
  showAll() {
    this.keepRules((r) => !["leave", "only", "show"].includes(r.do));
  }

  keepRules(keep) {
    const { kind, rules } = this.now;
    if (rules[kind].every(keep)) return;
    this.set({ rules: { ...rules, [kind]: rules[kind].filter(keep) } });
  }

  undo() {
    this.step(this.past, this.future);
  }

  redo() {
    this.step(this.future, this.past);
  }

  step(from, to) {
    if (from.length === 0) return;
    const before = this.now;
    const then = from.pop();
    to.push(before);
    this.now = { ...before, ...Object.fromEntries(UNDONE.map((k) => [k, then[k]])) };
    this.open = null;
    this.tell(before);
  }

  /** Another state as a whole, as a link has it. */
  restore(state) {
    this.set(state);
  }

  tell(before) {
    for (const listener of this.listeners) listener(this.now, before);
  }
}
