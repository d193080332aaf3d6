#!/usr/bin/env bash
# SimpleITK 2.5.7 (GDCM): a multi-frame CT whose frames are not in order along z loses its pixel size in x and y too.
#
# Expected: the frames of a multi-frame image may be stored in any order; DICOM PS3.3 C.7.6.16.2.2 gives each its
#   place (In-Stack Position Number) and C.7.6.16.2.3 its position. Pixel Spacing (C.7.6.16.2.1) is stated once,
#   for all. A reader sorts the frames, or says that it can not; the pixel size in x and y stands in any case.
# Seen: 0.2 x 0.1 x 0.5 mm reads as such with the frames in order. With two frames exchanged, or with one missing
#   from the middle, the spacing is 1 x 1 x 1, without a warning, and the frames stay in the order of the file.
# Why it matters: 1 mm is a plausible voxel. Volumes come out 100 times too large here, and nothing tells.
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
from pydicom.uid import EnhancedCTImageStorage, ExplicitVRLittleEndian, generate_uid

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

def read(path, heights):
    frames = [some(PlanePositionSequence=[some(ImagePositionPatient=[0, 0, z])],
                   FrameContentSequence=[some(StackID="1", InStackPositionNumber=1 + int(2 * z), DimensionIndexValues=[1, 1 + int(2 * z)])])
              for z in heights]
    shared = some(PixelMeasuresSequence=[some(PixelSpacing=[0.1, 0.2], SliceThickness=0.5)],
                  PlaneOrientationSequence=[some(ImageOrientationPatient=[1, 0, 0, 0, 1, 0])],
                  PixelValueTransformationSequence=[some(RescaleSlope=1, RescaleIntercept=0, RescaleType="HU")])
    samples = np.ones((len(heights), 4, 4), "<i2") * np.array([int(2 * z) for z in heights], "<i2")[:, None, None]
    image(EnhancedCTImageStorage, path, samples, NumberOfFrames=len(heights),
          SharedFunctionalGroupsSequence=[shared], PerFrameFunctionalGroupsSequence=frames)
    r = sitk.ReadImage(path)
    print(f"{path:14} z {heights} spacing {r.GetSpacing()} frames {sitk.GetArrayFromImage(r)[:, 0, 0].tolist()}")
    return r.GetSpacing()

in_order = read("in-order.dcm", [0, 0.5, 1, 1.5])
exchanged = read("exchanged.dcm", [0, 1, 0.5, 1.5])
missing = read("missing.dcm", [0, 0.5, 1.5, 2])
if in_order != (0.2, 0.1, 0.5) or exchanged != (1, 1, 1) or missing != (1, 1, 1):
    sys.exit("changed: no longer as recorded above")
EOF
