// Files of a tile set, read by hand.
import fs from "node:fs";
import path from "node:path";

const read = (set, name) => JSON.parse(fs.readFileSync(path.join(set, name), "utf8"));

export function manifestOf(set) {
  return read(set, "index.json");
}

/** Entries of all tiles. */
export function tilesOf(set) {
  return manifestOf(set).layers.flatMap((layer) => read(set, layer.path).tiles);
}

/** Document and binary part of a GLB. */
export function glb(file) {
  const bytes = fs.readFileSync(file);
  const length = bytes.readUInt32LE(12);
  return { doc: JSON.parse(bytes.subarray(20, 20 + length).toString()), binary: bytes.subarray(28 + length) };
}

/** Middles of the largest cells that the grid does not cut. */
export function middles(set, most) {
  const [head, ...lines] = fs.readFileSync(path.join(set, "cells.csv"), "utf8").trim().split("\n").map((l) => l.split(","));
  const column = (name) => head.findIndex((c) => c.split(" ")[0] === name);
  const whole = lines.filter((l) => l[column("touches_border")] === "0");
  whole.sort((a, b) => b[column("voxels")] - a[column("voxels")]);
  return whole.slice(0, most).map((l) => ["x", "y", "z"].map((a) => Number(l[column(`centroid_${a}`)])));
}
