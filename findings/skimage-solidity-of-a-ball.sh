#!/usr/bin/env bash
# scikit-image 0.26.0: regionprops finds that a ball of voxels fills 84 % of its convex hull.
#
# Expected: regionprops, "solidity": ratio of pixels in the region to pixels of the convex hull image. The voxels whose
#   centres lie in a ball are all the voxels whose centres lie in their convex hull, so the solidity is 1.
# Seen: 0.837 for a radius of 3 voxels, 0.843 for 5, 0.911 for 10, 0.953 for 20, but 1 for 2: the hull is taken
#   not around the centres but around points half a voxel further out, and counts the voxels within that. With
#   convex_hull_image(..., offset_coordinates=False) it is 1 for each.
# Why it matters: solidity (or area_convex) is what separates round pores from ragged ones. It grows with the size of
#   the pore alone: small round pores look like large ragged ones.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install -q --disable-pip-version-check scikit-image==0.26.0 numpy==2.4.6
cd "$work"
venv/bin/python - <<'EOF'
import sys
import numpy as np
from skimage.measure import regionprops
from skimage.morphology import convex_hull_image

seen, centres = [], []
for radius in (2, 3, 5, 10, 20):
    grid = np.indices((2 * radius + 3,) * 3) - radius - 1
    ball = (grid**2).sum(0) <= radius**2
    seen.append(round(float(regionprops(ball.astype(np.uint8))[0].solidity), 3))
    centres.append(float(ball.sum() / convex_hull_image(ball, offset_coordinates=False).sum()))
    print(f"radius {radius:2}: solidity {seen[-1]}, around the centres {centres[-1]}")
if seen != [1, 0.837, 0.843, 0.911, 0.953] or set(centres) != {1.0}:
    sys.exit("changed: no longer as recorded above")
EOF
