#!/usr/bin/env bash
# @gltf-transform/functions 4.5.1: normals() gives a triangle strip normals that point inwards, and NaN.
#
# Expected: "normals: Generates flat vertex normals for mesh primitives"; glTF 2.0, section 3.7.2.1: NORMAL holds unit
#   vectors, a primitive may be a TRIANGLE_STRIP, and each second triangle of a strip is wound the other way.
# Seen: the vertices are taken three at a time, as in a list of triangles, with that winding. Of the 10 normals of the
#   four outer sides of a box in one strip (no triangle without area among them), 6 point out, 3 point inwards and
#   one is NaN. The same box as triangles gets 24 normals, all outwards. No warning.
# Why it matters: strips take a third of the indices, so big surfaces of CT volumes come as strips. A viewer shows them
#   dark in part, and who takes orientations from the normals gets numbers that mean nothing.
set -euo pipefail
command -v npm >/dev/null || { echo "this one needs node and npm" >&2; exit 2; }
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
npm install --silent --no-audit --no-fund @gltf-transform/core@4.5.1 @gltf-transform/functions@4.5.1 >/dev/null
cat >normals.mjs <<'EOF'
import { Document } from "@gltf-transform/core";
import { convertPrimitiveToTriangles, normals } from "@gltf-transform/functions";

// the four outer sides of a box around the z axis, from below and above in turn
const corners = new Float32Array([[1, -1], [1, 1], [-1, 1], [-1, -1], [1, -1]].flatMap(([x, y]) => [x, y, 1, x, y, -1]));

async function directions(triangles) {
  const document = new Document(), buffer = document.createBuffer();
  const accessor = (type, array) => document.createAccessor().setType(type).setArray(array).setBuffer(buffer);
  const primitive = document.createPrimitive().setMode(5).setAttribute("POSITION", accessor("VEC3", corners))
    .setIndices(accessor("SCALAR", Uint16Array.from({ length: 10 }, (_, i) => i)));
  document.createScene().addChild(document.createNode().setMesh(document.createMesh().addPrimitive(primitive)));
  if (triangles) convertPrimitiveToTriangles(primitive);
  await document.transform(normals());
  const [position, normal] = ["POSITION", "NORMAL"].map((name) => primitive.getAttribute(name));
  const found = { outwards: 0, inwards: 0, other: 0 };
  for (let i = 0; i < normal.getCount(); i++) {
    const p = position.getElement(i, []), n = normal.getElement(i, []), towards = n[0] * p[0] + n[1] * p[1];
    found[towards > 0 ? "outwards" : towards < 0 ? "inwards" : "other"]++;
  }
  return JSON.stringify(found);
}
const seen = { strip: await directions(false), triangles: await directions(true) };
for (const name in seen) console.log(name, seen[name]);
if (seen.strip !== '{"outwards":6,"inwards":3,"other":1}' || seen.triangles !== '{"outwards":24,"inwards":0,"other":0}') {
  console.log("changed: no longer as recorded above");
  process.exit(1);
}
EOF
node normals.mjs
