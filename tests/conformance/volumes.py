"""The volumes that other programs are asked about, read with numpy, TIFF with Pillow (libtiff)."""

import gzip
import io
import zipfile
import zlib
from pathlib import Path

import numpy as np
from PIL import Image, ImageSequence


def _after(path: Path, mark: bytes) -> bytes:
    data = path.read_bytes()
    return data[data.index(mark) + len(mark):]


def _raw(path: Path) -> bytes:
    return path.read_bytes()


def _mha(path: Path) -> bytes:
    return zlib.decompress(_after(path, b"ElementDataFile = LOCAL\n"))


def _nrrd(path: Path) -> bytes:
    return gzip.decompress(_after(path, b"\n\n"))


def _tooth(path: Path) -> bytes:
    return path.with_suffix(".raw").read_bytes()


def _headsq(path: Path) -> bytes:
    return b"".join((path.parent / f"quarter.{i}").read_bytes() for i in range(1, 94))


def _pages(file) -> bytes:
    return b"".join(np.asarray(page).tobytes() for page in ImageSequence.Iterator(Image.open(file)))


def _zip(path: Path) -> bytes:
    with zipfile.ZipFile(path) as archive:
        return _pages(io.BytesIO(archive.read("ketton.tif")))


# name: path, how numpy reads it, type, dims (x, y, z), thresholds, what the command has to be told
VOLUMES = {
    "lobster": ("raw/lobster_301x324x56_uint8.raw", _raw, "u1", (301, 324, 56), [40, 130.5],
                ["--dims", "301,324,56", "--dtype", "u8", "--spacing", "1,1,1.4", "--unit", "mm"]),
    "headsq": ("raw_slices/headsq/quarter.nhdr", _headsq, "<i2", (64, 64, 93), [1150, 500], []),
    "tooth": ("nrrd/tooth.nhdr", _tooth, ">u2", (103, 94, 161), [654, 1000.25], []),
    "lidc2": ("metaimage/LIDC2.mha", _mha, "u1", (256, 256, 133), [59], []),
    "fuel": ("metaimage/fuel.mha", _mha, "u1", (68, 68, 68), [15], []),
    "marschnerlobb": ("metaimage/marschnerlobb.mha", _mha, "u1", (43, 43, 43), [128], []),
    "brain1": ("nrrd/brain1_image.nrrd", _nrrd, "<i2", (256, 256, 25), [394], []),
    # voids in cement, lacunae in bone, pores in limestone: thousands of cells
    "cement": ("tiff/cement_128x128x128.tif", _pages, "u1", (128, 128, 128), [75], []),
    "bone": ("tiff/bone_7H3A_B1.tif", _pages, "u1", (350, 250, 600), [64], []),
    "ketton": ("tiff/ketton.zip", _zip, "u1", (256, 256, 256), [128], []),
    "avf": ("nrrd/avf_float_32.nrrd", _nrrd, "<f4", (74, 93, 20), [740, 100.1], []),
}


def read(data: Path, name: str) -> np.ndarray:
    """The samples of a volume of the shared data, indexed [z, y, x], in the machine's byte order."""
    path, reader, kind, dims, _, _ = VOLUMES[name]
    samples = np.frombuffer(reader(data / path), dtype=kind)
    return samples.reshape(dims[::-1]).astype(np.dtype(kind).newbyteorder("="))


def noise(seed: int, dims: tuple[int, int, int], share: float) -> np.ndarray:
    """White noise of u8 with `share` of it at 128 or more, indexed [z, y, x]."""
    random = np.random.default_rng(seed)
    below = random.integers(0, 128, dims[::-1], dtype=np.uint8)
    return np.where(random.random(dims[::-1]) < share, below + np.uint8(128), below)
