// Numbers, counts and units as people read them.

/** 4,718,407. */
export function count(n) {
  return String(Math.round(n)).replace(/\B(?=(\d{3})+$)/g, ",");
}

/** 4,718,407 as "4.7 million". */
export function about(n) {
  if (n < 1e5) return count(n);
  if (n < 1e6) return `${Math.round(n / 1e3)} thousand`;
  return `${Number((n / 1e6).toPrecision(n < 1e8 ? 2 : 3))} million`;
}

export function many(n, one, more = `${one}s`) {
  return `${count(n)} ${n === 1 ? one : more}`;
}

/** A number with so many digits that count, and all of those before the point. */
export function number(x, digits = 4) {
  if (x === null || Number.isNaN(x)) return "–";
  if (Number.isInteger(x) && Math.abs(x) < 1e15) return String(x);
  const size = Math.abs(x);
  if (size >= 10 ** digits && size < 1e6) return String(Math.round(x));
  if (size >= Math.max(1e6, 10 ** digits) || size < 1e-4) return x.toExponential(digits - 1).replace(/\.?0+e/, "e").replace("e+", "e");
  const fixed = x.toPrecision(digits);
  return fixed.includes("e") ? String(Number(fixed)) : fixed.includes(".") ? fixed.replace(/\.?0+$/, "") : fixed;
}

/** How many digits tell numbers between two ends apart as well as `digits` do where one end is 0. */
export function digitsBetween(low, high, digits) {
  const common = Math.log10(Math.max(Math.abs(low), Math.abs(high)) / Math.abs(high - low));
  return Math.min(digits + Math.max(Math.ceil(common) || 0, 0), 15);
}

/** A value of a column. */
export function value(x, column, digits = 4) {
  if (x === null || Number.isNaN(x)) return "–";
  if (column.name === "touches_border") return x ? "yes" : "no";
  return column.whole ? String(x) : number(x, Math.max(digits, column.digits ?? 0));
}

/** A column's name in words, and with its unit. */
export function title(column) {
  return column.name.replaceAll("_", " ");
}

export function unit(text) {
  return text.replace("^2", "²").replace("^3", "³").replace(/^um/, "µm");
}

export function withUnit(column) {
  return column.unit ? `${title(column)} [${unit(column.unit)}]` : title(column);
}

const SINGULAR = { cells: "cell", objects: "object", surfaces: "surface" };

export function singular(kind) {
  return SINGULAR[kind];
}

/** The largest of 1, 2 and 5 times a power of ten that is no larger. */
export function round125(x) {
  const power = 10 ** Math.floor(Math.log10(x));
  const lead = x / power;
  return (lead >= 5 ? 5 : lead >= 2 ? 2 : 1) * power;
}

/** Even numbers between two, about `wanted` of them. */
export function ticks(low, high, wanted) {
  const step = round125(((high - low) / wanted) * 1.6) || 1;
  const out = [];
  for (let i = Math.ceil(low / step - 1e-9); i * step <= high + step * 1e-9; i++) out.push(Number((i * step).toPrecision(12)));
  return out;
}

/** Powers of ten, and 2 and 5 times these where there are few. */
export function logTicks(low, high) {
  const out = [];
  const few = Math.log10(high / low) < 2.2;
  for (let p = Math.floor(Math.log10(low)); p <= Math.ceil(Math.log10(high)); p++) {
    for (const k of few ? [1, 2, 5] : [1]) {
      const x = Number((k * 10 ** p).toPrecision(6));
      if (x >= low * 0.999 && x <= high * 1.001) out.push(x);
    }
  }
  return out;
}
