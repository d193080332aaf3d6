"""Compares tile sets with what other programs make of the same volumes.

    check.py ALVIS DATA WORK

ALVIS is the command, DATA the shared test data (volumes in it are skipped, and that is said, if it is
missing), WORK a directory for tile sets, which stay there for the glTF validator. Ends with a line
`N passed, N failed`.

- VTK's FlyingEdges3D has the same table of cases up to triangulation: vertices and triangles are
  compared to the last one. It counts v >= value as inside. With the faces joined the surface is that of
  the negative volume; with caps, that of the volume in a border of below.
- scipy.ndimage.label counts components independently, 6- and 18-connected: numbers, sizes, order of ids,
  and the ids at both ends of every vertex's lattice edge.
- numpy welds the triangles of all tiles again: no edge may be open but on the volume's faces.
"""

import json
import os
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import repeat
from pathlib import Path

import numpy as np
import tiles
import volumes
from scipy import ndimage
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonDataModel import vtkImageData
from vtkmodules.vtkFiltersCore import vtkFlyingEdges3D


@dataclass
class Case:
    name: str
    samples: np.ndarray
    source: Path
    arguments: list[str]
    threshold: float
    join: bool = False
    cap: bool = False
    lists: bool = False

    def options(self) -> list[str]:
        more = ["--ambiguous", "join"] if self.join else []
        more += ["--cap"] if self.cap else []
        more += ["--primitives", "triangles"] if self.lists else []
        return [*self.arguments, f"--threshold={self.threshold}", *more]

    def title(self) -> str:
        words = [self.name, str(self.threshold), "join" if self.join else "separate"]
        return "_".join(words + ["cap"] * self.cap + ["lists"] * self.lists)


def same(what: str, found, expected) -> None:
    if found != expected:
        raise AssertionError(f"{what}: {found}, expected {expected}")


def flying_edges(samples: np.ndarray, value: float) -> tuple[int, int]:
    """Vertices and triangles of VTK's surface."""
    image = vtkImageData()
    image.SetDimensions(*samples.shape[::-1])
    image.GetPointData().SetScalars(numpy_to_vtk(np.ascontiguousarray(samples).ravel(), deep=True))
    edges = vtkFlyingEdges3D()
    edges.SetInputData(image)
    edges.ComputeNormalsOff()
    edges.ComputeGradientsOff()
    edges.ComputeScalarsOff()
    edges.SetValue(0, value)
    edges.Update()
    surface = edges.GetOutput()
    return surface.GetNumberOfPoints(), surface.GetNumberOfPolys()


def vtk_counts(case: Case) -> tuple[int, int]:
    if not (case.join or case.cap):
        return flying_edges(case.samples, case.threshold)
    samples, value = case.samples.astype(np.float64), case.threshold
    if case.cap:
        samples = np.pad(samples, 1, constant_values=min(samples.min(), value) - 1)
    if case.join:
        # below is v < T, that is -v > -T
        samples, value = -samples, np.nextafter(-value, np.inf)
    return flying_edges(samples, value)


def ranked(mask: np.ndarray, connectivity: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Components numbered by first voxel, their sizes, and whether they touch the border."""
    labels, count = ndimage.label(mask, ndimage.generate_binary_structure(3, connectivity))
    flat = labels.ravel()
    _, first = np.unique(flat, return_index=True)
    first = first[flat[first] > 0]
    rank = np.zeros(count + 1, np.int64)
    rank[flat[np.sort(first)]] = np.arange(1, count + 1)
    ids = rank[labels]
    sizes = np.bincount(ids.ravel(), minlength=count + 1)[1:]
    faces = [np.take(ids, at, axis).ravel() for axis in range(3) for at in (0, -1)]
    touching = np.unique(np.concatenate(faces))
    border = np.isin(np.arange(1, count + 1), touching)
    return ids, sizes, border


def check_labels(case: Case, out: Path, pieces: list[tiles.Piece], totals: dict) -> None:
    above = case.samples >= case.threshold
    objects = ranked(above, 2 if case.join else 1)
    cells = ranked(~above, 1 if case.join else 2)
    for name, (_, sizes, border) in (("objects", objects), ("cells", cells)):
        table = tiles.table(out, f"{name}.csv")
        same(name, totals[name], len(sizes))
        same(f"ids of {name}", [int(v) for v in table["id"]], list(range(1, len(sizes) + 1)))
        same(f"voxels of {name}", [int(v) for v in table["voxels"]], sizes.tolist())
        stated = [v in ("true", "1") for v in table["touches_border"]]
        same(f"touches_border of {name}", stated, border.tolist())
    same("surfaces + 1", totals["surfaces"] + 1, totals["objects"] + totals["cells"])
    same("voxels_above", totals["voxels_above"], int(above.sum()))
    pairs = set()
    for piece in pieces:
        if piece.cell == 0:
            continue
        used = piece.positions[np.unique(piece.triangles)]
        low = used // 256
        high = low + (used % 256 > 0)
        same("lattice edges", np.unique((high - low).sum(1)).tolist(), [1])
        ends = [(p[:, 2], p[:, 1], p[:, 0]) for p in (low, high)]
        lower_above = above[ends[0]]
        if (lower_above == above[ends[1]]).any():
            raise AssertionError("a vertex where the volume has no sign change")
        for ids, side, wanted in ((objects[0], lower_above, piece.object), (cells[0], ~lower_above, piece.cell)):
            found = np.where(side, ids[ends[0]], ids[ends[1]])
            same("ids at vertices", np.unique(found).tolist(), [wanted])
        pairs.add((piece.surface, piece.cell, piece.object))
    same("pairs of cell and object", len(pairs), totals["surfaces"])
    same("surfaces", len({p[0] for p in pairs}), totals["surfaces"])


def weld(case: Case, pieces: list[tiles.Piece]) -> tuple[np.ndarray, np.ndarray]:
    """Distinct positions and triangles over them."""
    positions = np.concatenate([p.positions[p.triangles].reshape(-1, 3) for p in pieces])
    # the lattice edge, which no two vertices share: its lower voxel and axis
    low = positions // 256 + 1
    axis = (positions % 256 > 0) @ np.arange(3)
    nx, ny = case.samples.shape[2] + 2, case.samples.shape[1] + 2
    key = ((low[:, 2] * ny + low[:, 1]) * nx + low[:, 0]) * 3 + axis
    _, first, number = np.unique(key, return_index=True, return_inverse=True)
    same("one position to a lattice edge", bool((positions[first][number] == positions).all()), True)
    return positions[first], number.reshape(-1, 3)


def check_closed(case: Case, pieces: list[tiles.Piece], totals: dict) -> None:
    positions, triangles = weld(case, pieces)
    same("vertices", len(positions), totals["vertices"])
    same("triangles", len(triangles), totals["triangles"])
    edges = np.concatenate([triangles[:, [i, (i + 1) % 3]] for i in range(3)])
    n = len(positions)
    there, back = edges[:, 0] * n + edges[:, 1], edges[:, 1] * n + edges[:, 0]
    same("distinct directed edges", len(np.unique(there)), len(there))
    alone = edges[~np.isin(there, back)]
    same("border edges", len(alone), totals["border_edges"])
    if case.cap:
        same("open edges", len(alone), 0)
    ends = positions[alone]
    last = 256 * (np.array(case.samples.shape[::-1]) - 1)
    flat = (ends[:, 0] == ends[:, 1]) & ((ends[:, 0] == 0) | (ends[:, 0] == last))
    same("open edges off the volume's faces", int((~flat.any(1)).sum()), 0)
    corners = positions[triangles]
    six = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    # in two halves: the sum may pass 64 bits
    total = (int((six >> 20).sum()) << 20) + int((six & 0xFFFFF).sum())
    same("volume6", int(totals["volume6"]), total)
    euler = n - (3 * len(triangles) + len(alone)) // 2 + len(triangles)
    same("euler_characteristic", totals["euler_characteristic"], euler)


def run(alvis: Path, arguments: list[str]) -> dict:
    done = subprocess.run([alvis, *arguments, "--json", "--quiet"], capture_output=True, text=True)
    if done.returncode != 0:
        raise AssertionError(f"{arguments}: exit status {done.returncode}: {done.stderr}{done.stdout[:2000]}")
    return json.loads(done.stdout)


def check(alvis: Path, case: Case, work: Path) -> str:
    out = work / case.title()
    report = run(alvis, ["convert", str(case.source), str(out), "--force", *case.options()])
    against = run(alvis, ["verify", str(out), "--against", str(case.source)])
    same("verify", (against["ok"], against["issues"]), (True, []))
    totals = tiles.manifest(out)["totals"]
    for name in ("triangles", "vertices"):
        same(f"{name} of report and verifier", (report[name], against[name]), (totals[name],) * 2)
    same("vertices and triangles of VTK", (totals["vertices"], totals["triangles"]), vtk_counts(case))
    pieces = tiles.pieces(out)
    check_labels(case, out, pieces, totals)
    check_closed(case, pieces, totals)
    return f"{totals['triangles']} triangles, {totals['objects']} objects, {totals['cells']} cells"


def cases_of_data(data: Path) -> list[Case]:
    cases = []
    for name, (path, _, _, _, thresholds, arguments) in volumes.VOLUMES.items():
        samples = volumes.read(data, name)
        for i, threshold in enumerate(thresholds):
            base = (name, samples, data / path, arguments, threshold)
            cases.append(Case(*base))
            cases.append(Case(*base, join=True, lists=i == 1))
            # caps of the largest would only take long
            if i == 0 and samples.size < 10_000_000:
                cases.append(Case(*base, cap=True))
    return cases


def cases_of_noise(work: Path) -> list[Case]:
    cases = []
    for share in (0.02, 0.1, 0.25, 0.5, 0.75, 0.9):
        name, dims = f"noise{share:.0%}"[:-1], (50, 45, 40)
        samples = volumes.noise(7, dims, share)
        source = work / f"{name}.raw"
        samples.tofile(source)
        arguments = ["--dims", ",".join(map(str, dims)), "--dtype", "u8"]
        for join, lists in ((False, False), (True, True)):
            cases.append(Case(name, samples, source, arguments, 128, join=join, lists=lists, cap=join))
    return cases


def attempt(alvis: Path, case: Case, work: Path) -> tuple[bool, str]:
    try:
        return True, f"ok {case.title()}: {check(alvis, case, work)}"
    except Exception as error:  # each case reports, whatever it meets
        return False, f"FAILED {case.title()}: {type(error).__name__}: {error}"


def main() -> int:
    alvis, data, work = (Path(a).resolve() for a in sys.argv[1:4])
    work.mkdir(parents=True, exist_ok=True)
    cases = cases_of_noise(work)
    if (data / "raw").is_dir():
        cases += cases_of_data(data)
    else:
        print(f"SKIPPED volumes of the shared data: {data} is missing")
    passed = 0
    # most of the time goes into Python, which fills one processor
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        for ok, line in pool.map(attempt, repeat(alvis), cases, repeat(work)):
            print(line, flush=True)
            passed += ok
    print(f"{passed} passed, {len(cases) - passed} failed")
    return 0 if passed == len(cases) else 1


if __name__ == "__main__":
    sys.exit(main())
