// The tables of cells, objects and surfaces, column by column as they are needed.

export class Things {
  constructor(server, set) {
    this.server = server;
    this.set = set;
    this.loaded = new Map();
    this.asked = new Map();
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

  /** The same if they are here already. */
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
    const low = [Infinity, Infinity, Infinity];
    const high = [-Infinity, -Infinity, -Infinity];
    // the table's axes are those of the scan: each corner goes back to the grid's
    for (let i = 0; i < 8; i++) {
      const corner = [0, 1, 2].map((k) => ends[k + (((i >> k) & 1) ? 3 : 0)] - origin[k]);
      for (let a = 0; a < 3; a++) {
        const x = directions[a].reduce((s, d, k) => s + d * corner[k], 0);
        low[a] = Math.min(low[a], x);
        high[a] = Math.max(high[a], x);
      }
    }
    return { low: low.map((x, k) => x - spacing[k] / 2), high: high.map((x, k) => x + spacing[k] / 2) };
  }
}

function isDense(ids) {
  return ids.length === 0 || (ids[0] === 1 && ids[ids.length - 1] === ids.length);
}

const LENGTHS = { nm: 1e-9, um: 1e-6, "µm": 1e-6, mm: 1e-3, cm: 1e-2, m: 1 };

// Metres of a unit of length; voxels stand for themselves.
function lengths(unit) {
  return LENGTHS[unit] ?? 1;
}
