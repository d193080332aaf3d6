#!/usr/bin/env bash
# SimpleITK 2.5.7 and nibabel 5.4.2: an unused scl_inter of NIfTI shifts the values in one reader, not in the other.
#
# Expected: nifti1.h, "DATA SCALING": if the scl_slope field is nonzero, each value is scl_slope * x + scl_inter;
#   with scl_slope 0 both fields are unused, and the stored values are the values.
# Seen: with scl_slope 0 and scl_inter -1000, SimpleITK takes the slope as 1 and still adds -1000 (and turns the
#   samples into 32-bit floats); nibabel returns the stored values. The same with a slope that is not a number.
# Why it matters: the two most used readers of Python disagree by exactly the offset between Hounsfield units and
#   stored CT numbers, so either looks plausible, and a threshold found with one is wrong with the other.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install -q --disable-pip-version-check SimpleITK==2.5.7 nibabel==5.4.2 numpy==2.4.6
cd "$work"
venv/bin/python - <<'EOF' 2>&1
import struct, sys
import nibabel as nib, numpy as np, SimpleITK as sitk

nib.save(nib.Nifti1Image(np.array([0, 100, 200, 300], np.int16).reshape(4, 1, 1), np.eye(4)), "plain.nii")
plain, seen = open("plain.nii", "rb").read(), []
for slope in (1.0, 0.0, float("nan")):
    with open("scaled.nii", "wb") as file:  # scl_slope and scl_inter are two floats from byte 112 on
        file.write(plain[:112] + struct.pack("<2f", slope, -1000) + plain[120:])
    itk = sitk.GetArrayFromImage(sitk.ReadImage("scaled.nii")).ravel().tolist()
    nibabel = nib.load("scaled.nii").get_fdata().ravel().tolist()
    print(f"slope {slope}, intercept -1000: SimpleITK {itk} nibabel {nibabel}")
    seen.append((itk, nibabel))
stored, shifted = [0, 100, 200, 300], [-1000, -900, -800, -700]
if seen != [(shifted, shifted), (shifted, stored), (shifted, stored)]:
    sys.exit("changed: no longer as recorded above")
EOF
