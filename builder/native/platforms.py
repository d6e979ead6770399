"""The six platforms of a native FMU, with their FMI 2.0 names."""

from __future__ import annotations

import platform as this
import struct
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType


@dataclass(frozen=True, slots=True)
class Platform:
    """One folder of binaries/."""

    name: str  #: Name of the platform in FMI 2.0.
    name_3: str  #: Name of the platform in FMI 3.0.
    suffix: str  #: Suffix of the library's file name.
    #: Target names of the cross compiler, one per slice; several slices make a universal file.
    targets: tuple[str, ...]
    processor: str = "baseline"  #: Minimum processor, set if the target's default would round doubles differently.

    def member(self, identifier: str, fmi: int = 2) -> str:
        """Return the path of the library in the archive of an FMI version."""
        return f"binaries/{self.name_3 if fmi == 3 else self.name}/{identifier}{self.suffix}"


#: glibc 2.17 is the version of CentOS 7. win32 needs SSE2: the x87 unit computes with more digits than a double has.
PLATFORMS: Mapping[str, Platform] = MappingProxyType(
    {
        found.name: found
        for found in (
            Platform("linux64", "x86_64-linux", ".so", ("x86_64-linux-gnu.2.17",)),
            Platform("win64", "x86_64-windows", ".dll", ("x86_64-windows-gnu",)),
            Platform("win32", "x86-windows", ".dll", ("x86-windows-gnu",), "pentium4"),
            Platform("aarch64-linux", "aarch64-linux", ".so", ("aarch64-linux-gnu.2.17",)),
            Platform("darwin64", "x86_64-darwin", ".dylib", ("x86_64-macos.11.0", "aarch64-macos.11.0")),
            Platform("aarch64-darwin", "aarch64-darwin", ".dylib", ("aarch64-macos.11.0",)),
        )
    }
)

#: A page in a browser: a module without imports.
BROWSER = Platform("a browser", "a browser", ".wasm", ("wasm32-freestanding",))

_MACHINES = {"x86_64": "64", "amd64": "64", "aarch64": "aarch64", "arm64": "aarch64"}


def this_platform() -> Platform:
    """Return the platform that this program runs on; a platform that FMI does not list gets a similar name."""
    system = {"linux": "linux", "win32": "win", "darwin": "darwin"}.get(sys.platform, sys.platform)
    machine = _MACHINES.get(this.machine().lower(), this.machine().lower())
    if struct.calcsize("P") == 4:
        name = f"{system}32"
    else:
        name = f"aarch64-{system}" if machine == "aarch64" else f"{system}{machine}"
    return PLATFORMS.get(name) or Platform(name, name, ".so", ("",))
