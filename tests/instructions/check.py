"""Counts the instructions of the hot kernels with callgrind and compares them with stored limits.

    check.py PROGRAM [--store]

PROGRAM is examples/kernels, built for release. Counts do not depend on how busy or fast a machine is. A
kernel that takes over 3 % more than `limits.json` says has become slower; one that takes less by more than
10 % should have its limit stored anew (`--store`), or the next loss would not be seen. Compilers differ a
little, hence the room. Both ways through the kernels are counted, that for any processor and that for wide
vectors; the latter where the processor has them. Ends with a line `N passed, N failed`.
"""

import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path

LIMITS = Path(__file__).with_name("limits.json")
# the verifier's threads call what checks a tile: all that is done for each, once it has been read
KERNEL = re.compile(r"alvis::kernels::Kernels::(\w+)|alvis::(verify)::tile::check$")
# what the type has besides kernels
OTHERS = {"new", "triangles", "voxels"}


def count(program: str, portable: bool) -> dict[str, int]:
    """Instructions of each kernel with all that it calls."""
    with tempfile.TemporaryDirectory() as directory:
        out = Path(directory) / "out"
        command = ["valgrind", "--tool=callgrind", f"--callgrind-out-file={out}", program]
        way = {"ALVIS_PORTABLE": "1" if portable else "0"}
        subprocess.run(command, check=True, capture_output=True, env=way)
        names: dict[str, str] = {}
        counts: dict[str, int] = {}
        callee = ""
        lines = iter(out.read_text().splitlines())
        for line in lines:
            named = re.match(r"c?fn=\((\d+)\)(?: (.*))?", line)
            if named:
                number, name = named.groups()
                names.setdefault(number, name or "")
                callee = names[number]
            elif line.startswith("calls="):
                cost = int(next(lines).split()[1])
                kernel = KERNEL.search(callee)
                name = kernel and kernel[kernel.lastindex]
                if name and name not in OTHERS:
                    counts[name] = counts.get(name, 0) + cost
        return counts


def judge(limits: dict[str, int], counts: dict[str, int], way: str) -> int:
    """Prints how counts stand to limits; returns how many are outside."""
    failed = 0
    for kernel, limit in limits.items():
        found = counts.get(kernel)
        if found is None:
            print(f"FAILED {kernel}, {way}: not found in the profile")
            failed += 1
            continue
        share = found / limit - 1
        ok = -0.10 <= share <= 0.03
        failed += not ok
        word = "ok" if ok else "FAILED"
        print(f"{word} {kernel}, {way}: {found:,} instructions, {share:+.1%} of the limit")
    return failed


def main() -> int:
    counts = {way: count(sys.argv[1], way == "portable") for way in ("portable", "wide")}
    if counts["wide"] == counts["portable"]:
        print("SKIPPED the way with wide vectors: this processor has none")
        del counts["wide"]
    if "--store" in sys.argv:
        LIMITS.write_text(json.dumps(counts, indent=2, sort_keys=True) + "\n")
    limits = json.loads(LIMITS.read_text())
    failed = sum(judge(limits[way], found, way) for way, found in counts.items())
    total = sum(len(limits[way]) for way in counts)
    print(f"{total - failed} passed, {failed} failed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
