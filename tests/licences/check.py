"""Checks the licence and the source of every crate that alvis is built from, and of files of others in src/.

    python3 tests/licences/check.py [Cargo.toml]

Licences are SPDX expressions, of which one choice must be allowed in full; sources are the registry of
crates and this directory. What is allowed is read from deny.toml, so that this and `cargo deny check
licenses sources bans` agree. A file in src/ that is no Rust, such as a font, has a LICENSE beside it that names it.
Ends with `N passed, N failed`.
"""

import json
import pathlib
import re
import subprocess
import sys
import tomllib

ROOT = pathlib.Path(__file__).resolve().parents[2]
# the pages of `alvis view` and `alvis report`, which were written for them
OWN = {"src/view/page", "src/report"}


def allows(expression: str, allowed: set[str]) -> bool:
    """True if a choice of the expression needs allowed licences only."""
    tokens = re.findall(r"[()]|[^\s()]+", expression.replace("/", " OR "))

    def alternatives(at: int) -> tuple[bool, int]:
        value, at = together(at)
        while at < len(tokens) and tokens[at] == "OR":
            other, at = together(at + 1)
            value = value or other
        return value, at

    def together(at: int) -> tuple[bool, int]:
        value, at = single(at)
        while at < len(tokens) and tokens[at] == "AND":
            other, at = single(at + 1)
            value = value and other
        return value, at

    def single(at: int) -> tuple[bool, int]:
        if tokens[at] == "(":
            value, at = alternatives(at + 1)
            assert tokens[at] == ")", expression
            return value, at + 1
        name, at = tokens[at], at + 1
        if at < len(tokens) and tokens[at] == "WITH":
            name, at = f"{name} WITH {tokens[at + 1]}", at + 2
        return name in allowed, at

    value, at = alternatives(0)
    assert at == len(tokens), expression
    return value


def main() -> int:
    manifest = sys.argv[1] if len(sys.argv) > 1 else str(ROOT / "Cargo.toml")
    rules = tomllib.loads((ROOT / "deny.toml").read_text())
    allowed = set(rules["licenses"]["allow"])
    command = ["cargo", "metadata", "--locked", "--all-features", "--format-version", "1", "--manifest-path", manifest]
    packages = json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout)["packages"]
    # all come from one registry, Cargo's own, and none from a repository
    registries = {p["source"] for p in packages if (p["source"] or "").startswith("registry+")}
    assert len(registries) <= 1, registries
    wrong = []
    for package in packages:
        name = f"{package['name']} {package['version']}"
        source = package["source"]
        if source is not None and source not in registries:
            wrong.append(f"{name}: found source {source}, expected one of {sorted(registries)}")
        elif not package["license"] or not allows(package["license"], allowed):
            wrong.append(f"{name}: found licence {package['license']}, expected one of {sorted(allowed)}")
    others = [p for p in (ROOT / "src").rglob("*") if p.is_file() and p.suffix != ".rs" and p.name != "LICENSE"]
    others = [p for p in others if str(p.parent.relative_to(ROOT)) not in OWN]
    for path in others:
        licence = path.with_name("LICENSE")
        text = licence.read_text() if licence.is_file() else ""
        if path.name not in text or "Permission is hereby granted" not in text:
            wrong.append(f"{path.relative_to(ROOT)}: found no licence for it in {licence.relative_to(ROOT)}")
    # a check that allows everything would pass as well
    assert not allows("GPL-3.0-only", allowed) and not allows("MIT AND GPL-3.0-only", allowed)
    assert allows("GPL-3.0-only OR (MIT AND Zlib)", allowed)
    print("\n".join(wrong))
    print(f"licences and sources: {len(packages) + len(others) - len(wrong)} passed, {len(wrong)} failed")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
