"""Compares what alvis reads with what the usual readers of each format read, voxel by voxel.

    readers.py ALVIS DUMP DATA FIXTURES WORK

ALVIS is the command, DUMP the example dump_voxels, DATA the shared test data, FIXTURES tests/fixtures, WORK a
directory for tile sets. Every volume of DATA is also converted at a threshold and verified against itself. Without
DATA the fixtures alone are compared, and that is said. Ends with a line `N passed, N failed`.

Readers: SimpleITK for MetaImage, NRRD, NIfTI and DICOM (and pydicom, which orders nothing, for the numbers of a
slice), nibabel for NIfTI and MINC, those of scanners.py, tifffile and Pillow for TIFF and PNG, zarr-python, h5py, netCDF4, VTK and numpy,
which is asked about filters, too.
"""

import json
import shutil
import subprocess
import sys
import zipfile
from io import BytesIO
from pathlib import Path

import filters
import h5py
import hdf5_readers
import hdf5plugin  # noqa: F401, h5py finds the filters by it
import made
import nibabel
import numpy as np
import pydicom
import scanners
import sheared
import SimpleITK as sitk
import tifffile
import zarr
from PIL import Image
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkIOXML import vtkXMLImageDataReader

NAMES = {"u1": "u8", "i1": "i8", "u2": "u16", "i2": "i16", "u4": "u32", "i4": "i32", "f4": "f32", "f8": "f64"}


def run(program: Path, *words: str) -> bytes:
    done = subprocess.run([program, *map(str, words)], capture_output=True)
    if done.returncode != 0:
        raise AssertionError(f"exit status {done.returncode}: {done.stderr.decode()[-2000:]}")
    return done.stdout


def natural(path: Path) -> list:
    words = "".join(c if c.isdigit() else f" {c} " for c in path.name).split()
    return [(0, int(w), "") if w.isdigit() else (1, 0, w) for w in words]


# readers: arrays indexed [z, y, x]
def by_itk(path: Path) -> np.ndarray:
    return sitk.GetArrayFromImage(sitk.ReadImage(str(path)))


def by_itk_series(path: Path) -> np.ndarray:
    names = sitk.ImageSeriesReader.GetGDCMSeriesFileNames(str(path))
    return sitk.GetArrayFromImage(sitk.ReadImage(names))


def by_pydicom(path: Path) -> np.ndarray:
    sets = [pydicom.dcmread(p) for p in path.iterdir()]
    row, column = np.split(np.array(sets[0].ImageOrientationPatient, float), 2)
    sets.sort(key=lambda s: np.dot(np.cross(row, column), np.array(s.ImagePositionPatient, float)))
    return np.stack([s.pixel_array * float(s.RescaleSlope) + float(s.RescaleIntercept) for s in sets])


def by_nibabel(path: Path) -> np.ndarray:
    image = nibabel.load(path)
    return np.asanyarray(image.dataobj).transpose(2, 1, 0)


def by_tifffile(path: Path) -> np.ndarray:
    return tifffile.imread(path)


def by_pillow(path: Path) -> np.ndarray:
    with Image.open(path) as image:
        pages = []
        for k in range(image.n_frames):
            image.seek(k)
            pages.append(np.array(image))
    return np.stack(pages)


def by_folder(path: Path) -> np.ndarray:
    names = sorted((p for p in path.iterdir() if p.suffix in (".tif", ".tiff", ".png")), key=natural)
    return np.stack([np.array(Image.open(p)) for p in names])


def by_zip(path: Path) -> np.ndarray:
    with zipfile.ZipFile(path) as archive:
        (name,) = [n for n in archive.namelist() if n.lower().endswith((".tif", ".tiff")) and "__MACOSX" not in n]
        return tifffile.imread(BytesIO(archive.read(name)))


def by_numpy(path: Path) -> np.ndarray:
    array = np.load(path)
    return array if isinstance(array, np.ndarray) else array[array.files[0]]


def by_zarr(path: Path) -> np.ndarray:
    return zarr.open_array(path, mode="r")[...]


def by_pyramid(path: Path) -> np.ndarray:
    group = zarr.open_group(path, mode="r")
    attributes = group.attrs.get("ome", group.attrs)
    return group[attributes["multiscales"][0]["datasets"][0]["path"]][...]


def by_h5py(path: Path) -> np.ndarray:
    found = []
    with h5py.File(path) as file:
        file.visititems(lambda _, item: found.append(item[...]) if getattr(item, "ndim", 0) >= 3 else None)
    return found[0]


def by_vtk(path: Path) -> np.ndarray:
    reader = vtkXMLImageDataReader()
    reader.SetFileName(str(path))
    reader.Update()
    image = reader.GetOutput()
    return vtk_to_numpy(image.GetPointData().GetScalars()).reshape(image.GetDimensions()[::-1])


def by_raw(dims, kind):
    return lambda path: np.fromfile(path, kind).reshape(dims[::-1])


LOBSTER = ["--dims", "301,324,56", "--dtype", "u8"]
HEADSQ = ["--dims", "64,64,93", "--dtype", "u16"]


def by_slices(path: Path) -> np.ndarray:
    names = sorted(path.glob("quarter.*[0-9]"), key=natural)
    return np.stack([np.fromfile(p, "<u2").reshape(64, 64) for p in names])


# path, reader, threshold, what the command has to be told
VOLUMES = [
    ("raw/lobster_301x324x56_uint8.raw", by_raw((301, 324, 56), "u1"), 40, LOBSTER),
    ("raw_slices/headsq", by_slices, 1150, HEADSQ),
    ("raw_slices/headsq/quarter.%d", lambda p: by_slices(p.parent), 1150, HEADSQ),
    ("raw_slices/headsq/quarter.nhdr", lambda p: by_slices(p.parent), 1150, []),
    ("npy/berea_100_to_300.npz", by_numpy, 0.5, []),
    ("tiff/cement_128x128x128.tif", by_tifffile, 75, []),
    ("tiff/shell_225x128x128.tif", by_tifffile, 65, []),
    ("tiff/snow.tif", by_tifffile, 22800, []),
    ("tiff/100_fiberform.tif", by_tifffile, 90, []),
    ("tiff/bone_7H3A_B1.tif", by_pillow, 64, []),
    ("tiff/electrode.tiff", by_tifffile, 43, []),
    ("tiff/ketton.zip", by_zip, 128, []),
    ("tiff_slices/LHDL_3155_D_4_bc", by_folder, 84, []),
    ("nrrd/tooth.nhdr", by_itk, 654, []),
    ("nrrd/brain1_image.nrrd", by_itk, 394, []),
    ("nrrd/avf_float_32.nrrd", by_itk, 740, []),
    ("metaimage/LIDC2.mha", by_itk, 59, []),
    ("metaimage/HeadMRVolume.mhd", by_itk, 41, []),
    ("metaimage/hydrogenAtom.mha", by_itk, 15, []),
    ("metaimage/marschnerlobb.mha", by_itk, 128, []),
    ("metaimage/fuel.mha", by_itk, 15, []),
    ("nifti/engine.nii.gz", by_nibabel, 80, []),
    ("nifti/CT_pitch.nii.gz", by_nibabel, 89, []),
    ("nifti/mni_icbm152_t1_tal_nlin_sym_09a_converted.nii.gz", by_nibabel, 89, []),
    ("dicom/philips_head_phantom_5mm", by_itk_series, 300, []),
    ("dicom/philips_head_phantom_5mm", by_pydicom, -373, []),
    ("dicom/ge_variable_spacing_tilt", None, -300, ["--resample"]),
    ("dicom/bad_sliceincrement_002", None, -900, ["--resample"]),
    ("derived/snow_png16", by_folder, 22800, []),
    ("derived/snow_float32.tif", by_tifffile, 0.348, []),
    ("derived/cement_lzw_be.tif", by_tifffile, 75, []),
    ("derived/cement_deflate_pred_tiled.tif", by_tifffile, 75, []),
    ("derived/snow_be.nhdr", by_itk, 22800, []),
    ("derived/snow_v2.zarr", by_zarr, 22800, []),
    ("derived/snow_v3.zarr", by_zarr, 22800, []),
    ("derived/cement.ome.zarr", by_pyramid, 75, []),
]
# irregular series are refused without --resample, with these words
REFUSED = [("dicom/ge_variable_spacing_tilt", "18.5 degrees"), ("dicom/bad_sliceincrement_002", "missing slice")]


def fixtures(folder: Path):
    """Every fixture that a reader here knows."""
    readers = {".tif": by_tifffile, ".npy": by_numpy, ".npz": by_numpy, ".vti": by_vtk, ".h5": by_h5py, ".nii": by_nibabel}
    for path in sorted(folder.iterdir()):
        reader = readers.get(path.suffix, by_nibabel if path.name.endswith(".nii.gz") else None)
        # ImageJ's one directory and a pair of arrays: tifffile and numpy are asked elsewhere
        if reader and not path.name.startswith("no_") and path.name not in ("u8_two.h5",):
            yield path, reader
    for path in sorted((folder / "zarr").iterdir()):
        # what xarray writes is a group of arrays that are packed
        if not path.name.startswith(("no_", "xarray")):
            yield path, by_pyramid if "ome" in path.name else by_zarr


def same_voxels(alvis: Path, dump: Path, path: Path, reader, arguments: list[str]) -> str:
    words = [f"{a[2:]}={b}" for a, b in zip(arguments[::2], arguments[1::2])]
    info = json.loads(run(alvis, "info", path, "--json", "--quiet", *arguments))
    expected = reader(path)
    expected = expected.reshape(expected.shape[-3:])
    kind = np.dtype(next(k for k, v in NAMES.items() if v == info["dtype"]))
    if kind.kind == expected.dtype.kind == "f":
        expected = expected.astype(kind)
    found = np.frombuffer(run(dump, path, *words), kind).reshape(info["dims"][::-1])
    if found.shape != expected.shape:
        raise AssertionError(f"shape {found.shape}, expected {expected.shape}")
    wrong = ~((found == expected) | ((found != found) & (expected != expected)))
    if wrong.any():
        at = tuple(int(i) for i in np.argwhere(wrong)[0])
        raise AssertionError(f"{int(wrong.sum())} voxels differ, the first at {at}: {found[at]}, expected {expected[at]}")
    return f"{info['format']}, {found.size} voxels of {info['dtype']}"


def as_made(alvis: Path, dump: Path, path: Path, expected, spacing, origin, arguments: list[str]) -> str:
    """Samples, size of a voxel and origin of a file of made.py."""
    info = json.loads(run(alvis, "info", path, "--json", "--quiet", *arguments))
    for name, wanted in (("spacing", spacing), ("origin", origin)):
        if not np.allclose(info[name], wanted, rtol=1e-6, atol=1e-6):
            raise AssertionError(f"{name} {info[name]}, expected {wanted}")
    pairs = zip(arguments[::2], arguments[1::2])
    of_samples = [word for pair in pairs if pair[0] not in ("--spacing", "--unit") for word in pair]
    return same_voxels(alvis, dump, path, lambda _: expected, of_samples)


BODY = np.add.outer(100 * np.arange(4), np.add.outer(10 * np.arange(5), np.arange(6))).astype("u2")
JSON = {"axes": "ZYX", "spacing": 0.2, "unit": "um"}
XYZ = {f"PhysicalSize{a}": s for a, s in zip("XYZ", (0.5, 0.25, 2.0))}


def turned(path: Path, orientation: int) -> None:
    with tifffile.TiffWriter(path) as file:
        for page in BODY:
            file.write(page, metadata=None, contiguous=False, extratags=[(274, "H", 1, orientation, True)])


def itk_tiff(path: Path) -> None:
    image = sitk.GetImageFromArray(BODY)
    image.SetSpacing([0.13, 0.13, 0.5])
    sitk.WriteImage(image, str(path))


def several(path: Path, **more) -> None:
    tifffile.imwrite(path, np.stack([BODY, BODY + 7]), photometric="minisblack", **more)


# name, how it is written, reader or array, spacing and unit as info gives them, what the command has to be told
WRITTEN = [
    ("json.tif", lambda p: tifffile.imwrite(p, BODY, photometric="minisblack", resolution=(1 / 0.13,) * 2, metadata=JSON), by_tifffile, ([0.13, 0.13, 0.2], "um"), []),
    ("itk.tif", itk_tiff, by_itk, ([0.13] * 3, "mm"), []),
    ("top.tif", lambda p: turned(p, 1), by_itk, None, []),
    ("bottom.tif", lambda p: turned(p, 4), by_itk, None, []),
    ("right.tif", lambda p: turned(p, 2), lambda p: tifffile.imread(p)[:, :, ::-1], None, []),
    ("times.tif", lambda p: several(p, metadata={"axes": "TZYX"}), lambda p: tifffile.imread(p)[1], None, ["--time", "1"]),
    ("channels.ome.tif", lambda p: several(p, metadata={"axes": "CZYX", **XYZ}), lambda p: tifffile.imread(p)[1], ([0.5, 0.25, 2], "um"), ["--channel", "1"]),
    ("imagej.tif", lambda p: several(p, imagej=True, metadata={"axes": "TZYX"}), lambda p: tifffile.imread(p)[0], None, ["--time", "0"]),
]

# what people put into tifffile's description, and how it is told
JSON_SIZES = [
    ("voxel.tif", {"voxel_size": [0.5] * 3, "unit": "um"}, ([0.5] * 3, "um")),
    ("named.tif", {"spacing": {"x": 0.5, "y": 0.25, "z": 2.0}, "unit": "um"}, ([0.5, 0.25, 2], "um")),
    ("axes.tif", {"axes": "ZYX", "spacing": [2, 0.25, 0.5], "unit": "um"}, ([0.5, 0.25, 2], "um")),
    ("order.tif", {"spacing": [2, 0.25, 0.5], "unit": "um"}, ([1] * 3, "voxel")),
]
WRITTEN += [
    (name, lambda p, m=members: tifffile.imwrite(p, BODY, photometric="minisblack", metadata=m), by_tifffile, size, [])
    for name, members, size in JSON_SIZES
]
SCALED = {"scale_factor": 0.5, "add_offset": -10}
WRITTEN.append(("scaled.tif", lambda p: tifffile.imwrite(p, BODY, photometric="minisblack", metadata=SCALED), lambda p: tifffile.imread(p) * np.float32(0.5) - 10, None, []))


def written(alvis: Path, dump: Path, work: Path, name: str, write, reader, size, arguments: list[str]) -> str:
    """What a library writes is read as that library, or the one that is asked, reads it."""
    path = work / name
    write(path)
    found = same_voxels(alvis, dump, path, reader, arguments)
    info = json.loads(run(alvis, "info", path, "--json", "--quiet", *arguments))
    if size and (info["spacing"], info["unit"]) != size:
        raise AssertionError(f"{info['spacing']} {info['unit']}, expected {size}")
    return found


def scanner(alvis: Path, dump: Path, path: Path, reader, size) -> str:
    """Samples, size of a voxel and unit of a file of a scanner."""
    found = same_voxels(alvis, dump, path, reader, [])
    info = json.loads(run(alvis, "info", path, "--json", "--quiet"))
    if not np.allclose(info["spacing"], size[0], rtol=1e-6) or info["unit"] != size[1]:
        raise AssertionError(f"{info['spacing']} {info['unit']}, expected {size}")
    return found


def place_of_minc(alvis: Path, path: Path) -> str:
    return hdf5_readers.place_of_minc(json.loads(run(alvis, "info", path, "--json", "--quiet")), path)


def place_of_itk(alvis: Path, path: Path) -> str:
    """Spacing, origin and directions are those of SimpleITK."""
    series = sitk.ImageSeriesReader.GetGDCMSeriesFileNames(str(path)) if path.is_dir() else str(path)
    image = sitk.ReadImage(series)
    info = json.loads(run(alvis, "info", path, "--json", "--quiet"))
    columns = np.array(image.GetDirection()).reshape(3, 3).T
    for name, expected in (("spacing", image.GetSpacing()), ("origin", image.GetOrigin()), ("directions", columns)):
        if not np.allclose(info[name], expected, rtol=1e-6, atol=1e-6):
            raise AssertionError(f"{name} {info[name]}, expected {expected}")
    return str(image.GetSpacing())


def converted(alvis: Path, path: Path, threshold: float, arguments: list[str], out: Path) -> str:
    report = json.loads(run(alvis, "convert", path, out, f"--threshold={threshold}", "--force", "--json", "--quiet", *arguments))
    found = json.loads(run(alvis, "verify", out, "--against", path, "--json", "--quiet", *arguments))
    if not found["ok"] or found["triangles"] != report["triangles"] or report["triangles"] == 0:
        raise AssertionError(f"{found['issues'][:3]}, {report['triangles']} triangles")
    manifest = json.loads((out / "index.json").read_text())
    shutil.rmtree(out)  # what failed stays, to be looked at
    return f"{report['triangles']} triangles, spacing from {manifest['source']['provenance']['spacing']}"


def refused(alvis: Path, path: Path, words: str) -> str:
    done = subprocess.run([alvis, "info", path], capture_output=True, text=True)
    if done.returncode != 2 or words not in done.stderr or "--resample" not in done.stderr:
        raise AssertionError(f"exit status {done.returncode}: {done.stderr}")
    return "refused"


def main() -> int:
    alvis, dump, data, folder, work = (Path(a).resolve() for a in sys.argv[1:6])
    work.mkdir(parents=True, exist_ok=True)
    results = []

    def attempt(title: str, what, *arguments) -> None:
        try:
            print(f"ok {title}: {what(*arguments)}", flush=True)
            results.append(True)
        except Exception as error:  # each case reports, whatever it meets
            print(f"FAILED {title}: {type(error).__name__}: {error}", flush=True)
            results.append(False)

    for path, reader in fixtures(folder):
        attempt(f"fixture {path.name}", same_voxels, alvis, dump, path, reader, [])
    for title, path, arguments, expected, spacing, origin in made.cases(work):
        attempt(title, as_made, alvis, dump, path, expected, spacing, origin, arguments)
    for name, *rest in WRITTEN:
        attempt(f"written {name}", written, alvis, dump, work, name, *rest)
    for name, *rest in sheared.CASES:
        attempt(f"sheared {name}", sheared.as_itk, run, alvis, dump, work, name, *rest)
    for name, *rest in filters.CASES:
        attempt(f"filtered {name}", filters.as_numpy, run, dump, work, *rest)
    for name, reader, arguments in hdf5_readers.FIXTURES:
        path = folder / "hdf5" / name
        attempt(f"fixture {name}", same_voxels, alvis, dump, path, reader, arguments)
        if path.suffix == ".mnc":
            attempt(f"place of {name}", place_of_minc, alvis, path)
    for name, *rest in scanners.FIXTURES:
        attempt(f"fixture {name}", scanner, alvis, dump, folder / "scanners" / name, *rest)
    if not (data / "raw").is_dir():
        print(f"SKIPPED volumes of the shared data: {data} is missing")
    else:
        for name, reader, threshold, arguments in VOLUMES:
            path = data / name
            if reader:
                attempt(f"voxels of {name}", same_voxels, alvis, dump, path, reader, arguments)
            if reader in (by_itk, by_itk_series):
                attempt(f"place of {name}", place_of_itk, alvis, path)
            out = work / f"read_{len(results)}"
            attempt(f"surface of {name}", converted, alvis, path, threshold, arguments, out)
        for name, words in REFUSED:
            attempt(f"refusal of {name}", refused, alvis, data / name, words)
    print(f"{sum(results)} passed, {len(results) - sum(results)} failed")
    return 0 if all(results) else 1


if __name__ == "__main__":
    sys.exit(main())
