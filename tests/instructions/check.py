"""Counts the instructions of the hot kernels with callgrind and compares them with stored limits.

    check.py PROGRAM [--store]

PROGRAM is examples/kernels, built for release. Counts do not depend on how busy or fast a machine is. A
kernel that takes over 3 % more than `limits.json` says has become slower; one that takes less by more than
10 % should have its limit stored anew (`--store`), or the next loss would not be seen. Compilers differ a
little, hence the room. Ends with a line `N passed, N failed`.
"""

import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path

LIMITS = Path(__file__).with_name("limits.json")
KERNEL = re.compile(r"alvis::kernels::Kernels::(\w+)")


def count(program: str) -> dict[str, int]:
    """Instructions of each kernel with all that it calls."""
    with tempfile.TemporaryDirectory() as directory:
        out = Path(directory) / "out"
        command = ["valgrind", "--tool=callgrind", f"--callgrind-out-file={out}", program]
        # the portable way: processors differ in what else they have
        subprocess.run(command, check=True, capture_output=True, env={"ALVIS_PORTABLE": "1"})
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
                if kernel and kernel[1] != "new":
                    counts[kernel[1]] = counts.get(kernel[1], 0) + cost
        return counts


def main() -> int:
    counts = count(sys.argv[1])
    if "--store" in sys.argv:
        LIMITS.write_text(json.dumps(counts, indent=2, sort_keys=True) + "\n")
    limits = json.loads(LIMITS.read_text())
    failed = 0
    for kernel, limit in limits.items():
        found = counts.get(kernel)
        if found is None:
            print(f"FAILED {kernel}: not found in the profile")
            failed += 1
            continue
        share = found / limit - 1
        ok = -0.10 <= share <= 0.03
        failed += not ok
        print(f"{'ok' if ok else 'FAILED'} {kernel}: {found:,} instructions, {share:+.1%} of the limit")
    print(f"{len(limits) - failed} passed, {failed} failed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
