"""Friction and springs at the ports of a linear vehicle, integrated together with the vehicle.

The force at a port is the sum of three elements, positive in compression, with the port's velocity v and displacement
d from the static state:

    F_c tanh(v / v_f)      friction that creeps, with the Coulomb force F_c and the smoothing velocity v_f
    F_s z / z_s            friction that sticks: a bristle with the deflection z (eightpost/vehicle/bristle.py)
    k2 d^2                 a spring that is stiffer in compression than in rebound

It is added to the port's shock force, in the states and in the direct terms. The first element creeps instead of
sticking: under a constant load below F_c the port moves at less than `v_f atanh(load / F_c)`.

The python FMU of a vehicle contains this file, so it imports numpy only.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import ceil, sqrt
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from .bristle import deflection_after

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from .kernel import LinearStepper

    Array = NDArray[np.float64]

#: Largest sub-step, as a fraction of the fastest time constant of the friction that creeps.
SUB_STEP_SHARE = 0.0625

#: Largest sub-step times the frequency at which a port swings on bristles and springs [rad].
SUB_STEP_ANGLE = 0.125

#: Displacement at which the stiffness of port springs determines the sub-steps [m].
SPRING_TRAVEL = 0.05

#: Maximum number of sub-steps in one step.
MOST_SUB_STEPS = 100_000

#: Limits of the search for the steady state of port springs: Newton steps, and the last relative change.
_MOST_NEWTON_STEPS, _AGREEMENT = 50, 1e-13


class Ports(NamedTuple):
    """Ports of a linear model with m inputs and n states at which friction and springs act: P ports."""

    velocity: Array
    """Rows of C that give the port velocities (P, n)."""
    selector: Array
    """Matrix E (m, P) that selects the force input of each port."""
    mobility: Array
    """|C_v B_f| (P,) [1/kg]: immediate acceleration of a port per unit force at the port."""
    displacement: Array
    """Rows of C that give the port displacements (P, n); zeros where the model has none."""


def ports_of(
    stepper: LinearStepper,
    forces: Sequence[int],
    velocities: Sequence[int],
    displacements: Sequence[int | None] | None = None,
) -> Ports:
    """Return the ports of a model.

    Velocities and displacements are computed from the states alone; they must have no direct term.

    Args:
        stepper: Linear model.
        forces: Positions of the force inputs, in port order.
        velocities: Positions of the velocity outputs.
        displacements: Positions of the displacement outputs, None for a port without one; by default no port has one.
    """
    rows = stepper.C[list(velocities)]
    columns = stepper.B[:, list(forces)]
    selector = np.zeros((stepper.B.shape[1], len(forces)))
    selector[list(forces), range(len(forces))] = 1.0
    places = np.zeros_like(rows)
    for port, output in enumerate(displacements or ()):
        if output is not None:
            places[port] = stepper.C[output]
    return Ports(rows, selector, np.abs(np.einsum("pn,np->p", rows, columns)), places)


def named_ports(
    stepper: LinearStepper, channels: tuple[Sequence[str], Sequence[str]], ports: Sequence[str], springs: Sequence[str]
) -> Ports:
    """Return the ports of a model with named inputs and outputs.

    Args:
        stepper: Linear model.
        channels: Names of its inputs and of its outputs.
        ports: Prefixes of the ports: "lf.", ...; "" for a quarter car.
        springs: Prefixes of those that can have a spring.
    """
    inputs, outputs = (list(names) for names in channels)
    return ports_of(
        stepper,
        [inputs.index(f"{port}force") for port in ports],
        [outputs.index(f"{port}velocity") for port in ports],
        [outputs.index(f"{port}displacement") if port in springs else None for port in ports],
    )


class Bristles(NamedTuple):
    """Parameters of the bristles at P ports; see `eightpost.vehicle.bristle.Bristle`."""

    force: Array
    """Sliding forces (P,) [N]."""
    reach: Array
    """Deflections at which they slide (P,) [m]."""
    static_ratio: Array
    """Static over sliding forces (P,) [1]."""
    stribeck_velocity: Array
    """Stribeck velocities (P,) [m/s]."""

    @classmethod
    def none(cls, ports: int) -> Bristles:
        """Return bristles without force."""
        return cls(np.zeros(ports), np.full(ports, 1e-4), np.ones(ports), np.full(ports, 0.01))


@dataclass(frozen=True, slots=True, eq=False)
class PortFriction:
    """Friction and springs at the ports of a vehicle.

    The state of a vehicle with them is that of its linear model, followed by the deflections of its bristles (P,) [m]
    if the argument `bristles` is given.

    Raises:
        ValueError: A value is not finite or outside its range; the message gives the port.
    """

    ports: Ports  #: Ports at which they act (P).
    force: Array  #: Coulomb force F_c (P,) [N], not below zero; a port with zero has no such friction.
    width: Array  #: Smoothing velocity v_f (P,) [m/s], above zero.
    bristles: Bristles | None = None  #: Bristles of the ports, None for no states of bristles.
    #: Coefficient k2 of the port springs (P,) [N/m2]; zero without a spring. The port needs a displacement.
    spring: Array = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        """Check the values."""
        if self.spring.size == 0:
            object.__setattr__(self, "spring", np.zeros(len(self.ports.mobility)))
        _refuse(self.force, self.force >= 0.0, "friction force", "N, not below zero")
        _refuse(self.width, self.width > 0.0, "friction velocity", "m/s, above zero")
        _refuse(self.spring, np.full(self.spring.shape, True), "port spring", "N/m2")
        if self.bristles is not None:
            force, reach, ratio, stribeck = self.bristles
            _refuse(force, force >= 0.0, "bristle force", "N, not below zero")
            _refuse(reach, reach > 0.0, "bristle reach", "m, above zero")
            _refuse(ratio, ratio >= 1.0, "bristle static ratio", "at least 1")
            _refuse(stribeck, stribeck > 0.0, "bristle Stribeck velocity", "m/s, above zero")

    @classmethod
    def of_values(cls, ports: Ports, names: Sequence[str], values: Mapping[str, float]) -> PortFriction:
        """Return the friction for the parameters of a vehicle FMU; a missing `port_spring` is zero.

        Args:
            ports: Ports at which it acts.
            names: Prefixes of the ports.
            values: Parameters by name.
        """

        def at_ports(name: str) -> Array:
            return np.array([float(values.get(f"{port}{name}", 0.0)) for port in names])

        bristles = Bristles(*(at_ports(f"bristle_{name}") for name in Bristles._fields))
        return cls(ports, at_ports("friction_force"), at_ports("friction_velocity"), bristles, at_ports("port_spring"))

    @property
    def acts(self) -> bool:
        """Whether there is friction or a spring at any port."""
        return bool((self.force > 0.0).any() or self.sticks or self.springs)

    @property
    def sticks(self) -> bool:
        """Whether there is a bristle with a force at any port."""
        return self.bristles is not None and bool((self.bristles.force > 0.0).any())

    @property
    def springs(self) -> bool:
        """Whether there is a spring at any port."""
        return bool((self.spring != 0.0).any())

    @property
    def states(self) -> int:
        """Number of deflections in the state."""
        return 0 if self.bristles is None else len(self.bristles.force)

    @property
    def rate(self) -> float:
        """Sum over the ports of `F_c / v_f` times the mobility [1/s].

        For a car that consists of masses it is an upper bound of the rates at which friction alone decelerates the
        ports. These rates are the eigenvalues of a matrix that is similar to a positive semidefinite one, and the sum
        is the trace of that matrix.
        """
        return float(np.sum(self.force / self.width * self.ports.mobility))

    @property
    def squared_frequency(self) -> float:
        """Sum over the ports of the stiffness of bristle and spring times the mobility [rad2/s2].

        As the trace of such a matrix, it is an upper bound of the squared frequencies at which the ports swing on them.
        """
        own = 2.0 * SPRING_TRAVEL * np.abs(self.spring)
        if self.bristles is not None:
            own = self.bristles.force / self.bristles.reach + own
        return float(np.sum(own * self.ports.mobility))

    def sub_steps(self, h: float) -> int:
        """Return the number of equal sub-steps of a step of `h` seconds.

        Raises:
            ValueError: The number exceeds `MOST_SUB_STEPS`.
        """
        creeping, angle = h * self.rate / SUB_STEP_SHARE, h / SUB_STEP_ANGLE
        square = angle * angle * self.squared_frequency
        if not (creeping <= MOST_SUB_STEPS and square <= MOST_SUB_STEPS * MOST_SUB_STEPS):
            raise ValueError(
                f"the friction is too stiff for a step of {h:g} s: it settles at {self.rate:.3g} 1/s and swings at "
                f"{sqrt(self.squared_frequency):.3g} rad/s, which needs {max(creeping, sqrt(square)):.3g} sub-steps, "
                f"more than {MOST_SUB_STEPS}; use a smaller step, less friction_force, bristle_force or port_spring, "
                "or a larger friction_velocity or bristle_reach"
            )
        count = max(1, ceil(creeping))
        if count * count < square:
            count = max(count, ceil(sqrt(square)) - 1)
            count += count * count < square
        return count

    def split(self, x: Array) -> tuple[Array, Array]:
        """Return the state of the linear model (n,) and the deflections, from the whole state."""
        n = len(x) - self.states
        return x[:n], x[n:]

    def forces(self, x: Array, z: Array) -> Array:
        """Return the forces at the ports (P,) [N] in state `x` (n,) of the linear model with deflections `z`."""
        total = self.force * np.tanh(self.ports.velocity @ x / self.width)
        if self.sticks and self.bristles is not None:
            total = total + self.bristles.force / self.bristles.reach * z
        if self.springs:
            place = self.ports.displacement @ x
            total = total + self.spring * (place * place)
        return np.asarray(total)

    def inputs(self, x: Array) -> Array:
        """Return the forces, as an addition to the inputs (m,), in the whole state `x`."""
        return np.asarray(self.ports.selector @ self.forces(*self.split(x)))

    def deflections_after(self, z: Array, mean: Array, s: float) -> Array:
        """Return the deflections after `s` seconds with the mean velocities `mean` (P,), from the deflections `z`.

        The deflection of a bristle without force does not change.
        """
        if not self.sticks or self.bristles is None:
            return z
        force, *own = self.bristles
        return np.where(force > 0.0, deflection_after(z, mean, s, *own), z)


def _refuse(values: Array, is_in_range: NDArray[np.bool_], name: str, range_: str) -> None:
    wrong = ~(np.isfinite(values) & is_in_range)
    if wrong.any():
        port = int(np.flatnonzero(wrong)[0])
        raise ValueError(f"the {name} of port {port} is {values[port]!r}; give a finite number [{range_}]")


def advance(stepper: LinearStepper, friction: PortFriction, x: Array, u0: Array, u1: Array, h: float) -> Array:
    """Return the state after `h` seconds for inputs that change linearly from `u0` to `u1`, with friction at the ports.

    The step is divided into equal sub-steps of at most `SUB_STEP_SHARE / rate` and of at most `SUB_STEP_ANGLE` of the
    frequency on bristles and springs. Over each, the forces change linearly from their value f0 at the start to their
    value f1 at a predicted end, and the linear model is solved exactly:

        a = Ad x + B0 (u0 + f0) + B1 (u1 + f0),   x+ = Ad x + B0 (u0 + f0) + B1 (u1 + f1),   f1 = f(a)

    A bristle advances exactly for the mean of the velocities at both ends, to the predicted end for f1, and to the end
    itself for its state. The method has second order in the sub-step. Without friction it is bitwise equal to the step
    of the linear model.

    Args:
        stepper: Linear model.
        friction: Friction at its ports.
        x: Whole state (n,) or (n + P,) at t.
        u0: Inputs (m,) at t, without friction.
        u1: Inputs (m,) at t + h.
        h: Step [s], above zero.

    Raises:
        ValueError: The step is not a finite number above zero, or the friction is too stiff for it.

    Source: S. M. Cox, P. C. Matthews, "Exponential time differencing for stiff systems", J. Comput. Phys. 176 (2002)
    430-455, doi 10.1006/jcph.2002.6995: their ETD2RK.
    """
    own, z = friction.split(x)
    if not friction.acts:
        return _joined(stepper.advance(own, u0, u1, h), z)
    count = friction.sub_steps(h)
    before = u0
    for k in range(1, count + 1):
        after = u1 if k == count else u0 + (u1 - u0) * (k / count)
        own, z = _sub_step(stepper, friction, (own, z), (before, after), h / count)
        before = after
    return _joined(own, z)


def _joined(x: Array, z: Array) -> Array:
    return np.concatenate((x, z)) if z.size else x


def _sub_step(
    stepper: LinearStepper, friction: PortFriction, state: tuple[Array, Array], u: tuple[Array, Array], s: float
) -> tuple[Array, Array]:
    (x, z), (u0, u1) = state, u
    Ad, B0, B1 = stepper.discrete(s)
    E, rows = friction.ports.selector, friction.ports.velocity
    start = E @ friction.forces(x, z)
    held = Ad @ x + B0 @ (u0 + start)
    predicted = held + B1 @ (u1 + start)
    before = rows @ x
    bent = friction.deflections_after(z, 0.5 * (before + rows @ predicted), s)
    end = held + B1 @ (u1 + E @ friction.forces(predicted, bent))
    return np.asarray(end), friction.deflections_after(z, 0.5 * (before + rows @ end), s)


def output(stepper: LinearStepper, friction: PortFriction, x: Array, u: Array) -> Array:
    """Return the outputs (p,) for the whole state `x`, inputs `u` (m,) and friction: `y = C x + D (u + f(x))`."""
    return stepper.output(friction.split(x)[0], u + friction.inputs(x) if friction.acts else u)


def equilibrium(stepper: LinearStepper, friction: PortFriction, u: Array) -> Array:
    """Return the whole state in which constant inputs `u` (m,) and port springs are in balance, with relaxed bristles.

    With the displacements d0 without springs and the compliances G, the displacements d solve d = d0 + G k2 d^2 by
    Newton's method from zero.

    Raises:
        ValueError: There is no steady state, or the search for it does not converge.
    """
    if friction.springs:
        compliance = friction.ports.displacement @ stepper.equilibrium(friction.ports.selector)
        d = _balance(friction.ports.displacement @ stepper.equilibrium(u), compliance, friction.spring)
        u = u + friction.ports.selector @ (friction.spring * (d * d))
    return _joined(stepper.equilibrium(u), np.zeros(friction.states))


def _balance(d0: Array, compliance: Array, k2: Array) -> Array:
    d = np.zeros_like(d0)
    for _ in range(_MOST_NEWTON_STEPS):
        slope = np.eye(len(d)) - 2.0 * compliance * (k2 * d)
        try:
            change = np.linalg.solve(slope, d0 + compliance @ (k2 * (d * d)) - d)
        except np.linalg.LinAlgError:
            break
        d = d + change
        if (np.abs(change) <= _AGREEMENT * (np.abs(d) + 1.0)).all():
            return d
    raise ValueError(
        "the port springs have no steady state at these inputs, or the search for it does not converge: check "
        "port_spring and the inputs, or set start_at_equilibrium to false"
    )
