"""Compilation of an FMU's own sources into a library for a platform that it has no binary for."""

from __future__ import annotations

import hashlib
import os
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path

import fmpy

from eightpost.cache import keep, recall
from eightpost.compilers import find_compiler
from eightpost.errors import FmuError
from eightpost.files import sha256_of, writing

#: Strict double arithmetic without fused operations; warnings of foreign sources are suppressed.
_FLAGS = ("-O2", "-w", "-ffp-contract=off", "-shared")
_TIMEOUT = 600.0  # s
#: Cache folder of the libraries.
_KEPT_IN = "rebuilt"
_CPP = {".cc", ".cpp", ".cxx"}


def compile_sources(
    path: Path, target: Path, files: Sequence[str], options: Sequence[str] = (), *, version: int = 2
) -> None:
    """Compile an FMU's sources into the library for this platform, or read the library from the cache.

    The cache is the folder `rebuilt` in EIGHTPOST_CACHE, or in the user's cache folder; its key is the digest of the
    FMU file, the compiler and its options.

    Args:
        path: FMU file (.fmu).
        target: Library to write, in its folder of binaries for this platform.
        files: Source files, relative to sources/.
        options: Options that its build description demands.
        version: Major version of FMI.

    Raises:
        FmuError: A listed source is missing, there is no compiler, or the compilation fails.
    """
    sources = target.parents[2] / "sources"
    if missing := [name for name in files if not (sources / name).is_file()]:
        raise FmuError(f"{path}: lists the source {missing[0]!r}, which is not in its sources/; use a complete FMU")
    if not files:
        return  # the caller reports that there is neither a binary nor a source
    command = [*find_compiler(), *_options(files, version), *options]
    key = f"{_key(path, command)}{fmpy.sharedLibraryExtension}"
    if (library := recall(_KEPT_IN, key)) is None:
        library = _compile(path, sources, [*command, *files])
        keep(_KEPT_IN, key, library)
    with writing(target):
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(library)


def _options(files: Sequence[str], version: int) -> list[str]:
    headers = Path(fmpy.__file__).with_name("c-code")
    position = [] if os.name == "nt" else ["-fPIC"]
    # The FMU's own headers come first, because it may contain modified ones.
    # The definition keeps the functions' plain names (FMI 2.0.2 and later).
    plain = f"-DFMI{version}_OVERRIDE_FUNCTION_PREFIX"
    return [*_FLAGS, plain, *position, "-I.", "-I", str(headers), *(["-lstdc++"] if _has_cpp(files) else [])]


def _has_cpp(files: Sequence[str]) -> bool:
    return any(Path(name).suffix in _CPP for name in files)


def _key(path: Path, command: Sequence[str]) -> str:
    version = subprocess.run([*command[:1], "--version"], capture_output=True, check=False).stdout
    parts = (sha256_of(path).encode(), fmpy.platform.encode(), version, "\0".join(command).encode())
    return hashlib.sha256(b"\0".join(parts)).hexdigest()


def _compile(path: Path, sources: Path, command: Sequence[str]) -> bytes:
    with tempfile.TemporaryDirectory(prefix="fmu_build_") as build:
        product = Path(build) / f"library{fmpy.sharedLibraryExtension}"
        # The mathematics library comes last, because the linker resolves only symbols needed before it.
        fault = _run([*command, "-o", str(product), *([] if os.name == "nt" else ["-lm"])], sources)
        if fault or not product.is_file():
            raise FmuError(
                f"{path}: its sources do not compile with {Path(command[0]).name}: {fault or 'no library was made'}; "
                f"ask for a binary for this platform ({fmpy.platform})"
            )
        return product.read_bytes()


def _run(command: Sequence[str], folder: Path) -> str:
    """Run a compiler; return its first error message, or an empty string."""
    try:
        ran = subprocess.run(
            command, cwd=folder, capture_output=True, text=True, errors="replace", timeout=_TIMEOUT, check=False
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        return str(error)
    if ran.returncode == 0:
        return ""
    lines = [line.strip() for line in (ran.stderr + ran.stdout).splitlines()]
    return next((line for line in lines if "error" in line.lower()), f"it ended with code {ran.returncode}")
