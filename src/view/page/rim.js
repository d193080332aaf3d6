// Where the volume ends inside of material there is no surface, and a line of sight may run through material from end
// to end without one. What lies there is told by the edges in which the surface meets the volume's faces: they go round
// the material. This fills them, block by block, to small masks on these faces.

/** Texels of a mask along a side, at most. */
const MOST = 128;
/** Bit of the last 16 of a vertex that is of a fin. */
const FIN = 0x200;

/**
 * Masks of a block (255: material, 0: air) on the faces of the volume that it reaches: [{axis, top, mask, width,
 * height}], rows along the second of the other axes in cyclic order. `tile` is as read; `low` and `high` are the
 * block's ends on the lattice, `ends` those of the volume.
 */
export function rims(tile, low, high, ends) {
  const points = new Uint16Array(tile.vertices.buffer, tile.vertices.byteOffset, tile.vertices.byteLength / 2);
  const found = [];
  for (let axis = 0; axis < 3; axis++) {
    for (const top of [false, true]) {
      const plane = top ? ends[axis] : 0;
      if ((top ? high : low)[axis] !== plane) continue;
      const at = (plane - tile.origin[axis]) / tile.step;
      const [u, v] = [(axis + 1) % 3, (axis + 2) % 3];
      const place = (i, k) => tile.origin[k] + points[6 * i + k] * tile.step;
      const edges = openEdges(points, tile.indices, axis, at).map(([a, b]) => (
        { u0: place(a, u), v0: place(a, v), u1: place(b, u), v1: place(b, v) }));
      if (edges.length === 0) continue;
      const [width, height] = [u, v].map((k) => Math.min(MOST, Math.max(1, Math.round((high[k] - low[k]) / 256))));
      const grid = { u: low[u], v: low[v], du: (high[u] - low[u]) / width, dv: (high[v] - low[v]) / height, width, height };
      found.push({ axis, top, width, height, mask: filled(edges, grid, top ? -1 : 1) });
    }
  }
  return found;
}

// Edges [from, to] of triangles that have two corners in a plane, counter-clockwise as the triangle winds.
function openEdges(points, indices, axis, at) {
  const end = indices.BYTES_PER_ELEMENT === 2 ? 0xffff : 0xffffffff;
  const on = new Uint8Array(points.length / 6);
  // what ends there of fins between levels bounds nothing
  for (let i = 0; i < on.length; i++) on[i] = points[6 * i + axis] === at && !(points[6 * i + 5] & FIN) ? 1 : 0;
  const edges = [];
  if (!on.includes(1)) return edges;
  let [a, b, run] = [0, 0, 0];
  for (const c of indices) {
    run = c === end ? 0 : run + 1;
    if (run > 2 && on[a] + on[b] + on[c] === 2 && a !== b && b !== c && a !== c) {
      const [p, q] = run % 2 === 0 ? [b, a] : [a, b];
      edges.push(!on[c] ? [p, q] : !on[p] ? [q, c] : [c, p]);
    }
    [a, b] = [b, c];
  }
  return edges;
}

// Rows are cut at the edges they cross, which tell what is on either side; a row without one is filled along columns.
function filled(edges, grid, sign) {
  const { width, height } = grid;
  // air lies to the right of an edge that runs up, seen from outside of the lower face
  const rows = crossings(edges.map((e) => ({ a: e.v0, b: e.v1, at: e.u0, to: e.u1, air: sign * (e.v1 - e.v0) > 0 })), grid.v, grid.dv, height);
  const columns = crossings(edges.map((e) => ({ a: e.u0, b: e.u1, at: e.v0, to: e.v1, air: sign * (e.u1 - e.u0) < 0 })), grid.u, grid.du, width);
  const mask = new Uint8Array(width * height);
  for (let j = 0; j < height; j++) {
    for (let i = 0; i < width; i++) {
      const across = side(rows[j], grid.u + (i + 0.5) * grid.du);
      const along = side(columns[i], grid.v + (j + 0.5) * grid.dv);
      const air = across ?? along;
      mask[j * width + i] = air === null ? 2 : air ? 0 : 255;
    }
  }
  return spread(mask, width, height);
}

// For each line of texels: where edges cross its middle, in order, and whether air follows.
function crossings(edges, start, step, count) {
  const lines = Array.from({ length: count }, () => []);
  for (const { a, b, at, to, air } of edges) {
    if (a === b) continue;
    const [low, high] = [Math.min(a, b), Math.max(a, b)];
    // lines lie between lattice points, so none runs through a corner
    const first = Math.max(Math.ceil((low - start) / step - 0.5 - 0.25 / step), 0);
    for (let j = first; j < count; j++) {
      const line = start + (j + 0.5) * step + 0.25;
      if (line > high) break;
      if (line > low) lines[j].push({ at: at + ((line - a) / (b - a)) * (to - at), air });
    }
  }
  for (const line of lines) line.sort((p, q) => p.at - q.at);
  return lines;
}

function side(line, place) {
  if (line.length === 0) return null;
  let last = null;
  for (const c of line) {
    if (c.at > place) break;
    last = c;
  }
  return last ? last.air : !line[0].air;
}

// Texels of which no line tells take what is beside them.
function spread(mask, width, height) {
  for (let round = 0; round < 2; round++) {
    for (let n = 0; n < mask.length; n++) {
      const i = round === 0 ? n : mask.length - 1 - n;
      if (mask[i] !== 2) continue;
      const near = round === 0 ? [i % width > 0 ? i - 1 : i, i >= width ? i - width : i]
        : [i % width < width - 1 ? i + 1 : i, i < width * (height - 1) ? i + width : i];
      const known = near.find((k) => mask[k] !== 2);
      if (known !== undefined) mask[i] = mask[known];
    }
  }
  return mask;
}
