"""Friction and springs at the ports of a linear vehicle, integrated together with the vehicle.

The force at a port is the sum of three elements, positive in compression, with the port's velocity v and displacement
d from the static state:

    F_c tanh(v / v_f)      friction that creeps, with the Coulomb force F_c and the smoothing velocity v_f
    F_s z / z_s            friction that sticks: a bristle with the deflection z (`Bristle`)
    k2 d^2                 a spring that is stiffer in compression than in rebound

It is added to the port's shock force, in the states and in the direct terms. The first element creeps instead of
sticking: under a constant load below F_c the port moves at less than `v_f atanh(load / F_c)`.

The python FMU of a vehicle contains this file, so it imports numpy only. `eightpost.vehicle.compiled` compiles the
functions of the bristle.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import ceil, sqrt
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from .kernel import LinearStepper

    Array = NDArray[np.float64]

# ==== The bristle ====================================================================================================


def sliding_deflection(v: Any, reach: Any, static_ratio: Any, stribeck_velocity: Any) -> Any:
    """Return the deflection z_b [m] at which a bristle slides with the velocity `v` [m/s]; see `Bristle`."""
    ratio = v / stribeck_velocity
    return reach * (1.0 + (static_ratio - 1.0) * np.exp(-ratio * ratio))


def deflection_after(z: Any, v: Any, h: Any, reach: Any, static_ratio: Any, stribeck_velocity: Any) -> Any:
    """Return the deflection [m] after `h` seconds at the constant velocity `v`, from the deflection `z` [m].

        z+ = s z_b + (z - s z_b) exp(-|v| h / z_b),   s = sign v

    It is exact for a constant velocity, and equal to `z` for none. For a velocity that changes, `v` is its mean.
    """
    limit = sliding_deflection(v, reach, static_ratio, stribeck_velocity)
    return z - (np.copysign(limit, v) - z) * np.expm1(-np.abs(v) * h / limit)


@dataclass(frozen=True, slots=True)
class Bristle:
    """Friction that sticks: a bristle that bends with the port and slides at a given deflection.

        z' = v - |v| z / z_b(v),   z_b(v) = z_s (1 + (rho - 1) exp(-(v / v_s)^2)),   F = F_s z / z_s

    with the port velocity v, the deflection z, the reach z_s and the sliding force F_s. For a port that moves much less
    than the reach the bristle is a spring of stiffness F_s / z_s, so that the port sticks. At a port that slides the
    force is F_s, and up to rho F_s at speeds below the Stribeck velocity v_s. The methods take numbers or arrays.

    Source: C. Canudas de Wit, H. Olsson, K. J. Astrom, P. Lischinsky, "A new model for control of systems with
    friction", IEEE Trans. Autom. Control 40 (1995) 419-425, doi 10.1109/9.376053, without micro-damping and viscous
    friction.
    """

    force: float = 0.0  #: Sliding force F_s [N], not below zero; zero is no friction.
    reach: float = 1e-4  #: Deflection z_s at which the bristle slides with the sliding force [m], above zero.
    static_ratio: float = 1.0  #: Static over sliding force rho [1], at least 1.
    #: Velocity v_s at which the static force has fallen to the sliding force [m/s], above zero: by 1 - 1/e.
    stribeck_velocity: float = 0.01

    @property
    def stiffness(self) -> float:
        """Stiffness of a port that sticks, F_s / z_s [N/m]."""
        return self.force / self.reach

    def deflection_after(self, z: Any, v: Any, h: Any) -> Any:
        """Return the deflection [m] after `h` seconds at the mean velocity `v` [m/s], from the deflection `z` [m]."""
        return deflection_after(z, v, h, self.reach, self.static_ratio, self.stribeck_velocity)

    def force_at(self, z: Any) -> Any:
        """Return the force [N] at a deflection `z` [m]."""
        return self.force / self.reach * z


# ==== Ports ==========================================================================================================

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

    velocity: Array  #: Rows of C that give the port velocities (P, n).
    selector: Array  #: Matrix E (m, P) that selects the force input of each port.
    mobility: Array  #: |C_v B_f| (P,) [1/kg]: immediate acceleration of a port per unit force at the port.
    displacement: Array  #: Rows of C that give the port displacements (P, n); zeros where the model has none.


def ports_of(
    stepper: LinearStepper,
    forces: Sequence[int],
    velocities: Sequence[int],
    displacements: Sequence[int | None] | None = None,
) -> Ports:
    """Return the ports of a model from the positions of force inputs and of outputs, in port order.

    Velocities and displacements are computed from the states alone; they must have no direct term. A port without a
    displacement has None.
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
    """Return the ports of a model with named inputs and outputs (`channels`).

    `ports` are the prefixes of the ports: "lf.", ...; "" for a quarter car, and `springs` of those that can have a
    spring.
    """
    inputs, outputs = (list(names) for names in channels)
    return ports_of(
        stepper,
        [inputs.index(f"{port}force") for port in ports],
        [outputs.index(f"{port}velocity") for port in ports],
        [outputs.index(f"{port}displacement") if port in springs else None for port in ports],
    )


class Bristles(NamedTuple):
    """Parameters of the bristles at P ports, arrays (P,); see `Bristle`."""

    force: Array  #: [N]
    reach: Array  #: [m]
    static_ratio: Array  #: [1]
    stribeck_velocity: Array  #: [m/s]


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
        if self.spring.size == 0:
            object.__setattr__(self, "spring", np.zeros(len(self.ports.mobility)))
        rows = [
            (self.force, self.force >= 0.0, "friction force", "N, not below zero"),
            (self.width, self.width > 0.0, "friction velocity", "m/s, above zero"),
            (self.spring, np.isfinite(self.spring), "port spring", "N/m2"),
        ]
        if self.bristles is not None:
            force, reach, ratio, stribeck = self.bristles
            rows += [
                (force, force >= 0.0, "bristle force", "N, not below zero"),
                (reach, reach > 0.0, "bristle reach", "m, above zero"),
                (ratio, ratio >= 1.0, "bristle static ratio", "at least 1"),
                (stribeck, stribeck > 0.0, "bristle Stribeck velocity", "m/s, above zero"),
            ]
        for values, is_in_range, name, limits in rows:
            wrong = np.flatnonzero(~(np.isfinite(values) & is_in_range))
            if wrong.size:
                value = values[wrong[0]]
                raise ValueError(f"the {name} of port {wrong[0]} is {value!r}; give a finite number [{limits}]")

    @classmethod
    def of_values(cls, ports: Ports, names: Sequence[str], values: Mapping[str, float]) -> PortFriction:
        """Return the friction for the parameters of a vehicle FMU by name; a missing `port_spring` is zero.

        `names` are the prefixes of the ports.
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
        stiffness = 2.0 * SPRING_TRAVEL * np.abs(self.spring)
        if self.bristles is not None:
            stiffness = self.bristles.force / self.bristles.reach + stiffness
        return float(np.sum(stiffness * self.ports.mobility))

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
        force, *law = self.bristles
        return np.where(force > 0.0, deflection_after(z, mean, s, *law), z)


def advance(stepper: LinearStepper, friction: PortFriction, x: Array, u0: Array, u1: Array, h: float) -> Array:
    """Return the state after `h` seconds for inputs that change linearly from `u0` to `u1`, with friction at the ports.

    The step is divided into equal sub-steps of at most `SUB_STEP_SHARE / rate` and of at most `SUB_STEP_ANGLE` of the
    frequency on bristles and springs. Over each, the forces change linearly from their value f0 at the start to their
    value f1 at a predicted end, and the linear model is solved exactly:

        a = Ad x + B0 (u0 + f0) + B1 (u1 + f0),   x+ = Ad x + B0 (u0 + f0) + B1 (u1 + f1),   f1 = f(a)

    A bristle advances exactly for the mean of the velocities at both ends, to the predicted end for f1, and to the end
    itself for its state. The method has second order in the sub-step. Without friction it is bitwise equal to the step
    of the linear model.

    `x` is the whole state (n,) or (n + P,) at t; the inputs `u0` at t and `u1` at t + h (m,) are without friction.

    Raises:
        ValueError: The step is not a finite number above zero, or the friction is too stiff for it.

    Source: S. M. Cox, P. C. Matthews, "Exponential time differencing for stiff systems", J. Comput. Phys. 176 (2002)
    430-455, doi 10.1006/jcph.2002.6995: their ETD2RK.
    """
    state, z = friction.split(x)
    if not friction.acts:
        return _joined(stepper.advance(state, u0, u1, h), z)
    count = friction.sub_steps(h)
    before = u0
    for k in range(1, count + 1):
        after = u1 if k == count else u0 + (u1 - u0) * (k / count)
        state, z = _sub_step(stepper, friction, (state, z), (before, after), h / count)
        before = after
    return _joined(state, z)


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
