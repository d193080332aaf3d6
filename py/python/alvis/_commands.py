"""The commands ``info``, ``convert`` and ``verify`` as functions."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from . import _native
from ._table import Table
from ._tileset import TileSet

Triple = Sequence[float] | float
Filters = Mapping[str, Any] | Iterable[tuple[str, Any]]
Progress = Callable[[str, int, int], object]


@dataclass(frozen=True)
class Info:
    """What is known of a volume once it has been read, or of a tile set."""

    format: str
    """The format of the file, ``array`` for an array, ``alvis-tiles`` for a tile set."""
    dims: tuple[int, int, int]
    """Size in voxels, x, y, z."""
    spacing: tuple[float, float, float]
    """Size of a voxel along x, y, z, in ``unit``."""
    unit: str
    """``m``, ``cm``, ``mm``, ``um``, ``nm``, or ``voxel`` if no size is known."""
    raw: dict[str, Any] = field(repr=False)
    """Everything, as ``alvis info --json`` prints it."""

    @property
    def shape(self) -> tuple[int, int, int]:
        """Size in voxels as NumPy has it: z, y, x."""
        x, y, z = self.dims
        return (z, y, x)

    @property
    def dtype(self) -> str | None:
        """The type of the samples: ``u8``, ``i16``, ``f32``, ...; ``None`` of a tile set."""
        return self.raw.get("dtype")

    @property
    def range(self) -> tuple[float, float] | None:
        """The smallest and the largest sample; ``None`` if none is finite, or of a tile set."""
        low, high = self.raw.get("min"), self.raw.get("max")
        return None if low is None or high is None else (low, high)

    @property
    def otsu(self) -> float | None:
        """Otsu's threshold; ``None`` if all samples are alike, or of a tile set."""
        return self.raw.get("otsu_threshold")

    @property
    def histogram(self) -> list[int]:
        """Voxels in bins of equal width over ``range``; empty of a tile set."""
        return list(self.raw.get("histogram", []))

    @property
    def predicted(self) -> dict[str, Any] | None:
        """The surface to expect: ``threshold``, ``triangles``, ``bytes`` of tiles, ``memory_bytes``, ..."""
        return self.raw.get("predicted")

    @property
    def warnings(self) -> list[str]:
        """What may make numbers wrong."""
        return list(self.raw.get("warnings", []))


@dataclass(frozen=True)
class Conversion:
    """What a conversion made."""

    path: str
    """The directory of the tile set."""
    tiles: int
    """Files."""
    triangles: int
    """Of the whole surface."""
    vertices: int
    """Of the whole surface, each once."""
    objects_count: int
    """Objects: connected material."""
    cells_count: int
    """Cells: pores; the outside is one too."""
    surfaces_count: int
    """Surfaces: one more than they are objects and cells together."""
    warnings: list[str]
    """What may make numbers wrong."""
    raw: dict[str, Any] = field(repr=False)
    """Everything, as ``alvis convert --json`` prints it."""

    @property
    def tileset(self) -> TileSet:
        """The tile set, open for reading."""
        return TileSet(self.path)

    @property
    def cells(self) -> Table:
        """The table of cells."""
        return self.tileset.cells

    @property
    def objects(self) -> Table:
        """The table of objects."""
        return self.tileset.objects

    @property
    def surfaces(self) -> Table:
        """The table of surfaces."""
        return self.tileset.surfaces

    @property
    def components(self) -> Table:
        """The table of components: of a conversion with ``split`` or ``labels``."""
        return self.tileset.components

    @property
    def necks(self) -> Table:
        """The table of necks, the narrowest places between cells that touch: of a conversion with ``split`` or ``labels``."""
        return self.tileset.necks

    @property
    def walls(self) -> Table:
        """The table of walls between cells: of a conversion with ``walls``."""
        return self.tileset.walls


@dataclass(frozen=True)
class Issue:
    """Something that is wrong with a tile set."""

    code: str
    """What it is: ``open_edge``, ``checksum``, ..."""
    severity: str
    """``error`` or ``warning``."""
    path: str
    """The file, and the place in it."""
    message: str
    """What was found, and what was expected."""
    voxel: tuple[float, float, float] | None
    """Where, in voxels, x, y, z, if it is a place."""


@dataclass(frozen=True)
class Report:
    """What the verifier found."""

    ok: bool
    """The surface has no hole, and everything else is as it should be."""
    issues: list[Issue]
    """What is wrong; the first ``max_issues`` of it."""
    raw: dict[str, Any] = field(repr=False)
    """Everything, as ``alvis verify --json`` prints it."""


# options that take no value, or may
_ONLY_FLAGS = {"cap", "force", "invert", "keep_samples", "lod", "resample", "resume", "walls"}
_FLAGS = {*_ONLY_FLAGS, "split"}


_FILTERS = ("smooth", "median", "downsample", "invert", "clamp")


class _Words:
    """The words of a command line."""

    def __init__(self, command: str) -> None:
        self.words: list[str] = [command]

    def add(self, name: str, value: Any) -> None:
        """An option, unless its value is ``None`` or ``False``."""
        option = "--" + name.replace("_", "-")
        if getattr(value, "ndim", 1) == 0:
            value = value.item()
        if name in _ONLY_FLAGS and value is not None:
            if value not in (0, 1):
                raise TypeError(f"{name}: found {value!r}, expected True or False")
            value = bool(value)
        if value is True and name not in _FLAGS:
            raise TypeError(f"{name}: found True, expected a value")
        if value is True:
            self.words.append(option)
        elif value is not None and value is not False:
            self.words.append(f"{option}={_text(value)}")

    def add_input(self, options: Mapping[str, Any], filters: Filters | None) -> None:
        """The options of an input."""
        for name, value in options.items():
            self.add(name, value)
        pairs = filters.items() if isinstance(filters, Mapping) else filters or ()
        for name, value in pairs:
            if name not in _FILTERS:
                raise ValueError(f"filters: found {name!r}, expected {', '.join(_FILTERS)}")
            self.add(name, value)

    def end(self, *paths: str) -> list[str]:
        """All words, with what is no option at the end."""
        return [*self.words, "--", *paths]


def _text(value: Any) -> str:
    if isinstance(value, (str, int, float)):
        return str(value)
    if isinstance(value, os.PathLike):
        return str(os.fspath(value))
    if getattr(value, "ndim", 1) == 0:
        return str(value.item())
    if getattr(value, "ndim", 1) > 1:
        raise TypeError(f"found an array of shape {value.shape}, expected numbers or a path: write it to a file first")
    return ",".join(_text(each) for each in value)


def _crop(crop: Any) -> str | None:
    """``((x0, x1), (y0, y1), (z0, z1))`` as the command takes it; an end may be ``None``."""
    if crop is None or isinstance(crop, str):
        return crop
    for each in crop:
        if isinstance(each, slice) and each.step not in (None, 1):
            raise ValueError(f"crop: found a step of {each.step}, expected all voxels between two ends")
    ends = ((s.start, s.stop) if isinstance(s, slice) else s for s in crop)
    return ",".join(f"{'' if a is None else a}:{'' if b is None else b}" for a, b in ends)


def _source(volume: Any) -> tuple[str | None, Any]:
    """The path of a volume, or else what Python has of it."""
    if isinstance(volume, (str, os.PathLike)):
        return str(os.fspath(volume)), None
    path = _zarr_path(volume)
    if path is not None:
        return path, None
    if tuple(getattr(volume, "dims", ()))[:3] == ("x", "y", "z"):
        raise TypeError("volume: found the axes x, y, z, expected z, y, x: `array.transpose('z', 'y', 'x')` has these")
    if any(hasattr(volume, name) for name in ("__array_interface__", "__array_struct__", "__dlpack__")):
        import numpy

        if numpy.ma.is_masked(volume):
            # its mask would be passed over
            raise TypeError("volume: found masked voxels, expected an array without a mask: `array.filled(value)` is one")
        return None, numpy.asarray(volume)
    if volume is None:
        raise TypeError("volume: found None, expected a path or an array with the axes z, y, x")
    return None, volume


def _zarr_path(array: Any) -> str | None:
    """Where a Zarr array of this machine lies, so that its chunks are read without Python."""
    # some types of C have no module
    if (type(array).__module__ or "").split(".")[0] != "zarr":
        return None
    store = getattr(array, "store", None)
    kind = type(store).__name__
    if kind == "LocalStore":
        root = getattr(store, "root", None)
    elif kind in ("DirectoryStore", "NestedDirectoryStore"):
        root = getattr(store, "path", None)
    else:
        root = None
    return None if root is None else os.path.join(root, getattr(array, "path", ""))


def info(
    volume: Any,
    *,
    threshold: float | str | None = None,
    spacing: Triple | None = None,
    unit: str | None = None,
    crop: Any = None,
    filters: Filters | None = None,
    roi: str | None = None,
    roi_fill: str | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
    **options: Any,
) -> Info:
    """Reads a volume once: range, histogram, thresholds and the surface to expect. Of a tile set: what it is.

    ``volume`` and the options of inputs are those of :func:`convert`; ``threshold`` is what the surface is predicted
    for, by default Otsu's.

    >>> import alvis, numpy
    >>> found = alvis.info(numpy.arange(24000, dtype="u2").reshape(20, 30, 40), spacing=(0.1, 0.1, 0.2), unit="mm")
    >>> found.dims, found.shape, found.range
    ((40, 30, 20), (20, 30, 40), (0.0, 23999.0))
    """
    words = _Words("info")
    words.add_input(options, filters)
    rest = {"spacing": spacing, "unit": unit, "crop": _crop(crop), "roi": roi, "roi_fill": roi_fill, "threads": threads}
    words.add_input({"threshold": threshold, **rest}, None)
    path, array = _source(volume)
    raw = json.loads(_native.call(words.end(path or "array"), array, "array", "", progress))
    (dx, dy, dz), (sx, sy, sz) = raw["dims"], raw["spacing"]
    return Info(raw["format"], (dx, dy, dz), (sx, sy, sz), raw["unit"], raw)


def convert(
    volume: Any,
    out: str | os.PathLike[str],
    *,
    threshold: float | str,
    spacing: Triple | None = None,
    unit: str | None = None,
    macrocube: Triple = 64,
    memory: int | str = "1GiB",
    threads: int | None = None,
    ambiguous: str = "separate",
    cap: bool = False,
    min_voxels: int = 0,
    labels: str | os.PathLike[str] | None = None,
    split: float | bool = False,
    split_h: float | None = None,
    split_min_radius: float | None = None,
    walls: bool = False,
    crop: Any = None,
    filters: Filters | None = None,
    roi: str | None = None,
    roi_fill: str | None = None,
    table_unit: str | None = None,
    parquet: bool = False,
    primitives: str | None = None,
    encoding: str | None = None,
    layout: str | None = None,
    lod: bool = False,
    force: bool = False,
    resume: bool = False,
    name: str = "array",
    progress: Progress | None = None,
    **options: Any,
) -> Conversion:
    """Converts a volume to a tile set in the directory ``out``.

    :param volume: a path of any format that the command reads; a NumPy array of shape (z, y, x), with any strides, of
        bool, 8, 16 or 32 bits, float16, float32 or float64, in either byte order, which is read where it is: do not
        write to it meanwhile; a Zarr array, whose chunks are read from its directory if it has one here; or whatever
        else has ``shape``, ``dtype`` and slices, such as an HDF5 dataset, a Zarr array far away or in memory, or a Dask
        array, which is copied through Python, block by block, to a temporary file.
    :param threshold: a voxel is material if its value is at least this; or ``"otsu"``, ``"peaks"``, ``"li"``,
        ``"triangle"``, ``"porosity=31%"``.
    :param spacing: size of a voxel along x, y, z, in ``unit``; one number if they are the same. Overrides the file.
    :param unit: of ``spacing``: ``m``, ``cm``, ``mm``, ``um``, ``nm`` or ``voxel``.
    :param macrocube: cubes along an edge of a tile, or along x, y, z.
    :param memory: limit of memory: bytes, or as in ``"2GiB"``. An array that is in memory does not count.
    :param threads: worker threads; by default one per core. What is made does not depend on them.
    :param ambiguous: ``"separate"`` or ``"join"`` the two material corners of an ambiguous face.
    :param cap: close the surface half a voxel outside the volume's faces.
    :param min_voxels: leave out objects and cells of fewer voxels.
    :param labels: file of integers of the same size, in any format that the command reads: cells are its labels.
    :param split: cut cells at necks narrower than this share of the smaller of the two radii; ``True`` for 0.8.
    :param split_h: with ``split``: how much deeper than its saddle a cell is at least, in voxels.
    :param split_min_radius: with ``split``: radius in voxels below which nothing is a cell of its own.
    :param walls: measure the walls between cells, and count the neighbours of each.
    :param crop: ``((x0, x1), (y0, y1), (z0, z1))`` in voxels, half-open; ``None`` for an end of the volume.
    :param filters: by name, in their order: ``{"median": 1, "smooth": 1.5}``; of ``smooth``, ``median``,
        ``downsample``, ``invert`` (``True``) and ``clamp`` (a pair).
    :param roi: the part that counts: ``"cylinder"``, ``"cylinder:CX,CY,R"`` in voxels or ``"mask:FILE"``.
    :param roi_fill: what is outside of it: ``"material"`` or ``"air"``.
    :param table_unit: unit of lengths in tables and measures.
    :param parquet: write the tables as Parquet, too.
    :param primitives: ``"strips"`` or ``"triangles"``.
    :param encoding: ``"float"``, ``"quantized"`` or ``"meshopt"``.
    :param layout: ``"auto"``, ``"nodes"`` or ``"merged"``.
    :param lod: add levels of detail.
    :param force: replace a tile set that is in the directory.
    :param resume: go on with a conversion that was interrupted; its input and options must be the same.
    :param name: what the tile set calls an array that it was made from.
    :param progress: called in this thread with the stage, the steps that are done and the steps in all (0 if that is
        not known), some times a second. What it raises stops the work, as Ctrl-C does.
    :param options: other options of the command for files: ``dims``, ``dtype``, ``endian``, ``offset``, ``series``,
        ``resample``, ``dataset``, ``level``, ``channel``, ``time``, ``io``.

    Work is done without the interpreter's lock. Warnings are ``AlvisWarning``. If the work fails or is stopped, nothing
    is left under a final name; layers that are done are kept, for ``resume=True`` to go on.

    >>> import alvis, numpy, tempfile
    >>> foam = numpy.full((24, 24, 24), 200, "u1")
    >>> foam[8:16, 8:16, 8:16] = 0
    >>> made = alvis.convert(foam, tempfile.mkdtemp(), threshold=100)
    >>> made.cells_count, made.objects_count
    (1, 1)
    >>> int(made.cells["voxels"][0])
    512
    """
    words = _Words("convert")
    words.add_input(options, filters)
    given = {
        "threshold": threshold,
        "spacing": spacing,
        "unit": unit,
        "macrocube": macrocube,
        "memory": memory,
        "threads": threads,
        "ambiguous": ambiguous,
        "cap": cap,
        "min_voxels": min_voxels,
        "labels": labels,
        "split": split,
        "split_h": split_h,
        "split_min_radius": split_min_radius,
        "walls": walls,
        "crop": _crop(crop),
        "roi": roi,
        "roi_fill": roi_fill,
        "table_unit": table_unit,
        "tables": "csv,parquet" if parquet else None,
        "primitives": primitives,
        "encoding": encoding,
        "layout": layout,
        "lod": lod,
        "force": force,
        "resume": resume,
    }
    words.add_input(given, None)
    path, array = _source(volume)
    directory = os.fspath(out)
    again = "convert(..., resume=True)"
    raw = json.loads(_native.call(words.end(path or name, directory), array, name, again, progress))
    return Conversion(
        directory,
        raw["tiles"],
        raw["triangles"],
        raw["vertices"],
        raw["objects"],
        raw["cells"],
        raw["surfaces"],
        raw["warnings"],
        raw,
    )


def verify(
    out: str | os.PathLike[str],
    *,
    against: Any = None,
    max_issues: int = 1000,
    name: str = "array",
    spacing: Triple | None = None,
    unit: str | None = None,
    roi: str | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
    **options: Any,
) -> Report:
    """Rebuilds the surface from the tiles and proves that it has no hole.

    With ``against``, the volume that it was made from, in any form that :func:`convert` takes, it also proves that the
    surface is that of the volume. That something is wrong with the tiles is no exception: see ``ok`` and ``issues``.

    Raises ``MissingFileError`` if there is no tile set.
    """
    words = _Words("verify")
    words.add_input(options, None)
    given = {"spacing": spacing, "unit": unit, "roi": roi, "threads": threads, "max_issues": max_issues}
    path, array = (None, None) if against is None else _source(against)
    given["against"] = path or (None if array is None else name)
    words.add_input(given, None)
    raw = json.loads(_native.call(words.end(os.fspath(out)), array, name, "", progress))
    issues = [
        Issue(i["code"], i["severity"], i["path"], i["message"], tuple(i["voxel"]) if i.get("voxel") else None)
        for i in raw["issues"]
    ]
    return Report(raw["ok"], issues, raw)
