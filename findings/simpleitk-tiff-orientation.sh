#!/usr/bin/env bash
# SimpleITK 2.5.7: a grey 16-bit TIFF with Orientation 2, 3 or 5 to 8 becomes four channels of 8 bits.
#
# Expected: TIFF 6.0, section 8, Orientation: where the 0th row and column lie; it says nothing of the samples. A
#   reader turns the picture or leaves it, and the samples stay 16-bit grey, as with 1 and 4.
# Seen: with Orientation 1 and 4 the file is 16-bit grey. With 2, 3 and 5 to 8 it is RGBA of 8 bits, the values
#   divided by 257 (20000 becomes 78), and 255 for opacity. A warning goes to the error stream, no error.
#   With 6 and 8, width and height are not exchanged either.
# Why it matters: scanners' software and image editors do write 3 or 6. 65,536 grey values become 256, and what asks
#   for the array gets one dimension more.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install -q --disable-pip-version-check SimpleITK==2.5.7 tifffile==2026.3.3 numpy==2.4.6
cd "$work"
venv/bin/python - <<'EOF' 2>/dev/null
import sys
import numpy as np, SimpleITK as sitk, tifffile

picture = np.arange(12, dtype=np.uint16).reshape(3, 4) * 5000
grey, colour = [], []
for orientation in range(1, 9):
    tifffile.imwrite("grey.tif", picture, photometric="minisblack", metadata=None, extratags=[(274, "H", 1, orientation, True)])
    image = sitk.ReadImage("grey.tif")
    values = sorted(set(sitk.GetArrayFromImage(image).ravel().tolist()))
    print(f"Orientation {orientation}: {image.GetSize()}, {image.GetPixelIDTypeAsString()}, values {values}")
    (grey if image.GetPixelID() == sitk.sitkUInt16 else colour).append(orientation)
    if orientation in (6, 8) and image.GetSize() != (4, 3):
        sys.exit("changed: the sides are exchanged now")
if grey != [1, 4] or colour != [2, 3, 5, 6, 7, 8]:
    print("changed: no longer as recorded above")
    sys.exit(1)
EOF
