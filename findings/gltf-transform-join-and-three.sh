#!/usr/bin/env bash
# @gltf-transform/functions 4.5.1 with three.js 0.187.0: two strips joined by the one have NaN triangles in the other.
#
# Expected: glTF 2.0, section 3.7.2.1: indices must not hold the largest value of their type (primitive restart). Two
#   strips can be joined by repeating an index. Section 3.12: without what extensionsRequired names, a file can not be
#   loaded.
# Seen: join() puts 65535 between the strips and makes the file require KHR_mesh_primitive_restart, a draft
#   (KhronosGroup/glTF, pull request 2569). GLTFLoader of three.js warns of an unknown extension, loads the file all
#   the same, turns the strip into triangles and takes 65535 as a vertex. Three triangles have a corner that is none,
#   and the volume, 2 before, is NaN.
# Why it matters: join() is part of `gltf-transform optimize`. The objects still draw, but areas and volumes are NaN.
set -euo pipefail
command -v npm >/dev/null || { echo "this one needs node and npm" >&2; exit 2; }
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
npm install --silent --no-audit --no-fund @gltf-transform/core@4.5.1 @gltf-transform/extensions@4.5.1 @gltf-transform/functions@4.5.1 three@0.187.0 >/dev/null
cat >join.mjs <<'EOF'
import { Document, Logger, NodeIO } from "@gltf-transform/core";
import { ALL_EXTENSIONS } from "@gltf-transform/extensions";
import { join } from "@gltf-transform/functions";
import { Vector3 } from "three";
import { GLTFLoader } from "three/examples/jsm/loaders/GLTFLoader.js";

globalThis.self = globalThis;
// a cube of side 1, its six sides joined into one strip by repeated indices
const strip = [];
for (const side of [[0, 2, 1, 3], [4, 5, 6, 7], [0, 1, 4, 5], [2, 6, 3, 7], [0, 4, 2, 6], [1, 3, 5, 7]]) {
  if (strip.length) strip.push(strip.at(-1), side[0]);
  strip.push(...side);
}
const corners = new Float32Array([0, 1].flatMap((z) => [0, 1].flatMap((y) => [0, 1].flatMap((x) => [x, y, z]))));
const document = new Document().setLogger(new Logger(Logger.Verbosity.WARN)), buffer = document.createBuffer(), scene = document.createScene();
const accessor = (type, array) => document.createAccessor().setType(type).setArray(array).setBuffer(buffer);
const positions = accessor("VEC3", corners), indices = accessor("SCALAR", new Uint16Array(strip));
for (const x of [0, 3]) {
  const primitive = document.createPrimitive().setMode(5).setAttribute("POSITION", positions).setIndices(indices);
  scene.addChild(document.createNode().setMesh(document.createMesh().addPrimitive(primitive)).setTranslation([x, 0, 0]));
}
const io = new NodeIO().registerExtensions(ALL_EXTENSIONS), seen = {};
for (const name of ["apart", "joined"]) {
  if (name === "joined") await document.transform(join());
  const file = await io.writeBinary(document);
  const gltf = await new GLTFLoader().parseAsync(file.buffer.slice(file.byteOffset, file.byteOffset + file.byteLength), "");
  gltf.scene.updateMatrixWorld(true);
  let volume = 0, outside = 0;
  gltf.scene.traverse(({ isMesh, geometry, matrixWorld }) => {
    if (!isMesh) return;
    const { index, attributes: { position } } = geometry;
    const [a, b, c] = [0, 1, 2].map(() => new Vector3());
    for (let i = 0; i < index.count; i += 3) {
      [a, b, c].forEach((v, j) => v.fromBufferAttribute(position, index.getX(i + j)).applyMatrix4(matrixWorld));
      outside += [0, 1, 2].some((j) => index.getX(i + j) >= position.count);
      volume += a.dot(b.cross(c)) / 6;
    }
  });
  const required = document.getRoot().listExtensionsRequired().map((extension) => extension.extensionName);
  console.log(`${name}: requires ${JSON.stringify(required)}, triangles outside of the vertices ${outside}, volume ${volume}`);
  seen[name] = [outside, Math.round(volume)];
}
if (JSON.stringify(seen) !== '{"apart":[0,2],"joined":[3,null]}') {
  console.log("changed: no longer as recorded above");
  process.exit(1);
}
EOF
node join.mjs
