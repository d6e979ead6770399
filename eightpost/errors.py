"""The errors that a caller acts on differently.

Every message says what, where (file, line, channel), which value, and what to do. The command line turns an
`InputError` into exit code 2 and any other `EightpostError` into exit code 1.
"""

from __future__ import annotations

from pathlib import Path


class EightpostError(Exception):
    """Base of everything this project raises on purpose."""


class InputError(EightpostError, ValueError):
    """What was given cannot be used: a file, a value, a name."""


class DataError(InputError):
    """A fault of a record, with the place where it is."""

    def __init__(
        self,
        what: str,
        *,
        path: str | Path | None = None,
        line: int | None = None,
        channel: str | None = None,
    ) -> None:
        """Compose `file, line, channel: what`.

        Args:
            what: The fault, the value and what to do about it.
            path: The file.
            line: One-based line (text files) or sample (binary files) where it is.
            channel: The channel's name.
        """
        place = [str(path)] if path is not None else []
        if line is not None:
            place.append(f"line {line}")
        if channel is not None:
            place.append(f"channel {channel!r}")
        super().__init__(f"{', '.join(place)}: {what}" if place else what)
        self.path, self.line, self.channel = path, line, channel


class FileFormatError(DataError):
    """The file cannot be read as what its name says."""


class OutputError(InputError):
    """A file or folder that cannot be written."""


class MissingChannelError(DataError):
    """A channel that is needed is not there."""


class MissingUnitError(DataError):
    """A channel has no unit; units are never guessed."""


class UnknownUnitError(DataError):
    """A unit that is not known, or of the wrong dimension."""


class NotANumberError(DataError):
    """A sample is NaN, infinite, empty or text."""


class BackwardTimeError(DataError):
    """Time runs backwards."""


class DuplicateTimeError(DataError):
    """Two samples have the same time."""


class TimeGapError(DataError):
    """Samples are missing."""


class ConstantChannelError(DataError):
    """A channel that must move does not."""


class TooShortError(DataError):
    """Too few samples for what is asked."""


class WrongSignError(DataError):
    """A channel is positive the other way."""


class ClippedChannelError(DataError):
    """A channel sits at the end of its range."""


class ParameterError(InputError):
    """A parameter is outside what its law or model admits."""


class FmuError(InputError):
    """A file is not an FMU that can be used here."""


class WiringError(InputError):
    """A system's connections do not fit together."""


class StepError(EightpostError):
    """A component failed while it was initialised or stepped."""


class DivergedError(StepError):
    """The coupling diverged: a smaller step or another scheme may be stable."""


class TerminatedError(StepError):
    """A component wants no more steps: the simulation has come to its end."""
