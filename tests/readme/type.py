"""Types README.md from top to bottom, as somebody would who begins with it.

    type.py BINARIES WORK [--python PYTHON] [--npm DIR] [--data DIR] [--readme FILE]

BINARIES holds `alvis` and `examples/`, as a release build leaves them. Every `sh` and `python` block is run as it stands, in order,
in one directory (WORK), where only what the page has made before lies. It fails if a command fails, if a file that the
block names is not there after it, if a command that makes a directory of tiles made none, and if a `text` block shows
what the block above it did not print; lines on time and memory differ from machine to machine and are passed over.

Above a block there may be a comment that the page does not show:

    <!-- not typed: REASON -->        it cannot be run here; tests/readme.rs parses its commands all the same
    <!-- typed with: WHAT, ... -->    program:NAME and python:MODULE have to be there; data:PATH (shared test data) and
                                      repo:PATH (this checkout) are brought, `as NAME` under the name that the page uses
                                      for a scan of the reader; passed by, and said so, where one of them is missing
    <!-- not printed: REASON -->      a `text` block that shows something else than the output above it
    <!-- saved as: NAME -->           a block of any language that is saved in the directory
    <!-- opened: NAME -->             the page of that name is opened in a browser, from the directory, if --npm is given

PYTHON is of an environment that has what blocks install by pip, which finds them there; DIR of --npm is where
tests/conformance/clients/package.json is installed, that of --data holds the shared test data.
Ends with a line `N passed, N failed`.
"""

import argparse
import itertools
import os
import re
import shlex
import shutil
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
COMMENT = re.compile(r"<!-- (not typed|typed with|not printed|saved as|opened): (.+?) -->")
# a command's place among the words without a dash for what it makes, and the file that shows it is whole
MAKES = {"demo": (0, "foam/index.json"), "convert": (1, "index.json"), "select": (1, "index.json"),
         "repack": (1, "index.json"), "convert_and_verify": (0, "index.json")}
FILE = re.compile(r"[A-Za-z][\w./-]*\.(?:png|ply|stl|obj|glb|mhd|nrrd|raw|bash|html)")
RUNS = {"alvis", "cargo", "run", "--release", "--example", "--"}
# what of the output no two machines have in common
VARIES = ("took", "memory", "...")
# `cargo run --release` as the page has it, by what is built already
CARGO = """#!/bin/sh
case "$*" in
  "run --release --example "*" -- "*) name=$4; shift 5; exec "$BINARIES/examples/$name" "$@" ;;
  "run --release -- "*) shift 3; exec "$BINARIES/alvis" "$@" ;;
esac
echo "cargo $*: only \\`cargo run --release\\` is typed" >&2
exit 1
"""


@dataclass
class Block:
    """A fenced block, with the line that it begins at and the comments above it."""

    line: int
    language: str
    text: str
    comments: dict[str, str]


def blocks(page: str) -> list[Block]:
    found, comments, start, lines = [], {}, None, page.splitlines()
    for number, line in enumerate(lines, 1):
        if start is None and line.startswith("```"):
            start = number
        elif start is not None and line == "```":
            text = "\n".join(lines[start : number - 1])
            found.append(Block(start, lines[start - 1][3:].strip(), text, comments))
            comments, start = {}, None
        elif start is None and (comment := COMMENT.fullmatch(line)):
            comments[comment[1]] = comment[2]
        elif start is None and line.startswith("<!--"):
            raise SystemExit(f"line {number}: not understood: {line}")
        elif start is None and line:
            if comments:
                raise SystemExit(f"line {number}: a comment above no block: {comments}")
    return found


class Typist:
    def __init__(self, arguments: argparse.Namespace):
        self.arguments = arguments
        self.work = arguments.work
        self.passed = self.failed = 0
        self.printed: list[str] = []
        tools = self.work.with_name(self.work.name + "-tools")
        for folder in (self.work, tools):
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir(parents=True)
        (tools / "cargo").write_text(CARGO)
        (tools / "cargo").chmod(0o755)
        (tools / "alvis").symlink_to(arguments.binaries / "alvis")
        # the page is typed in a checkout
        (self.work / "examples").symlink_to(ROOT / "examples")
        path = [str(tools)] + ([str(arguments.python.parent)] if arguments.python else []) + [os.environ["PATH"]]
        self.environment = os.environ | {
            "PATH": os.pathsep.join(path), "BINARIES": str(arguments.binaries), "PIP_NO_INDEX": "1",
            "PIP_DISABLE_PIP_VERSION_CHECK": "1", "PYTHONDONTWRITEBYTECODE": "1",
        }

    def note(self, block: Block, wrong: list[str], seconds: float = 0.0) -> None:
        first = block.text.splitlines()[0][:60]
        self.passed += not wrong
        self.failed += bool(wrong)
        text = f"ok ({seconds:.1f} s)" if not wrong else "FAILED"
        print(f"{text} line {block.line}: {first}" + "".join(f"\n    {w}" for w in wrong), flush=True)

    def missing(self, needs: str) -> str | None:
        """The first of the things that a block needs and that are not here; brings test data."""
        for need in needs.split(", "):
            kind, name = need.split(":", 1)
            if kind == "program" and not shutil.which(name, path=self.environment["PATH"]):
                return need
            if kind == "python":
                line = [str(self.arguments.python), "-c", f"import {name}"]
                if not self.arguments.python or subprocess.run(line, capture_output=True).returncode:
                    return need
            if kind in ("data", "repo"):
                base = ROOT if kind == "repo" else self.arguments.data
                place, _, alias = name.partition(" as ")
                if not base or not (base / place).exists():
                    return need
                target = self.work / (alias or Path(place).name)
                # shared data may not be written to, and what is made of them here may
                subprocess.run(["cp", "-r", "--no-preserve=mode", base / place, target], check=True)
        return None

    def run(self, block: Block) -> None:
        start = time.monotonic()
        shell = ["python", "-c"] if block.language == "python" else ["bash", "-euo", "pipefail", "-c"]
        done = subprocess.run([*shell, block.text], cwd=self.work, env=self.environment,
                              stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=600)
        self.printed = done.stdout.decode(errors="replace").splitlines()
        wrong = []
        if done.returncode:
            wrong = [f"exit status {done.returncode}", *self.printed[-5:]]
        else:
            wrong = [f"{name} is not there" for name in made(block.text) if not self.whole(name)]
        self.note(block, wrong, time.monotonic() - start)

    def whole(self, name: str) -> bool:
        path = self.work / name
        return path.is_file() and path.stat().st_size > 0

    def compare(self, block: Block) -> None:
        printed = {line.rstrip() for line in self.printed}
        shown = [line.rstrip() for line in block.text.splitlines()]
        wrong = [line for line in shown if not line.strip().startswith(VARIES) and line not in printed]
        self.note(block, [f"not printed: {line}" for line in wrong])

    def open(self, block: Block, page: str) -> None:
        script = ROOT / "tests/readme/open.mjs"
        line = ["node", script, self.arguments.npm, self.work, page]
        done = subprocess.run(line, capture_output=True, text=True, timeout=600)
        print(done.stdout.strip())
        self.note(block, [] if done.returncode == 0 else (done.stderr or "no message").splitlines()[:5])

    def block(self, block: Block) -> None:
        needs = block.comments.get("typed with")
        if "saved as" in block.comments:
            (self.work / block.comments["saved as"]).write_text(block.text + "\n")
        if "opened" in block.comments:
            if self.arguments.npm and shutil.which("chromium"):
                self.open(block, block.comments["opened"])
            else:
                print(f"SKIPPED line {block.line}: there is no browser")
        elif block.language == "text":
            if "not printed" not in block.comments and self.printed:
                self.compare(block)
        elif block.language in ("sh", "python") and "not typed" not in block.comments:
            self.printed = []
            if needs and (missing := self.missing(needs)):
                print(f"SKIPPED line {block.line}: {missing} is not here")
            else:
                self.run(block)


def made(text: str) -> list[str]:
    """What has to be there after a block, by the words of its lines."""
    names = []
    for line in text.splitlines():
        words = [w for w in shlex.split(line, comments=True) if w not in RUNS]
        names += [word for word in words if FILE.fullmatch(word)]
        plain = list(itertools.takewhile(lambda word: not word.startswith("-"), words))
        if "--out-dir" in words:
            names.append(f"{words[words.index('--out-dir') + 1]}/scans.csv")
        elif plain and plain[0] in MAKES:
            place, file = MAKES[plain[0]]
            folder = plain[1 + place] if len(plain) > 1 + place else "alvis-demo"
            names.append(f"{folder}/{file}")
    return names


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("binaries", type=Path)
    parser.add_argument("work", type=Path)
    parser.add_argument("--python", type=Path)
    parser.add_argument("--npm", type=Path)
    parser.add_argument("--data", type=Path)
    parser.add_argument("--readme", type=Path, default=ROOT / "README.md")
    arguments = parser.parse_args()
    for name in ("binaries", "work", "npm", "data"):
        if value := getattr(arguments, name):
            setattr(arguments, name, value.resolve())
    if arguments.python:
        # not resolved: the link is what makes it an environment
        arguments.python = arguments.python.absolute()
    if arguments.npm and not arguments.npm.is_dir():
        arguments.npm = None
    typist = Typist(arguments)
    for block in blocks(arguments.readme.read_text()):
        typist.block(block)
    print(f"{typist.passed} passed, {typist.failed} failed")
    return 0 if typist.failed == 0 else 1


if __name__ == "__main__":
    sys.exit(main())
