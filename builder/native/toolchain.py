"""C compilers: zig, which builds for all platforms on any platform, and the system's compiler."""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Protocol

from builder.native.headers import fmi_headers
from builder.native.platforms import PLATFORMS, Platform, this_platform
from builder.sources import source_folder
from eightpost.errors import FmuError

#: C99; no fused floating-point operations, so that all platforms give the same bits; only the functions of
#: fmi2Functions.h are visible; no debug information, and so no paths; no frame pointers, which cost a few percent.
FLAGS = ("-std=c99", "-O2", "-g0", "-fomit-frame-pointer", "-ffp-contract=off", "-fvisibility=hidden")
WARNINGS = ("-Wall", "-Wextra", "-Wpedantic", "-Werror")


class Toolchain(Protocol):
    """A compiler.

    Attributes:
        name: Name and version, for messages and for the cache.
        platforms: Platforms that it builds for.
        limits: Sentence about its limits, or an empty string.
    """

    @property
    def name(self) -> str: ...  # noqa: D102
    @property
    def platforms(self) -> tuple[Platform, ...]: ...  # noqa: D102
    @property
    def limits(self) -> str: ...  # noqa: D102

    def command(self, identifier: str, platform: Platform, target: str, files: Sequence[str]) -> list[str]:
        """Return the command that compiles files of the working folder into `identifier` + the platform's suffix."""
        ...


@dataclass(frozen=True)
class Zig:
    """The compiler zig from PyPI's package ziglang (`eightpost[build]`)."""

    path: str

    @property
    def name(self) -> str:
        """Name and version."""
        return f"zig {_first_line((self.path, 'version'))}"

    @property
    def platforms(self) -> tuple[Platform, ...]:
        """All six platforms."""
        return tuple(PLATFORMS.values())

    @property
    def limits(self) -> str:
        """Empty: there are no limits."""
        return ""

    def command(self, identifier: str, platform: Platform, target: str, files: Sequence[str]) -> list[str]:
        """Return the command that compiles files of the working folder."""
        options = ["build-lib", "-dynamic", "-OReleaseFast", "-fstrip", "-target", target, "-mcpu", platform.processor]
        options += ["--name", identifier, f"-femit-bin={identifier}{platform.suffix}", *_includes()]
        entry: list[str] = []
        if platform.suffix == ".dll":
            # The MinGW runtime of zig takes minutes to build, and an FMU only needs three functions of Windows.
            entry = [str(source_folder() / "common" / "windows_entry.c")]
            include = Path(self.path).parent / "lib" / "libc" / "include" / "any-windows-any"
            options += ["-fno-emit-implib", "-fcompiler-rt", "-isystem", str(include)]
            options += ["-lapi-ms-win-crt-heap-l1-1-0", "-lapi-ms-win-crt-string-l1-1-0"]
        else:
            options += ["-fno-compiler-rt", "-lc"]
        if platform.suffix == ".so":
            options.append(f"-fsoname={identifier}.so")
        if platform.suffix == ".dylib":
            options += ["-install_name", f"@rpath/{identifier}.dylib"]
        flags = [*FLAGS, *WARNINGS, "-fno-sanitize=all", "-fno-stack-protector"]
        if platform.name == "win32":
            flags.append("-mstackrealign")  # callers on win32 only align the stack to four bytes
        return [self.path, *options, "-cflags", *flags, "--", *files, *entry]


@dataclass(frozen=True)
class SystemCompiler:
    """The installed compiler, gcc or clang, which only builds for this platform."""

    path: str

    @property
    def name(self) -> str:
        """First line of its --version output."""
        return _first_line((self.path, "--version"))

    @property
    def platforms(self) -> tuple[Platform, ...]:
        """Only the platform of this machine."""
        return (this_platform(),)

    @property
    def limits(self) -> str:
        """Sentence that it only builds for this platform, with the package that builds for all."""
        return (
            f"built for {this_platform().name} only, with {Path(self.path).name}; to build for all six platforms, "
            "install the compiler zig: pip install 'eightpost[build]'"
        )

    def command(self, identifier: str, platform: Platform, target: str, files: Sequence[str]) -> list[str]:
        """Return the command that compiles files of the working folder."""
        options = [*FLAGS, *WARNINGS, "-fPIC", "-shared", "-s", *_includes()]
        return [self.path, *options, *files, "-o", f"{identifier}{platform.suffix}"]


def find_toolchain() -> Toolchain:
    """Return zig if it is installed (`eightpost[build]`), otherwise the system's compiler.

    Raises:
        FmuError: No compiler is installed.
    """
    if zig := _zig():
        return Zig(zig)
    for name in (os.environ.get("CC", ""), "cc", "gcc", "clang"):
        if name and (found := shutil.which(name)):
            return SystemCompiler(found)
    raise FmuError(
        "there is no C compiler for native FMUs: install one that builds for all platforms with "
        "pip install 'eightpost[build]', or build with --target python"
    )


def _includes() -> list[str]:
    """Return the include options; the absolute folder is a separate argument, which the cache key leaves out."""
    return ["-I", str(fmi_headers()), "-I."]


def _zig() -> str | None:
    spec = importlib.util.find_spec("ziglang")
    if spec is None or spec.origin is None:
        return None
    found = Path(spec.origin).with_name("zig.exe" if sys.platform == "win32" else "zig")
    return str(found) if found.is_file() else None


@cache
def _first_line(command: tuple[str, ...]) -> str:
    ran = subprocess.run(command, capture_output=True, text=True, check=False)
    return (ran.stdout or ran.stderr).strip().partition("\n")[0]
