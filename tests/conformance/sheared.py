"""Volumes whose axes are not at right angles, which `--resample` brings to axes that are: each voxel is what SimpleITK
interpolates at its place in space."""

import json
from pathlib import Path

import nibabel
import numpy as np
import SimpleITK as sitk

SPACING = np.array([0.5, 0.25, 2.0])
ORIGIN = np.array([10.0, -20.0, 30.0])
# the axes x, y and z as columns: a gantry's tilt, and axes of which no two are at right angles
TILT = np.array([[1, 0, 0], [0, 1, 0.25], [0, 0, 1.0]])
SKEW = np.array([[1, 0.2, -0.1], [0, 1, 0.15], [0.1, 0, 1.0]])
CURVED = np.fromfunction(lambda z, y, x: 40 * np.sin(x / 3) + 30 * np.cos(y / 4) + 25 * np.sin(z + x / 5) + 100, (6, 11, 13))


def unit(axes: np.ndarray) -> np.ndarray:
    return axes / np.linalg.norm(axes, axis=0)


def nifti(path: Path, voxels: np.ndarray, axes: np.ndarray) -> None:
    affine = np.eye(4)
    affine[:3, :3] = axes * SPACING
    affine[:3, 3] = ORIGIN
    image = nibabel.Nifti1Image(voxels.T, affine)
    image.header.set_xyzt_units("mm")
    nibabel.save(image, path)


def nrrd(path: Path, voxels: np.ndarray, axes: np.ndarray) -> None:
    vectors = " ".join("(" + ",".join(map(repr, v.tolist())) + ")" for v in (axes * SPACING).T)
    kind = {"f4": "float", "i2": "short", "u1": "uchar"}[voxels.dtype.str[1:]]
    sizes = " ".join(map(str, voxels.shape[::-1]))
    head = f"NRRD0004\ntype: {kind}\ndimension: 3\nsizes: {sizes}\nspace: left-posterior-superior\n"
    head += f"space directions: {vectors}\nspace origin: ({','.join(map(str, ORIGIN.tolist()))})\nendian: little\nencoding: raw\n\n"
    path.write_bytes(head.encode() + voxels.tobytes())


def metaimage(path: Path, voxels: np.ndarray, axes: np.ndarray) -> None:
    kind = {"f4": "FLOAT", "i2": "SHORT", "u1": "UCHAR"}[voxels.dtype.str[1:]]
    words = lambda numbers: " ".join(map(repr, numbers))
    head = f"ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\nDimSize = {words(voxels.shape[::-1])}\n"
    head += f"TransformMatrix = {words(axes.T.ravel().tolist())}\nOffset = {words(ORIGIN.tolist())}\n"
    head += f"ElementSpacing = {words(SPACING.tolist())}\nElementType = MET_{kind}\nElementDataFile = LOCAL\n"
    path.write_bytes(head.encode() + voxels.tobytes())


CASES = [
    ("tilt.nii", nifti, TILT, "i2", 0.51),
    ("tilt.nii.gz", nifti, TILT, "u1", 0.51),
    ("skew.nii", nifti, SKEW, "f4", 1e-3),
    ("skew.nrrd", nrrd, SKEW, "f4", 1e-3),
    ("tilt.mha", metaimage, TILT, "u1", 0.51),
    ("skew.mha", metaimage, SKEW, "i2", 0.51),
]


def as_itk(run, alvis: Path, dump: Path, work: Path, name: str, write, axes: np.ndarray, kind: str, near: float) -> str:
    path, axes = work / name, unit(axes)
    voxels = CURVED.round(0 if kind[0] in "iu" else 6).astype(kind)
    write(path, voxels, axes)
    info = json.loads(run(alvis, "info", path, "--json", "--quiet", "--resample"))
    found = np.frombuffer(run(dump, path, "resample=true"), kind).reshape(info["dims"][::-1])
    image = sitk.GetImageFromArray(voxels.astype("f8"))
    image.SetSpacing(SPACING.tolist())
    image.SetOrigin(ORIGIN.tolist())
    image.SetDirection(axes.ravel().tolist())
    grid = sitk.Image(info["dims"], sitk.sitkFloat64)
    directions = np.array(info["directions"]).T
    if not np.allclose(directions.T @ directions, np.eye(3), atol=1e-9):
        raise AssertionError(f"directions {directions}")
    grid.SetSpacing(info["spacing"])
    grid.SetOrigin(info["origin"])
    grid.SetDirection(directions.ravel().tolist())
    expected = sitk.GetArrayFromImage(sitk.Resample(image, grid, sitk.Transform(), sitk.sitkLinear, 0.0))
    # where each voxel of the grid lies in the file's own
    index = np.stack(np.meshgrid(*map(np.arange, info["dims"]), indexing="ij"), -1)[..., ::1]
    world = index * info["spacing"] @ directions.T + info["origin"]
    own = np.moveaxis((world - ORIGIN) @ np.linalg.inv(axes * SPACING).T, (0, 1, 2), (2, 1, 0))
    last = np.array(voxels.shape[::-1]) - 1
    inside = ((own > 1e-6) & (own < last - 1e-6) | (abs(own - own.round()) < 1e-6) & (own.round() >= 0) & (own.round() <= last)).all(-1)
    outside = ((own < -0.02) | (own > last + 0.02)).any(-1)
    wrong = inside & ~(abs(found - expected) <= near)
    if wrong.any() or inside.sum() < voxels.size / 2:
        at = tuple(np.argwhere(wrong)[0]) if wrong.any() else None
        raise AssertionError(f"{int(wrong.sum())} of {int(inside.sum())} voxels differ, the first at {at}")
    fill = {"f": np.nan, "i": -1000, "u": 0}[kind[0]]
    if not (np.isnan(found[outside]) if kind[0] == "f" else found[outside] == fill).all():
        raise AssertionError(f"voxels outside that are not {fill}")
    return f"{int(inside.sum())} voxels as SimpleITK's, {int(outside.sum())} outside"
