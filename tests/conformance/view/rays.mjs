// What a line of sight meets first in the exact tiles: read from the GLBs of a set in default form, by hand, and tested
// triangle by triangle. Shares nothing with the page.
import fs from "node:fs";
import path from "node:path";

const STRIP = 5;
const FLOAT = 5126;
const WIDE = 5125;

/** All triangles of a set in voxel coordinates, tile by tile, with the ids of their pieces. */
export class Rays {
  constructor(set) {
    this.manifest = JSON.parse(fs.readFileSync(path.join(set, "index.json"), "utf8"));
    const entries = this.manifest.layers.flatMap((l) => JSON.parse(fs.readFileSync(path.join(set, l.path), "utf8")).tiles);
    this.tiles = entries.map((e) => readTile(fs.readFileSync(path.join(set, e.path))));
  }

  /**
   * The nearest triangle along a ray in lengths along the grid's axes, before `cut` ({normal, at}: what lies beyond is
   * not there): {ids, front, place}, or null. `front` is the side from which corners go round counter-clockwise.
   */
  first({ from, along }, cut = null) {
    const { spacing } = this.manifest;
    const origin = from.map((x, k) => x / spacing[k]);
    const way = along.map((x, k) => x / spacing[k]);
    let best = null;
    for (const tile of this.tiles) {
      if (!meetsBox(origin, way, tile.low, tile.high)) continue;
      for (const piece of tile.pieces) {
        if (!meetsBox(origin, way, piece.low, piece.high)) continue;
        for (let n = 0; n < piece.corners.length; n += 9) {
          const hit = meet(origin, way, piece.corners, n);
          if (hit === null || (best && hit.t >= best.t)) continue;
          const place = from.map((x, k) => x + hit.t * along[k]);
          if (cut && place.reduce((s, x, k) => s + x * cut.normal[k], 0) > cut.at) continue;
          best = { t: hit.t, front: hit.front, ids: piece.ids, place };
        }
      }
    }
    return best;
  }
}

function readTile(bytes) {
  const length = bytes.readUInt32LE(12);
  const doc = JSON.parse(bytes.subarray(20, 20 + length).toString());
  const binary = bytes.subarray(28 + length);
  const pieces = doc.nodes.filter((n) => n.mesh !== undefined).map((node) => {
    const primitive = doc.meshes[node.mesh].primitives[0];
    if (primitive.mode !== STRIP) throw new Error("not a set in default form");
    const points = numbers(doc, binary, primitive.attributes.POSITION);
    const strip = numbers(doc, binary, primitive.indices);
    const corners = [];
    for (let n = 2; n < strip.length; n++) {
      let [a, b, c] = [strip[n - 2], strip[n - 1], strip[n]];
      if (a === b || b === c || a === c) continue;
      if (n % 2 === 1) [a, b] = [b, a];
      for (const i of [a, b, c]) corners.push(points[3 * i], points[3 * i + 1], points[3 * i + 2]);
    }
    const { cells, objects, surfaces } = { cells: node.extras.cell, objects: node.extras.object, surfaces: node.extras.surface };
    return { ids: { cells, objects, surfaces }, corners: Float64Array.from(corners), ...bounds(corners) };
  });
  const join = (f, end) => [0, 1, 2].map((k) => pieces.reduce((s, p) => f(s, p[end][k]), pieces[0][end][k]));
  return { pieces, low: join(Math.min, "low"), high: join(Math.max, "high") };
}

function bounds(corners) {
  const low = [Infinity, Infinity, Infinity];
  const high = [-Infinity, -Infinity, -Infinity];
  corners.forEach((x, i) => {
    low[i % 3] = Math.min(low[i % 3], x);
    high[i % 3] = Math.max(high[i % 3], x);
  });
  return { low, high };
}

function numbers(doc, binary, index) {
  const accessor = doc.accessors[index];
  const view = doc.bufferViews[accessor.bufferView];
  const size = accessor.type === "VEC3" ? 3 : 1;
  const width = accessor.componentType === FLOAT || accessor.componentType === WIDE ? 4 : 2;
  const stride = view.byteStride ?? size * width;
  const start = (view.byteOffset ?? 0) + (accessor.byteOffset ?? 0);
  const out = [];
  for (let i = 0; i < accessor.count; i++) {
    for (let k = 0; k < size; k++) {
      const at = start + i * stride + k * width;
      out.push(accessor.componentType === FLOAT ? binary.readFloatLE(at) : width === 4 ? binary.readUInt32LE(at) : binary.readUInt16LE(at));
    }
  }
  return out;
}

function meetsBox(origin, way, low, high) {
  let [enter, leave] = [0, Infinity];
  for (let k = 0; k < 3; k++) {
    const [a, b] = [(low[k] - origin[k]) / way[k], (high[k] - origin[k]) / way[k]];
    if (Number.isNaN(a) || Number.isNaN(b)) continue;
    enter = Math.max(enter, Math.min(a, b));
    leave = Math.min(leave, Math.max(a, b));
  }
  return enter <= leave + 1e-9;
}

// Cramer's rule for origin + t way = a + u (b - a) + v (c - a).
function meet(o, d, p, n) {
  const e = [p[n + 3] - p[n], p[n + 4] - p[n + 1], p[n + 5] - p[n + 2]];
  const f = [p[n + 6] - p[n], p[n + 7] - p[n + 1], p[n + 8] - p[n + 2]];
  const q = [d[1] * f[2] - d[2] * f[1], d[2] * f[0] - d[0] * f[2], d[0] * f[1] - d[1] * f[0]];
  const det = e[0] * q[0] + e[1] * q[1] + e[2] * q[2];
  if (Math.abs(det) < 1e-15) return null;
  const s = [o[0] - p[n], o[1] - p[n + 1], o[2] - p[n + 2]];
  const u = (s[0] * q[0] + s[1] * q[1] + s[2] * q[2]) / det;
  if (u < 0 || u > 1) return null;
  const r = [s[1] * e[2] - s[2] * e[1], s[2] * e[0] - s[0] * e[2], s[0] * e[1] - s[1] * e[0]];
  const v = (d[0] * r[0] + d[1] * r[1] + d[2] * r[2]) / det;
  if (v < 0 || u + v > 1) return null;
  const t = (f[0] * r[0] + f[1] * r[1] + f[2] * r[2]) / det;
  return t > 1e-9 ? { t, front: det > 0 } : null;
}

/** The line of sight through a pixel: 35 degrees from bottom to top, z up, as the page's state tells the camera. */
export function sight(camera, size, x, y) {
  const { azimuth: a, elevation: e, distance, target, flat } = camera;
  const back = [Math.cos(e) * Math.cos(a), Math.cos(e) * Math.sin(a), Math.sin(e)];
  const right = [-Math.sin(a), Math.cos(a), 0];
  const up = [-Math.sin(e) * Math.cos(a), -Math.sin(e) * Math.sin(a), Math.cos(e)];
  const eye = target.map((t, k) => t + distance * back[k]);
  const half = Math.tan((35 / 2) * (Math.PI / 180)) * (flat ? distance : 1);
  const u = ((2 * x) / size.width - 1) * half * (size.width / size.height);
  const v = (1 - (2 * y) / size.height) * half;
  const across = right.map((r, k) => u * r + v * up[k]);
  if (flat) return { from: eye.map((p, k) => p + across[k]), along: back.map((b) => -b) };
  return { from: eye, along: across.map((c, k) => c - back[k]) };
}
