"""Suspension friction at the ports of a linear vehicle, stepped with it.

The friction force at a port is `F_c tanh(v / v_f)`: F_c the Coulomb force, v the shock velocity, v_f the velocity over
which it is smoothed. It is positive in compression and adds to the port's shock force, in the states and in the
direct terms. It creeps instead of sticking: under a constant load below F_c the port moves at less than
`v_f atanh(load / F_c)`.

The python FMU of a vehicle ships this very file, so it imports numpy only.
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

#: A sub-step is at most this share of the friction's fastest time constant.
SUB_STEP_SHARE = 0.0625

#: Sub-steps that one step may take.
MOST_SUB_STEPS = 100_000


class Ports(NamedTuple):
    """Where friction acts on a linear model with m inputs and n states: P ports."""

    velocity: Array
    """Rows of C that give the shock velocities (P, n)."""
    selector: Array
    """E (m, P): which input a port's force is."""
    mobility: Array
    """|C_v B_f| (P,) [1/kg]: what a unit force at the port accelerates it by, at once."""


def ports_of(stepper: LinearStepper, forces: Sequence[int], velocities: Sequence[int]) -> Ports:
    """Return the ports of a model whose force inputs and velocity outputs stand at these positions, in port order.

    A velocity is taken from the states alone; it must have no direct term.
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
        ports: Where it acts, P ports.
        force: F_c (P,) [N], not below zero; where it is zero there is no friction.
        width: v_f (P,) [m/s], above zero.

    Raises:
        ValueError: A value is not finite or outside its range; the message says which port.
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
        """The sum over the ports of `F_c / v_f` times the mobility [1/s].

        On a car of masses it is at least the fastest rate at which friction alone settles the ports: those rates
        are the eigenvalues of a matrix similar to a symmetric one without negative eigenvalues, and the rate is
        its trace.
        """
        return float(np.sum(self.force / self.width * self.ports.mobility))

    def sub_steps(self, h: float) -> int:
        """Return in how many equal parts a step of `h` seconds is taken.

        Raises:
            ValueError: More than `MOST_SUB_STEPS`.
        """
        count = h * self.rate / SUB_STEP_SHARE
        if not count <= MOST_SUB_STEPS:
            raise ValueError(
                f"the friction is too stiff for a step of {h:g} s: it settles at {self.rate:.3g} 1/s, which takes "
                f"{count:.3g} sub-steps, more than {MOST_SUB_STEPS}; take a smaller step, less friction_force or a "
                "larger friction_velocity"
            )
        return max(1, ceil(count))

    def inputs(self, x: Array) -> Array:
        """Return what friction adds to the inputs (m,) in state `x` (n,)."""
        return np.asarray(self.ports.selector @ (self.force * np.tanh(self.ports.velocity @ x / self.width)))


def _refuse(values: Array, wrong: NDArray[np.bool_], name: str, range_: str) -> None:
    if wrong.any():
        port = int(np.flatnonzero(wrong)[0])
        raise ValueError(f"the friction {name} of port {port} is {values[port]!r}; give a finite number [{range_}]")


def advance(stepper: LinearStepper, friction: PortFriction, x: Array, u0: Array, u1: Array, h: float) -> Array:
    """Return the state `h` seconds on, for inputs that go linearly from `u0` to `u1`, with friction at the ports.

    The step is cut into equal sub-steps of at most `SUB_STEP_SHARE / rate`. Over each, friction goes linearly from
    its value f0 at the start to its value f1 at a predicted end, and the linear model is solved exactly under it:

        a = Ad x + B0 (u0 + f0) + B1 (u1 + f0),   x+ = Ad x + B0 (u0 + f0) + B1 (u1 + f1),   f1 = f(a)

    This is of second order in the sub-step. Without friction it is the plain step, bit for bit.

    Args:
        stepper: The linear model.
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
    """Return the outputs (p,) in state `x` (n,) under inputs `u` (m,) and friction: `y = C x + D (u + f(x))`."""
    return stepper.output(x, u + friction.inputs(x) if friction.acts else u)
