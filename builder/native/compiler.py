"""Compilation of C sources into shared libraries, in parallel and with a cache."""

from __future__ import annotations

import os
import subprocess
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from builder.native.headers import NAMES, fmi_headers
from builder.native.platforms import Platform
from builder.native.toolchain import Toolchain
from builder.native.universal import universal
from eightpost.cache import cache_folder, digest, keep, recall
from eightpost.errors import FmuError
from eightpost.processors import usable_processors

#: A C file that includes all others, and one that does the same for processors with AVX (fmus/common/wide.h).
_WHOLE, _WIDE = "whole.c", "wide.c"

#: The typedef is there because ISO C requires at least one declaration in every file.
_WIDE_UNIT = """\
#if defined(__x86_64__)
#if defined(__clang__)
#pragma clang attribute push(__attribute__((target("avx"))), apply_to = function)
#else
#pragma GCC target("avx")
#endif
#define FMI2_FUNCTION_PREFIX wide_
{includes}#if defined(__clang__)
#pragma clang attribute pop
#endif
#else
typedef int not_here;
#endif
"""


@dataclass(frozen=True)
class Library:
    """One shared library to compile.

    Args:
        identifier: Name of the library.
        sources: C files and headers by name (one flat folder).
        is_one_unit: Whether its C files can be compiled as one translation unit, which requires that no two of them
            define the same static name. Functions can then be inlined across files, which makes steps a few percent
            faster.
        is_wide: Whether the unit is compiled a second time for processors with AVX.
    """

    identifier: str
    sources: Mapping[str, bytes]
    is_one_unit: bool = False
    is_wide: bool = False

    @property
    def units(self) -> tuple[str, ...]:
        """Names of the C files that are compiled."""
        if not self.is_one_unit:
            return _c_files(self.sources)
        return (_WHOLE, _WIDE) if self.is_wide else (_WHOLE,)

    @property
    def files(self) -> Mapping[str, bytes]:
        """Files in the compiler's working folder."""
        if not self.is_one_unit:
            return self.sources
        includes = "".join(f'#include "{name}"\n' for name in _c_files(self.sources))
        if not self.is_wide:
            return {**self.sources, _WHOLE: includes.encode()}
        units = {_WHOLE: f"#define EIGHTPOST_WIDE\n{includes}", _WIDE: _WIDE_UNIT.format(includes=includes)}
        return {**self.sources, **{name: text.encode() for name, text in units.items()}}


def compile_libraries(
    libraries: Sequence[Library],
    *,
    toolchain: Toolchain,
    progress: Callable[[int, int], None] | None = None,
) -> list[dict[str, bytes]]:
    """Compile each library for all platforms of the toolchain; binaries in the cache are not compiled again.

    Args:
        libraries: Libraries to compile.
        toolchain: Compiler and its platforms.
        progress: Callback that receives the number of finished binaries and the total number.

    Returns:
        Members of the archive for each library: name -> content.

    Raises:
        FmuError: The compiler fails; the message quotes its error.
    """
    jobs = [(library, platform) for library in libraries for platform in toolchain.platforms]
    done: list[bytes] = []
    with ThreadPoolExecutor(usable_processors()) as pool:
        for content in pool.map(lambda job: _binary(toolchain, *job), jobs):
            done.append(content)
            if progress:
                progress(len(done), len(jobs))
    found = iter(done)
    return [{p.member(library.identifier): next(found) for p in toolchain.platforms} for library in libraries]


def _binary(toolchain: Toolchain, library: Library, platform: Platform) -> bytes:
    slices = [_slice(toolchain, library, platform, target) for target in platform.targets]
    return slices[0] if len(slices) == 1 else universal(slices)


def _slice(toolchain: Toolchain, library: Library, platform: Platform, target: str) -> bytes:
    command = toolchain.command(library.identifier, platform, target, library.units)
    key = _key(toolchain, library, target or platform.name, command)
    content = recall("binaries", key)
    if content is None:
        content = _compile(toolchain, library, platform, command)
        keep("binaries", key, content)
    return content


def _key(toolchain: Toolchain, library: Library, target: str, command: Sequence[str]) -> str:
    """Return a digest of everything that the binary depends on, without folder names of this machine."""
    parts: list[bytes | str] = [toolchain.name, library.identifier, target]
    parts += [part for part in command if not Path(part).is_absolute()]
    for name, content in sorted(library.files.items()):
        parts += [name, content]
    own = [Path(part) for part in command if Path(part).is_absolute() and part.endswith(".c")]
    return digest([*parts, *(path.read_bytes() for path in (*own, *(fmi_headers() / name for name in NAMES)))])


def _compile(toolchain: Toolchain, library: Library, platform: Platform, command: Sequence[str]) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        for name, content in library.files.items():
            (Path(folder) / name).write_bytes(content)
        ran = subprocess.run(
            command, cwd=folder, env=_environment(folder), capture_output=True, text=True, errors="replace", check=False
        )
        if ran.returncode != 0:
            raise FmuError(
                f"{library.identifier}: {toolchain.name} could not compile it for {platform.name}: "
                f"{_first_error(ran.stderr) or f'it ended with status {ran.returncode} and printed no error'}"
            )
        return (Path(folder) / f"{library.identifier}{platform.suffix}").read_bytes()


def _c_files(names: Iterable[str]) -> tuple[str, ...]:
    return tuple(sorted(name for name in names if name.endswith(".c")))


def _first_error(errors: str) -> str:
    lines = [line for line in errors.splitlines() if "error" in line]
    return (lines or errors.strip().splitlines() or [""])[0]


def _environment(folder: str) -> dict[str, str]:
    """Return the environment of the compiler, which sets the cache folders of zig.

    The compiled C libraries are kept in a folder of our cache. The cache of one FMU is in `folder` and is deleted with
    it: zig would never reuse it, because the folder's name is always different, and it never removes anything.
    """
    local = Path(folder) / ".zig-cache"
    return os.environ | {"ZIG_GLOBAL_CACHE_DIR": str(cache_folder() / "zig"), "ZIG_LOCAL_CACHE_DIR": str(local)}
