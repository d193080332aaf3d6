// From the state to what the graphics card needs: a colour and a state for each id; and to what people read of it.
import { BEST, EMPTY, MARK, WORST, mapped, rgb } from "./colours.js";
import { TABLE_WIDTH } from "./shaders.js";
import { quantile } from "./things.js";

export const SHOWN = 1;
export const CHOSEN = 2;

const PLAIN = [201, 196, 186];

export class Look {
  constructor(things, server) {
    Object.assign(this, { things, server });
    this.answers = new Map();
  }

  // Ids that the server answers with, which are kept.
  ask(kind, asked) {
    const key = JSON.stringify([kind, asked]);
    if (!this.answers.has(key)) {
      const answer = this.server.query(kind, asked);
      answer.catch(() => this.answers.delete(key));
      this.answers.set(key, answer);
    }
    return this.answers.get(key);
  }

  /** Ids for which a condition of `alvis cells` holds. */
  where(kind, expression) {
    return this.ask(kind, { where: expression });
  }

  /** Ids from the best form factor to the worst. */
  ranked(kind) {
    return this.ask(kind, { where: "not missing(form_factor)", sort: "form_factor", descending: true });
  }

  ids(kind, rule) {
    return rule.ids ?? this.where(kind, rule.where);
  }

  /** The card's table before ids are known, where all things look the same: they have the first entry. Else null. */
  plain({ kind, colour, rules }) {
    if (colour[kind].by !== "plain" || rules[kind].length > 0) return null;
    const bytes = new Uint8Array(4 * TABLE_WIDTH);
    bytes.set([...PLAIN, SHOWN]);
    return bytes;
  }

  /**
   * What the state shows of its kind: `bytes` for the card, `shown` (how many), `marked` and `hidden` (sets of ids),
   * `painted` (colours by id), `solid` (nothing is left out), `all` (nor what belongs to no thing), `scale` for the legend.
   */
  async make(state) {
    const { kind } = state;
    const ids = await this.things.ids(kind);
    const rules = state.rules[kind];
    const lists = await Promise.all(rules.map((r) => this.ids(kind, r)));
    const largest = ids.length > 0 ? ids[ids.length - 1] : 0;
    const bytes = new Uint8Array(4 * TABLE_WIDTH * Math.ceil((largest + 1) / TABLE_WIDTH));
    const hidden = hiddenBy(rules, lists, ids);
    const { marked, painted } = brushed(rules, lists);
    const put = (id, [r, g, b]) => {
      bytes[4 * id] = r;
      bytes[4 * id + 1] = g;
      bytes[4 * id + 2] = b;
    };
    const scale = await this.colour(state, ids, hidden, put);
    for (const [id, colour] of painted) put(id, rgb(colour));
    for (const id of marked) put(id, MARK.rgb);
    let shown = 0;
    for (const id of ids) {
      if (hidden.has(id)) continue;
      bytes[4 * id + 3] = SHOWN;
      shown++;
    }
    // what belongs to no thing, as the caps of a cut body: it stays unless one asked for some things only
    put(0, EMPTY);
    bytes[3] = rules.some((r) => r.do === "only") ? 0 : SHOWN;
    const all = shown === ids.length && bytes[3] === SHOWN;
    return { kind, bytes, shown, hidden, marked, painted, solid: hidden.size === 0, all, scale };
  }

  async colour(state, ids, hidden, put) {
    const { kind } = state;
    const asked = state.colour[kind];
    if (asked.by === "best" && this.things.column(kind, "form_factor")) {
      const order = (await this.ranked(kind)).filter((id) => !hidden.has(id));
      const values = await this.things.values(kind, "form_factor");
      for (const id of ids) put(id, EMPTY);
      // of a few things the better half is best, the other half worst
      const n = Math.min(asked.count, order.length >> 1);
      for (const id of order.subarray(0, n)) put(id, BEST.rgb);
      for (const id of order.subarray(order.length - n)) put(id, WORST.rgb);
      const [best, worst] = [n - 1, order.length - n].map((i) => (n > 0 ? values[this.things.row(kind, order[i])] : NaN));
      return { by: "best", count: n, ranked: order.length, best, worst };
    }
    const column = this.things.column(kind, asked.column);
    if (asked.by !== "column" || !column) {
      for (const id of ids) put(id, PLAIN);
      return null;
    }
    const values = await this.things.values(kind, column.name);
    const limits = limitsOf(await this.things.sorted(kind, column.name), asked);
    const share = shares(limits);
    for (let i = 0; i < ids.length; i++) {
      put(ids[i], Number.isNaN(values[i]) ? EMPTY : mapped(asked.map, share(values[i])));
    }
    return { by: "column", column, map: asked.map, ...limits };
  }
}

// Rules in their order: each leaves out, shows again, or shows nothing but its things.
function hiddenBy(rules, lists, ids) {
  let hidden = new Set();
  rules.forEach((r, i) => {
    if (r.do === "leave") for (const id of lists[i]) hidden.add(id);
    if (r.do === "show") for (const id of lists[i]) hidden.delete(id);
    if (r.do === "only") {
      hidden = new Set(ids);
      for (const id of lists[i]) hidden.delete(id);
    }
  });
  return hidden;
}

// What is marked, and colours by id. What was painted later covers what was earlier.
function brushed(rules, lists) {
  const marked = new Set();
  const painted = new Map();
  rules.forEach((r, i) => {
    for (const id of lists[i]) {
      if (r.do === "mark") marked.add(id);
      if (r.do === "unmark") marked.delete(id);
      if (r.do === "paint") painted.set(id, r.colour);
      if (r.do === "unpaint") painted.delete(id);
    }
  });
  return { marked, painted };
}

/**
 * The ends of a scale of rising values: those asked for, else the values that 2 % lie below and above, so that one large
 * thing does not take all of it. What is left out counts as well, so that colours stay. Without values: 0 to 1.
 */
export function limitsOf(sorted, { log, low, high }) {
  const positive = sorted.findIndex((v) => v > 0);
  const used = !log ? sorted : positive < 0 ? [] : sorted.subarray(positive);
  const at = (share) => quantile(used, share);
  const few = used.length < 50;
  let ends = [low ?? at(few ? 0 : 0.02), high ?? at(few ? 1 : 0.98)];
  if (!ends.every(Number.isFinite)) ends = log ? [1, 10] : [0, 1];
  if (log) ends = ends.map((x) => (x > 0 ? x : at(0) || 1e-6));
  if (ends[0] === ends[1]) ends = log ? [ends[0] / 2, ends[1] * 2] : [ends[0] - 0.5, ends[1] + 0.5];
  return { low: ends[0], high: ends[1], log, least: at(0), most: at(1) };
}

/** The colour of a bar of values as the scale of a look has it, of the best if one of them is in it; null without a scale. */
export function barColour(scale) {
  if (scale?.by === "best") return (least, _, largest) => (largest >= scale.best ? BEST.rgb : least <= scale.worst ? WORST.rgb : EMPTY);
  if (scale?.by !== "column") return null;
  const share = shares(scale);
  return (_, middle) => mapped(scale.map, share(middle));
}

/** The share of a value between the ends, which may be turned round. */
export function shares({ low, high, log }) {
  const f = log ? (x) => Math.log(Math.max(x, Number.MIN_VALUE)) : (x) => x;
  const [a, b] = [f(low), f(high)];
  return (x) => (f(x) - a) / (b - a);
}
