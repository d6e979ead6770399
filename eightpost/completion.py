"""Mark of an output folder whose command has not completed: its other files may be of an earlier run.

A command marks its folder before it computes, and removes the mark when all outputs are written. A command that fails,
crashes or is killed leaves the mark, so that whoever reads the folder later can say that the results are older.
"""

from __future__ import annotations

import logging
import shlex
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

#: Name of the mark in the folder.
MARK = "unfinished.txt"

#: Function that takes a sentence about earlier results, which another process prints if this one ends. Commands set it.
tell: Callable[[str], None] | None = None

_LOGGER = logging.getLogger(__name__)

#: Folders that this process has marked, as the user named them, and whether it created them.
_marked: dict[Path, tuple[str, bool]] = {}


def begin(folder: str | Path) -> None:
    """Mark the output folder of this command, before it computes.

    Raises:
        InputError: The path or one of its parents is a file.
        OutputError: The folder cannot be written.
    """
    from eightpost.files import writing  # noqa: PLC0415 -- help texts do not need it
    from eightpost.outputs import check_folder  # noqa: PLC0415

    check_folder(folder)
    shown, folder = folder, Path(folder).absolute()  # an FMU may change the working directory
    is_new = not folder.exists()
    with writing(folder / MARK):
        folder.mkdir(parents=True, exist_ok=True)
        (folder / MARK).write_text(
            f"{shlex.join(['eightpost', *sys.argv[1:]])}\n\nbegan at {time.strftime('%Y-%m-%d %H:%M:%S %z')} and has "
            "not written all of its results. Until it has, the other files in this folder may be of an earlier run. A "
            "complete run removes this file.\n",
            encoding="utf-8",
        )
    _marked[folder] = str(shown), is_new
    if tell is not None and not _is_bare(folder):
        tell(_remains(shown))


@contextmanager
def marks_removed(*done: type[BaseException]) -> Iterator[None]:
    """Remove the marks that the block made if it ends without an exception, or with one of those in `done`.

    Any other exception gets a note about the results that remain.
    """
    try:
        yield
    except done:
        _end()
        raise
    except BaseException as error:
        for sentence in abandon():
            error.add_note(sentence)
        raise
    _end()


def abandon() -> list[str]:
    """Leave the marks; return a sentence about each folder in which results remain.

    A mark in a folder without any other file is removed, and the folder if it was created for it.
    """
    found = []
    for folder, (shown, is_new) in _marked.items():
        if not _is_bare(folder):
            found.append(_remains(shown))
            continue
        with suppress(OSError):
            (folder / MARK).unlink()
            if is_new:
                folder.rmdir()
    _marked.clear()
    return found


def warn_of_earlier_results(folder: str | Path) -> None:
    """Log a warning if the results in a folder are not of the last run, because that did not finish."""
    folder = Path(folder)
    if folder.absolute() not in _marked and (folder / MARK).is_file():
        _LOGGER.warning("results in %s are of an earlier run: the last one did not finish (see %s)", folder, MARK)


def _end() -> None:
    for folder in _marked:
        (folder / MARK).unlink(missing_ok=True)
    _marked.clear()


def _is_bare(folder: Path) -> bool:
    """Return whether a folder contains nothing but the mark."""
    with suppress(OSError):
        return all(path.name == MARK for path in folder.iterdir())
    return True


def _remains(folders: str | Path) -> str:
    return f"The results in {folders} are of an earlier run"
