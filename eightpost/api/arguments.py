"""Checks of arguments, with messages for the person who wrote the call."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from eightpost.errors import FileFormatError, InputError, missing_file
from eightpost.files import read_text

if TYPE_CHECKING:
    from eightpost.signals import ChannelMap


def existing(path: str | Path) -> Path:
    """Return the path of a file or folder.

    Raises:
        InputError: It is not a path.
        FileFormatError: It does not exist; the message lists similar names in its folder.
    """
    if not isinstance(path, str | Path):
        raise InputError(f"a file is needed here, as a text or a Path, not {a(path)}")
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
        content = tomllib.loads(read_text(path))
    except tomllib.TOMLDecodeError as error:
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


def channel_map_of(given: ChannelMap | Mapping[str, str] | str | Path | None) -> ChannelMap | None:
    """Return the channel map of an argument: a map, a file of one, or the name of the column by channel.

    Raises:
        InputError: It is something else.
        FileFormatError: The file cannot be read.
    """
    from eightpost.signals import ChannelMap, MappedChannel

    if given is None or isinstance(given, ChannelMap):
        return given
    if isinstance(given, str | Path):
        return ChannelMap.read(given)
    if not isinstance(given, Mapping) or not all(isinstance(column, str) for column in given.values()):
        raise InputError(
            f"channel_map is {given!r}; give a file, a ChannelMap, or columns by channel: {{'force': 'Load cell 2'}}"
        )
    return ChannelMap({name: MappedChannel(column) for name, column in given.items()})


def a(value: object) -> str:
    """Return the type of a value with its article.

    >>> a(1.0), a(None)
    ('a float', 'None')
    """
    if value is None:
        return "None"
    name = type(value).__name__
    return f"{'an' if name[0] in 'AEIOaeio' else 'a'} {name}"
