"""The car and its shocks as the machine takes them: matrices, ports and laws, and modes that are exact over a step."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from eightpost.array_types import Array, Complex, Integers
from eightpost.machine.library import Driven, Library

# ==== Reasons why a study cannot run as a batch ======================================================================


class NotInBatchError(Exception):
    """Reason, as a clause, why setups run through the FMUs instead of a batch."""


class UnstableCarError(NotInBatchError):
    """The car's motion grows even with the mean damping of its shocks."""


# ==== Shocks: the law and its parameters =============================================================================

#: Laws of fmus/machine/port.h by name.
LAWS = {"polylinear": 0, "lpf1": 1, "lpnl2": 1, "hysteresis": 2}

#: Limits of the lagged force with which the weight of the lag is always 0, or always 1 [N].
_NO_LAG, _ONLY_LAG = (-2.0, -1.0), (0.0, 1e300)

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
        return cls(LAWS[name], np.array(found))

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

    def data(self, step: float) -> bytes:
        """Return the structure Car of fmus/machine/car.h for a step [s]."""
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
        return np.concatenate([np.ravel(part) for part in parts]).astype(np.float64).tobytes()

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
