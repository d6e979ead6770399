"""The car and its shocks as the machine takes them, and the library that is compiled for the size of a car."""

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
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from eightpost.array_types import Array, Complex, Integers
from eightpost.cache import keep, recall
from eightpost.compilers import find_compiler
from eightpost.errors import FmuError
from eightpost.extras import is_installed, needs

# ==== The library: compiled once per size of a car and per processor, from sources of the FMUs =======================


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

#: Bytes of a vector with gcc, which handles vectors badly that are wider than those of the processor.
_BYTES_OF_GCC = {"avx512dq": 64, "avx2": 32, "": 16}

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


def compiled(pairs: int, corners: int, *, sweeps: int = 2, single: bool = False) -> bytes:
    """Return the library for the size of a car, from the cache or from the compiler.

    Args:
        pairs: Number of modes.
        corners: Number of shocks.
        sweeps: Number of times that the ports are evaluated in a step.
        single: Whether numbers are in single precision: then twice as many setups run at once.

    Raises:
        FmuError: There is no compiler, or it fails.
    """
    sizes = f"enum {{ PAIRS = {pairs}, CORNERS = {corners} }};\n".encode()
    own = (f"-DSWEEPS={sweeps}", *(["-DEIGHTPOST_SINGLE"] if single else []))
    return built({**sources(), "sizes.h": sizes}, *own)


def built(files: Mapping[str, bytes], *own: str) -> bytes:
    """Return a library from C files and options of their own, from the cache or from the compiler; see `compiled`."""
    chosen, compiler = instruction_set(), _compiler()
    options = [*_FLAGS, *own, *_WIDTHS.get(chosen, ())]
    if _is_gcc(compiler[0]):
        options.append(f"-DEIGHTPOST_BYTES={_BYTES_OF_GCC[chosen]}")
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


SignalStructure = _structure("Signal", corner=_INT, number=_INT)
QuantityStructure = _structure(
    "Quantity", first=_INT, count=_INT, is_product=_INT, begin=_INT, end=_INT, has_limits=_INT, low=_REAL, high=_REAL
)
FilterStructure = _structure("Filter", rows=_POINTER, rest=_POINTER, sections=_LONG, pad=_LONG)
LimitStructure = _structure("Limit", sign=_REAL, limit=_REAL, output=_INT)
_POINTERS = (
    "car", "velocities", "travels", "outputs", "output_rows", "signals", "quantities", "terms", "weights", "limits",
    "series",
)  # fmt: skip
_COUNTS = (
    "steps", "every", "settling", "output_count", "signal_count", "quantity_count", "limit_count", "series_count",
)  # fmt: skip
RunStructure = _structure("Run", **dict.fromkeys(_POINTERS, _POINTER), step=_REAL, **dict.fromkeys(_COUNTS, _LONG))
Driven = _structure(
    "Driven",
    **dict.fromkeys(("into", "turn", "first", "last", "kinds", "inputs", "wanted", "rows"), _POINTER),
    **dict.fromkeys(("intervals", "input_count", "wanted_count", "output_count"), _LONG),
)
#: Names of the arrays of Sums, in their order.
SUMS = (
    "transferred", "residual", "defect", "total", "squares", "beyond", "watched", "statistics", "values", "ended",
)  # fmt: skip
SumsStructure = _structure("Sums", **dict.fromkeys(SUMS, _POINTER))


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
        for name in ("size_of_march", "size_of_number", "number_of_parameters", "number_of_setups"):
            getattr(self._library, name).restype = ctypes.c_int64
        self.size = int(self._library.size_of_march())
        self.number = np.dtype(f"f{self._library.size_of_number()}")
        self.integer = np.dtype(f"i{self.number.itemsize}")
        self.parameters = int(self._library.number_of_parameters())
        self.setups = int(self._library.number_of_setups())

    def call(self, function: str, *arguments: Any) -> None:
        """Call a function of fmus/machine with structures, addresses and numbers."""
        given = (ctypes.byref(a) if isinstance(a, ctypes.Structure) else ctypes.c_int64(a) for a in arguments)
        getattr(self._library, function)(*given)


# ==== The car: matrices, ports and laws, and modes that are exact over a step ========================================


# ==== Reasons why a study cannot run as a batch ======================================================================


class NotInBatchError(Exception):
    """Reason, as a clause, why setups run through the FMUs instead of a batch."""


class UnstableCarError(NotInBatchError):
    """The car's motion grows even with the mean damping of its shocks."""


# ==== Shocks: the law and its parameters =============================================================================

#: Laws of fmus/machine/port.h by name.
LAWS = {"polylinear": 0, "lpf1": 1, "lpnl2": 1, "hysteresis": 2}

#: Largest number, which stands for no limit: single precision has it.
_LARGEST = 1e30

#: Limits of the lagged force with which the weight of the lag is always 0, or always 1 [N].
_NO_LAG, _ONLY_LAG = (-2.0, -1.0), (0.0, _LARGEST)

#: Parameters in the order of fmus/machine/component.h, with their number; the last ones are those of single laws.
_COMMON = {
    "motion_ratio": 1, "compression_scale": 1, "rebound_scale": 1, "gas_stiffness": 1, "gas_preload": 1,
    "seal_friction": 1, "friction_velocity": 1, "curve.transition_speed": 1, "curve.transition_width": 1,
    "curve.compression_speed": 1, "curve.rebound_speed": 1, "curve.compression_slope": 1, "curve.rebound_slope": 1,
    "curve.inner": 15, "curve.compression": 4, "curve.rebound": 4, "curve.knot_velocity": 25, "curve.knot_force": 25,
    "curve.knot_slope": 25,
}  # fmt: skip
_HYSTERESIS = {"time_constant": 3, "stop_stiffness": 1, "stop_yield": 1, "stop_time": 1, "curve.lagged_slope": 25}


@dataclass(frozen=True, slots=True, eq=False)
class ShockData:
    """A shock as the machine takes it."""

    law: int  #: Number of its law in fmus/machine/port.h.
    parameters: Array  #: Parameters in the order of fmus/machine/component.h (P,).

    @classmethod
    def of(cls, name: str, numbers: Callable[[str, int], Sequence[float]]) -> ShockData:
        """Return a shock.

        Args:
            name: Name of its law.
            numbers: Function that returns the values of a parameter, given its name and their number.

        Raises:
            NotInBatchError: The machine does not have the law.
        """
        if name not in LAWS:
            raise NotInBatchError(f"the machine does not have the law {name}")
        found = [number for parameter, count in _COMMON.items() for number in numbers(parameter, count)]
        found += numbers("time_constant", 1) if name in ("lpf1", "lpnl2") else [1.0]
        if name == "lpnl2":
            found += [*numbers("lag_full_force", 1), *numbers("lag_zero_force", 1)]
        else:
            found += _NO_LAG if name == "polylinear" else _ONLY_LAG
        for parameter, count in _HYSTERESIS.items():
            found += numbers(parameter, count) if name == "hysteresis" else [1.0] * count
        return cls(LAWS[name], np.clip(found, -_LARGEST, _LARGEST))

    @classmethod
    def of_law(cls, name: str, law: Any) -> ShockData:
        """Return the shock of a law of eightpost.shock and its name; see `of`."""

        def numbers(parameter: str, _: int) -> list[float]:
            plain = parameter.removeprefix("curve.")
            owner = next(one for one in (law, law.curve, law.port) if hasattr(one, plain))
            values: list[float] = np.ravel(getattr(owner, plain)).tolist()
            return values

        return cls.of(name, numbers)

    def mean_slope(self, velocity: float) -> float:
        """Return about the mean slope of the static curve at the port, up to a velocity [N.s/m]."""
        own = dict(zip(_COMMON, np.split(self.parameters, np.cumsum([*_COMMON.values()])), strict=False))
        ratio, speed = own["motion_ratio"].item(), own["curve.transition_speed"].item()
        v = ratio * velocity
        if own["curve.knot_velocity"][-1] > 0.0:
            force = np.interp([-v, v], own["curve.knot_velocity"], own["curve.knot_force"])
        else:
            force = np.polyval([*own["curve.inner"][::-1], 0.0], np.clip([-v / speed, v / speed], -1.0, 1.0))
        scaled = own["compression_scale"] * force[1] - own["rebound_scale"] * force[0]
        return float(ratio * scaled.item() / (2.0 * velocity))


# ==== Vehicle with ports: x' = A x + B u, y = C x + D u + offset =====================================================

#: No friction and no spring, in the order of PortFriction in fmus/machine/car.h.
_FREE = (0.0, 1.0, 0.0, 1.0, 1.0, 1.0, 0.0)


@dataclass(frozen=True, slots=True)
class Port:
    """A port of a vehicle for a shock."""

    force: int  #: Number of the force's input.
    velocity: int  #: Number of the velocity's output.
    travel: int | None  #: Number of the travel's output; None if nothing depends on it.
    friction: tuple[float, ...] = _FREE  #: Friction and spring, in the order of PortFriction in fmus/machine/car.h.

    @property
    def has_forces(self) -> bool:
        """Whether the port has friction or a spring."""
        return self.friction[0] != 0.0 or self.friction[2] != 0.0 or self.friction[6] != 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Vehicle:
    """A vehicle in SI units."""

    A: Array  #: (n, n).
    B: Array  #: (n, m).
    C: Array  #: (p, n).
    D: Array  #: (p, m).
    offset: Array  #: Added to the outputs (p,).
    at_rest: bool  #: Whether it starts at rest under its loads, or else with states of zero.

    def with_dampers(self, ports: Sequence[Port], damping: Array) -> Vehicle:
        """Return the vehicle with linear dampers (P,) [N.s/m] at ports whose velocities no force changes at once."""
        forces, velocities = [port.force for port in ports], [port.velocity for port in ports]
        by_states, direct = damping[:, None] * self.C[velocities], damping[:, None] * self.D[velocities]
        B, D = self.B[:, forces], self.D[:, forces]
        return replace(
            self, A=self.A + B @ by_states, B=self.B + B @ direct, C=self.C + D @ by_states, D=self.D + D @ direct
        )


# ==== The car around a damper at each port, exact over a step, and its motion by a drive =============================

#: Largest condition number of the modes, and largest growth of one [1/s]: by half in a minute.
_CONDITION, _GROWTH = 1e7, 0.007

#: Changes of A that are tried, as a share of its largest element, and the seed of their direction.
_APART, _SEED = (0.0, 1e-12, 1e-11, 1e-10), 1


class Drive(NamedTuple):
    """Inputs of a vehicle over time, and the steps of a run on them."""

    times: Array  #: Ends of the steps, all equal, from 0 (K + 1,) [s].
    every: int  #: Number of steps between records.
    points: Array  #: Times at which the inputs are given, those of the steps among them (N + 1,) [s].
    inputs: Array  #: Inputs there (N + 1, m), linear between them.


@dataclass(frozen=True, slots=True, eq=False)
class LinearCar:
    """Car with a damper at each port, as independent complex modes z' = lambda z + b u with outputs Re(c z) + D u."""

    vehicle: Vehicle  #: The car with the dampers.
    ports: tuple[Port, ...]  #: Ports of the shocks.
    damping: Array  #: Damping of each (C,) [N.s/m].
    poles: Complex  #: lambda (P,) [1/s].
    into: Complex  #: b (P, m).
    out: Complex  #: c (p, P).

    @classmethod
    def of(cls, vehicle: Vehicle, ports: Sequence[Port], damping: Array, *, multiple: int = 1) -> LinearCar:
        """Close the loops of linear dampers.

        Args:
            vehicle: Car without dampers.
            ports: Ports of the shocks.
            damping: Damping of each, about the mean slope of the shocks (C,) [N.s/m].
            multiple: Number of which the number of modes is made a multiple, with modes without effect: a library is
                compiled for every number of modes.

        Raises:
            NotInBatchError: The car has no such modes, or is not stable with these dampers (`UnstableCarError`).
        """
        motions = [row for port in ports for row in (port.velocity, port.travel) if row is not None]
        if vehicle.D[np.ix_(motions, [port.force for port in ports])].any():
            raise NotInBatchError("a force acts on the velocity of a port without delay")
        closed = vehicle.with_dampers(ports, damping)
        poles, vectors = _modes(closed.A)
        if poles.real.max(initial=-1.0) > _GROWTH:
            raise UnstableCarError("the vehicle is not stable with the mean damping of its shocks")
        kept = poles.imag >= 0.0
        twice = np.where(poles.imag > 0.0, 2.0, 1.0)[kept, None]  # z + conj(z) = 2 Re(z)
        into = twice * (np.linalg.inv(vectors) @ closed.B)[kept]
        more = -int(kept.sum()) % multiple
        return cls(
            closed,
            tuple(ports),
            damping,
            np.concatenate([poles[kept], np.full(more, -1.0)]),
            np.concatenate([into, np.zeros((more, into.shape[1]))]),
            np.concatenate([closed.C @ vectors[:, kept], np.zeros((len(closed.C), more))], axis=1).astype(
                np.complex128
            ),
        )

    @property
    def pairs(self) -> int:
        """Number of modes."""
        return self.poles.size

    def data(self, step: float) -> Array:
        """Return the numbers of the structure Car of fmus/machine/car.h for a step [s]."""
        turn, (start, middle, end) = np.exp(self.poles * step), self._loads(step)
        static = self._by_ports / np.where(self.poles == 0.0, np.inf, -self.poles)[:, None] * self.vehicle.at_rest
        velocity = _columns(self.out[[port.velocity for port in self.ports]])
        travel = _columns(
            np.stack([np.zeros(self.pairs) if p.travel is None else self.out[p.travel] for p in self.ports])
        )
        now, after = np.hstack([middle, end]), np.hstack([turn[:, None] * middle, turn[:, None] * end + start])
        parts = [
            np.stack([turn.real, turn.imag], axis=1), _rows(after), _rows(static - middle - end),
            travel @ _rows(static), velocity, travel, velocity @ _rows(now), travel @ _rows(now),
            self.damping, np.array([port.friction for port in self.ports]),
        ]  # fmt: skip
        return np.concatenate([np.ravel(part) for part in parts])

    def output_rows(self, outputs: Sequence[int], step: float) -> Array:
        """Return rows of outputs by the states and forces of fmus/machine/car.h (R, 2 P + 2 C)."""
        _, middle, end = self._loads(step)
        rows, forces = _columns(self.out[list(outputs)]), [port.force for port in self.ports]
        direct = self.vehicle.D[np.ix_(list(outputs), forces)]
        return np.hstack([rows, rows @ _rows(middle), rows @ _rows(end) + direct])

    @property
    def _by_ports(self) -> Complex:
        return self.into[:, [port.force for port in self.ports]]

    def _loads(self, step: float) -> list[Complex]:
        """Return the modes at the end of a step by its forces at the start, the middle and the end (P, C)."""
        one, two, three = (step * phi for phi in _phi(self.poles * step))
        weights = one - 3.0 * two + 4.0 * three, 4.0 * two - 8.0 * three, 4.0 * three - two
        return [weight[:, None] * self._by_ports for weight in weights]

    def by_drive(self, drive: Drive, wanted: Integers, outputs: Sequence[int], found_by: Library) -> Array:
        """Return outputs (K, R) at points of the drive, without forces beyond the dampers.

        Args:
            drive: Drive.
            wanted: Ascending numbers of the points whose outputs are returned (K,).
            outputs: Numbers of the outputs.
            found_by: Library for this car.
        """
        inputs = np.ascontiguousarray(drive.inputs)
        start = np.zeros(self.pairs, dtype=np.complex128)
        if self.vehicle.at_rest:
            if np.any(self.poles == 0.0):
                raise NotInBatchError("the vehicle has no unique steady state")
            start = -(self.into @ inputs[0]) / self.poles
        lengths, kinds = np.unique(np.diff(drive.points).round(12), return_inverse=True)
        x = np.multiply.outer(lengths, self.poles)
        one, two, _ = (lengths[:, None] * phi for phi in _phi(x))
        found = np.empty((wanted.size, len(outputs)))
        arrays = {
            "into": _rows(self.into).T, "turn": np.exp(x), "first": one - two, "last": two,
            "kinds": kinds.astype(np.int32), "inputs": inputs, "wanted": wanted.astype(np.int64),
            "rows": _columns(self.out[list(outputs)]),
        }  # fmt: skip
        arrays = {name: np.ascontiguousarray(array) for name, array in arrays.items()}
        addresses = {name: array.ctypes.data for name, array in arrays.items()}
        driven = Driven(**addresses, intervals=kinds.size, input_count=inputs.shape[1], wanted_count=wanted.size,
                        output_count=len(outputs))  # fmt: skip
        found_by.call("drive_car", driven, start.ctypes.data, found.ctypes.data)
        return found + inputs[wanted] @ self.vehicle.D[list(outputs)].T + self.vehicle.offset[list(outputs)]


def _modes(closed: Array) -> tuple[Complex, Complex]:
    """Return poles and eigenvectors; modes that coincide are drawn apart by a change of A far below its accuracy.

    Raises:
        NotInBatchError: They remain nearly dependent.
    """
    noise = np.abs(closed).max() * np.random.default_rng(_SEED).standard_normal(closed.shape)
    for share in _APART:
        poles, vectors = np.linalg.eig(closed + share * noise)
        if np.linalg.cond(vectors) <= _CONDITION:
            return poles.astype(np.complex128), vectors.astype(np.complex128)
    raise NotInBatchError("modes of the vehicle nearly coincide")


def _rows(values: Complex) -> Array:
    """Return real rows (2 P, C) of complex ones: real and imaginary part of each."""
    return np.stack([values.real, values.imag], axis=1).reshape(-1, values.shape[1])


def _columns(values: Complex) -> Array:
    """Return the real columns (R, 2 P) that give Re(c z) from the real and the imaginary parts of z."""
    return np.stack([values.real, -values.imag], axis=2).reshape(len(values), 2 * values.shape[1])


def _phi(x: Complex) -> tuple[Complex, Complex, Complex]:
    """Return phi1(x) = (e^x - 1) / x, phi2(x) = (phi1(x) - 1) / x and phi3(x) = (phi2(x) - 1/2) / x."""
    small = np.abs(x) < 1.0
    far = np.where(small, 1.0, x)
    one = np.expm1(far) / far
    two = (one - 1.0) / far
    three = (two - 0.5) / far
    near = np.where(small, x, 0.0)
    series = np.full_like(x, 1.0 / 6.0)
    term = np.full_like(x, 1.0 / 6.0)
    for k in range(4, 24):
        term = term * near / k
        series = series + term
    third = np.where(small, series, three)
    second = np.where(small, 0.5 + near * series, two)
    return np.where(small, 1.0 + near * (0.5 + near * series), one), second, third
