"""Exceptions of the project, one class for each case that callers may handle separately.

Every message says what is wrong, where (file, line, channel), which value, and what to do. The command line turns an
`InputError` into exit code 2 and any other `EightpostError` into exit code 1.
"""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches
from numbers import Real
from pathlib import Path

#: Number of known names that a message lists if none is similar.
_LISTED = 12


def suggestion(name: str, known: Iterable[str]) -> str:
    """Return the end of a message about an unknown name: similar names, or else the first known ones.

    >>> suggestion("forse", ["force", "velocity"])
    'did you mean force?'
    """
    names = list(known)
    close = get_close_matches(name, names, n=3)
    if close:
        return f"did you mean {', '.join(close)}?"
    more = f" and {len(names) - _LISTED} more" if len(names) > _LISTED else ""
    return f"there are: {', '.join(names[:_LISTED]) or 'none'}{more}"


def choice_of(what: str, value: object, known: Iterable[str]) -> str:
    """Return the known word that a value spells, in capitals or not; 3 and `3.0` are also `3`.

    Args:
        what: Name of the choice in the message.
        value: Word or number that a user wrote.
        known: Words, in lower case.

    Raises:
        ParameterError: The value is not one of them; the message names similar ones.

    >>> choice_of("FMI version", "3.0", ["2", "3"])
    '3'
    """
    word, words = str(value).strip().lower().removesuffix(".0"), list(known)
    if word not in words:
        close = suggestion(word, words)
        near = f"; {close}" if close.startswith("did") else ""
        raise ParameterError(f"unknown {what} {value!r}; it must be one of {', '.join(words)}{near}")
    return word


def missing_file(path: str | Path, advice: str = "") -> str:
    """Return what is wrong with a path that does not exist: similar names in its folder, or what to do.

    Args:
        path: Path of the file.
        advice: Advice for the user if no name in the folder is similar.
    """
    folder, name = Path(path).parent, Path(path).name
    try:
        if Path(path).is_symlink():
            return f"it is a link to {Path(path).readlink()}, which does not exist; correct the link"
        if not folder.is_dir():
            what = advice or f"the current folder is {Path.cwd()}"
            return f"there is no such file: there is no folder {folder}; {what}"
        names = [one.name for one in folder.iterdir()]
        same = [one for one in names if one.lower() == name.lower()]
        close = same or get_close_matches(name, names, n=3, cutoff=0.75)
    except (OSError, ValueError):
        close = []
    if close:
        return f"there is no such file; did you mean {', '.join(close)}?"
    return f"there is no such file{': ' if advice else ''}{advice}"


def check_number(name: str, value: object, unit: str = "") -> None:
    """Check that an argument is a number, so that a text such as '1 ms' is an error of the call that has it.

    Args:
        name: Name of the argument.
        value: Value of the argument; None is accepted, because it stands for the default.
        unit: Unit of the number.

    Raises:
        InputError: It is neither a number nor None.

    >>> check_number("step", "1 ms", "s")
    Traceback (most recent call last):
    ...
    eightpost.errors.InputError: step is '1 ms'; give a number [s]
    """
    if value is not None and (isinstance(value, bool) or not isinstance(value, Real)):
        raise InputError(f"{name} is {value!r}; give a number{f' [{unit}]' if unit else ''}")


class EightpostError(Exception):
    """Base class of all exceptions that this project raises deliberately."""


class InputError(EightpostError, ValueError):
    """An input cannot be used: a file, a value, a name."""


class DataError(InputError):
    """A fault in a record, with its location."""

    def __init__(
        self,
        what: str,
        *,
        path: str | Path | None = None,
        line: int | None = None,
        sample: int | None = None,
        channel: str | None = None,
    ) -> None:
        """Compose `file, line or sample, channel: what`.

        Args:
            what: Description of the fault, with the value and what to do.
            path: Path of the file.
            line: One-based line of the fault in a text file.
            sample: One-based sample of the fault in a binary file or in memory.
            channel: Name of the channel.
        """
        place = [str(path)] if path is not None else []
        if line is not None:
            place.append(f"line {line}")
        if sample is not None:
            place.append(f"sample {sample}")
        if channel is not None:
            place.append(f"channel {channel!r}")
        super().__init__(f"{', '.join(place)}: {what}" if place else what)
        self.path, self.line, self.sample, self.channel = path, line, sample, channel


class FileFormatError(DataError):
    """A file cannot be read as the format that its name indicates."""


class OutputError(InputError):
    """A file or folder cannot be written."""


class MissingChannelError(DataError):
    """A required channel is missing."""


class MissingUnitError(DataError):
    """A channel has no unit; units are never guessed."""


class UnknownUnitError(DataError):
    """A unit is unknown or has the wrong dimension."""


class NotANumberError(DataError):
    """A sample is NaN, infinite, empty or text."""


class BackwardTimeError(DataError):
    """The time decreases between two samples."""


class DuplicateTimeError(DataError):
    """Two samples have the same time."""


class TimeGapError(DataError):
    """Samples are missing."""


class ConstantChannelError(DataError):
    """A channel that must vary is constant."""


class TooShortError(DataError):
    """A record has too few samples."""


class WrongSignError(DataError):
    """A channel has the opposite sign convention."""


class ClippedChannelError(DataError):
    """A channel is clipped at the end of its range."""


class ParameterError(InputError):
    """A parameter is outside the range that its law or model allows."""


class FmuError(InputError):
    """A file is not an FMU that this project can use."""


class WiringError(InputError):
    """The connections of a system are inconsistent."""


class StepError(EightpostError):
    """A component failed during initialisation or in a step."""


class DivergedError(StepError):
    """The coupling diverged; a smaller coupling step or another scheme may be stable."""


class WorkersLostError(StepError):
    """The workers that run the setups of a study have ended, or cannot run it; completed setups are kept."""


class TerminatedError(StepError):
    """A component requested the end of the simulation."""
