"""The command ``alvis``, also as ``python -m alvis``."""

from __future__ import annotations

import signal
import sys

from . import _native


def main() -> None:
    """Runs the command line and ends the process with its exit status."""
    # the command sees to Ctrl-C itself, or is ended by it as any other program is
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    sys.exit(_native.command(["alvis", *sys.argv[1:]]))


if __name__ == "__main__":
    main()
