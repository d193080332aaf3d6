#!/usr/bin/env bash
# trimesh 5.2.0: a closed surface stored as one triangle strip is said not to be watertight.
#
# Expected: glTF 2.0, section 3.7.2.1: a mesh may be a TRIANGLE_STRIP. Runs are joined by repeated indices, whose
#   triangles have no area and are not part of the surface. A closed surface stays closed.
# Seen: trimesh keeps the triangles without area as faces, with process=True as well. Volume and area are right, but
#   is_watertight is False and is_volume too, so boolean operations, which ask is_volume, refuse the mesh. After
#   update_faces(nondegenerate_faces()) the mesh is watertight.
# Why it matters: who checks a surface of a CT volume for holes finds one in each object, and there is none.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install -q --disable-pip-version-check trimesh==5.2.0 scipy==1.17.1 numpy==2.4.6
cd "$work"
venv/bin/python - <<'EOF'
import json, struct, sys
import numpy as np, trimesh

corners = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], "<f4")
strip = []
for run in ([0, 2, 1, 3], [4, 5, 6, 7], [0, 1, 4, 5], [2, 6, 3, 7], [0, 4, 2, 6], [1, 3, 5, 7]):
    strip += ([strip[-1], run[0]] if strip else []) + run
strip = np.array(strip, "<u2")
binary = corners.tobytes() + strip.tobytes()
text = json.dumps({
    "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
    "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "mode": 5}]}],
    "buffers": [{"byteLength": len(binary)}],
    "bufferViews": [{"buffer": 0, "byteLength": corners.nbytes}, {"buffer": 0, "byteOffset": corners.nbytes, "byteLength": strip.nbytes}],
    "accessors": [{"bufferView": 0, "componentType": 5126, "count": 8, "type": "VEC3", "min": [0] * 3, "max": [1] * 3},
                  {"bufferView": 1, "componentType": 5123, "count": len(strip), "type": "SCALAR"}]}).encode()
text, binary = text + b" " * (-len(text) % 4), binary + bytes(-len(binary) % 4)
with open("cube.glb", "wb") as file:
    file.write(b"glTF" + struct.pack("<II", 2, 28 + len(text) + len(binary)))
    file.write(struct.pack("<I", len(text)) + b"JSON" + text + struct.pack("<I", len(binary)) + b"BIN\0" + binary)

seen = []
mesh = trimesh.load_mesh("cube.glb", process=True)
for what in ("as read", "without triangles of no area"):
    if seen:
        mesh.update_faces(mesh.nondegenerate_faces())
    print(f"{what}: {len(mesh.faces)} faces, volume {mesh.volume:.3f}, watertight {mesh.is_watertight}, volume {mesh.is_volume}")
    seen.append((len(mesh.faces), round(float(mesh.volume), 3), bool(mesh.is_watertight)))
if seen != [(32, 1, False), (12, 1, True)]:
    sys.exit("changed: no longer as recorded above")
EOF
