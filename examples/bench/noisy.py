"""A noisy foam in the hands of three: alvis, scikit-image, PoreSpy. Time, memory and cells found, one process each.

    noisy.py ALVIS WORK [--size 256] [--noise 0.3]

Each smooths by a Gaussian of 0.8 voxels, takes Otsu's threshold, numbers the cells and measures them: volume, centroid, diameter
(scikit-image: regionprops_table; PoreSpy: regionprops_3D, which adds surface areas from marching cubes, so that it has
sphericities, too). alvis also writes the surface as tiles and verifies nothing here. In an environment with numpy,
scipy, scikit-image and porespy.
"""

import argparse
import json
import subprocess
import sys
from pathlib import Path

from measured import run

SCRIPT = """
import sys
import numpy as np
from scipy import ndimage
from skimage import filters, measure

path, n, which = sys.argv[1], int(sys.argv[2]), sys.argv[3]
scan = np.fromfile(path, np.uint16).reshape(n, n, n)
smooth = ndimage.gaussian_filter(scan.astype(np.float32), 0.8, truncate=4, mode="nearest")
air = smooth < filters.threshold_otsu(smooth)
labels = measure.label(air, connectivity=2)
if which == "porespy":
    import porespy
    table = porespy.metrics.regionprops_3D(labels)
    sizes = np.array([p.volume for p in table])
    round_ones = [p.sphericity for p in table]
else:
    table = measure.regionprops_table(labels, properties=("area", "centroid", "equivalent_diameter_area", "axis_major_length"))
    sizes = table["area"]
print(len(sizes), int((sizes > 30).sum()), air.mean())
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("alvis")
    parser.add_argument("work", type=Path)
    parser.add_argument("--size", type=int, default=256)
    parser.add_argument("--noise", default="0.3")
    args = parser.parse_args()
    args.work.mkdir(parents=True, exist_ok=True)
    scan, n = args.work / "noisy.raw", args.size
    dims = f"{n},{n},{n}"
    phantom = [args.alvis, "phantom", "foam", str(scan), "--dims", dims, "--dtype", "u16", "--noise", args.noise, "--force", "-q"]
    subprocess.run(phantom, check=True)
    convert = [args.alvis, "convert", str(scan), str(args.work / "tiles"), "--dims", dims, "--dtype", "u16"]
    convert += ["--threshold", "otsu", "--smooth", "0.8", "--force", "--json", "-q"]
    rows = []
    made, *cost = run(convert)
    made = json.loads(made)
    table = subprocess.run([args.alvis, "cells", str(args.work / "tiles"), "--format", "csv"], capture_output=True, text=True, check=True)
    sizes = [int(line.split(",")[1]) for line in table.stdout.splitlines()[1:]]
    porosity = 1 - made["voxels_above"] / n**3
    rows.append(("alvis convert", len(sizes), sum(s > 30 for s in sizes), porosity, *cost))
    for name in ("scikit-image", "porespy"):
        printed, *cost = run([sys.executable, "-c", SCRIPT, str(scan), str(n), name])
        cells, large, porosity = printed.split()[-3:]
        rows.append((name, int(cells), int(large), float(porosity), *cost))
    print("| | cells | of more than 30 voxels | porosity | wall | processor | memory |\n|---|---|---|---|---|---|---|")
    for name, cells, large, porosity, wall, cpu, memory in rows:
        print(f"| {name} | {cells:,} | {large:,} | {100 * porosity:.2f} % | {wall:.2f} s | {cpu:.2f} s | {memory:,.0f} MiB |")


if __name__ == "__main__":
    main()
