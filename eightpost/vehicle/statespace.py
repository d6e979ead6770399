"""Linear models with named channels, and exact conversions of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from scipy.linalg import schur

from eightpost.array_types import Array, Complex
from eightpost.errors import ParameterError, UnknownUnitError
from eightpost.extras import needs
from eightpost.units import si_factor
from eightpost.vehicle import kernel

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import ArrayLike, NDArray


# ---- The model ------------------------------------------------------------------------------------------------------

#: A direct term below this fraction of the channel pair's own dynamic response is a rounding error.
DIRECT_TERM_TOLERANCE = 1e-9

_CHUNK = 4_000_000  # complex numbers in memory at once while a frequency response is computed
_POLE_DISTANCE = 100.0 * float(np.finfo(np.float64).eps)

#: Magnitude [1/s] below which a pole counts as zero, because gains relative to it would overflow.
_SLOWEST = 1e-200


class Mode(NamedTuple):
    """Natural frequency and damping ratio of one pole pair or one real pole.

    A real pole has the frequency |s| / 2 pi and the damping ratio 1 (-1 if it is unstable); a pole at
    zero has the frequency 0 and no damping ratio (NaN).
    """

    frequency_hz: float
    damping_ratio: float


@dataclass(frozen=True, slots=True)
class Channel:
    """Name and SI unit of one input or output, see docs/reference/ports.md: `Channel("lf.road", "m")`."""

    name: str
    unit: str

    def __post_init__(self) -> None:
        if not self.name or self.name != self.name.strip() or ":" in self.name:
            raise ParameterError(
                f"channel name {self.name!r} is invalid: it must not be empty, begin or end with a blank, or contain "
                "a colon"
            )
        if si_factor(self.unit) != 1.0:
            raise UnknownUnitError(
                f"unit {self.unit!r} is not SI; convert the values first (eightpost.units.convert), because models "
                "use SI units",
                channel=self.name,
            )


@dataclass(frozen=True, slots=True, eq=False)
class StateSpace:
    """Linear model with named channels.

    The model is `x' = A x + B u` (or `x[k+1] = A x[k] + B u[k]` if `dt` is given) and `y = C x + D u`. Frequency
    responses are (output, input, frequency), as in python-control.
    """

    A: Array  #: State matrix (n, n).
    B: Array  #: Input matrix (n, m).
    C: Array  #: Output matrix (p, n).
    D: Array  #: Direct terms (p, m).
    inputs: tuple[Channel, ...]  #: Input channels (m).
    outputs: tuple[Channel, ...]  #: Output channels (p).
    dt: float | None = None  #: Sample time [s], or None for a continuous model.
    name: str = "model"  #: Name of the model.

    def __post_init__(self) -> None:
        for field in ("inputs", "outputs"):
            object.__setattr__(self, field, tuple(getattr(self, field)))
            names = [channel.name for channel in getattr(self, field)]
            if twice := sorted({name for name in names if names.count(name) > 1}):
                raise ParameterError(
                    f"{self.name}: {field} contain {', '.join(twice)} more than once; names must be unique"
                )
        n, m, p = len(self.A), len(self.inputs), len(self.outputs)
        for field, expected in {"A": (n, n), "B": (n, m), "C": (p, n), "D": (p, m)}.items():
            object.__setattr__(self, field, _frozen(getattr(self, field), f"{self.name}: {field}"))
            shape = getattr(self, field).shape
            if shape != expected:
                raise ParameterError(
                    f"{self.name}: {field} has the shape {shape}; {n} states, {m} inputs and {p} outputs need "
                    f"{expected}"
                )
        if self.dt is not None and not (np.isfinite(self.dt) and self.dt > 0.0):
            raise ParameterError(
                f"{self.name}: the sample time is {self.dt!r} s; give a finite number above zero, or None for a "
                "continuous model"
            )

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, StateSpace):
            return NotImplemented
        return all(
            getattr(self, field) == getattr(other, field) for field in ("inputs", "outputs", "dt", "name")
        ) and all(np.array_equal(getattr(self, field), getattr(other, field)) for field in ("A", "B", "C", "D"))

    def __hash__(self) -> int:
        return hash((self.inputs, self.outputs, self.dt, self.name, self.A.tobytes(), self.B.tobytes()))

    @property
    def input_names(self) -> tuple[str, ...]:
        """Names of the inputs, in order."""
        return tuple(channel.name for channel in self.inputs)

    @property
    def output_names(self) -> tuple[str, ...]:
        """Names of the outputs, in order."""
        return tuple(channel.name for channel in self.outputs)

    def select(self, *, inputs: Iterable[str] | None = None, outputs: Iterable[str] | None = None) -> StateSpace:
        """Return the model with the given channels in the given order; None keeps all.

        Raises:
            ParameterError: A name is unknown; the message lists the known ones.
        """
        columns, rows = (
            list(range(len(names))) if chosen is None else _positions(names, chosen, f"{self.name}: unknown {kind}")
            for kind, names, chosen in (("input", self.input_names, inputs), ("output", self.output_names, outputs))
        )
        return replace(
            self,
            B=self.B[:, columns],
            C=self.C[rows],
            D=self.D[np.ix_(rows, columns)],
            inputs=tuple(self.inputs[i] for i in columns),
            outputs=tuple(self.outputs[i] for i in rows),
        )

    def poles(self) -> Complex:
        """Return the poles (n,) in s [1/s], or in z if the model is discrete."""
        return np.asarray(np.linalg.eigvals(self.A), dtype=np.complex128)

    def modes(self) -> tuple[Mode, ...]:
        """Return natural frequency and damping ratio of every pole pair and every real pole, slowest first.

        `f = |s| / 2 pi`, `zeta = -Re(s) / |s|`, with `s = ln(z) / dt` for a discrete model.
        """
        poles = _continuous(self.poles(), self.dt)
        poles = poles[poles.imag >= 0.0]
        return tuple(_mode(pole) for pole in poles[np.argsort(np.abs(poles), kind="stable")])

    def frequency_response(self, frequency_hz: ArrayLike) -> Complex:
        """Return `H = C (s I - A)^-1 B + D` (p, m, K) at `s = 2 pi j f`, or at `z = exp(2 pi j f dt)`, for f (K,) [Hz].

        The state matrix is balanced and transformed to complex Schur form once. Each frequency then needs one
        triangular solve, which is backward stable even for repeated poles and many states.

        Raises:
            ParameterError: A pole is at one of the frequencies.
        """
        frequency = np.atleast_1d(np.asarray(frequency_hz, dtype=np.float64))
        s = 2j * np.pi * frequency
        points = np.asarray(s if self.dt is None else np.exp(s * self.dt), dtype=np.complex128)
        try:
            return self._transfer(points) + self.D[:, :, None]
        except ZeroDivisionError as error:
            at = frequency[error.args[0]]
            raise ParameterError(
                f"{self.name}: the response is infinite at {at:g} Hz, where the model has an undamped pole; omit this "
                "frequency or add damping to the model"
            ) from error

    def _transfer(self, points: Complex) -> Complex:
        """Return `C (s I - A)^-1 B` (p, m, K) at `points`; ZeroDivisionError has the index of a point at a pole."""
        if not len(self.A):
            return np.zeros((*self.D.shape, len(points)), dtype=np.complex128)
        balanced, scaling = kernel.balance(self.A)
        T, Q = schur(balanced.astype(np.complex128), output="complex")
        B = Q.conj().T @ (self.B / scaling[:, None])
        C = (self.C * scaling) @ Q
        distance = np.abs(points[None, :] - np.diag(T)[:, None])
        near = distance <= _POLE_DISTANCE * max(float(np.abs(T).max(initial=0.0)), 1e-300)
        if near.any():
            raise ZeroDivisionError(int(np.flatnonzero(near.any(axis=0))[0]))
        size = max(1, _CHUNK // max(1, B.size))
        parts = [C @ _resolvent(T, B, points[k : k + size]) for k in range(0, len(points), size)]
        joined = np.concatenate(parts, axis=1) if parts else np.zeros((len(C), 0), dtype=np.complex128)
        return np.ascontiguousarray(joined.reshape(len(C), len(points), B.shape[1]).transpose(0, 2, 1))

    def dc_gain(self) -> Array:
        """Return the steady outputs per steady input (p, m), `D - C A^-1 B`.

        Raises:
            ParameterError: The state matrix is singular, so that a constant input has no steady response.
        """
        A = self.A if self.dt is None else self.A - np.eye(len(self.A))
        try:
            states = kernel.equilibrium(A, self.B, np.eye(len(self.inputs)))
        except ValueError as error:
            raise ParameterError(f"{self.name}: {error}") from error
        return np.asarray(self.C @ states + self.D, dtype=np.float64)

    def direct_terms(self) -> NDArray[np.bool_]:
        """Return the mask of outputs that depend on inputs without delay (p, m).

        A term counts if it exceeds `DIRECT_TERM_TOLERANCE` times the response of the states between the same two
        channels: the largest `|C_i (s I - A)^-1 B_j|` on a ray in the right half plane (away from the poles), with
        `|s|` from a thousandth to ten times the fastest pole. This measure does not depend on units. If the response
        of the states is zero, every nonzero term counts.
        """
        resolution = 1e-8 * float(np.abs(self.A).max(initial=0.0))
        fastest = max(float(np.abs(_continuous(self.poles(), self.dt)).max(initial=0.0)), resolution)
        fastest = fastest if fastest > _SLOWEST else 1.0
        s = fastest * np.geomspace(1e-3, 10.0, 9) * np.exp(1j)
        points = s if self.dt is None else np.exp(s * min(self.dt, 50.0 / (10.0 * fastest)))
        dynamic = np.abs(self._transfer(np.asarray(points, dtype=np.complex128))).max(axis=2, initial=0.0)
        return np.asarray((self.D != 0.0) & (np.abs(self.D) > DIRECT_TERM_TOLERANCE * dynamic))

    def to_control(self) -> Any:
        """Return the model as a `control.StateSpace`.

        python-control does not allow dots in names, so they become colons (`lf.road` -> `lf:road`), which channel
        names cannot contain. Units are lost.
        """
        with needs("control", "exchange with python-control"):
            import control  # noqa: PLC0415  because loading it takes seconds and most uses do not need it

        return control.ss(
            self.A,
            self.B,
            self.C,
            self.D,
            0 if self.dt is None else self.dt,
            inputs=[name.replace(".", ":") for name in self.input_names],
            outputs=[name.replace(".", ":") for name in self.output_names],
            name=self.name.replace(".", ":"),
        )

    @classmethod
    def from_control(
        cls, system: Any, *, input_units: Sequence[str], output_units: Sequence[str], name: str | None = None
    ) -> StateSpace:
        """Convert a `control.StateSpace`, or anything that `control.ss` accepts, which has no units.

        Raises:
            ParameterError: The number of units is not that of the channels, or it has no time base (`dt=None`).
        """
        with needs("control", "exchange with python-control"):
            import control  # noqa: PLC0415  see to_control

        system = control.ss(system)
        if system.dt is None or system.dt is True:
            raise ParameterError(
                f"{system.name}: the system has no defined time base (dt={system.dt}); set dt=0 (continuous) or its "
                "sample time in seconds"
            )
        return cls(
            np.asarray(system.A),
            np.asarray(system.B),
            np.asarray(system.C),
            np.asarray(system.D),
            _channels(system.input_labels, input_units, "input"),
            _channels(system.output_labels, output_units, "output"),
            float(system.dt) or None,
            name if name is not None else str(system.name).replace(":", "."),
        )


def _frozen(values: ArrayLike, where: str) -> Array:
    array = np.array(values, dtype=np.float64, order="C") + 0.0  # no negative zeros
    if not np.isfinite(array).all():
        place = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        raise ParameterError(f"{where} contains {array[place]} at {place}; every entry must be a finite number")
    array.setflags(write=False)
    return array


def _positions(names: tuple[str, ...], selection: Iterable[str], problem: str) -> list[int]:
    chosen = [selection] if isinstance(selection, str) else list(selection)
    for name in chosen:
        if name not in names:
            raise ParameterError(f"{problem} {name!r}; the names are {', '.join(names)}")
    return [names.index(name) for name in chosen]


def _channels(labels: Sequence[str], units: Sequence[str], kind: str) -> tuple[Channel, ...]:
    if len(labels) != len(units):
        raise ParameterError(f"{len(units)} {kind} units given, but the system has {len(labels)} {kind}s: {labels}")
    return tuple(Channel(label.replace(":", "."), unit) for label, unit in zip(labels, units, strict=True))


def _continuous(poles: Complex, dt: float | None) -> Complex:
    if dt is None:
        return poles
    moved = poles[poles != 0.0]  # a pole at z = 0 is a pure delay, not a mode
    return np.asarray(np.log(moved) / dt, dtype=np.complex128)


def _mode(pole: complex) -> Mode:
    size = abs(pole)
    return Mode(float(size / (2.0 * np.pi)), float(-pole.real / size) if size else float("nan"))


def _resolvent(T: Complex, B: Complex, points: Complex) -> Complex:
    """Solve `(s I - T) X = B` with upper triangular T for all points at once; X is (n, K * m), point by point."""
    n, m = B.shape
    X = np.empty((n, len(points), m), dtype=np.complex128)
    flat = X.reshape(n, -1)
    for i in range(n - 1, -1, -1):
        carried = (T[i, i + 1 :] @ flat[i + 1 :]).reshape(len(points), m)
        X[i] = (B[i] + carried) / (points - T[i, i])[:, None]
    return flat


# ---- Conversions: to discrete time, and with linear dampers or springs at the shock ports ---------------------------

Hold = Literal["zero", "first"]


def discretise(model: StateSpace, step: float, hold: Hold = "zero") -> StateSpace:
    """Return the discrete model whose samples, `step` [s] apart, equal those of the continuous model.

    "zero": Inputs are held over the step. `x[k+1] = Ad x[k] + (B0 + B1) u[k]`; C and D do not change, so an output
    without a direct term does not get one.

    "first": Inputs are linear over the step. `x[k+1] = Ad x[k] + B0 u[k] + B1 u[k+1]` becomes a proper state
    space with the state `xi = x - B1 u`:

        xi[k+1] = Ad xi[k] + (B0 + Ad B1) u[k],    y[k] = C xi[k] + (D + C B1) u[k]

    The new direct term is not a property of the vehicle: it is the effect, at the sample, of an input that is linear
    up to the sample. With a shock it gives an algebraic loop; coupled runs use the continuous model.

    Raises:
        ParameterError: The model is already discrete, or the step or the hold is invalid.
    """
    if model.dt is not None:
        raise ParameterError(f"{model.name}: the model is already discrete (dt = {model.dt:g} s)")
    try:
        Ad, B0, B1 = kernel.discretise(model.A, model.B, step)
    except ValueError as error:
        raise ParameterError(f"{model.name}: {error}") from error
    if hold == "zero":
        return replace(model, A=Ad, B=B0 + B1, dt=float(step))
    if hold == "first":
        return replace(model, A=Ad, B=B0 + Ad @ B1, D=model.D + model.C @ B1, dt=float(step))
    raise ParameterError(f"{model.name}: unknown hold {hold!r}; choose 'zero' or 'first'")


def add_port_damping(model: StateSpace, damping: Mapping[str, float]) -> StateSpace:
    """Return the continuous model with linear dampers at its shock ports: the force is `c v` plus the input.

    With `u_F = c v + u_F'` and `v = C_v x` (a shock velocity has no direct term):

        A' = A + B_F c C_v,    C' = C + D_F c C_v

    A negative rate removes a damper: a model that was identified around a baseline damping (the dissertation's C-bar)
    becomes a model whose input is the whole shock force. Both conversions are exact. Rates are by port [N.s/m]: "lf",
    "rf", ...; "" is the port of a quarter car.

    Raises:
        ParameterError: The model is discrete, a port does not exist, or a velocity has a direct term.
    """
    return _fed_back(model, damping, "velocity")


def add_port_stiffness(model: StateSpace, stiffness: Mapping[str, float]) -> StateSpace:
    """Return the model with linear springs at its shock ports [N/m], as `add_port_damping` adds dampers.

    Raises:
        ParameterError: The model is discrete, a port does not exist, or a displacement has a direct term.
    """
    return _fed_back(model, stiffness, "displacement")


def _fed_back(model: StateSpace, rates: Mapping[str, float], motion: str) -> StateSpace:
    """Return the model with forces at its ports that are proportional to their velocity or displacement."""
    if model.dt is not None:
        raise ParameterError(f"{model.name}: dampers and springs of ports can be added to a continuous model only")
    ports = [f"{corner}." if corner else "" for corner in rates]
    chosen = model.select(inputs=[f"{port}force" for port in ports], outputs=[f"{port}{motion}" for port in ports])
    direct = model.select(outputs=chosen.output_names).direct_terms()
    if direct.any():
        row, column = (int(i) for i in np.argwhere(direct)[0])
        raise ParameterError(
            f"{model.name}: {chosen.output_names[row]} has a direct term in {model.input_names[column]}; "
            f"a shock {motion} must depend on the state alone (use the continuous model)"
        )
    feedback = np.array(list(rates.values()), dtype=np.float64)[:, None] * chosen.C
    forces = [model.input_names.index(name) for name in chosen.input_names]
    return replace(model, A=model.A + model.B[:, forces] @ feedback, C=model.C + model.D[:, forces] @ feedback)
