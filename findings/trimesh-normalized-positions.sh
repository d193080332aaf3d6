#!/usr/bin/env bash
# trimesh 5.2.0: a cube of 2 mm with normalized 16-bit positions is 131,070 mm wide.
#
# Expected: KHR_mesh_quantization allows POSITION as normalized 16-bit integers ("Extending Mesh Attributes"), and an
#   unsigned one, c, stands for c / 65535 ("Encoding Quantized Data"). quantize() of glTF Transform, for one,
#   writes normalized positions.
# Seen: trimesh reads files that require the extension, and takes an integer as it is, normalized or not. A cube that
#   is 1 wide and scaled by 2 in its node gets 131,070. Without `normalized` it is right. No warning.
# Why it matters: volumes are wrong by the third power, 2.8e14; the proportions are right, so a picture looks right.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install -q --disable-pip-version-check trimesh==5.2.0 numpy==2.4.6
cd "$work"
venv/bin/python - <<'EOF'
import json, struct, sys
import numpy as np, trimesh

corners = np.array([[x, y, z, 0] for z in (0, 1) for y in (0, 1) for x in (0, 1)])
faces = np.array([[a, b, c, c, b, d] for a, b, c, d in
                  ([0, 2, 1, 3], [4, 5, 6, 7], [0, 1, 4, 5], [2, 6, 3, 7], [0, 4, 2, 6], [1, 3, 5, 7])], "<u2")

def cube(path, largest, normalized):
    positions = (corners * largest).astype("<u2")
    binary = positions.tobytes() + faces.tobytes()
    scale = 2 if normalized else 2 / largest
    text = json.dumps({
        "asset": {"version": "2.0"}, "extensionsUsed": ["KHR_mesh_quantization"], "extensionsRequired": ["KHR_mesh_quantization"],
        "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0, "scale": [scale] * 3}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"byteLength": len(binary)}],
        "bufferViews": [{"buffer": 0, "byteLength": positions.nbytes, "byteStride": 8, "target": 34962},
                        {"buffer": 0, "byteOffset": positions.nbytes, "byteLength": faces.nbytes, "target": 34963}],
        "accessors": [{"bufferView": 0, "componentType": 5123, "normalized": normalized, "count": 8, "type": "VEC3",
                       "min": [0] * 3, "max": [largest] * 3},
                      {"bufferView": 1, "componentType": 5123, "count": faces.size, "type": "SCALAR"}]}).encode()
    text += b" " * (-len(text) % 4)
    with open(path, "wb") as file:
        file.write(b"glTF" + struct.pack("<II", 2, 28 + len(text) + len(binary)))
        file.write(struct.pack("<I", len(text)) + b"JSON" + text + struct.pack("<I", len(binary)) + b"BIN\0" + binary)
    scene = trimesh.load(path)
    print(f"{path:14} is 2 wide, read as {scene.extents[0]:.6g}, volume {scene.to_geometry().volume:.6g}")
    return round(float(scene.extents[0]), 3)

if (cube("plain.glb", 1000, False), cube("normalized.glb", 65535, True)) != (2, 131070):
    sys.exit("changed: no longer as recorded above")
EOF
