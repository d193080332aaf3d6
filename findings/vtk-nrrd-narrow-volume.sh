#!/usr/bin/env bash
# VTK 9.7.2: vtkNrrdReader takes a volume that is less than 10 voxels wide for a slice of vectors.
#
# Expected: NRRD, "kinds" (format.html, section "Per-axis field specifications"): an axis of kind "domain" or "space" is
#   sampled space; only others hold the components of a sample.
# Seen: a volume of 9 x 20 x 30 voxels whose three axes are "domain" reads as 20 x 30 x 1 with 9 components; its
#   spacing 0.1, 0.2, 0.5 as 0.2, 0.5, 1. From a width of 10 voxels on it is 10 x 20 x 30. No warning.
# Why it matters: narrow crops and thin plates turn into something else: the axes move up by one, and the size in z is
#   a made-up 1. A batch over many crops fails for the narrow ones alone.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install -q --disable-pip-version-check vtk==9.7.2 pynrrd==1.1.3 numpy==2.4.6
cd "$work"
venv/bin/python - <<'EOF'
import sys
import nrrd, numpy as np
from vtkmodules.vtkIOImage import vtkNrrdReader

seen = {}
for width in (1, 3, 9, 10):
    header = {"spacings": [0.1, 0.2, 0.5], "kinds": ["domain"] * 3}
    nrrd.write("volume.nrrd", np.zeros((width, 20, 30), np.int16), header)
    reader = vtkNrrdReader()
    reader.SetFileName("volume.nrrd")
    reader.Update()
    image = reader.GetOutput()
    seen[width] = (image.GetDimensions(), image.GetSpacing(), image.GetNumberOfScalarComponents())
    print(f"{width} x 20 x 30 of 0.1 x 0.2 x 0.5:", *seen[width])
if seen[9] != ((20, 30, 1), (0.2, 0.5, 1), 9) or seen[10] != ((10, 20, 30), (0.1, 0.2, 0.5), 1):
    sys.exit("changed: no longer as recorded above")
EOF
