"""Checks of arguments, with messages for the person who wrote the call."""

from __future__ import annotations

from pathlib import Path

from eightpost.errors import FileFormatError, suggestion


def existing(path: str | Path) -> Path:
    """Return the path of a file or folder.

    Raises:
        FileFormatError: It does not exist; the message lists similar names in its folder.
    """
    path = Path(path)
    if path.exists():
        return path
    if not path.parent.is_dir():
        what = f"the folder {path.parent} does not exist; the current folder is {Path.cwd()}"
    else:
        what = f"the file does not exist; {suggestion(path.name, (one.name for one in path.parent.iterdir()))}"
    raise FileFormatError(what, path=path)


def a(value: object) -> str:
    """Return the type of a value with its article.

    >>> a(1.0)
    'a float'
    """
    name = type(value).__name__
    return f"{'an' if name[0] in 'AEIOaeio' else 'a'} {name}"
