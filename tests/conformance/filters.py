"""What filters make of random volumes of each type, beside what numpy makes of them: whole numbers to the last bit,
floats to 1e-5 of their size."""

from pathlib import Path

import numpy as np

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


# filters as the program is told them, and in numpy
FILTERS = [
    (["invert"], inverted),
    (["clamp 20,101"], lambda v: between(v, 20, 101)),
    *[([f"downsample {n}"], lambda v, n=n: blocks(v, n)) for n in (2, 3, 5)],
    (["clamp 20,101", "downsample 2", "invert"], lambda v: inverted(blocks(between(v, 20, 101), 2))),
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
    near = 1e-5 if wanted.dtype.kind == "f" else 0
    wrong = ~np.isclose(found, wanted, rtol=near, atol=0, equal_nan=True)
    if wrong.any():
        at = tuple(int(i) for i in np.argwhere(wrong)[0])
        raise AssertionError(f"{int(wrong.sum())} voxels differ, the first at {at}: {found[at]}, expected {wanted[at]}")
    return f"{found.size} voxels"
