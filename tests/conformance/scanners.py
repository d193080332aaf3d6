"""Files of scanners and their programs, as the readers of each format read them: mrcfile for MRC, itk-ioscanco and aimio-py
for Scanco, nibabel for ANALYZE, Pillow for BMP; numpy for headers beside raw samples, which have no reader of their own.

Of AmiraMesh no reader on PyPI installs without its own build steps (ahds), so its samples are those that the fixtures are
made of.
"""

from pathlib import Path

import itk
import mrcfile
import nibabel
import numpy as np
import py_aimio
from PIL import Image

SIZE = (19, 17, 3)
VOXEL = (0.5, 0.25, 2.0)


def by_mrcfile(path: Path) -> np.ndarray:
    with mrcfile.open(path) as file:
        axes = (file.header.mapc, file.header.mapr, file.header.maps)
        # the array is indexed [section, row, column]
        return np.moveaxis(file.data, (0, 1, 2), [3 - int(axis) for axis in axes[::-1]])


def by_itk(path: Path) -> np.ndarray:
    reader = itk.ImageFileReader[itk.Image[itk.SS, 3]].New()
    reader.SetImageIO(itk.ScancoImageIO.New())
    reader.SetFileName(str(path))
    reader.Update()
    return itk.array_from_image(reader.GetOutput())


def by_aimio(path: Path) -> np.ndarray:
    return py_aimio.read_aim(str(path))[0]


def by_nibabel(path: Path) -> np.ndarray:
    return np.asanyarray(nibabel.AnalyzeImage.from_filename(str(path)).dataobj).transpose(2, 1, 0)


def by_pillow(path: Path) -> np.ndarray:
    return np.stack([np.array(Image.open(p)) for p in sorted(path.glob("*.bmp"))])


def by_raw(name: str, kind: str, skip: int = 0):
    return lambda path: np.fromfile(path.with_name(name), kind, offset=skip).reshape(SIZE[::-1])


def as_made(kind: str):
    z, y, x = np.mgrid[:3, :17, :19]
    v = x * 7 + y * 13 + z * 29
    return lambda _: (v + 0.5 if kind == "f4" else v).astype(kind)


# name, reader, size of a voxel and its unit
FIXTURES = [
    ("u16.mrc", by_mrcfile, (VOXEL, "nm")),
    ("i8.mrc", by_mrcfile, (VOXEL, "nm")),
    ("f16.mrc", by_mrcfile, (VOXEL, "nm")),
    ("i16_zyx_be.mrc", by_mrcfile, (VOXEL, "nm")),
    ("i16.isq", by_itk, ((500, 250, 2000), "um")),
    ("i8.aim", by_aimio, (VOXEL, "mm")),
    ("i16.hdr", by_nibabel, (VOXEL, "mm")),
    ("bmp", by_pillow, ((17.51,) * 3, "um")),
    ("vg.vgi", by_raw("vg.vol", "<u2", 4), (VOXEL, "mm")),
    ("nikon.xtekct", by_raw("nikon.vol", "<f4"), (VOXEL, "mm")),
    ("esrf.vol.info", by_raw("esrf.vol", ">f4"), ((0.55,) * 3, "um")),
    ("ge.pcr", by_raw("ge.vol", "<u2"), ((0.017,) * 3, "mm")),
    ("u16.am", as_made("u2"), (VOXEL, "mm")),
    ("u8_rle.am", as_made("u1"), (VOXEL, "mm")),
    ("f32_zip_be.am", as_made("f4"), (VOXEL, "mm")),
]
