"""A foam whose walls leak in the hands of three: alvis, scikit-image, PoreSpy. Time, memory and cells found, one process each.

    leaking.py ALVIS WORK [--size 256] [--threads 1]

Each takes the same threshold, splits the air into cells at its necks and counts the voxels of each: alvis by `--split`,
scikit-image by distances, h_maxima of 0.5 and the watershed of these, PoreSpy by SNOW2 (`networks.snow2`, which finds pores
and throats as well, as alvis has its table of necks; and its first step alone, `snow_partitioning`). alvis also writes the
surface as tiles; `--walls` is a run of its own. In an environment with numpy, scipy, scikit-image and porespy.
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

path, n, which = sys.argv[1], int(sys.argv[2]), sys.argv[3]
air = np.fromfile(path, np.uint8).reshape(n, n, n) < float(sys.argv[4])
if which == "scikit-image":
    from scipy.ndimage import distance_transform_edt
    from skimage.measure import label
    from skimage.morphology import h_maxima
    from skimage.segmentation import watershed

    depth = distance_transform_edt(air).astype(np.float32)
    labels = watershed(-depth, label(h_maxima(depth, 0.5)), mask=air)
else:
    import porespy

    porespy.settings.tqdm["disable"] = True
    if which == "porespy.networks.snow2":
        labels = porespy.networks.snow2(air.astype(int), parallel_kw=None).regions
    else:
        labels = porespy.filters.snow_partitioning(air).regions
sizes = np.bincount(np.asarray(labels).ravel().astype(np.int64))[1:]
print(int((sizes > 0).sum()), int((sizes > 30).sum()))
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("alvis")
    parser.add_argument("work", type=Path)
    parser.add_argument("--size", type=int, default=256)
    parser.add_argument("--threads", type=int, default=1)
    args = parser.parse_args()
    args.work.mkdir(parents=True, exist_ok=True)
    scan, n = args.work / "leaking.raw", args.size
    raw = ["--dims", f"{n},{n},{n}", "--dtype", "u8"]
    # air is 51 and metal 204: at a threshold near that of metal thin walls leak
    foam = ["--pitch", "22", "--bubble", "0.75", "--wall", "2", "--force", "-q"]
    subprocess.run([args.alvis, "phantom", "foam", str(scan), *raw, *foam], check=True)
    tiles, threshold = str(args.work / "tiles"), "190"
    convert = [args.alvis, "convert", str(scan), tiles, *raw, "--threshold", threshold, "--threads", str(args.threads)]
    convert += ["--force", "--json", "-q"]
    print("| | cells | of more than 30 voxels | wall | processor | memory | processor, memory by `--split` |\n|---|---|---|---|---|---|---|")
    names = ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS", "OPENBLAS_NUM_THREADS")
    threads = dict.fromkeys(names, str(args.threads))
    own = None

    def row(name: str, cells: int, large: int, wall: float, cpu: float, memory: float) -> None:
        by = "" if own is None else f"{cpu / own[0]:.1f}, {memory / own[1]:.1f}"
        print(f"| {name} | {cells:,} | {large:,} | {wall:.2f} s | {cpu:.2f} s | {memory:,.0f} MiB | {by} |", flush=True)

    for name, more in [("--split", ["--split"]), ("--split --walls", ["--split", "--walls"]), ("threshold alone", [])]:
        made, *cost = run(convert + more, threads)
        table = [args.alvis, "cells", tiles, "--format", "csv", "--columns", "voxels"]
        found = subprocess.run(table, capture_output=True, text=True, check=True)
        sizes = [int(line) for line in found.stdout.splitlines()[1:]]
        assert len(sizes) == json.loads(made)["cells"]
        own = own or cost[1:]
        row(f"alvis convert, {name}", len(sizes), sum(s > 30 for s in sizes), *cost)
    for name in ("scikit-image", "porespy.filters.snow_partitioning", "porespy.networks.snow2"):
        printed, *cost = run([sys.executable, "-c", SCRIPT, str(scan), str(n), name, threshold], threads)
        cells, large = printed.split()[-2:]
        row(name, int(cells), int(large), *cost)


if __name__ == "__main__":
    main()
