#!/usr/bin/env bash
# SimpleITK 2.5.7 (GDCM): a multi-frame CT with a slope per frame gets the first frame's slope throughout.
#
# Expected: DICOM PS3.3 C.7.6.16.1 lets a functional group be shared or stated frame by frame, and the Pixel
#   Value Transformation (C.7.6.16.2.9, Rescale Slope and Intercept) is one of those. Each frame is to be scaled
#   by its own slope, as SimpleITK does where the same slices are single files.
# Seen: stored value 10 in each of three frames with slopes 1, 2 and 4 reads as 10, 10, 10 instead of 10, 20, 40,
#   without a warning. From single files the same slices read as 10, 20, 40.
# Why it matters: scanners that use all 16 bits of every slice write such slopes. Grey values differ by factors
#   along z, a threshold cuts each slice elsewhere, and the picture of one slice looks right.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install -q --disable-pip-version-check SimpleITK==2.5.7 pydicom==3.0.2 numpy==2.4.6
cd "$work"
venv/bin/python - <<'EOF'
import sys
import numpy as np, SimpleITK as sitk
from pydicom.dataset import Dataset, FileMetaDataset
from pydicom.uid import CTImageStorage, EnhancedCTImageStorage, ExplicitVRLittleEndian, generate_uid

def some(**attributes):
    d = Dataset()
    for name, value in attributes.items():
        setattr(d, name, value)
    return d

def image(sop_class, path, samples, **attributes):
    d = some(SOPClassUID=sop_class, SOPInstanceUID=generate_uid(), StudyInstanceUID="1.2.3", SeriesInstanceUID="1.2.4",
             FrameOfReferenceUID="1.2.5", Modality="CT", PatientName="", PatientID="1", InstanceNumber=1, Rows=4, Columns=4,
             SamplesPerPixel=1, PhotometricInterpretation="MONOCHROME2", BitsAllocated=16, BitsStored=16, HighBit=15,
             PixelRepresentation=1, PixelData=samples.tobytes(), **attributes)
    if "NumberOfFrames" in d:
        d.DimensionOrganizationSequence = [some(DimensionOrganizationUID="1.2.6")]
        d.DimensionIndexSequence = [some(DimensionOrganizationUID="1.2.6", DimensionIndexPointer=tag, FunctionalGroupPointer=0x00209111)
                                    for tag in (0x00209056, 0x00209057)]  # Stack ID, In-Stack Position Number
    d.file_meta = FileMetaDataset()
    d.file_meta.TransferSyntaxUID = ExplicitVRLittleEndian
    d.file_meta.MediaStorageSOPClassUID, d.file_meta.MediaStorageSOPInstanceUID = sop_class, d.SOPInstanceUID
    d.save_as(path, enforce_file_format=True)

slopes = [1, 2, 4]
frames, slice_files = [], []
for i, slope in enumerate(slopes):
    frames.append(some(
        PlanePositionSequence=[some(ImagePositionPatient=[0, 0, i * 0.5])],
        FrameContentSequence=[some(StackID="1", InStackPositionNumber=i + 1, DimensionIndexValues=[1, i + 1])],
        PixelValueTransformationSequence=[some(RescaleSlope=slope, RescaleIntercept=0, RescaleType="US")]))
    image(CTImageStorage, f"{i}.dcm", np.full((4, 4), 10, "<i2"), ImagePositionPatient=[0, 0, i * 0.5], PixelSpacing=[0.2, 0.2],
          ImageOrientationPatient=[1, 0, 0, 0, 1, 0], RescaleSlope=slope, RescaleIntercept=0, RescaleType="US")
    slice_files.append(f"{i}.dcm")
shared = some(PixelMeasuresSequence=[some(PixelSpacing=[0.2, 0.2], SliceThickness=0.5)],
              PlaneOrientationSequence=[some(ImageOrientationPatient=[1, 0, 0, 0, 1, 0])])
image(EnhancedCTImageStorage, "frames.dcm", np.full((3, 4, 4), 10, "<i2"), NumberOfFrames=3,
      SharedFunctionalGroupsSequence=[shared], PerFrameFunctionalGroupsSequence=frames)

read = lambda what: sitk.GetArrayFromImage(sitk.ReadImage(what))[:, 0, 0].tolist()
multi, single = read("frames.dcm"), read(slice_files)
print("stated     ", [10 * slope for slope in slopes])
print("one file   ", multi)
print("three files", single)
if multi != [10, 10, 10] or single != [10, 20, 40]:
    sys.exit("changed: no longer as recorded above")
EOF
