"""Tile sets, and tiles as NumPy arrays."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from . import _native
from ._errors import OptionError
from ._table import Table

if TYPE_CHECKING:
    import trimesh

# vertices lie on a lattice of so many steps to a voxel
LATTICE = 256


@dataclass(frozen=True, eq=False)
class Piece:
    """All triangles of a tile between one cell and one object."""

    name: str
    """``cell_17``, ``cell_17_object_3`` or ``cap_object_3``; empty in tiles of very many pieces."""
    cell: int
    """The id of the cell, the row of the table ``cells``; 0 for a cap."""
    object: int
    """The id of the object."""
    surface: int
    """The id of the surface; 0 for a cap."""
    positions: NDArray[np.float32]
    """Shape (n, 3): x, y, z in voxels of the whole grid, multiples of 1/256, exact."""
    normals: NDArray[np.float32]
    """Shape (n, 3): unit vectors in voxel coordinates, from the material to the cell."""
    triangles: NDArray[np.uint32]
    """Shape (m, 3): rows of ``positions``, counter-clockwise seen from the cell."""
    measures: dict[str, float | str]
    """Measures of the whole cell, by the names of the table, in the unit of the tables; without those that it has not."""
    world_from_voxel: NDArray[np.float64]
    """Shape (4, 4): homogeneous voxel coordinates to those of the scan, in the set's unit."""

    def world(self) -> NDArray[np.float64]:
        """Positions in the coordinates of the scan and the set's unit, shape (n, 3), x, y, z."""
        return self.positions @ self.world_from_voxel[:3, :3].T + self.world_from_voxel[:3, 3]

    def to_trimesh(self) -> trimesh.Trimesh:
        """The piece as a ``trimesh.Trimesh`` in the coordinates of the scan, with cell, object and surface as its
        ``metadata``. It is open where it goes on in another tile."""
        return _mesh([self], self.world_from_voxel, {"cell": self.cell, "object": self.object, "surface": self.surface})


class Tile:
    """One macrocube of a tile set; its file is read when ``pieces`` is asked for first."""

    def __init__(self, tiles: TileSet, entry: _native.Entry) -> None:
        self._tiles, self._entry = tiles, entry
        x, y, z = entry.grid
        self.grid: tuple[int, int, int] = (x, y, z)
        """Place among the macrocubes, x first."""
        self.path: str = os.path.join(tiles.path, entry.path)
        """The GLB file."""
        self.vertices: int = entry.vertices
        """Vertices in the file."""
        self.triangles: int = entry.triangles
        """Triangles in the file."""

    @property
    def bounds(self) -> NDArray[np.float64]:
        """Smallest and largest coordinates of its vertices in voxels, shape (2, 3), x first."""
        return np.array(self._entry.bounds)

    @cached_property
    def pieces(self) -> list[Piece]:
        """Its surface pieces.

        Raises ``FormatError`` if the file is not that of the index.
        """
        matrix = self._tiles.world_from_voxel
        return [
            Piece(p.name, p.cell, p.object, p.surface, p.positions, p.normals, p.triangles, p.measures, matrix)
            for p in self._tiles._set.read(self._entry)
        ]

    def to_trimesh(self) -> trimesh.Trimesh:
        """The tile as one ``trimesh.Trimesh`` in the coordinates of the scan. It is open at the faces of the tile."""
        return _mesh(self.pieces, self._tiles.world_from_voxel, {"grid": self.grid})

    def __repr__(self) -> str:
        return f"<alvis.Tile {self.grid}: {self.triangles} triangles>"


class TileSet:
    """A directory of tiles that ``convert`` made; iterating gives its tiles, by rising z, y, x.

    Raises ``MissingFileError`` if there is none, ``FormatError`` if its index is damaged.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path: str = os.fspath(path)
        """The directory."""
        self._set = _native.TileSet(path)

    @cached_property
    def manifest(self) -> dict[str, Any]:
        """The index as it lies in ``index.json``: source, grid, threshold, totals, ..."""
        manifest: dict[str, Any] = json.loads(self._set.manifest())
        return manifest

    @property
    def dims(self) -> tuple[int, int, int]:
        """Size of the grid in voxels, x, y, z."""
        x, y, z = self.manifest["grid"]["dims"]
        return (x, y, z)

    @property
    def spacing(self) -> tuple[float, float, float]:
        """Size of a voxel along x, y, z, in ``unit``."""
        x, y, z = self.manifest["spacing"]
        return (x, y, z)

    @property
    def unit(self) -> str:
        """``m``, ``cm``, ``mm``, ``um``, ``nm``, or ``voxel`` if no size is known."""
        return str(self.manifest["unit"])

    @property
    def threshold(self) -> float:
        """The value at which the surface lies."""
        return float(self.manifest["threshold"])

    @cached_property
    def world_from_voxel(self) -> NDArray[np.float64]:
        """Shape (4, 4): homogeneous voxel coordinates (x, y, z, 1) to those of the scan, in ``unit``, Z up as there."""
        return np.array(self._set.world_from_voxel())

    def _table(self, name: str) -> Table:
        return Table(self.path, name, self.manifest["totals"].get(name, 0))

    @property
    def cells(self) -> Table:
        """The table of cells (pores)."""
        return self._table("cells")

    @property
    def objects(self) -> Table:
        """The table of objects (connected material)."""
        return self._table("objects")

    @property
    def surfaces(self) -> Table:
        """The table of surfaces."""
        return self._table("surfaces")

    @property
    def components(self) -> Table:
        """The table of components (connected pores), where cells are parts of these.

        Raises ``OptionError`` if cells are whole components, as without ``split`` and ``labels``.
        """
        return self._table("components")

    @property
    def necks(self) -> Table:
        """The table of necks, where cells are parts of components: ``cell_a``, ``cell_b``, ``neck_radius``, ...

        Raises ``OptionError`` if cells are whole components, as without ``split`` and ``labels``.
        """
        return self._table("necks")

    @property
    def walls(self) -> Table:
        """The table of walls between cells: ``cell_a``, ``cell_b``, ``wall_area``, ``wall_thickness``, ...

        Raises ``OptionError`` if they were not looked for, as without ``walls``.
        """
        return self._table("walls")

    def __len__(self) -> int:
        """Tiles."""
        return int(self.manifest["totals"]["tiles"])

    def __iter__(self) -> Iterator[Tile]:
        return self.tiles()

    def tiles(self, *, cell: int | None = None, object: int | None = None) -> Iterator[Tile]:
        """The tiles, or those with a piece of this cell, of this object, or of the surface between the two."""
        for layer in range(len(self._set.layers())):
            for entry in self._set.layer(layer):
                if entry.has(cell, object):
                    yield Tile(self, entry)

    def tile(self, x: int, y: int, z: int) -> Tile:
        """The tile at this place among the macrocubes.

        Raises ``KeyError`` if there is none: a macrocube without surface has no tile.
        """
        layers = self._set.layers()
        found = self._set.layer(layers.index(z)) if z in layers else []
        for entry in found:
            if list(entry.grid) == [x, y, z]:
                return Tile(self, entry)
        raise KeyError(f"no tile at x {x}, y {y}, z {z}: no surface there, or outside of the grid")

    def to_trimesh(self, *, cell: int | None = None, object: int | None = None) -> trimesh.Trimesh:
        """The surface as one ``trimesh.Trimesh`` in the coordinates of the scan, sewn at the planes between tiles: all of
        it, or that of one cell, of one object, or between the two. A cell that touches no border is watertight.

        Memory is that of the mesh: choose a cell of a large set, or use the command ``alvis export``.
        """
        pieces = [
            piece
            for tile in self.tiles(cell=cell, object=object)
            for piece in tile.pieces
            if cell in (None, piece.cell) and object in (None, piece.object)
        ]
        if not pieces and (cell is not None or object is not None):
            found = ", ".join(f"{name} {n}" for name, n in [("cell", cell), ("object", object)] if n is not None)
            expected = "one with a surface, as the tables have them"
            raise OptionError(f"to_trimesh: found {found}, expected {expected}", "to_trimesh", found, expected)
        return _mesh(pieces, self.world_from_voxel, {"cell": cell, "object": object})

    def __repr__(self) -> str:
        return f"<alvis.TileSet {self.path!r}: {len(self)} tiles, {len(self.cells)} cells>"


def _mesh(pieces: list[Piece], matrix: NDArray[np.float64], metadata: dict[str, Any]) -> trimesh.Trimesh:
    """Pieces as one mesh; vertices are the same if their places on the lattice are."""
    try:
        import trimesh
    except ImportError as error:
        raise ImportError("to_trimesh needs trimesh: pip install trimesh") from error
    starts = np.cumsum([0] + [len(piece.positions) for piece in pieces])
    empty = np.empty((0, 3))
    positions = np.concatenate([piece.positions for piece in pieces]) if pieces else empty
    faces = [piece.triangles.astype(np.int64) + start for piece, start in zip(pieces, starts)]
    steps = np.rint(positions * LATTICE).astype(np.int64)
    _, first, place = np.unique(steps, axis=0, return_index=True, return_inverse=True)
    triangles = place.reshape(-1)[np.concatenate(faces)] if pieces else np.empty((0, 3), np.int64)
    world = positions[first].astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3]
    # a left-handed grid turns triangles over
    if np.linalg.det(matrix[:3, :3]) < 0:
        triangles = triangles[:, ::-1]
    return trimesh.Trimesh(world, triangles, process=False, metadata=metadata)
