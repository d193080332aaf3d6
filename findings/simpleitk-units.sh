#!/usr/bin/env bash
# SimpleITK 2.5.7: 100 micrometres read as 0.1 from NIfTI, but as 100 from NRRD and MetaImage.
#
# Expected: each of the formats states the unit of its sizes: NIfTI in xyzt_units (nifti1.h), NRRD in "space units"
#   (format.html, section "Space and orientation information"), MetaImage in DistanceUnits. A library that
#   converts the sizes of one into millimetres does so with the others, or leaves all as they are.
# Seen: of the same volume with voxels of 100 micrometres, SimpleITK makes 0.1 (millimetres) if it is a NIfTI file
#   and 100 if it is an NRRD or MetaImage file. Nothing is said. Converting the one into the other changes the size:
#   a NIfTI file written from the NRRD file says 100 mm.
# Why it matters: micro-CT uses micrometres. Volumes are wrong by 1e9 in either direction, depending on a suffix.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install -q --disable-pip-version-check SimpleITK==2.5.7 nibabel==5.4.2 pynrrd==1.1.3 numpy==2.4.6
cd "$work"
venv/bin/python - <<'EOF'
import sys
import nibabel as nib, nrrd, numpy as np, SimpleITK as sitk

volume = np.zeros((4, 4, 4), np.uint8)
nifti = nib.Nifti1Image(volume, np.diag([100, 100, 100, 1]))
nifti.header.set_xyzt_units("micron")
nib.save(nifti, "volume.nii")
nrrd.write("volume.nrrd", volume, {"space dimension": 3, "space directions": np.eye(3) * 100, "space units": ["um"] * 3})
volume.tofile("volume.raw")
with open("volume.mhd", "w") as file:
    file.write("ObjectType = Image\nNDims = 3\nDimSize = 4 4 4\nDistanceUnits = um\nElementSpacing = 100 100 100\n"
               "ElementType = MET_UCHAR\nElementDataFile = volume.raw\n")
sitk.WriteImage(sitk.ReadImage("volume.nrrd"), "converted.nii")
seen = {}
for path in ("volume.nii", "volume.nrrd", "volume.mhd"):
    seen[path] = round(sitk.ReadImage(path).GetSpacing()[0], 6)
    print(f"{path:12} says 100 um, SimpleITK reads {seen[path]}")
header = nib.load("converted.nii").header
print("volume.nrrd as NIfTI:", header.get_zooms()[0], header.get_xyzt_units()[0])
if list(seen.values()) != [0.1, 100, 100] or header.get_xyzt_units()[0] != "mm" or header.get_zooms()[0] != 100:
    sys.exit("changed: no longer as recorded above")
EOF
