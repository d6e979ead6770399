"""Suspension friction at the ports of a linear vehicle, integrated together with the vehicle.

The friction force at a port is `F_c tanh(v / v_f)` with the Coulomb force F_c, the shock velocity v and the smoothing
velocity v_f. It is positive in compression and is added to the port's shock force, in the states and in the direct
terms. The port creeps instead of sticking: under a constant load below F_c it moves at less than
`v_f atanh(load / F_c)`.

The python FMU of a vehicle contains this file, so it imports numpy only.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from .kernel import LinearStepper

    Array = NDArray[np.float64]

#: Largest sub-step, as a fraction of the friction's fastest time constant.
SUB_STEP_SHARE = 0.0625

#: Maximum number of sub-steps in one step.
MOST_SUB_STEPS = 100_000


class Ports(NamedTuple):
    """Ports at which friction acts on a linear model with m inputs and n states: P ports."""

    velocity: Array
    """Rows of C that give the shock velocities (P, n)."""
    selector: Array
    """Matrix E (m, P) that selects the force input of each port."""
    mobility: Array
    """|C_v B_f| (P,) [1/kg]: immediate acceleration of a port per unit force at the port."""


def ports_of(stepper: LinearStepper, forces: Sequence[int], velocities: Sequence[int]) -> Ports:
    """Return the ports of a model, from the positions of their force inputs and velocity outputs, in port order.

    A velocity is computed from the states alone; it must have no direct term.
    """
    rows = stepper.C[list(velocities)]
    columns = stepper.B[:, list(forces)]
    selector = np.zeros((stepper.B.shape[1], len(forces)))
    selector[list(forces), range(len(forces))] = 1.0
    return Ports(rows, selector, np.abs(np.einsum("pn,np->p", rows, columns)))


@dataclass(frozen=True, slots=True, eq=False)
class PortFriction:
    """Friction at the ports of a vehicle.

    Attributes:
        ports: Ports at which the friction acts (P).
        force: Coulomb force F_c (P,) [N], not below zero; a port with zero has no friction.
        width: Smoothing velocity v_f (P,) [m/s], above zero.

    Raises:
        ValueError: A value is not finite or outside its range; the message gives the port.
    """

    ports: Ports
    force: Array
    width: Array

    def __post_init__(self) -> None:
        """Check the values."""
        _refuse(self.force, ~(np.isfinite(self.force) & (self.force >= 0.0)), "force", "N, not below zero")
        _refuse(self.width, ~(np.isfinite(self.width) & (self.width > 0.0)), "velocity", "m/s, above zero")

    @property
    def acts(self) -> bool:
        """Whether there is friction at any port."""
        return bool((self.force > 0.0).any())

    @property
    def rate(self) -> float:
        """Sum over the ports of `F_c / v_f` times the mobility [1/s].

        For a car that consists of masses it is an upper bound of the rates at which friction alone decelerates the
        ports. These rates are the eigenvalues of a matrix that is similar to a positive semidefinite one, and the sum
        is the trace of that matrix.
        """
        return float(np.sum(self.force / self.width * self.ports.mobility))

    def sub_steps(self, h: float) -> int:
        """Return the number of equal sub-steps of a step of `h` seconds.

        Raises:
            ValueError: The number exceeds `MOST_SUB_STEPS`.
        """
        count = h * self.rate / SUB_STEP_SHARE
        if not count <= MOST_SUB_STEPS:
            raise ValueError(
                f"the friction is too stiff for a step of {h:g} s: it settles at {self.rate:.3g} 1/s, which needs "
                f"{count:.3g} sub-steps, more than {MOST_SUB_STEPS}; use a smaller step, less friction_force or a "
                "larger friction_velocity"
            )
        return max(1, ceil(count))

    def inputs(self, x: Array) -> Array:
        """Return the friction forces, as an addition to the inputs (m,), in state `x` (n,)."""
        return np.asarray(self.ports.selector @ (self.force * np.tanh(self.ports.velocity @ x / self.width)))


def _refuse(values: Array, wrong: NDArray[np.bool_], name: str, range_: str) -> None:
    if wrong.any():
        port = int(np.flatnonzero(wrong)[0])
        raise ValueError(f"the friction {name} of port {port} is {values[port]!r}; give a finite number [{range_}]")


def advance(stepper: LinearStepper, friction: PortFriction, x: Array, u0: Array, u1: Array, h: float) -> Array:
    """Return the state after `h` seconds for inputs that change linearly from `u0` to `u1`, with friction at the ports.

    The step is divided into equal sub-steps of at most `SUB_STEP_SHARE / rate`. Over each, friction changes linearly
    from its value f0 at the start to its value f1 at a predicted end, and the linear model is solved exactly:

        a = Ad x + B0 (u0 + f0) + B1 (u1 + f0),   x+ = Ad x + B0 (u0 + f0) + B1 (u1 + f1),   f1 = f(a)

    The method has second order in the sub-step. Without friction it is bitwise equal to the step of the linear model.

    Args:
        stepper: Linear model.
        friction: Friction at its ports.
        x: State (n,) at t.
        u0: Inputs (m,) at t, without friction.
        u1: Inputs (m,) at t + h.
        h: Step [s], above zero.

    Raises:
        ValueError: The step is not a finite number above zero, or the friction is too stiff for it.

    Source: S. M. Cox, P. C. Matthews, "Exponential time differencing for stiff systems", J. Comput. Phys. 176 (2002)
    430-455, doi 10.1006/jcph.2002.6995: their ETD2RK.
    """
    if not friction.acts:
        return stepper.advance(x, u0, u1, h)
    count = friction.sub_steps(h)
    before = u0
    for k in range(1, count + 1):
        after = u1 if k == count else u0 + (u1 - u0) * (k / count)
        x = _sub_step(stepper, friction, x, before, after, h / count)
        before = after
    return x


def _sub_step(stepper: LinearStepper, friction: PortFriction, x: Array, u0: Array, u1: Array, s: float) -> Array:
    Ad, B0, B1 = stepper.discrete(s)
    start = friction.inputs(x)
    held = Ad @ x + B0 @ (u0 + start)
    end = friction.inputs(held + B1 @ (u1 + start))
    return np.asarray(held + B1 @ (u1 + end), dtype=np.float64)


def output(stepper: LinearStepper, friction: PortFriction, x: Array, u: Array) -> Array:
    """Return the outputs (p,) for state `x` (n,), inputs `u` (m,) and friction: `y = C x + D (u + f(x))`."""
    return stepper.output(x, u + friction.inputs(x) if friction.acts else u)
