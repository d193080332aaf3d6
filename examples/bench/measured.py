"""Time and memory of a whole process, for the scripts beside this one."""

import os
import subprocess


def run(command: list[str], environment: dict[str, str] | None = None) -> tuple[str, float, float, float]:
    """What it printed, wall and processor seconds, and MiB at most, of a process of its own; `environment` is added to that of
    this one."""
    before = os.times()
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=os.environ | (environment or {}))
    printed = process.stdout.read()
    _, status, usage = os.wait4(process.pid, 0)
    if status:
        raise SystemExit(f"failed: {command}")
    wall = os.times().elapsed - before.elapsed
    return printed, wall, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024
