#!/usr/bin/env python3
"""One volume in four parts by real engines, compared byte by byte with what one process makes.

    tests/engines/run.py PROGRAM DIR [--cpus N]

Slurm runs the script that `alvis plan --script slurm` prints, in a cluster of one node that this starts; HyperQueue the
tasks of its local cluster. In each one task is killed in its midst, and has to be run again by the loop alone. An engine
that is not installed is skipped, with a line that says so. Ends with `N passed, N failed`.
"""

import argparse
import contextlib
import filecmp
import io
import os
import pathlib
import shutil
import stat
import subprocess
import sys

sys.path.insert(0, str(pathlib.Path(__file__).parent))
import slurm

PARTS = 4
KILLED = 2
# in KiB: more than a part writes into a file before it is in its midst, less than it writes into its largest
KILL_AT = 64
# how a shell tells that the system ended a program which wrote more than it may (SIGXFSZ)
KILLED_STATUS = "153"
OPTIONS = ["--threshold", "otsu", "--macrocube", "16", "--threads", "1"]


def run(command, **kwargs):
    """The standard output of a command that succeeds."""
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True, **kwargs)
    if done.returncode != 0:
        raise RuntimeError(f"{command[0]} {command[1]} ended with {done.returncode}: {done.stderr or done.stdout}")
    return done.stdout


def differences(a, b):
    """Files that one of two directories lacks, or that differ in any byte."""
    found = [{path.relative_to(root) for path in root.rglob("*") if path.is_file()} for root in [a, b]]
    differing = [path for path in found[0] & found[1] if not filecmp.cmp(a / path, b / path, shallow=False)]
    return sorted(map(str, [*(found[0] ^ found[1]), *differing]))


class Volume:
    """A foam, and the tile set that one process makes of it."""

    def __init__(self, program, directory):
        self.program, self.directory = program, directory
        self.scan = directory / "foam.mhd"
        run([program, "phantom", "foam", self.scan, "--dims", "256,256,256", "--quiet"])
        self.whole = directory / "whole"
        run([program, "convert", self.scan, self.whole, *OPTIONS, "--quiet"])

    def plan(self, name, *options):
        """Plans its parts in a directory of this name; what the program says."""
        words = ["plan", self.scan, self.directory / name, "--parts", PARTS, *OPTIONS, "--memory", "256MiB", *options]
        return run([self.program, *words])

    def killing(self, name):
        """A directory with a program `alvis` that is killed when it is first asked for one of the parts, and the file that
        then tells with which status it ended. Killed by what it has written, since no time is in its midst on every
        machine; engines in Python hand on that they ignore the signal."""
        place = self.directory / f"{name}-bin"
        place.mkdir()
        told = place / "killed"
        script = place / "alvis"
        script.write_text(
            f"""#!/bin/bash
if [[ " $* " == *" --part {KILLED} "* ]] && mkdir {place}/once 2>/dev/null; then
  (ulimit -c 0 -f {KILL_AT} && exec env --default-signal=XFSZ {self.program} "$@")
  status=$?
  echo $status >{told}
  exit $status
fi
exec {self.program} "$@"
"""
        )
        script.chmod(script.stat().st_mode | stat.S_IXUSR)
        return place, told

    def compare(self, name, told):
        """That the tile set of parts is that of the whole, and that one task was killed indeed."""
        status = told.read_text().strip()
        assert status == KILLED_STATUS, f"the task was to be killed, and ended with {status}"
        differing = differences(self.whole, self.directory / name)
        assert not differing, f"differing files: {differing[:10]}"
        run([self.program, "verify", self.directory / name, "--against", self.scan])


def by_slurm(volume, cpus):
    """The script that is printed for Slurm."""
    script = volume.directory / "slurm.sh"
    script.write_text(volume.plan("by-slurm", "--script", "slurm"))
    bin, told = volume.killing("by-slurm")
    with slurm.Slurm(volume.directory / "slurm", cpus) as cluster:
        environment = {**cluster.environment, "PATH": f"{bin}:{os.environ['PATH']}"}
        run(["bash", script], env=environment, cwd=volume.directory, timeout=600)
    volume.compare("by-slurm", told)


def by_hyperqueue(volume, cpus):
    """The loop of the docs, with jobs of HyperQueue's own server and worker."""
    from hyperqueue import Job
    from hyperqueue.cluster import LocalCluster, WorkerConfig
    from hyperqueue.ffi.protocol import ResourceRequest

    volume.plan("by-hyperqueue")
    out = volume.directory / "by-hyperqueue"
    bin, told = volume.killing("by-hyperqueue")
    with LocalCluster() as cluster:
        cluster.start_worker(WorkerConfig(cores=cpus))
        client = cluster.client()
        for _ in range(20):
            merged = subprocess.run([volume.program, "merge", out], capture_output=True, text=True)
            if merged.returncode == 0:
                break
            assert merged.returncode == 3, merged.stderr
            job = Job(default_workdir=volume.directory / "hyperqueue")
            for part in parts_of(merged.stdout):
                words = [str(bin / "alvis"), "work", str(out), "--part", str(part), "--threads", "1"]
                job.program(words, resources=ResourceRequest(cpus=1))
            with contextlib.redirect_stderr(io.StringIO()):
                # it draws a bar
                client.wait_for_jobs([client.submit(job)], raise_on_error=False)
        else:
            raise AssertionError("20 rounds were not enough")
    volume.compare("by-hyperqueue", told)


def parts_of(text):
    """Numbers of parts as `0-3` or `0,2-3`."""
    for piece in text.strip().split(","):
        first, _, last = piece.partition("-")
        yield from range(int(first), int(last or first) + 1)


def lacks_hyperqueue():
    """What is not installed; empty if it is."""
    try:
        import hyperqueue.cluster  # noqa: F401
    except ImportError as error:
        return f"the Python package hyperqueue is not installed ({error})"
    return ""


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("program", type=pathlib.Path)
    parser.add_argument("directory", type=pathlib.Path)
    parser.add_argument("--cpus", type=int, default=os.cpu_count())
    arguments = parser.parse_args()
    shutil.rmtree(arguments.directory, ignore_errors=True)
    arguments.directory.mkdir(parents=True)
    volume = Volume(arguments.program.resolve(), arguments.directory.resolve())
    passed = failed = 0
    for name, lacks, engine in [
        ("Slurm", slurm.missing(), by_slurm),
        ("HyperQueue", lacks_hyperqueue(), by_hyperqueue),
    ]:
        if lacks:
            print(f"SKIPPED {name}: {lacks}")
            continue
        try:
            engine(volume, arguments.cpus)
            passed += 1
        except Exception as error:
            failed += 1
            print(f"FAILED {name}: {error}")
    print(f"engines: {passed} passed, {failed} failed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
