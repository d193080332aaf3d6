"""A reader of tile sets that knows the format only: numpy, no glTF library."""

import csv
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

TYPES = {5123: "<u2", 5125: "<u4", 5126: "<f4"}


@dataclass
class Piece:
    """A surface piece: ids, positions in lattice steps (n x 3), triangles (n x 3)."""

    cell: int
    object: int
    surface: int
    positions: np.ndarray
    triangles: np.ndarray


def _chunks(data: bytes) -> tuple[dict, bytes]:
    assert data[:4] == b"glTF" and int.from_bytes(data[8:12], "little") == len(data)
    length = int.from_bytes(data[12:16], "little")
    return json.loads(data[20:20 + length]), data[28 + length:]


class _Tile:
    def __init__(self, data: bytes):
        self.doc, self.bin = _chunks(data)

    def accessor(self, at: int) -> np.ndarray:
        accessor = self.doc["accessors"][at]
        view = self.doc["bufferViews"][accessor["bufferView"]]
        width = {"SCALAR": 1, "VEC3": 3}[accessor["type"]]
        start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        flat = np.frombuffer(self.bin, TYPES[accessor["componentType"]], accessor["count"] * width, start)
        return flat.reshape(-1, width) if width > 1 else flat

    def mesh(self, primitive: dict) -> tuple[np.ndarray, np.ndarray]:
        exact = self.accessor(primitive["attributes"]["POSITION"]).astype(np.float64) * 256
        positions = exact.astype(np.int64)
        assert (positions == exact).all(), "a vertex is not on the lattice"
        normals = self.accessor(primitive["attributes"]["NORMAL"]).astype(np.float64)
        assert np.allclose((normals**2).sum(1), 1, atol=1e-5), "a normal is not of unit length"
        indices = self.accessor(primitive["indices"]).astype(np.int64)
        if primitive.get("mode", 4) == 4:
            return positions, indices.reshape(-1, 3)
        a, b, c = indices[:-2], indices[1:-1], indices[2:]
        odd = np.arange(len(a)) % 2 == 1
        triangles = np.stack([np.where(odd, b, a), np.where(odd, a, b), c], 1)
        return positions, triangles[(a != b) & (b != c) & (a != c)]

    def merged(self, primitive: dict) -> list[Piece]:
        positions, triangles = self.mesh(primitive)
        row = self.accessor(primitive["attributes"]["_FEATURE_ID_0"]).astype(np.int64)
        metadata = self.doc["extensions"]["EXT_structural_metadata"]
        table = metadata["propertyTables"][0]
        kinds = metadata["schema"]["classes"][table["class"]]["properties"]

        def column(name: str) -> np.ndarray:
            view = self.doc["bufferViews"][table["properties"][name]["values"]]
            kind = {"UINT32": "<u4", "UINT64": "<u8"}[kinds[name]["componentType"]]
            return np.frombuffer(self.bin, kind, table["count"], view.get("byteOffset", 0))

        ids = [column(name) for name in ("cell", "object", "surface")]
        of = row[triangles]
        assert (of == of[:, :1]).all(), "a triangle of two pieces"
        order = np.argsort(of[:, 0], kind="stable")
        ends = np.searchsorted(of[order, 0], np.arange(table["count"] + 1))
        parts = [triangles[order[ends[i]:ends[i + 1]]] for i in range(table["count"])]
        return [Piece(*(int(c[i]) for c in ids), positions, part) for i, part in enumerate(parts)]

    def pieces(self) -> list[Piece]:
        out = []
        for node in self.doc["nodes"]:
            if "mesh" not in node:
                continue
            primitive = self.doc["meshes"][node["mesh"]]["primitives"][0]
            if "_FEATURE_ID_0" in primitive["attributes"]:
                out += self.merged(primitive)
            else:
                extras = node["extras"]
                positions, triangles = self.mesh(primitive)
                assert extras["triangles"] == len(triangles)
                out.append(Piece(extras["cell"], extras["object"], extras["surface"], positions, triangles))
        return out


def manifest(out: Path) -> dict:
    return json.loads((out / "index.json").read_text())


def pieces(out: Path) -> list[Piece]:
    """All pieces of all tiles that the index names."""
    found = []
    for layer in manifest(out)["layers"]:
        for entry in json.loads((out / layer["path"]).read_text())["tiles"]:
            found += _Tile((out / entry["path"]).read_bytes()).pieces()
    return found


def table(out: Path, name: str) -> dict[str, list[str]]:
    """The columns of a table by name, without their units."""
    with open(out / name, newline="") as file:
        rows = list(csv.reader(file))
    return {title.split(" ")[0]: [row[i] for row in rows[1:]] for i, title in enumerate(rows[0])}
