"""Prints the licence of every crate that alvis is built from, and the text of each, for who gets the program alone.

    python3 packaging/licences.py
"""

import json
import pathlib
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[1]
# as a licence's text is named in a crate
NAMES = ("licen", "copying", "copyright", "notice", "unlicense")


def texts(package: dict) -> list[str]:
    """What lies beside a crate's manifest under such a name."""
    folder = pathlib.Path(package["manifest_path"]).parent
    files = sorted(f for f in folder.iterdir() if f.is_file() and f.name.lower().startswith(NAMES))
    return [f.read_text(errors="replace").strip() for f in files]


def built(metadata: dict) -> list[dict]:
    """The packages that end up in the program and in the Python module, without what only tests and builds need."""
    nodes = {node["id"]: node for node in metadata["resolve"]["nodes"]}
    found, queue = set(), list(metadata["workspace_members"])
    while queue:
        each = queue.pop()
        if each in found:
            continue
        found.add(each)
        for dependency in nodes[each]["deps"]:
            if any(kind["kind"] is None for kind in dependency["dep_kinds"]):
                queue.append(dependency["pkg"])
    packages = [p for p in metadata["packages"] if p["id"] in found]
    return sorted(packages, key=lambda p: (p["name"], p["version"]))


def main() -> int:
    platform = next(l for l in subprocess.check_output(["rustc", "-vV"], text=True).splitlines() if l.startswith("host"))
    command = ["cargo", "metadata", "--locked", "--format-version", "1", "--filter-platform", platform.split()[1]]
    packages = built(json.loads(subprocess.check_output(command, cwd=ROOT)))
    print("alvis is made of these parts, each under its licence; the texts follow.\n")
    for package in packages:
        print(f"{package['name']} {package['version']}: {package['license']}")
    print("Rust's standard library: MIT OR Apache-2.0")
    users: dict[str, list[str]] = {}
    for package in packages:
        for text in texts(package):
            users.setdefault(text, []).append(f"{package['name']} {package['version']}")
    font = ROOT / "src/picture/font/LICENSE"
    users.setdefault(font.read_text().strip(), []).append("the font DejaVu Sans")
    for text, names in sorted(users.items(), key=lambda pair: pair[1]):
        print(f"\n{'-' * 80}\n{', '.join(names)}\n\n{text}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
