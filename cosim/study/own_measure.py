"""User-defined measures: functions in a Python file."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from functools import cache
from pathlib import Path

from cosim.study.statistics import Response
from eightpost.errors import InputError

OwnFunction = Callable[[Response], float]


@cache
def own_function(entry: str) -> OwnFunction:
    """Return the function that `file.py:name` names.

    The function takes a Response (`rows` (C, N) in SI, `total` (N,), `step` [s], `options`) and returns a number in SI.

    Raises:
        InputError: The file or the function does not exist, or the file cannot be run.
    """
    file, colon, name = entry.rpartition(":")
    if not colon or not name.isidentifier():
        raise InputError(f"{entry!r}: a user-defined measure must be written as FILE.py:FUNCTION")
    path = Path(file)
    specification = importlib.util.spec_from_file_location(f"_measures_of_{path.stem}", path)
    if specification is None or specification.loader is None or not path.is_file():
        raise InputError(f"{entry}: there is no Python file {path}")
    module = importlib.util.module_from_spec(specification)
    try:
        specification.loader.exec_module(module)
    except Exception as error:  # the file may raise anything
        raise InputError(f"{path}: cannot be run: {type(error).__name__}: {error}") from error
    found = getattr(module, name, None)
    if not callable(found):
        raise InputError(f"{path}: has no function {name!r}")
    function: OwnFunction = found
    return function
