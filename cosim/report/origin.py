"""Origin of a run: files with their digests, versions and the machine."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from xml.etree import ElementTree

from cosim.results.result import Result
from eightpost import __version__
from eightpost.archive import open_archive
from eightpost.errors import FmuError
from eightpost.files import sha256_of
from eightpost.signals import Drivefile

_PACKAGES = ("numpy", "scipy", "numba", "fmpy")


@dataclass(frozen=True, slots=True)
class Origin:
    """Origin of a component."""

    name: str  #: Name of the component.
    file: str  #: Name of its file.
    identity: str  #: GUID.
    made_by: str  #: Tool and model version stated in its description; empty if not known.
    digest: str  #: SHA-256 of the file; empty if not known.
    parameters: tuple[str, ...]  #: Values that differ from its defaults, in its own units.


def origins(result: Result, files: Mapping[str, Path]) -> tuple[Origin, ...]:
    """Return the origin of every component.

    Args:
        result: Result of the run.
        files: FMU files by component, if known; each is read once.
    """
    known = {path: (_made_by(path), _digest(path)) for path in set(files.values())}
    return tuple(
        Origin(
            name,
            result.sources.get(name, ""),
            identity,
            *(known[files[name]] if name in files else ("", "")),
            parameters=tuple(f"{p} = {value}" for p, value in result.parameters.get(name, {}).items()),
        )
        for name, identity in result.identities.items()
    )


def drive_digest(drive: Drivefile) -> str:
    """Return the SHA-256 of the contents of a drive, independent of its file format.

    It is computed from one line `name [unit]` per channel in UTF-8, then the times and the values, channel
    after channel, in SI as little-endian 64-bit numbers.
    """
    digest = hashlib.sha256()
    for name, unit in zip(drive.names, drive.units, strict=True):
        digest.update(f"{name} [{unit}]\n".encode())
    digest.update(drive.series.time.astype("<f8").tobytes())
    digest.update(drive.series.values.astype("<f8").tobytes())
    return digest.hexdigest()


def versions() -> str:
    """Return the versions of the current installation."""
    return ", ".join((f"eightpost {__version__}", f"Python {platform.python_version()}", *_packages(), _machine()))


def _packages() -> Iterator[str]:
    for name in _PACKAGES:
        try:
            yield f"{name} {version(name)}"
        except PackageNotFoundError:
            continue


def _machine() -> str:
    return f"{platform.system()} {platform.machine()}"


def _digest(path: Path) -> str:
    return sha256_of(path) if path.is_file() else ""


def _made_by(path: Path) -> str:
    """Return the tool and the model's version from modelDescription.xml; empty if the file cannot be read."""
    try:
        with open_archive(path) as archive:
            content = archive.read("modelDescription.xml")
        root = ElementTree.fromstring(content)
    except (FmuError, ElementTree.ParseError, ValueError, LookupError):
        return ""
    model = f"version {root.get('version')}" if root.get("version") else ""
    return ", ".join(filter(None, (root.get("generationTool"), model, f"FMI {root.get('fmiVersion', '')}")))
