"""The linear part of a machine: the car around a damper at each port, exact over a step, and its motion by a drive."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.study.machine.car import Vehicle
from cosim.study.machine.reasons import NotInBatchError
from eightpost.array_types import Array

_Complex = NDArray[np.complex128]

#: Largest condition number of the modes, and largest growth of one [1/s]: what exceeds them runs through the FMUs.
_CONDITION, _GROWTH = 1e7, 1e-6

#: Changes of A that are tried, as a share of its largest element, and the seed of their direction.
_APART, _SEED = (0.0, 1e-12, 1e-11, 1e-10), 1

#: Number of intervals of a drive that are handled at once.
_AT_ONCE = 1 << 16


class Bond(NamedTuple):
    """A shock's port of the vehicle: numbers of the force's input and of the outputs velocity and travel."""

    force: int
    velocity: int
    travel: int


@dataclass(frozen=True, slots=True, eq=False)
class LinearCar:
    """Car with a damper at each port, as independent complex modes z' = lambda z + b u with outputs Re(c z) + D u."""

    vehicle: Vehicle  #: The car without the dampers.
    bonds: tuple[Bond, ...]  #: Ports of the shocks.
    damping: Array  #: Damping of each (C,) [N.s/m].
    poles: _Complex  #: lambda (P,) [1/s].
    into: _Complex  #: b (P, m).
    out: _Complex  #: c (p, P).

    @classmethod
    def of(cls, vehicle: Vehicle, bonds: Sequence[Bond], damping: Array) -> LinearCar:
        """Close the loops of linear dampers.

        Raises:
            NotInBatchError: The car has no such modes, or is not stable with these dampers.
        """
        forces, velocities = [b.force for b in bonds], [b.velocity for b in bonds]
        if np.any(vehicle.D[np.ix_([*velocities, *(b.travel for b in bonds)], forces)]):
            raise NotInBatchError("a force acts on the velocity of a port without delay")
        poles, vectors = _modes(vehicle.A + vehicle.B[:, forces] @ (damping[:, None] * vehicle.C[velocities]))
        if poles.real.max(initial=-1.0) > _GROWTH:
            raise NotInBatchError("the vehicle is not stable with the mean damping of its shocks")
        kept = poles.imag >= 0.0
        twice = np.where(poles.imag > 0.0, 2.0, 1.0)[kept, None]  # z + conj(z) = 2 Re(z)
        into = twice * (np.linalg.inv(vectors) @ vehicle.B)[kept]
        return cls(vehicle, tuple(bonds), damping, poles[kept], into, vehicle.C @ vectors[:, kept])

    @property
    def pairs(self) -> int:
        """Number of modes."""
        return self.poles.size

    def data(self, step: float, friction: Sequence[Sequence[float]]) -> bytes:
        """Return the structure Car of fmus/machine/car.h for a step [s]."""
        x = self.poles * step
        one, two, three = (step * phi for phi in _phi(x))
        nodes = one - 3.0 * two + 4.0 * three, 4.0 * two - 8.0 * three, 4.0 * three - two
        into = self.into[:, [b.force for b in self.bonds]]
        load = np.stack([_rows(w[:, None] * into) for w in nodes])
        velocity, travel = (_columns(self.out[[b[k] for b in self.bonds]]) for k in (1, 2))
        rest = _rows(-into / np.where(self.poles == 0.0, np.inf, self.poles)[:, None])
        turn = np.exp(x)
        parts = [
            np.stack([turn.real, turn.imag], axis=1), load, rest, velocity, travel, velocity @ load, travel @ load,
            self.damping, np.array(friction),
        ]  # fmt: skip
        return np.concatenate([np.ravel(part) for part in parts]).astype(np.float64).tobytes()

    def output_rows(self, outputs: Sequence[int]) -> tuple[Array, Array]:
        """Return the rows (R, 2 P) and the direct terms (R, C) of outputs."""
        forces = [b.force for b in self.bonds]
        return _columns(self.out[list(outputs)]), self.vehicle.D[np.ix_(list(outputs), forces)]

    def by_drive(
        self,
        times: Array,
        inputs: Array,
        wanted: NDArray[np.intp],
        outputs: Sequence[int],
        accumulate: Callable[..., Any],
    ) -> Array:
        """Return outputs (K, R) at points of the drive, without forces beyond the dampers.

        Args:
            times: Times of the points (N + 1,) [s].
            inputs: Inputs there (N + 1, m), linear between them.
            wanted: Numbers of the points whose outputs are returned (K,).
            outputs: Numbers of the outputs.
            accumulate: Function of fmus/machine/drive.c.
        """
        load = inputs @ self.into.T
        z = np.zeros_like(load[0])
        if self.vehicle.at_rest:
            if np.any(self.poles == 0.0):
                raise NotInBatchError("the vehicle has no unique steady state")
            z = -load[0] / self.poles
        lengths, kinds = np.unique(np.diff(times).round(12), return_inverse=True)
        x = np.multiply.outer(lengths, self.poles)
        turn, (one, two, _) = np.exp(x), (lengths[:, None] * phi for phi in _phi(x))
        out, direct = self.out[list(outputs)].T, self.vehicle.D[list(outputs)].T
        found = np.empty((wanted.size, len(outputs)))
        first = np.searchsorted(wanted, 0, side="right")
        found[:first] = (z @ out).real
        for begin in range(0, kinds.size, _AT_ONCE):
            several = slice(begin, min(begin + _AT_ONCE, kinds.size))
            own = kinds[several]
            states = (one - two)[own] * load[several] + two[own] * load[several.start + 1 : several.stop + 1]
            accumulate(z, turn, own.astype(np.int32), states)
            last = np.searchsorted(wanted, several.stop, side="right")
            found[first:last] = (states[wanted[first:last] - begin - 1] @ out).real
            first, z = last, states[-1].copy()
        return found + inputs[wanted] @ direct + self.vehicle.offset[list(outputs)]


def _modes(closed: Array) -> tuple[_Complex, _Complex]:
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


def _rows(values: _Complex) -> Array:
    """Return real rows (2 P, C) of complex ones: real and imaginary part of each."""
    return np.stack([values.real, values.imag], axis=1).reshape(-1, values.shape[1])


def _columns(values: _Complex) -> Array:
    """Return the real columns (R, 2 P) that give Re(c z) from the real and the imaginary parts of z."""
    return np.stack([values.real, -values.imag], axis=2).reshape(len(values), -1)


def _phi(x: _Complex) -> tuple[_Complex, _Complex, _Complex]:
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
