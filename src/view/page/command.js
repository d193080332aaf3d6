// The line for the terminal that makes tiles of what the picture shows.
import { BEST, MARK, WORST } from "./colours.js";
import { digitsBetween } from "./format.js";
import { runsOf } from "./link.js";

/** One word for a shell. */
export function quoted(text) {
  return /^[\w@%+=:,./-]+$/.test(text) ? text : `'${text.replaceAll("'", "'\\''")}'`;
}

/** The condition of a rule. */
export function condition(rule) {
  if (rule.where !== undefined) return rule.where;
  const parts = runsOf(rule.ids).map(([a, b]) => (a === b ? `id == ${a}` : b === a + 1 ? `id == ${a} or id == ${b}` : `id >= ${a} and id <= ${b}`));
  return parts.map((p) => (parts.length > 1 && p.includes("and") ? `(${p})` : p)).join(" or ");
}

/** The condition of what is shown; null for all. */
export function shownWhere(rules) {
  let shown = null;
  for (const rule of rules) {
    const it = condition(rule);
    if (rule.do === "only") shown = it;
    if (rule.do === "leave") shown = shown === null ? `not (${it})` : `(${shown}) and not (${it})`;
    if (rule.do === "show" && shown !== null) shown = `(${shown}) or (${it})`;
  }
  return shown;
}

/** `alvis select`, with `out` as it was typed and quoted, for a state and the look that it has. */
export function command(state, out, { scale, marked, painted }) {
  const { kind } = state;
  const rules = state.rules[kind];
  const words = ["alvis", "select", out, "PART"];
  if (kind !== "cells") words.push(`--${kind}`);
  const leave = rules.filter((r) => r.do === "leave");
  const others = rules.some((r) => r.do === "only" || r.do === "show");
  if (leave.length === 1 && !others) words.push("--where", quoted(condition(leave[0])), "--omit");
  else {
    const shown = shownWhere(rules);
    if (shown !== null) words.push("--where", quoted(shown));
  }
  if (scale?.by === "column") words.push(...coloured(scale));
  if (scale?.by === "best" && scale.count > 0) {
    words.push("--paint", quoted(`best:${scale.count}=${BEST.hex}`), "--paint", quoted(`worst:${scale.count}=${WORST.hex}`));
  }
  for (const [where, colour] of paints(rules, marked, painted)) words.push("--paint", quoted(`${where}=${colour}`));
  // of tiles as they are, all cells are still something to select
  if (!words.some((w) => ["--where", "--colour-by", "--paint"].includes(w))) words.push("--where", quoted("id > 0"));
  return words.join(" ");
}

function coloured({ column, map, low, high, log }) {
  const f = log ? Math.log10 : (x) => x;
  const by = log ? `log10(${column.name})` : column.name;
  const digits = digitsBetween(f(low), f(high), 7);
  const words = ["--colour-by", quoted(by), "--range", [low, high].map((x) => Number(f(x).toPrecision(digits))).join(":")];
  // a range may begin with a minus sign, which would be an option of its own
  if (words[3].startsWith("-")) words.splice(2, 2, `--range=${words[3]}`);
  return map === "viridis" ? words : [...words, "--map", map];
}

// Conditions and colours in their order. Where some of it was taken back, what is left is told by ids.
function paints(rules, marked, painted) {
  const out = [];
  if (!rules.some((r) => r.do === "unpaint")) {
    for (const r of rules) if (r.do === "paint") out.push([condition(r), r.colour]);
  } else {
    for (const colour of new Set(painted.values())) {
      const ids = [...painted.keys()].filter((id) => painted.get(id) === colour);
      out.push([condition({ ids: ids.sort((a, b) => a - b) }), colour]);
    }
  }
  if (!rules.some((r) => r.do === "unmark")) {
    for (const r of rules) if (r.do === "mark") out.push([condition(r), MARK.hex]);
  } else if (marked.size > 0) out.push([condition({ ids: [...marked].sort((a, b) => a - b) }), MARK.hex]);
  return out;
}
