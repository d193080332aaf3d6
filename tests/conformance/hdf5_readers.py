"""What h5py, netCDF4 and nibabel read of the fixtures in tests/fixtures/hdf5, as arrays indexed [z, y, x]."""
from pathlib import Path

import h5py
import netCDF4
import nibabel
import numpy as np


def dataset(name: str, order: str = "zyx", part=()):
    """A dataset whose axes are in that order, once a part of it is taken."""

    def read(path: Path) -> np.ndarray:
        with h5py.File(path) as file:
            found = np.asarray(file[name].astype("f4")[...] if path.name == "bfloat16.h5" else file[name][part or ...])
        return np.squeeze(found).transpose([order.index(axis) for axis in "zyx"])

    return read


def by_netcdf(path: Path) -> np.ndarray:
    with netCDF4.Dataset(path) as file:
        variable = file["ct"]
        found = variable[...]
        values = np.ma.filled(found.astype("f8"), np.nan) if np.ma.is_masked(found) else np.asarray(found)
        return values.transpose([variable.dimensions.index(axis) for axis in "zyx"])


def by_nibabel(path: Path) -> np.ndarray:
    image = nibabel.load(path)
    values = np.array(image.dataobj)
    with h5py.File(path) as file:
        stored = file["minc-2.0/image/0/image"]
        names = stored.attrs["dimorder"].decode().split(",")
        low, high = stored.attrs.get("valid_range", (0, 65535))
        # nibabel cuts what is out of the valid range to its ends, by the format it stands for nothing
        values[(stored[...] < low) | (stored[...] > high)] = np.nan
    return values.transpose([names.index(axis + "space") for axis in "zyx"])


IMAGE = "DataSet/ResolutionLevel 0/TimePoint 0/Channel {}/Data"
ALL = (slice(None),) * 3
V = dataset("v")

# name, reader, what the command has to be told
FIXTURES = [
    *[(name + ".h5", V, []) for name in ("one_entry", "bits12", "bits12_nbit", "bits11_be", "bits11_be_nbit", "f16", "i64", "bool")],
    *[(name + ".h5", V, []) for name in ("bfloat16", "scaleoffset_u16", "scaleoffset_f32", "block_8192", "size_um", "never")],
    *[(f"partial_{name}.h5", V, []) for name in ("old", "fixed", "extensible", "tree")],
    ("matlab.mat", V, []),
    ("size_group.h5", dataset("scan/ct"), []),
    ("packed_coordinates.nc", dataset("ct"), []),
    ("axistags_xyz.h5", dataset("v", "xyz"), []),
    ("labels_yxz.h5", dataset("v", "yxz"), []),
    ("openpmd_xyz.h5", dataset("v", "xyz"), []),
    ("nexus_xyz.nxs", dataset("entry/data/data", "xyz"), []),
    ("dream3d.dream3d", dataset("DataContainers/Image/CellData/ct"), []),
    ("channels_tzyxc.h5", dataset("v", part=(1, *ALL, 1)), ["--channel", "1", "--time", "1"]),
    ("imaris.ims", dataset(IMAGE.format(1), part=(slice(3), slice(17), slice(19))), ["--channel", "1"]),
    ("cf_yzx.nc", by_netcdf, []),
    ("falling.nc", by_netcdf, []),
    ("unsigned.nc", by_netcdf, []),
    *[(name + ".mnc", by_nibabel, []) for name in ("slices", "rows", "columns", "whole", "range")],
]


def place_of_minc(info: dict, path: Path) -> str:
    """The world's place of voxels along each axis is that of nibabel."""
    image = nibabel.load(path)
    with h5py.File(path) as file:
        names = file["minc-2.0/image/0/image"].attrs["dimorder"].decode().split(",")
    columns = [image.affine[:3, names.index(axis + "space")] for axis in "xyz"]
    found = [np.array(direction) * step for direction, step in zip(info["directions"], info["spacing"])]
    if not np.allclose(found, columns) or not np.allclose(info["origin"], image.affine[:3, 3]):
        raise AssertionError(f"{found} at {info['origin']}, expected {columns} at {image.affine[:3, 3]}")
    return str(info["spacing"])
