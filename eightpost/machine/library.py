"""The library of a machine: compiled once per size of a car and per processor, from sources of the FMUs."""

from __future__ import annotations

import ctypes
import hashlib
import importlib.util
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from eightpost.cache import keep, recall
from eightpost.compilers import find_compiler
from eightpost.errors import FmuError
from eightpost.extras import is_installed, needs

# ---- Sources --------------------------------------------------------------------------------------------------------

_FLAGS = (
    "-std=gnu11", "-O3", "-w", "-shared", "-fPIC", "-fvisibility=hidden", "-fno-math-errno", "-ffp-contract=fast",
)  # fmt: skip

#: Compiler options of the instruction sets by the processor features that they need, widest first.
_WIDTHS: Mapping[str, tuple[str, ...]] = {
    "avx512dq": ("-mavx512f", "-mavx512dq", "-mavx512vl", "-mavx2", "-mfma", "-mprefer-vector-width=512"),
    "avx2": ("-mavx2", "-mfma"),
}

#: Processors of zig by instruction set.
_ZIG = {"avx512dq": "x86_64_v4", "avx2": "x86_64_v3", "": "baseline"}

#: Numbers of setups in lanes with gcc, which handles vectors badly that are wider than those of the processor.
_SETUPS_OF_GCC = {"avx512dq": 8, "avx2": 4, "": 2}

#: Sources from the folders of the FMUs: name in the compiler's folder, and path in fmus/.
_SHARED = {
    **{name: f"common/{name}" for name in ("curve.h", "elementary.c", "elementary.h", "lag.h", "real.h",
                                           "shock.h")},
    "friction.h": "vehicle_ss/friction.h",
    "hysteresis.c.inc": "shock_hysteresis/model.c",
}  # fmt: skip

_PACKAGE = Path(__file__).parents[2]


def source_folder() -> Path:
    """Return the folder with the C sources of the FMUs: that of the checkout, or its copy in an installed wheel.

    Raises:
        FmuError: The folder does not exist; the installation is broken.
    """
    for folder in (_PACKAGE / "fmus", _PACKAGE / "builder" / "fmus"):
        if (folder / "machine" / "machine.c").is_file():
            return folder
    raise FmuError(f"there is no fmus/ folder in {_PACKAGE}; reinstall eightpost")


@cache
def sources() -> Mapping[str, bytes]:
    """Return the sources of a machine by file name, without the size of a car."""
    folder = source_folder()
    paths = sorted(path for path in (folder / "machine").iterdir() if path.suffix in (".c", ".h"))
    own = {path.name: path.read_bytes() for path in paths}
    return {name: (folder / path).read_bytes() for name, path in _SHARED.items()} | own


def instruction_set() -> str:
    """Return the widest instruction set of this processor that a machine uses.

    Empty, without llvmlite too: that of every processor.
    """
    if not is_installed("llvmlite"):
        return ""
    with needs("fit", "the widest instruction set"):
        import llvmlite.binding as llvm  # noqa: PLC0415 - an extra
    features = llvm.get_host_cpu_features()
    return next((name for name in _WIDTHS if features.get(name)), "")


# ---- Compilation ----------------------------------------------------------------------------------------------------


def compiled(pairs: int, corners: int, *, sweeps: int = 2, width: str | None = None) -> bytes:
    """Return the library for the size of a car, from the cache or from the compiler.

    Args:
        pairs: Number of modes.
        corners: Number of shocks.
        sweeps: Number of times that the ports are evaluated in a step.
        width: Instruction set; None: the widest of this processor.

    Raises:
        FmuError: There is no compiler, or it fails.
    """
    sizes = f"enum {{ PAIRS = {pairs}, CORNERS = {corners} }};\n".encode()
    return built({**sources(), "sizes.h": sizes}, f"-DSWEEPS={sweeps}", width=width)


def built(files: Mapping[str, bytes], *own: str, width: str | None = None) -> bytes:
    """Return a library from C files and options of their own, from the cache or from the compiler; see `compiled`."""
    chosen = instruction_set() if width is None else width
    compiler = _compiler()
    options = [*_FLAGS, *own, *_WIDTHS.get(chosen, ())]
    if _is_gcc(compiler[0]):
        options.append(f"-DEIGHTPOST_SETUPS={_SETUPS_OF_GCC[chosen]}")
    else:
        options.append("-flto")
    if "ziglang" in compiler:  # which compiles for this processor, and checks, if it is not told otherwise
        options += ["-fno-sanitize=undefined", f"-mcpu={_ZIG[chosen]}"]
    key = _key(files, [*compiler, *options])
    library = recall("machine", key)
    if library is None:
        library = _compile(files, compiler, options)
        keep("machine", key, library)
    return library


def _compiler() -> list[str]:
    """Return the command of a C compiler, preferably clang or zig, whose code for vectors is faster than that of gcc.

    Raises:
        FmuError: No compiler is installed.
    """
    if not os.environ.get("CC"):
        if clang := shutil.which("clang"):
            return [clang]
        if importlib.util.find_spec("ziglang"):
            return [sys.executable, "-P", "-m", "ziglang", "cc"]
    return find_compiler()


@cache
def _is_gcc(compiler: str) -> bool:
    ran = subprocess.run([compiler, "--version"], capture_output=True, text=True, check=False)
    return "Free Software Foundation" in ran.stdout


def _key(files: Mapping[str, bytes], command: Sequence[str]) -> str:
    digest = hashlib.sha256("\0".join((platform.platform(), *command)).encode())
    for name, content in sorted(files.items()):
        digest.update(name.encode() + b"\0" + content)
    return digest.hexdigest()


def _compile(files: Mapping[str, bytes], compiler: Sequence[str], options: Sequence[str]) -> bytes:
    with tempfile.TemporaryDirectory(prefix="machine_") as name:
        folder = Path(name)
        for file, content in files.items():
            (folder / file).write_bytes(content)
        product = folder / "machine.so"
        units = sorted(file for file in files if file.endswith(".c"))
        ran = subprocess.run(
            [*compiler, *options, "-I.", *units, "-o", str(product)],
            cwd=folder, capture_output=True, text=True, errors="replace", check=False,
        )  # fmt: skip
        if ran.returncode != 0 or not product.is_file():
            lines = [line for line in (ran.stderr + ran.stdout).splitlines() if "error" in line.lower()]
            raise FmuError(f"the machine does not compile with {Path(compiler[0]).name}: {(lines or ['?'])[0]}")
        return product.read_bytes()


# ---- Structures of fmus/machine/machine.h ---------------------------------------------------------------------------

_INT, _LONG, _REAL, _POINTER = ctypes.c_int, ctypes.c_int64, ctypes.c_double, ctypes.c_void_p


def _structure(name: str, **fields: Any) -> type[ctypes.Structure]:
    return type(name, (ctypes.Structure,), {"_fields_": list(fields.items())})


Signal = _structure("Signal", corner=_INT, number=_INT)
Quantity = _structure(
    "Quantity", first=_INT, count=_INT, is_product=_INT, begin=_INT, end=_INT, has_limits=_INT, low=_REAL, high=_REAL
)
Filter = _structure("Filter", rows=_POINTER, rest=_POINTER, sections=_LONG, pad=_LONG)
Limit = _structure("Limit", sign=_REAL, limit=_REAL, output=_INT)
_POINTERS = (
    "car", "velocities", "travels", "outputs", "output_rows", "signals", "quantities", "terms", "weights", "limits",
    "series",
)  # fmt: skip
_COUNTS = (
    "steps", "every", "settling", "output_count", "signal_count", "quantity_count", "limit_count", "series_count",
)  # fmt: skip
Run = _structure("Run", **dict.fromkeys(_POINTERS, _POINTER), step=_REAL, **dict.fromkeys(_COUNTS, _LONG))
Driven = _structure(
    "Driven",
    **dict.fromkeys(("into", "turn", "first", "last", "kinds", "inputs", "wanted", "rows"), _POINTER),
    **dict.fromkeys(("intervals", "input_count", "wanted_count", "output_count"), _LONG),
)
#: Names of the arrays of Sums, in their order.
SUMS = (
    "transferred", "residual", "defect", "total", "squares", "beyond", "watched", "statistics", "values", "ended",
)  # fmt: skip
Sums = _structure("Sums", **dict.fromkeys(SUMS, _POINTER))


class Library:
    """The functions of a compiled library.

    Args:
        content: Library as `compiled` returns it.
    """

    def __init__(self, content: bytes) -> None:
        with tempfile.TemporaryDirectory(prefix="machine_", ignore_cleanup_errors=True) as folder:
            path = Path(folder) / "machine.so"
            path.write_bytes(content)
            self._library = ctypes.CDLL(str(path))
        for name in ("size_of_march", "number_of_parameters", "number_of_setups"):
            getattr(self._library, name).restype = ctypes.c_int64
        self.size = int(self._library.size_of_march())
        self.parameters = int(self._library.number_of_parameters())
        self.setups = int(self._library.number_of_setups())

    def call(self, function: str, *arguments: Any) -> None:
        """Call a function of fmus/machine with structures, addresses and numbers."""
        given = (ctypes.byref(a) if isinstance(a, ctypes.Structure) else ctypes.c_int64(a) for a in arguments)
        getattr(self._library, function)(*given)
