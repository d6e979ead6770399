"""Checks of arguments, with messages for the person who wrote the call."""

from __future__ import annotations

import tomllib
from pathlib import Path

from eightpost.errors import FileFormatError, InputError, missing_file


def existing(path: str | Path) -> Path:
    """Return the path of a file or folder.

    Raises:
        FileFormatError: It does not exist; the message lists similar names in its folder.
    """
    path = Path(path)
    if path.exists():
        return path
    raise FileFormatError(missing_file(path, f"the current folder is {Path.cwd()}"), path=path)


def toml_kind(path: Path) -> str:
    """Return what a TOML file defines: `system`, `study` or `vehicle`; an empty text for any other file.

    Raises:
        FileFormatError: It is not a TOML file.
    """
    try:
        content = tomllib.loads(path.read_text("utf-8"))
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise FileFormatError(f"is not a TOML file ({error})", path=path) from error
    found = (
        kind for kind, key in (("study", "bank"), ("system", "components"), ("vehicle", "model")) if key in content
    )
    return next(found, "")


#: What to do with the files of each kind.
_USES = {"system": "run it with run", "study": "run it with study", "vehicle": "make an FMU of it with build"}


def existing_toml(path: str | Path, kind: str) -> Path:
    """Return the path of a file, which may be of another format.

    Raises:
        FileFormatError: It does not exist, or is not a TOML file.
        InputError: It is a TOML file of another kind.
    """
    path = existing(path)
    if path.suffix.lower() == ".toml" and (found := toml_kind(path)) not in ("", kind):
        raise InputError(f"{path} defines a {found}, not a {kind}; {_USES[found]}")
    return path


def a(value: object) -> str:
    """Return the type of a value with its article.

    >>> a(1.0)
    'a float'
    """
    name = type(value).__name__
    return f"{'an' if name[0] in 'AEIOaeio' else 'a'} {name}"
