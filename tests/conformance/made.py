"""Files by other writers whose headers state more than size and type: what the samples and the place must be.

Each case is a title, a path, what the command has to be told, the samples indexed [z, y, x] and the size of a voxel.
"""

from pathlib import Path

import nibabel
import numpy as np
import pydicom
import SimpleITK as sitk
from pydicom.dataset import Dataset, FileDataset, FileMetaDataset
from pydicom.sequence import Sequence
from pydicom.uid import CTImageStorage, ExplicitVRLittleEndian, generate_uid
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonDataModel import vtkImageData
from vtkmodules.vtkFiltersCore import vtkCellCenters
from vtkmodules.vtkIOXML import vtkXMLImageDataWriter

SAMPLES = np.arange(4 * 5 * 6, dtype=np.uint16).reshape(4, 5, 6) * 7


def cells(work: Path):
    """Image data with cell scalars, as PyVista and ParaView save it; its origin is the centre of the first cell."""
    image = vtkImageData()
    image.SetDimensions(7, 6, 5)
    image.SetSpacing(0.5, 1.0, 2.0)
    image.SetOrigin(10, 20, 30)
    array = numpy_to_vtk(SAMPLES.ravel(), deep=True)
    array.SetName("values")
    image.GetCellData().SetScalars(array)
    path = work / "cells.vti"
    writer = vtkXMLImageDataWriter()
    writer.SetFileName(str(path))
    writer.SetInputData(image)
    writer.Write()
    centers = vtkCellCenters()
    centers.SetInputData(image)
    centers.Update()
    return "cell data of VTK", path, [], SAMPLES, (0.5, 1.0, 2.0), centers.GetOutput().GetPoint(0)


def degenerate(work: Path):
    """An sform with a flat axis beside a sound qform."""
    image = nibabel.Nifti1Image(SAMPLES.transpose(2, 1, 0), None)
    header = image.header
    header.set_qform(np.diag([0.7, 0.7, 11, 1]), code=1)
    header.set_xyzt_units("mm")
    path = work / "degenerate.nii"
    nibabel.save(image, path)
    data = bytearray(path.read_bytes())
    rows = np.array([[-0.7, 0, 0, 5], [0, 0.7, 0, 6], [0, 0, 0, 7]], "<f4")
    data[254:256] = b"\1\0"
    data[280:328] = rows.tobytes()
    path.write_bytes(data)
    zooms = nibabel.load(path).header.get_zooms()
    return "sform without a third axis", path, [], SAMPLES, tuple(float(str(z)) for z in zooms), (0, 0, 0)


def times(work: Path):
    """The second of two times."""
    path = work / "times.nii.gz"
    both = np.stack([SAMPLES, SAMPLES + 1], axis=-1).transpose(2, 1, 0, 3)
    nibabel.save(nibabel.Nifti1Image(both, np.diag([1, 2, 3, 1])), path)
    return "a time of NIfTI", path, ["--time", "1"], nibabel.load(path).dataobj[..., 1].T, (1, 2, 3), (0, 0, 0)


def one_entry(work: Path):
    path = work / "one.nrrd"
    image = sitk.GetImageFromArray(SAMPLES[None], isVector=False)
    image.SetSpacing((0.5, 1, 2, 9))
    sitk.WriteImage(image, str(path))
    return "four axes, one of one entry", path, [], sitk.GetArrayFromImage(sitk.ReadImage(str(path)))[0], (0.5, 1, 2), (0, 0, 0)


def dicom(frames: int) -> FileDataset:
    meta = FileMetaDataset()
    meta.MediaStorageSOPClassUID, meta.MediaStorageSOPInstanceUID = CTImageStorage, generate_uid()
    meta.TransferSyntaxUID = ExplicitVRLittleEndian
    ds = FileDataset(None, {}, file_meta=meta, preamble=b"\0" * 128)
    ds.SOPClassUID, ds.SOPInstanceUID = CTImageStorage, meta.MediaStorageSOPInstanceUID
    ds.Modality, ds.SeriesInstanceUID, ds.SeriesNumber = "CT", "1.2.3", 1
    ds.SamplesPerPixel, ds.PhotometricInterpretation = 1, "MONOCHROME2"
    ds.Rows, ds.Columns = SAMPLES.shape[1:]
    ds.BitsAllocated, ds.BitsStored, ds.HighBit, ds.PixelRepresentation = 16, 16, 15, 0
    ds.PixelSpacing, ds.NumberOfFrames = [0.25, 0.5], frames
    ds.ImagePositionPatient, ds.ImageOrientationPatient = [-4, -3, 2], [1, 0, 0, 0, 1, 0]
    ds.PixelData = SAMPLES[:frames].tobytes()
    return ds


def cone_beam(work: Path):
    """One position for all frames, and their distance."""
    ds = dicom(len(SAMPLES))
    ds.SpacingBetweenSlices = 0.3
    path = work / "cone_beam.dcm"
    ds.save_as(path, enforce_file_format=True)
    image = sitk.ReadImage(str(path))
    return "frames at one position", path, [], sitk.GetArrayFromImage(image), image.GetSpacing(), image.GetOrigin()


def real_world(work: Path):
    """The mapping to real-world values, as PS3.3 C.7.6.16.2.11 defines it."""
    ds = dicom(len(SAMPLES))
    ds.SpacingBetweenSlices = 0.3
    item = Dataset()
    item.RealWorldValueIntercept, item.RealWorldValueSlope = -3.0, 0.5
    item.add_new("RealWorldValueFirstValueMapped", "US", 0)
    item.add_new("RealWorldValueLastValueMapped", "US", 65535)
    ds.RealWorldValueMappingSequence = Sequence([item])
    path = work / "real_world.dcm"
    ds.save_as(path, enforce_file_format=True)
    values = pydicom.dcmread(path).pixel_array * 0.5 - 3.0
    return "real-world values", path, [], values.astype("f4"), (0.5, 0.25, 0.3), (-4, -3, 2)


def analyze(work: Path):
    """ANALYZE 7.5 as nibabel writes it."""
    path = work / "old.hdr"
    image = nibabel.AnalyzeImage(SAMPLES.astype("i2").transpose(2, 1, 0), np.diag([0.7, 0.7, 2, 1]))
    image.header["pixdim"][1:4] = [0.7, 0.7, 2]
    nibabel.save(image, work / "old.img")
    expected = np.asanyarray(nibabel.load(path).dataobj).transpose(2, 1, 0)
    return "ANALYZE of nibabel", path, [], expected, (0.7, 0.7, 2), (0, 0, 0)


def cases(work: Path):
    made = [cells, degenerate, times, one_entry, cone_beam, real_world, analyze]
    return [case(work) for case in made]
