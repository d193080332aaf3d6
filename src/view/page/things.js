// The tables of cells, objects and surfaces, column by column as they are needed.
import { extent } from "./camera.js";
import { digitsBetween } from "./format.js";
import { add, scale, sub } from "./vector.js";

export class Things {
  constructor(server, set) {
    this.server = server;
    this.set = set;
    this.loaded = new Map();
    this.asked = new Map();
    this.ranked = new Map();
    const far = digitsOfPlaces(set);
    for (const { columns } of Object.values(set.tables)) {
      for (const c of columns.filter(isPlace)) c.digits = far;
    }
  }

  columns(kind) {
    return this.set.tables[kind].columns;
  }

  column(kind, name) {
    return this.columns(kind).find((c) => c.name === name);
  }

  /** Ids of all things of a kind, rising. */
  async ids(kind) {
    await this.need(kind, []);
    return this.loaded.get(kind).ids;
  }

  /** The values of a column in the order of the ids, NaN where there is none. */
  async values(kind, name) {
    await this.need(kind, [name]);
    return this.loaded.get(kind).columns.get(name);
  }

  /** The finite values of a column, rising. */
  async sorted(kind, name) {
    const key = `${kind} ${name}`;
    const values = await this.values(kind, name);
    if (!this.ranked.has(key)) this.ranked.set(key, rising(values));
    return this.ranked.get(key);
  }

  /** The values of a column if they are here already. */
  known(kind, name) {
    return this.loaded.get(kind)?.columns.get(name) ?? null;
  }

  /** Asks for the columns that are not here yet, all in one request. */
  async need(kind, names) {
    const open = names.filter((n) => !this.known(kind, n) && !this.asked.has(`${kind} ${n}`));
    if (open.length > 0 || !this.asked.has(kind)) {
      const request = this.server.table(kind, open).then(({ ids, columns }) => {
        const have = this.loaded.get(kind) ?? { ids, columns: new Map(), dense: isDense(ids) };
        for (const [name, values] of columns) have.columns.set(name, values);
        this.loaded.set(kind, have);
      });
      for (const key of [kind, ...open.map((n) => `${kind} ${n}`)]) this.asked.set(key, request);
      request.catch(() => {
        for (const key of [kind, ...open.map((n) => `${kind} ${n}`)]) this.asked.delete(key);
      });
    }
    await Promise.all([this.asked.get(kind), ...names.map((n) => this.asked.get(`${kind} ${n}`))]);
  }

  /** The row of an id, -1 if there is none. */
  row(kind, id) {
    const { ids, dense } = this.loaded.get(kind);
    if (dense) return id >= 1 && id <= ids.length ? id - 1 : -1;
    let [low, high] = [0, ids.length];
    while (low < high) {
      const mid = (low + high) >> 1;
      if (ids[mid] < id) low = mid + 1;
      else high = mid;
    }
    return ids[low] === id ? low : -1;
  }

  /** The box of a thing along the grid's axes, null if the table has none. */
  async box(kind, id) {
    const names = ["min", "max"].flatMap((m) => ["x", "y", "z"].map((a) => `${m}_${a}`));
    if (kind === "surfaces") {
      const cell = (await this.values(kind, "cell"))[this.row(kind, id)];
      return cell > 0 ? this.box("cells", cell) : null;
    }
    if (!names.every((n) => this.column(kind, n))) return null;
    await this.need(kind, names);
    const row = this.row(kind, id);
    if (row < 0) return null;
    const { spacing, origin, directions, unit } = this.set;
    const factor = lengths(this.column(kind, "min_x").unit) / lengths(unit);
    const ends = names.map((n) => this.known(kind, n)[row] * factor);
    const scanned = { low: sub(ends.slice(0, 3), origin), high: sub(ends.slice(3), origin) };
    // the table's axes are those of the scan: the box goes back to the grid's
    const along = directions.map((d) => extent(scanned, d));
    const [low, high] = [0, 1].map((end) => along.map((a) => a[end]));
    const half = scale(spacing, 0.5);
    return { low: sub(low, half), high: add(high, half) };
  }
}

// Where something is, in the axes of the scan.
function isPlace({ name, unit }) {
  return /^(centroid|min|max)_[xyz]$|^[xyz]$/.test(name) && unit !== "";
}

// Scans may lie far from where their axes begin.
function digitsOfPlaces({ origin, spacing, dims }) {
  const size = Math.max(...spacing.map((s, k) => s * dims[k]));
  const far = Math.max(...origin.map(Math.abs));
  return digitsBetween(far, far + size, 4);
}

/** Finite values, the least first. */
export function rising(values) {
  return Float64Array.from(values.filter(Number.isFinite)).sort();
}

/** The value that a share of 0 to 1 of rising values lies below; NaN if there are none. */
export function quantile(sorted, share) {
  return sorted[Math.round(share * (sorted.length - 1))] ?? NaN;
}

function isDense(ids) {
  return ids.length === 0 || (ids[0] === 1 && ids[ids.length - 1] === ids.length);
}

const LENGTHS = { nm: 1e-9, um: 1e-6, "µm": 1e-6, mm: 1e-3, cm: 1e-2, m: 1 };

// Metres of a unit of length; voxels stand for themselves.
function lengths(unit) {
  return LENGTHS[unit] ?? 1;
}
