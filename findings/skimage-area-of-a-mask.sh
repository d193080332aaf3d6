#!/usr/bin/env bash
# scikit-image 0.26.0: the area of a segmented ball is 9 % too large, however fine the voxels.
#
# Expected: marching_cubes and mesh_surface_area give a surface that comes closer to the true one the finer the voxels;
#   the volume inside does: 0.964, 0.995 and 0.999 of the true one at a radius of 5, 20 and 60 voxels.
# Seen: of a mask (0 and 1), the area is 1.082, 1.085 and 1.086 of the true one at these radii: it does not
#   converge to 1, since all triangles have one of a few directions. Of the same balls with grey values at the edge,
#   as a scan has them, it is within 0.2 % from 20 voxels on.
# Why it matters: specific surface, sphericity and shape factors of a segmented CT volume are off by 9 %, and measuring
#   at half the voxel size does not show it.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install -q --disable-pip-version-check scikit-image==0.26.0 numpy==2.4.6
cd "$work"
venv/bin/python - <<'EOF'
import math, sys
import numpy as np
from skimage.measure import marching_cubes, mesh_surface_area

def measure(volume, radius):
    vertices, faces, _, _ = marching_cubes(volume.astype(np.float32), 0.5)
    a, b, c = (vertices[faces[:, i]].astype(float) - radius for i in range(3))
    inside = abs(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)
    return mesh_surface_area(vertices, faces) / (4 * math.pi * radius**2), inside / (4 / 3 * math.pi * radius**3)

seen = []
for radius in (5, 20, 60):
    grid = np.indices((2 * radius + 5,) * 3, np.float32) - radius - 2
    distance = np.sqrt((grid**2).sum(0))
    mask, grey = measure(distance <= radius, radius), measure(np.clip(radius - distance + 0.5, 0, 1), radius)
    print(f"radius {radius:2}: of the mask area {mask[0]:.3f} volume {mask[1]:.3f}, with grey edges area {grey[0]:.3f} volume {grey[1]:.3f}")
    seen.append((round(mask[0], 2), round(grey[0], 2)))
if not all(mask >= 1.08 for mask, _ in seen) or seen[2][1] != 1:
    sys.exit("changed: no longer as recorded above")
EOF
