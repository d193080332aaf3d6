#!/usr/bin/env bash
# ome-zarr-py 0.18.0: write_image loses the voxel size and the unit that its arguments state.
#
# Expected: OME-Zarr 0.5, "axes": an axis may have a unit; write_image takes the axes as dictionaries ("list of dicts")
#   and coordinate_transformations, of which its description says "each list of dicts is added to each dataset".
#   write_multiscale of the same library, with the same two arguments, writes both.
# Seen: write_image writes axes without units and a scale of 1, 1, 1. The one message is a DeprecationWarning, which
#   Python does not show outside __main__ and which does not say that the size is dropped.
# Why it matters: the file is valid and opens everywhere, with voxels of 1 of nothing instead of 0.5 x 0.1 x 0.1 um.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install -q --disable-pip-version-check ome-zarr==0.18.0 zarr==3.1.6 numpy==2.4.6
cd "$work"
venv/bin/python - <<'EOF'
import json, sys
import numpy as np
from ome_zarr.writer import write_image, write_multiscale

axes = [{"name": name, "type": "space", "unit": "micrometer"} for name in "zyx"]
sizes = [[{"type": "scale", "scale": [0.5, 0.1, 0.1]}], [{"type": "scale", "scale": [0.5, 0.2, 0.2]}]]
levels = [np.zeros((4, 64, 64), np.uint16), np.zeros((4, 32, 32), np.uint16)]
write_image(levels[0], "image", axes=axes, coordinate_transformations=sizes, scale_factors=[2])
write_multiscale(levels, "multiscale", axes=axes, coordinate_transformations=sizes)
seen = {}
for name in ("image", "multiscale"):
    with open(f"{name}/zarr.json") as file:
        multiscale = json.load(file)["attributes"]["ome"]["multiscales"][0]
    units = [axis.get("unit") for axis in multiscale["axes"]]
    scales = [dataset["coordinateTransformations"][0]["scale"] for dataset in multiscale["datasets"]]
    print(f"write_{name:10} units {units} scales {scales}")
    seen[name] = (units[0], scales[0])
if seen != {"image": (None, [1, 1, 1]), "multiscale": ("micrometer", [0.5, 0.1, 0.1])}:
    sys.exit("changed: no longer as recorded above")
EOF
