"""What goes wrong, as exceptions that keep where, what was found and what was expected."""

from __future__ import annotations


class Error(Exception):
    """Something that went wrong; the text is one line that says it all.

    Nothing half-written is left under a final name, whatever goes wrong.
    """

    place: str | None
    """The file, or the name of the argument."""
    found: str | None
    """What was found there."""
    expected: str | None
    """What should have been there."""
    hint: str | None
    """What can be done about it."""

    def __init__(
        self,
        message: str,
        place: str | None = None,
        found: str | None = None,
        expected: str | None = None,
        hint: str | None = None,
    ) -> None:
        super().__init__(message)
        self.message = message
        self.place, self.found, self.expected, self.hint = place, found, expected, hint

    def __str__(self) -> str:
        return self.message

    def __reduce__(self) -> tuple[type[Error], tuple[str | None, ...]]:
        return type(self), (self.message, self.place, self.found, self.expected, self.hint)


class FileError(Error, OSError):
    """The system refused a file operation."""


class MissingFileError(FileError, FileNotFoundError):
    """A file is not there."""


class FormatError(Error, ValueError):
    """A file is not what it says it is, or is damaged."""


class UnsupportedError(Error, ValueError):
    """A file is sound, but of a kind that is not read."""


class OptionError(Error, ValueError):
    """An argument has a value that cannot be; ``place`` is its name."""


class MemoryLimitError(Error, MemoryError):
    """``memory`` is too little for this volume; ``expected`` has the smallest limit that works."""


class OutputError(Error):
    """The output directory holds something already, or somebody writes to it."""


class InputChangedError(Error):
    """The input was changed while it was read."""


class Stopped(Error):
    """The work was asked to stop."""


class AlvisWarning(UserWarning):
    """What may make numbers wrong unless something is done about it."""
