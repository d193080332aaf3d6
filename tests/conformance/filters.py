"""What filters make of random volumes of each type, beside what numpy and scipy make of them: whole numbers to the last
bit, floats to 1e-5 of their size, or, where large samples cancel out, 1e-7 of the largest one."""

from pathlib import Path

import numpy as np
from scipy import ndimage

SHAPE = (23, 26, 31)
KINDS = {"u8": "u1", "i8": "i1", "u16": "u2", "i16": "i2", "u32": "u4", "i32": "i4", "f32": "f4", "f64": "f8"}


def volume(kind: str, nan: bool) -> np.ndarray:
    random = np.random.default_rng(5)
    if kind[0] == "f":
        voxels = random.normal(100, 40, SHAPE).astype(kind)
        voxels[random.random(SHAPE) < 0.3 * nan] = np.nan
        return voxels
    ends = np.iinfo(kind)
    return random.integers(ends.min, ends.max, SHAPE, kind, endpoint=True)


def blocks(voxels: np.ndarray, factor: int) -> np.ndarray:
    few = [n // factor for n in voxels.shape]
    whole = voxels[tuple(slice(n * factor) for n in few)].astype("f8")
    parts = whole.reshape(few[0], factor, few[1], factor, few[2], factor)
    if voxels.dtype.kind != "f":
        return np.rint(parts.mean((1, 3, 5))).astype(voxels.dtype)
    numbers = ~np.isnan(parts)
    with np.errstate(invalid="ignore"):
        mean = np.where(numbers, parts, 0).sum((1, 3, 5)) / numbers.sum((1, 3, 5))
    return mean.astype(voxels.dtype)


def inverted(voxels: np.ndarray) -> np.ndarray:
    if voxels.dtype.kind == "f":
        return -voxels
    ends = np.iinfo(voxels.dtype)
    return (int(ends.min) + int(ends.max) - voxels.astype("i8")).astype(voxels.dtype)


def between(voxels: np.ndarray, low: float, high: float) -> np.ndarray:
    return np.clip(voxels, voxels.dtype.type(low), voxels.dtype.type(high))


def smoothed(voxels: np.ndarray, sigma) -> np.ndarray:
    """By a Gaussian; what is NaN stays, and counts for no other voxel: the mean is of the others."""
    kind = "f8" if voxels.dtype == "f8" else "f4"
    numbers = ~np.isnan(voxels)
    along = sigma[::-1] if isinstance(sigma, tuple) else sigma
    blur = lambda v: ndimage.gaussian_filter(v.astype("f8"), along, mode="nearest", truncate=4)
    if numbers.all():
        return blur(voxels).astype(kind)
    return np.where(numbers, blur(np.where(numbers, voxels, 0)) / blur(numbers), np.nan).astype(kind)


def median(voxels: np.ndarray, radius: int) -> np.ndarray:
    """Of the numbers in a cube, the lower one of two in the middle; NaN stays."""
    side = 2 * radius + 1
    numbers = ~np.isnan(voxels)
    if numbers.all():
        return ndimage.median_filter(voxels, side, mode="nearest")
    padded = np.pad(voxels, radius, mode="edge")
    cubes = np.lib.stride_tricks.sliding_window_view(padded, (side,) * 3).reshape(*voxels.shape, -1)
    ordered = np.sort(cubes, axis=-1)  # NaN comes last
    middle = (np.maximum((~np.isnan(cubes)).sum(-1), 1) - 1) // 2
    return np.where(numbers, np.take_along_axis(ordered, middle[..., None], -1)[..., 0], np.nan).astype(voxels.dtype)


# filters as the program is told them, and in numpy
FILTERS = [
    (["invert"], inverted),
    (["clamp 20,101"], lambda v: between(v, 20, 101)),
    *[([f"downsample {n}"], lambda v, n=n: blocks(v, n)) for n in (2, 3, 5)],
    (["clamp 20,101", "downsample 2", "invert"], lambda v: inverted(blocks(between(v, 20, 101), 2))),
    *[([f"smooth {s}"], lambda v, s=s: smoothed(v, s)) for s in (0.5, 1, 2.7)],
    (["smooth 2,1,0.4"], lambda v: smoothed(v, (2, 1, 0.4))),
    *[([f"median {r}"], lambda v, r=r: median(v, r)) for r in (1, 2)],
    (["median 1", "smooth 1", "downsample 2"], lambda v: blocks(smoothed(median(v, 1), 1), 2)),
    (["invert", "downsample 4", "clamp 10,90"], lambda v: between(blocks(inverted(v), 4), 10, 90)),
]
CASES = [
    (f"{kind}{' with NaN' * nan}: {', '.join(names)}", kind, nan, names, expected)
    for kind in KINDS
    for nan in ([False, True] if kind[0] == "f" else [False])
    for names, expected in FILTERS
]


def as_numpy(run, dump: Path, work: Path, kind: str, nan: bool, names: list[str], expected) -> str:
    voxels = volume(KINDS[kind], nan)
    path = work / "random.raw"
    voxels.tofile(path)
    dims = ",".join(map(str, SHAPE[::-1]))
    made = run(dump, path, f"dims={dims}", f"dtype={kind}", *[f"filter={name}" for name in names])
    wanted = expected(voxels)
    found = np.frombuffer(made, wanted.dtype)
    if found.size != wanted.size:
        raise AssertionError(f"{found.size} voxels, expected {wanted.shape}")
    found = found.reshape(wanted.shape)
    near, rounded = (1e-5, 1e-7 * float(np.nanmax(abs(voxels.astype("f8"))))) if wanted.dtype.kind == "f" else (0, 0)
    wrong = ~np.isclose(found, wanted, rtol=near, atol=rounded, equal_nan=True)
    if wrong.any():
        at = tuple(int(i) for i in np.argwhere(wrong)[0])
        raise AssertionError(f"{int(wrong.sum())} voxels differ, the first at {at}: {found[at]}, expected {wanted[at]}")
    return f"{found.size} voxels"
