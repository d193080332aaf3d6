"""Starts stores of objects on this machine."""

import contextlib
import os
import pathlib
import shutil
import socket
import subprocess
import sys
import time


def free_port():
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        return listening.getsockname()[1]


def wait_for(port, process, seconds=60):
    """Waits until somebody listens on a port."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port), 1):
            return
        if process.poll() is not None:
            raise RuntimeError(f"{process.args[0]} ended with {process.returncode}")
        time.sleep(0.05)
    raise RuntimeError(f"{process.args[0]} does not listen after {seconds} s")


class Store:
    """A store that runs while it is used as a context, `address` being its HOST:PORT."""

    def __init__(self, command, port, log):
        self.command, self.port, self.log = command, port, log
        self.address = f"127.0.0.1:{port}"

    def __enter__(self):
        with open(self.log, "wb") as log:
            self.process = subprocess.Popen([str(word) for word in self.command], stdout=log, stderr=log)
        wait_for(self.port, self.process)
        return self

    def __exit__(self, *_):
        self.process.terminate()
        self.process.wait()


def moto(directory):
    """The store of moto, which is in memory; `None` if it is not installed."""
    program = pathlib.Path(sys.executable).with_name("moto_server")
    if not program.exists():
        return None
    port = free_port()
    return Store([program, "-H", "127.0.0.1", "-p", port], port, directory / "moto.log")


def s3rver(directory, npm):
    """A store whose objects are files, which does not know conditions; `None` if it is not installed."""
    program = pathlib.Path(npm or os.devnull) / "node_modules" / ".bin" / "s3rver"
    if not shutil.which("node") or not program.exists():
        return None
    files, port = directory / "s3rver", free_port()
    files.mkdir()
    command = [program, "--directory", files, "--address", "127.0.0.1", "--port", port, "--configure-bucket", "lab"]
    return Store(command, port, directory / "s3rver.log")
