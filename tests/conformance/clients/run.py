"""Opens tile sets in programs that people use, and compares what they show with what the verifier says.

    run.py ALVIS DATA WORK --python PYTHON --blender PYTHON --npm DIR --validator DIR [--only PROGRAM]...

ALVIS is the command, DATA the shared test data (without them there is nothing to do, and that is said), WORK
a directory for tile sets. PYTHON has the packages of ../requirements.txt, the other one those of
requirements-blender.txt; the directories are where package.json here and the one above are installed.

Each volume is converted once and repacked into each form. For every program and form it is known whether
the program reads it; that it does not is asserted as well, so a table that says so stays true. Where it
reads: the triangles and the signed volume are those that `alvis verify --json` finds, triangles wind as the
normals point in as many cases as in the file, names and extras are those of the tables, and the vertices of
neighbouring tiles fall together: distinct places in 32-bit floats are as many as lattice vertices.

Prints a table for the README and ends with a line `N passed, N failed`.
"""

import argparse
import csv
import gzip
import json
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
import tiles  # noqa: E402
from measure import Sum  # noqa: E402

FORMS = {
    "blender": ["--for", "blender"],
    "meshlab": ["--for", "meshlab"],
    "quantized": ["--for", "blender", "--encoding", "quantized"],
    "web": ["--for", "web"],
}
# what of a form a program reads, and how it shows the cells of a tile in node layout
READS = {
    "gltf-validator": (["blender", "meshlab", "quantized", "web"], "no errors, no warnings"),
    "blender": (["blender", "meshlab", "quantized"], "an object per piece, measures as custom properties"),
    "meshlab": (["meshlab"], "a layer per piece, by name"),
    "trimesh": (["blender", "meshlab", "quantized"], "a geometry per piece, measures as metadata"),
    "open3d": (["blender", "meshlab"], "one mesh for a tile, no names"),
    "vtk": (["blender", "meshlab"], "a block per piece"),
    "assimp": (["blender", "meshlab"], "a node per piece, measures as metadata"),
    "three": (["blender", "meshlab", "quantized", "web"], "an object per piece, measures in `userData`"),
    "cesium": (["blender", "meshlab", "quantized", "web"], "picks a cell with its measures, in `web`"),
    "babylon": (["blender", "meshlab", "quantized", "web"], "a mesh per piece, measures in `metadata`"),
}
TITLES = {"gltf-validator": "glTF validator", "blender": "Blender", "meshlab": "MeshLab (pymeshlab)", "open3d": "Open3D",
          "vtk": "VTK", "assimp": "assimp", "three": "three.js", "cesium": "CesiumJS", "babylon": "Babylon.js"}
NAMES = {"blender", "meshlab", "trimesh", "assimp", "three", "cesium", "babylon"}
EXTRAS = {"blender", "trimesh", "assimp", "three", "babylon"}
WEB = {"three", "cesium", "babylon"}


@dataclass
class Set:
    """A tile set with what has to be found in it."""

    files: list[str]
    triangles: int
    vertices: int
    volume: float
    # what rounding of places to 32 bits may do to the volume
    slack: float
    agree: int
    names: list[str]
    extras: dict[str, dict[str, float]]
    # false where vertices of two tiles are rounded in two ways
    exact: bool
    bytes: int


@dataclass
class Tally:
    passed: int = 0
    failed: int = 0
    versions: dict[str, str] = field(default_factory=dict)

    def check(self, what: str, wrong: list[str]) -> None:
        if wrong:
            self.failed += 1
            print(f"FAILED {what}: {'; '.join(wrong)}", flush=True)
        else:
            self.passed += 1
            print(f"ok {what}", flush=True)


def volumes(data: Path, work: Path) -> dict[str, list[str]]:
    """What to convert: the input and its options."""
    foam = work / "foam.raw"
    foam.write_bytes(gzip.decompress((data / "phantom/foam_closed_200x200x200_uint8.raw.gz").read_bytes()))
    lobster = str(data / "raw/lobster_301x324x56_uint8.raw")
    return {
        "lobster": [lobster, "--dims", "301,324,56", "--dtype", "u8", "--spacing", "1,1,1.4", "--unit", "mm",
                    "--threshold", "40", "--crop", "70:200,100:230,:", "--cap"],
        "cement": [str(data / "tiff/cement_128x128x128.tif"), "--threshold", "75", "--crop", ":,:,0:70"],
        "foam": [str(foam), "--dims", "200,200,200", "--dtype", "u8", "--threshold", "128", "--cap",
                 "--crop", "0:129,0:129,0:80"],
    }


def alvis(command: Path, arguments: list[str]) -> dict:
    done = subprocess.run([command, *arguments, "--json", "--quiet"], capture_output=True, text=True)
    if done.returncode != 0:
        raise RuntimeError(f"{arguments}: exit status {done.returncode}: {done.stderr}{done.stdout[:2000]}")
    return json.loads(done.stdout)


def measured(out: Path) -> tuple[int, list[str], dict[str, dict[str, float]]]:
    """Of a set of floats and nodes, read with numpy: winding, names, and extras by tile and node."""
    total, names, extras = Sum(), [], {}
    # what is normal to a triangle in voxels is not where voxels are no cubes
    matrix = np.array(tiles.manifest(out)["transform"]).reshape(4, 4).T
    with open(out / "cells.csv", newline="") as file:
        rows = {int(r["id"]): r for r in csv.DictReader(file)}
    column = next(c for c in next(iter(rows.values())) if c.startswith("volume"))
    for path in files(out):
        tile = tiles._Tile(Path(path).read_bytes())
        for node in tile.doc["nodes"][1:]:
            primitive = tile.doc["meshes"][node["mesh"]]["primitives"][0]
            positions, triangles = tile.mesh(primitive)
            normals = tile.accessor(primitive["attributes"]["NORMAL"])
            total.add(positions / 256, triangles, normals, matrix)
            names.append(node["name"])
            wanted = {k: float(node["extras"][k]) for k in ("cell", "object", "surface")}
            if node["extras"]["cell"] > 0:
                wanted["volume"] = float(rows[node["extras"]["cell"]][column])
            extras[f"{Path(path).name} {node['name']}"] = wanted
    return total.agree, sorted(names), extras


def files(out: Path) -> list[str]:
    layers = tiles.manifest(out)["layers"]
    return [str(out / e["path"]) for l in layers for e in json.loads((out / l["path"]).read_text())["tiles"]]


def make(command: Path, name: str, options: list[str], work: Path, tally: Tally) -> dict[str, Set]:
    """Converts a volume, repacks it into each form, and holds the verifier's reports together."""
    base = work / f"{name}_blender"
    alvis(command, ["convert", options[0], str(base), "--force", *options[1:], *FORMS["blender"]])
    agree, names, extras = measured(base)
    made, reports = {}, {}
    for form, wanted in FORMS.items():
        out = work / f"{name}_{form}"
        if form != "blender":
            alvis(command, ["repack", str(base), str(out), "--force", *wanted])
        report = alvis(command, ["verify", str(out)])
        manifest = tiles.manifest(out)
        scale = np.linalg.norm(np.array(manifest["transform"]).reshape(4, 4)[:3, :3], axis=1)
        unit = float(np.prod(scale))
        box = unit * float(np.prod(manifest["grid"]["dims"]))
        reports[form] = {k: v for k, v in report.items() if k not in ("bytes", "seconds", "peak_rss_bytes")}
        made[form] = Set(
            files=files(out),
            triangles=report["triangles"],
            vertices=report["vertices"],
            volume=int(report["volume6"]) / 6 / 256**3 * unit,
            slack=2e-6 * box,
            agree=agree,
            names=["cells"] * len(files(out)) if form == "web" else names,
            extras={} if form == "web" else extras,
            # a power of two keeps all bits; else a corner of its own rounds in its own way
            exact=form in ("blender", "meshlab") or all(np.frexp(s)[0] == 0.5 for s in scale),
            bytes=report["bytes"],
        )
    differ = [form for form in FORMS if reports[form] != reports["blender"]]
    tally.check(f"{name}: the verifier's report in all forms", differ)
    per_triangle = ", ".join(f"{form} {s.bytes / s.triangles:.2f}" for form, s in made.items())
    print(f"   {made['web'].triangles} triangles; bytes a triangle: {per_triangle}")
    return made


def compare(program: str, form: str, found: dict, expected: Set) -> list[str]:
    """What is not as it should be."""
    if "error" in found:
        return [found["error"]]
    wrong = []
    if found["triangles"] != expected.triangles:
        wrong.append(f"{found['triangles']} triangles, expected {expected.triangles}")
    if not abs(found["volume"] - expected.volume) <= expected.slack:
        wrong.append(f"volume {found['volume']}, expected {expected.volume} within {expected.slack}")
    # rounding turns a few triangles that lie along their normals
    rounded = form in ("quantized", "web")
    if abs(found["agree"] - expected.agree) > (1e-3 if rounded else 1e-4) * expected.triangles:
        wrong.append(f"{found['agree']} triangles wind as their normals, expected {expected.agree}")
    # these turn Y up by a rounded matrix, which the corner of each tile rounds in its own way
    exact = expected.exact and not (program in ("blender", "babylon") and rounded)
    if exact and found["places"] != expected.vertices:
        wrong.append(f"{found['places']} distinct places, expected {expected.vertices}")
    if program in NAMES and found["names"] != expected.names:
        wrong.append(f"names {found['names'][:4]} ..., expected {expected.names[:4]} ...")
    if program == "open3d" and len(found["names"]) != len(expected.files):
        wrong.append(f"{len(found['names'])} meshes, expected one for each of {len(expected.files)} tiles")
    if program in EXTRAS:
        wrong += compare_extras(found["extras"], expected.extras)
    if program in ("three", "cesium") and found["pixels"] < 1000:
        wrong.append(f"{found['pixels']} pixels are lit, expected a picture")
    return wrong


def compare_extras(found: dict, expected: dict) -> list[str]:
    if found.keys() != expected.keys():
        return [f"extras of {len(found)} nodes, expected {len(expected)}"]
    for node, wanted in expected.items():
        for key, value in wanted.items():
            if abs(float(found[node].get(key, "nan")) - value) > 1e-6 * abs(value) or key not in found[node]:
                return [f"{node}: {key} is {found[node].get(key)}, expected {value}"]
    return []


class Programs:
    def __init__(self, arguments: argparse.Namespace):
        self.arguments = arguments
        self.here = Path(__file__).resolve().parent

    def load(self, program: str, job: dict[str, list[str]]) -> dict | None:
        """Runs a program over sets; nothing if it crashed."""
        a, work = self.arguments, self.arguments.work
        task, out = work / "job.json", work / f"{program}.json"
        task.write_text(json.dumps(job))
        out.unlink(missing_ok=True)
        if program in WEB:
            line = ["node", self.here / "browser.mjs", program, a.npm, work, task, out]
        else:
            python = a.blender if program == "blender" else a.python
            line = [python, self.here / "desktop.py", program, task, out]
        with open(work / f"{program}.log", "ab") as log:
            subprocess.run(line, stdout=log, stderr=log, timeout=600)
        return json.loads(out.read_text()) if out.exists() else None

    def validate(self, made: dict[str, dict[str, Set]], tally: Tally) -> None:
        work = self.arguments.work
        folders = [work / f"{name}_{form}" for name in made for form in FORMS]
        script = self.arguments.validator / "validate.js"
        done = subprocess.run(["node", script, *folders], capture_output=True, text=True)
        package = self.arguments.validator / "node_modules/gltf-validator/package.json"
        tally.versions["gltf-validator"] = json.loads(package.read_text())["version"]
        lines = done.stdout.splitlines()
        for folder in folders:
            good = any(l.startswith(f"ok {folder}:") for l in lines)
            tally.check(f"gltf-validator {folder.name}", [] if good else lines[:5] + [done.stderr[-300:]])

    def check(self, program: str, made: dict[str, dict[str, Set]], tally: Tally) -> None:
        reads, _ = READS[program]
        # without a graphics card CesiumJS takes long for many nodes: one volume will do
        few = {"cement"} if program == "cesium" else set(made)
        cases = [(name, form) for name in made for form in reads if form == "web" or name in few]
        job = {f"{name}_{form}": made[name][form].files for name, form in cases}
        found = self.load(program, job)
        if found is None:
            tally.check(program, ["it crashed"])
            return
        tally.versions[program] = found["version"]
        for name, form in cases:
            expected, got = made[name][form], found["sets"][f"{name}_{form}"]
            tally.check(f"{program} {name}_{form}", compare(program, form, got, expected))
            if program == "cesium" and form == "web":
                self.check_picked(name, got.get("picked"), tally)
        # the smallest tile is enough to see that a form is not read
        for form in FORMS.keys() - set(reads):
            file = min(made["cement"][form].files, key=lambda f: Path(f).stat().st_size)
            found = self.load(program, {"one": [file]})
            got = found["sets"]["one"] if found else {"error": "crash"}
            stated = sum(g["triangles"] for g in entry_of(file)["groups"])
            read = "error" not in got and got["triangles"] == stated and got["agree"] > 0.9 * stated
            tally.check(f"{program} does not read {form}", ["it does: the table is out of date"] if read else [])

    def check_picked(self, name: str, picked: dict | None, tally: Tally) -> None:
        table = tiles.table(self.arguments.work / f"{name}_web", "cells.csv")
        wrong = ["no cell was picked"]
        if picked:
            row = table["id"].index(str(int(picked["cell"])))
            same = abs(picked["volume"] - float(table["volume"][row])) < 1e-9 * picked["volume"]
            wrong = [] if same else [f"picked {picked}, expected volume {table['volume'][row]}"]
        tally.check(f"cesium picks a cell of {name}_web", wrong)


def entry_of(file: str) -> dict:
    """The shard's entry of a tile."""
    path = Path(file)
    out = path.parents[2]
    shard = json.loads((out / "index" / f"{path.parent.name}.json").read_text())
    return next(e for e in shard["tiles"] if out / e["path"] == path)


def table(tally: Tally) -> str:
    lines = ["| program | version | `blender` | `meshlab` | quantized | `web` | cells |", "|---|---|---|---|---|---|---|"]
    for program, (reads, shows) in READS.items():
        if program in tally.versions:
            marks = ["yes" if form in reads else "no" for form in FORMS]
            cells = [TITLES.get(program, program), tally.versions[program], *marks, shows]
            lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("alvis", type=Path)
    parser.add_argument("data", type=Path)
    parser.add_argument("work", type=Path)
    for option in ("python", "blender", "npm", "validator"):
        parser.add_argument(f"--{option}", type=Path, required=True)
    parser.add_argument("--only", action="append", choices=READS)
    arguments = parser.parse_args()
    for name in ("alvis", "data", "work", "npm", "validator"):
        setattr(arguments, name, getattr(arguments, name).resolve())
    if not (arguments.data / "phantom").is_dir():
        print(f"SKIPPED other programs on tiles of the shared data: {arguments.data} is missing")
        return 0
    work = arguments.work
    work.mkdir(parents=True, exist_ok=True)
    tally = Tally()
    inputs = volumes(arguments.data, work)
    made = {name: make(arguments.alvis, name, options, work, tally) for name, options in inputs.items()}
    programs = Programs(arguments)
    for program in arguments.only or READS:
        if program == "gltf-validator":
            programs.validate(made, tally)
        else:
            programs.check(program, made, tally)
    print(table(tally))
    print(f"{tally.passed} passed, {tally.failed} failed")
    return 0 if tally.failed == 0 else 1


if __name__ == "__main__":
    sys.exit(main())
