"""What an FMU of this project contains about itself: its interface and the constants in its sources."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from cosim.components.fmu_component import FmuComponent
from eightpost.array_types import Array, Integers
from eightpost.machine import NotInBatchError

_KIND = re.compile(r"/\* (\w+) [\d.]+: generated from interface\.toml")
_CONSTANT = re.compile(r"(\w+) = (-?\d+)[,\s}]")
_TABLE = re.compile(r"static const (?:double|int) (\w+)(?:\[\w+(?: \+ 1)?\])* = (\{.*?\});", re.DOTALL)
_SCALAR = re.compile(r"static const double (\w+) = ([^;]+);")
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*(?:[eE][-+]?\d+)?|inf|nan)")


@dataclass(frozen=True, slots=True, eq=False)
class Constants:
    """Constants of a generated C file."""

    sizes: Mapping[str, int]  #: Enumeration constants by name.
    numbers: Mapping[str, Array]  #: Numbers of every table, in their order, by name.

    @classmethod
    def of(cls, text: str) -> Constants:
        """Read a generated C file."""
        tables = {name: _numbers(content) for name, content in _TABLE.findall(text)}
        tables |= {name: _numbers(content) for name, content in _SCALAR.findall(text)}
        return cls({name: int(value) for name, value in _CONSTANT.findall(text)}, tables)

    def filled(self, name: str, count: int) -> Array:
        """Return the numbers of a table, filled up with zeros as a C compiler does."""
        numbers = np.zeros(count)
        numbers[: self.numbers[name].size] = self.numbers[name]
        return numbers

    def integers(self, name: str, count: int) -> Integers:
        """Return the numbers of a table of integers."""
        return self.filled(name, count).astype(np.int64)


def _numbers(text: str) -> Array:
    return np.array([float(number) for number in _NUMBER.findall(text)])


@dataclass(frozen=True, slots=True)
class Sources:
    """Sources of an FMU of this project."""

    kind: str  #: Interface: `vehicle_ss`, `shock_lpnl2` and so on.
    files: Mapping[str, str]  #: Content of the files in sources/ by name.

    @classmethod
    def of(cls, component: FmuComponent, path: Path) -> Sources:
        """Read the sources of an FMU.

        Raises:
            NotInBatchError: The FMU is not of this project, or contains no sources.
        """
        if not component.is_ours:
            raise NotInBatchError(f"{path.name} was not built by eightpost")
        try:
            state = path.stat()
            files = _headers(path, state.st_mtime_ns, state.st_size)
        except (OSError, UnicodeDecodeError, zipfile.BadZipFile) as error:
            raise NotInBatchError(f"{path.name} cannot be read: {error}") from error
        found = _KIND.search(files.get("interface.h", ""))
        if found is None:
            raise NotInBatchError(f"{path.name} contains no sources (it is confidential)")
        return cls(found[1], files)


@lru_cache(maxsize=128)  # the trials of a search are thousands of shocks with the same few FMUs
def _headers(path: Path, _changed: int, _size: int) -> Mapping[str, str]:
    """Return the headers in the sources of an FMU by name; the time of its last change and its size identify it."""
    with zipfile.ZipFile(path) as archive:
        names = [name for name in archive.namelist() if name.startswith("sources/") and name.endswith(".h")]
        return {name.removeprefix("sources/"): archive.read(name).decode() for name in names}
