#!/usr/bin/env bash
# nibabel 5.4.2 and SimpleITK 2.5.7: a NIfTI volume without a form is mirrored in one of them.
#
# Expected: nifti1.h, METHOD 1 (qform_code = 0, sform_code not > 0): x = pixdim[1] * i, y = pixdim[2] * j,
#   z = pixdim[3] * k: all axes grow with their index, so the determinant is positive and nothing is mirrored.
# Seen: nibabel's affine has -0.1 for x and a negative determinant (default_x_flip, from Analyze), and an origin in the middle.
#   SimpleITK has the identity, in its own axes, which point left and back instead of right and forward: in
#   those of NIfTI it is turned by 180 degrees about z, not mirrored, and its origin is 0.
# Why it matters: files of programs that know no patient may have neither form. Left-handed threads, fibres and helices become
#   right-handed, and a surface made with one does not lie on one made with the other.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install -q --disable-pip-version-check SimpleITK==2.5.7 nibabel==5.4.2 numpy==2.4.6
cd "$work"
venv/bin/python - <<'EOF'
import struct, sys
import nibabel as nib, numpy as np, SimpleITK as sitk

nib.save(nib.Nifti1Image(np.zeros((3, 4, 5), np.uint8), np.diag([0.1, 0.2, 0.3, 1])), "volume.nii")
data = open("volume.nii", "rb").read()
with open("volume.nii", "wb") as file:  # qform_code and sform_code are two 16-bit numbers from byte 252 on
    file.write(data[:252] + struct.pack("<2h", 0, 0) + data[256:])
affine = nib.load("volume.nii").affine
image = sitk.ReadImage("volume.nii")
ras = np.diag([-1, -1, 1]) @ np.array(image.GetDirection()).reshape(3, 3) @ np.diag(image.GetSpacing())
print("METHOD 1   diagonal [0.1, 0.2, 0.3] origin [0, 0, 0]")
print("nibabel    diagonal", np.diag(affine)[:3].round(3).tolist(), "origin", affine[:3, 3].round(3).tolist())
print("SimpleITK  diagonal", np.diag(ras).round(3).tolist(), "origin", list(image.GetOrigin()), "(in the axes of NIfTI)")
mirrored = [bool(np.linalg.det(m) < 0) for m in (affine[:3, :3], ras)]
print("mirrored   nibabel", mirrored[0], "SimpleITK", mirrored[1])
if mirrored != [True, False] or ras[0, 0] > 0:
    sys.exit("changed: no longer as recorded above")
EOF
