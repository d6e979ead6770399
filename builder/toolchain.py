"""Compilers for all platforms, and compilation in parallel with a cache."""

from __future__ import annotations

import importlib.util
import os
import platform as this
import shutil
import struct
import subprocess
import sys
import tempfile
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from types import MappingProxyType

from builder.interface import source_folder
from eightpost.cache import cache_folder, digest, keep, recall
from eightpost.errors import FmuError
from eightpost.extras import MissingExtraError, install_command
from eightpost.progress import Progress
from eightpost.workers.process import usable_processors


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


# ==== Header files of the FMI standard, and where packages are installed =============================================

HEADERS = (
    "fmi2Functions.h", "fmi2FunctionTypes.h", "fmi2TypesPlatform.h",
    "fmi3Functions.h", "fmi3FunctionTypes.h", "fmi3PlatformTypes.h",
)  # fmt: skip


def headers_of(fmi: int) -> tuple[str, ...]:
    """Return the headers that the sources of an FMI version include; those of FMI 3.0 include both."""
    return HEADERS if fmi == 3 else HEADERS[:3]


def fmi_headers() -> Path:
    """Return the folder that contains the standard's header files; those of FMPy know no function prefix.

    Raises:
        MissingExtraError: The package that contains the header files is not installed.
        FmuError: It no longer contains them.
    """
    package = "fmu_manipulation_toolbox"
    folder = installed(package, "resources/fmi")
    if folder is None:
        raise MissingExtraError("building FMUs", package, "build")
    if missing := [name for name in HEADERS if not (folder / name).is_file()]:
        raise FmuError(f"{folder}: {missing[0]} is missing; pip install --force-reinstall {package}")
    return folder


@cache
def installed(package: str, name: str) -> Path | None:
    """Return a path in the folder of a package, which is not imported; None if the package is not installed."""
    spec = importlib.util.find_spec(package)
    return None if spec is None or spec.origin is None else Path(spec.origin).parent / name


# ==== Universal macOS library from several thin Mach-O files, one per processor ======================================

_FAT_MAGIC = 0xCAFEBABE
_THIN_MAGIC = 0xFEEDFACF
#: Alignment of slices (power of 2): the largest page size in use, 16 KiB on Apple's processors.
_ALIGNMENT = 14


def universal(slices: Sequence[bytes]) -> bytes:
    """Return the fat file of 64-bit slices, in the given order.

    Source: Apple, "Mach-O Programming Topics" and <mach-o/fat.h>: a big-endian header, then one entry per slice with
    processor type and subtype, offset, size and alignment.

    Raises:
        ValueError: A slice is not a 64-bit Mach-O file.
    """
    offset = 8 + 20 * len(slices)
    header = struct.pack(">II", _FAT_MAGIC, len(slices))
    body = b""
    for content in slices:
        magic, kind, subkind = struct.unpack_from("<IiI", content)
        if magic != _THIN_MAGIC:
            raise ValueError(f"a slice starts with {magic:#x} and is not a 64-bit Mach-O file")
        start = -(-(offset + len(body)) >> _ALIGNMENT) << _ALIGNMENT
        header += struct.pack(">iIIII", kind, subkind, start, len(content), _ALIGNMENT)
        body += b"\0" * (start - offset - len(body)) + content
    return header + body


# ---- C compilers ----------------------------------------------------------------------------------------------------

#: C99; no fused floating-point operations, so that all platforms give the same bits; only the functions of
#: the FMI version are visible; no debug information, and so no paths; no frame pointers, which cost a few percent; no
#: prefix of function names (fmus/common/names.h).
FLAGS = (
    "-std=c99",
    "-O2",
    "-g0",
    "-fomit-frame-pointer",
    "-ffp-contract=off",
    "-fvisibility=hidden",
    "-DFMI2_OVERRIDE_FUNCTION_PREFIX",
    "-DFMI3_OVERRIDE_FUNCTION_PREFIX",
)
WARNINGS = ("-Wall", "-Wextra", "-Wpedantic", "-Werror")


class Toolchain(ABC):
    """A compiler."""

    path: str  #: Program.
    name: str  #: Name and version, for messages and for the cache.
    platforms: tuple[Platform, ...]  #: Platforms that it builds for.
    limits: str = ""  #: Sentence about its limits, or an empty string.

    @abstractmethod
    def command(self, identifier: str, platform: Platform, target: str, files: Sequence[str]) -> list[str]:
        """Return the command that compiles files of the working folder into `identifier` + the platform's suffix."""


class Zig(Toolchain):
    """The compiler zig from PyPI's package ziglang (`eightpost[build]`)."""

    platforms = tuple(PLATFORMS.values())

    def __init__(self, path: str) -> None:
        self.path = path
        self.name = f"zig {_first_line((path, 'version'))}"

    def command(self, identifier: str, platform: Platform, target: str, files: Sequence[str]) -> list[str]:
        """Return the command that compiles files of the working folder."""
        form = ["build-exe", "-fno-entry"] if platform == BROWSER else ["build-lib", "-dynamic"]
        options = [*form, "-OReleaseFast", "-fstrip", "-target", target, "-mcpu", platform.processor]
        options += ["--name", identifier, f"-femit-bin={identifier}{platform.suffix}", *_includes()]
        entry: list[str] = []
        headers = Path(self.path).parent / "lib" / "libc" / "include"
        if platform.suffix == ".dll":
            # The MinGW runtime of zig takes minutes to build, and an FMU only needs three functions of Windows.
            entry = [str(source_folder() / "common" / "windows_entry.c")]
            options += ["-fno-emit-implib", "-fcompiler-rt", "-isystem", str(headers / "any-windows-any")]
            options += ["-lapi-ms-win-crt-heap-l1-1-0", "-lapi-ms-win-crt-string-l1-1-0"]
        elif platform == BROWSER:  # without the C library: fmus/common/browser.c has what an FMU needs of it
            options += ["-fcompiler-rt", "-isystem", str(headers / "wasm-wasi-musl")]
            options += ["-isystem", str(headers / "generic-musl")]
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


class SystemCompiler(Toolchain):
    """The installed compiler, gcc or clang, which only builds for this platform."""

    def __init__(self, path: str) -> None:
        here = this_platform()
        self.path = path
        self.name = _first_line((path, "--version"))
        self.platforms = (here,)
        self.limits = (
            f"built for {here.name} only, with {Path(path).name}; to build for all six platforms, "
            f"install the compiler zig: {install_command('build')}"
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
        f"{install_command('build')}, or build with --target python"
    )


def _includes() -> list[str]:
    """Return the include options; the absolute folder is a separate argument, which the cache key leaves out."""
    return ["-I", str(fmi_headers()), "-I."]


def _zig() -> str | None:
    found = installed("ziglang", "zig.exe" if sys.platform == "win32" else "zig")
    return str(found) if found and found.is_file() else None


@cache
def _first_line(command: tuple[str, ...]) -> str:
    ran = subprocess.run(command, capture_output=True, text=True, check=False)
    return (ran.stdout or ran.stderr).strip().partition("\n")[0]


# ---- Compilation of C sources into shared libraries, in parallel and with a cache -----------------------------------

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
#define FMI2_ACTUAL_FUNCTION_PREFIX wide_
{includes}#if defined(__clang__)
#pragma clang attribute pop
#endif
#else
typedef int not_here;
#endif
"""


@dataclass(frozen=True)
class Library:
    """One shared library to compile."""

    identifier: str  #: Name of the library.
    sources: Mapping[str, bytes]  #: C files and headers by name (one flat folder).
    #: Whether its C files can be compiled as one translation unit, which requires that no two of them define the same
    #: static name. Functions can then be inlined across files, which makes steps a few percent faster.
    is_one_unit: bool = False
    is_wide: bool = False  #: Whether the unit is compiled a second time for processors with AVX.
    fmi: int = 2  #: FMI version, 2 or 3.

    @property
    def units(self) -> tuple[str, ...]:
        """Names of the C files that are compiled."""
        return tuple(self._whole) or _c_files(self.sources)

    @property
    def files(self) -> Mapping[str, bytes]:
        """Files in the compiler's working folder."""
        return {**self.sources, **self._whole}

    @property
    def _whole(self) -> dict[str, bytes]:
        """The C files that include all others; empty if they are compiled separately."""
        if not self.is_one_unit:
            return {}
        files = _c_files(self.sources)
        includes = _includes_of(files)
        if not self.is_wide:
            return {_WHOLE: includes.encode()}
        wide = _includes_of(name for name in files if not name.startswith("fmi3_"))  # only the core switches
        texts = {_WHOLE: f"#define EIGHTPOST_WIDE\n{includes}", _WIDE: _WIDE_UNIT.format(includes=wide)}
        return {name: text.encode() for name, text in texts.items()}


#: Interval at which progress is reported while a binary is compiled [s].
_INTERVAL = 0.1


def compile_libraries(
    libraries: Sequence[Library], *, toolchain: Toolchain, progress: Progress | None = None
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
    with ThreadPoolExecutor(usable_processors()) as pool:
        slices = [_begin_slices(toolchain, library, pool) for library in libraries]
        total, done = sum(map(len, slices)), 0
        members: list[dict[str, bytes]] = []
        try:
            for library, parts_of in zip(libraries, slices, strict=True):
                members.append({})
                for platform, parts in zip(toolchain.platforms, parts_of, strict=True):
                    while progress and wait(parts, timeout=_INTERVAL).not_done:
                        progress(done, total)
                    content = [part.result() for part in parts]
                    path = platform.member(library.identifier, library.fmi)
                    members[-1][path] = content[0] if len(content) == 1 else universal(content)
                    done += 1
                    if progress:
                        progress(done, total)
        finally:
            pool.shutdown(cancel_futures=True)  # after an error, nothing else is begun
    return members


def _begin_slices(toolchain: Toolchain, library: Library, pool: ThreadPoolExecutor) -> list[list[Future[bytes]]]:
    """Begin to compile the slices of a library for each platform; a slice that two platforms share is compiled once.

    The universal binary for macOS contains that for macOS on ARM.
    """
    begun: dict[tuple[str, ...], Future[bytes]] = {}
    found: list[list[Future[bytes]]] = []
    for platform in toolchain.platforms:
        found.append([])
        for target in platform.targets:
            command = tuple(toolchain.command(library.identifier, platform, target, library.units))
            if command not in begun:
                begun[command] = pool.submit(_slice, toolchain, library, platform, target)
            found[-1].append(begun[command])
    return found


def compile_for_browser(library: Library) -> bytes:
    """Return a library as a WebAssembly module, with the functions of fmus/common/browser.c.

    Raises:
        FmuError: The compiler zig is not installed, or it fails.
    """
    toolchain = find_toolchain()
    if not isinstance(toolchain, Zig):
        raise FmuError(f"a page in a browser needs the compiler zig: {install_command('build')}")
    browser = (source_folder() / "common" / "browser.c").read_bytes()
    (target,) = BROWSER.targets
    return _slice(toolchain, replace(library, sources={**library.sources, "browser.c": browser}), BROWSER, target)


def _slice(toolchain: Toolchain, library: Library, platform: Platform, target: str) -> bytes:
    command = toolchain.command(library.identifier, platform, target, library.units)
    key = _key(toolchain, library, target or platform.name, command)
    if (content := recall("binaries", key)) is None:
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
    return digest([*parts, *(path.read_bytes() for path in (*own, *(fmi_headers() / name for name in HEADERS)))])


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


def _includes_of(files: Iterable[str]) -> str:
    return "".join(f'#include "{name}"\n' for name in files)


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
