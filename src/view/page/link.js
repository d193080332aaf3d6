// The state as text for the fragment of the address, `#TOKEN&STATE`, and back. Numbers keep all their bits. A link may
// come from anywhere, so each member is checked, and what is not as expected keeps its default.
import { MAP_NAMES, isColour } from "./colours.js";
import { AXES, COLOURINGS, KINDS, RULES, fresh } from "./state.js";

/** Token and state text of a fragment. */
export function parts(fragment) {
  const [token, ...rest] = fragment.replace(/^#/, "").split("&");
  return { token: /^[0-9a-f]{32}$/.test(token) ? token : "", text: rest.join("&") };
}

/** URL-safe text of a state. */
export function encode(state) {
  const { camera: c, clip, kind } = state;
  const brief = {
    v: 1,
    c: [...c.target, c.distance, c.azimuth, c.elevation, c.flat ? 1 : 0],
    k: kind,
    o: state.colour,
    r: Object.fromEntries(KINDS.filter((k) => state.rules[k].length > 0).map((k) => [k, state.rules[k].map(packed)])),
    s: clip,
  };
  const bytes = new TextEncoder().encode(JSON.stringify(brief));
  let text = "";
  for (const b of bytes) text += String.fromCharCode(b);
  return btoa(text).replaceAll("+", "-").replaceAll("/", "_").replace(/=+$/, "");
}

/** The state of a text; null if it is none. */
export function decode(text) {
  let brief;
  try {
    const bytes = Uint8Array.from(atob(text.replaceAll("-", "+").replaceAll("_", "/")), (c) => c.charCodeAt(0));
    brief = JSON.parse(new TextDecoder().decode(bytes));
  } catch {
    return null;
  }
  if (brief === null || typeof brief !== "object" || brief.v !== 1) return null;
  const state = fresh();
  state.kind = one(brief.k, KINDS, state.kind);
  if (numbers(brief.c, 7) && brief.c[3] > 0) {
    const [x, y, z, distance, azimuth, elevation, flat] = brief.c;
    state.camera = { target: [x, y, z], distance, azimuth, elevation, flat: flat === 1 };
  } else return null;
  for (const k of KINDS) {
    state.colour[k] = colour(brief.o?.[k], state.colour[k]);
    const list = brief.r?.[k];
    if (Array.isArray(list)) state.rules[k] = list.slice(0, 1000).map(unpacked).filter((r) => r !== null);
  }
  state.clip = clip(brief.s, state.clip);
  return state;
}

const one = (value, of, otherwise) => (of.includes(value) ? value : otherwise);
const number = (value, otherwise) => (Number.isFinite(value) ? value : otherwise);
const numbers = (list, count) => Array.isArray(list) && list.length === count && list.every(Number.isFinite);

function colour(c, otherwise) {
  if (c === null || typeof c !== "object") return otherwise;
  return {
    by: one(c.by, COLOURINGS, otherwise.by),
    column: typeof c.column === "string" && /^\w{0,64}$/.test(c.column) ? c.column : "",
    map: one(c.map, MAP_NAMES, otherwise.map),
    log: c.log === true,
    low: number(c.low, null),
    high: number(c.high, null),
    count: Number.isInteger(c.count) && c.count > 0 ? c.count : otherwise.count,
  };
}

function clip(c, otherwise) {
  if (c === null || typeof c !== "object") return otherwise;
  return {
    on: c.on === true,
    axis: one(c.axis, AXES, otherwise.axis),
    normal: numbers(c.normal, 3) && Math.abs(Math.hypot(...c.normal) - 1) < 1e-6 ? c.normal : otherwise.normal,
    at: number(c.at, otherwise.at),
    flip: c.flip === true,
    slice: one(c.slice, ["none", "material", "whole"], otherwise.slice),
  };
}

// Ids that follow each other are told as the distance from the one before, in runs "first+more".
function packed(rule) {
  if (!rule.ids) return rule;
  const runs = runsOf(rule.ids).map(([first, last]) => (last > first ? `${first}+${last - first}` : `${first}`));
  return { ...rule, ids: runs.join(",") };
}

function unpacked(rule) {
  if (rule === null || typeof rule !== "object" || !RULES.includes(rule.do)) return null;
  const out = { do: rule.do };
  // a part of a condition is another one
  if (typeof rule.where === "string" && rule.where.length <= 4000) out.where = rule.where;
  else if (typeof rule.ids === "string") {
    const ids = [];
    for (const run of rule.ids.split(",")) {
      const [first, more = 0] = run.split("+").map(Number);
      if (!Number.isInteger(first) || !Number.isInteger(more) || more < 0 || ids.length + more > 1e6) return null;
      for (let i = 0; i <= more; i++) ids.push(first + i);
    }
    out.ids = ids;
  } else return null;
  if (rule.do === "paint") {
    if (!isColour(rule.colour)) return null;
    out.colour = rule.colour;
  }
  return out;
}

/** [first, last] of the runs of rising ids without a gap. */
export function runsOf(ids) {
  const runs = [];
  for (const id of ids) {
    const run = runs.at(-1);
    if (run && id === run[1] + 1) run[1] = id;
    else runs.push([id, id]);
  }
  return runs;
}
