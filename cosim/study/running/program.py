"""The program that computes a study: results of workers are equal to the bit only if they have the same one."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path

import cosim
import eightpost
from eightpost import __version__
from eightpost.machine.library import sources


@dataclass(frozen=True, slots=True)
class Program:
    """What determines the bits of a result besides its inputs."""

    version: str  #: Version of eightpost.
    code: str  #: SHA-256 of its sources.
    libraries: Mapping[str, str]  #: Versions of the libraries that compute measures, by name.

    def difference(self, expected: Program) -> str:
        """Return in words how this program differs from the expected one; empty if it is the same."""
        if self.version != expected.version:
            return f"eightpost {self.version}, but {expected.version} is required"
        if self.code != expected.code:
            return f"eightpost {self.version} with other sources, but the same ones are required"
        return ""

    def other_libraries(self, expected: Program) -> str:
        """Return the libraries that have other versions than expected, as text."""
        apart = {name: found for name, found in self.libraries.items() if found != expected.libraries.get(name)}
        return ", ".join(f"{name} {found} instead of {expected.libraries.get(name)}" for name, found in apart.items())


@cache
def program() -> Program:
    """Return the program of this process."""
    digest = hashlib.sha256()
    for package in (cosim, eightpost):
        folder = Path(package.__file__ or "").parent
        for path in sorted(folder.rglob("*.py")):
            if "examples" not in path.relative_to(folder).parts:  # a wheel has them, a checkout does not
                _add(digest, path.relative_to(folder).as_posix(), path.read_bytes())
    for name, content in sorted(sources().items()):
        _add(digest, name, content)
    return Program(__version__, digest.hexdigest(), {name: version(name) for name in ("numpy", "scipy")})


def _add(digest: hashlib._Hash, name: str, content: bytes) -> None:
    digest.update(name.encode() + b"\0" + content.replace(b"\r\n", b"\n") + b"\0")
