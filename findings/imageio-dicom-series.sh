#!/usr/bin/env bash
# imageio 2.38.1: the DICOM plugin gives a coronal series a slice distance of 0, and orders slices by their number.
#
# Expected: DICOM PS3.3 C.7.6.2.1.1: Image Position and Image Orientation (Patient) say where a slice lies; Instance
#   Number (C.7.6.1.1.1) only identifies it. volread's "sampling" is the distance of the samples.
# Seen: the distance is that of the z coordinates, whatever the orientation: right, 0.5, for axial slices and 0.0 for
#   coronal and sagittal ones, without a warning. And slices stored from the top down are returned in the order of
#   their numbers, with the same sampling and nothing that says so: the volume is mirrored.
# Why it matters: volumes in cubic millimetres are 0, or a left-handed fibre becomes a right-handed one. The plugin is
#   marked as deprecated, but it is what imageio.volread(folder, "DICOM") still runs.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install -q --disable-pip-version-check imageio==2.38.1 pydicom==3.0.2 numpy==2.4.6
cd "$work"
venv/bin/python -W ignore - <<'EOF'
import os, sys
import imageio.v2 as imageio, numpy as np
from pydicom.dataset import Dataset, FileMetaDataset
from pydicom.uid import CTImageStorage, ExplicitVRLittleEndian, generate_uid

def read(name, orientation, positions):
    os.mkdir(name)
    for i, position in enumerate(positions):
        d = Dataset()
        d.SOPClassUID, d.SOPInstanceUID = CTImageStorage, generate_uid()
        d.StudyInstanceUID, d.SeriesInstanceUID, d.FrameOfReferenceUID = "1.2.3", "1.2.4", "1.2.5"
        d.Modality, d.PatientName, d.PatientID, d.InstanceNumber = "CT", "", "1", i + 1
        d.ImagePositionPatient, d.ImageOrientationPatient, d.PixelSpacing = list(position), orientation, [0.2, 0.1]
        d.Rows, d.Columns, d.SamplesPerPixel, d.PhotometricInterpretation = 4, 3, 1, "MONOCHROME2"
        d.BitsAllocated, d.BitsStored, d.HighBit, d.PixelRepresentation = 16, 16, 15, 1
        d.RescaleSlope, d.RescaleIntercept = 1, 0
        d.PixelData = np.full((4, 3), round(2 * sum(position)), "<i2").tobytes()  # height in steps of 0.5 mm
        d.file_meta = FileMetaDataset()
        d.file_meta.TransferSyntaxUID = ExplicitVRLittleEndian
        d.file_meta.MediaStorageSOPClassUID, d.file_meta.MediaStorageSOPInstanceUID = CTImageStorage, d.SOPInstanceUID
        d.save_as(f"{name}/{i}.dcm", enforce_file_format=True)
    volume = imageio.volread(name, "DICOM", progress=False)
    print(f"{name:9} sampling {volume.meta['sampling']}, heights of the slices {volume[:, 0, 0].tolist()}")
    return volume.meta["sampling"][0], int(volume[0, 0, 0])

axial = read("axial", [1, 0, 0, 0, 1, 0], [(0, 0, 0.5 * i) for i in range(4)])
top_down = read("top-down", [1, 0, 0, 0, 1, 0], [(0, 0, 1.5 - 0.5 * i) for i in range(4)])
coronal = read("coronal", [1, 0, 0, 0, 0, -1], [(0, 0.5 * i, 0) for i in range(4)])
if (axial, top_down, coronal) != ((0.5, 0), (0.5, 3), (0.0, 0)):
    sys.exit("changed: no longer as recorded above")
EOF
