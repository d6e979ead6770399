"""Cars defined by parameters: the quarter car and the seven-DOF car, and whether their numbers are plausible."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import MISSING, dataclass, field, fields, replace
from itertools import chain
from math import inf, pi, sqrt
from typing import Any, NamedTuple

import numpy as np

from eightpost.array_types import Array
from eightpost.corners import CORNERS
from eightpost.errors import ParameterError
from eightpost.units import convert
from eightpost.vehicle.statespace import Channel, StateSpace

# ==== Parameters: dataclass fields with unit and range, and values per corner ========================================


class Corners(NamedTuple):
    """Values per corner."""

    lf: float
    rf: float
    lr: float
    rr: float

    @classmethod
    def same(cls, value: float) -> Corners:
        """Return the same value for all four corners."""
        return cls(value, value, value, value)

    @classmethod
    def axles(cls, front: float, rear: float) -> Corners:
        """Return the same value for both corners of an axle."""
        return cls(front, front, rear, rear)


def positive(unit: str, *, default: Any = MISSING) -> Any:
    """Declare a parameter in `unit` that must be above zero."""
    return field(default=default, metadata={"unit": unit, "above": 0.0})


def not_negative(unit: str, *, default: Any = MISSING) -> Any:
    """Declare a parameter in `unit` that must not be below zero."""
    return field(default=default, metadata={"unit": unit, "least": 0.0})


def _either_sign(default: float | None) -> Any:
    """Declare a distance [m] that may have either sign."""
    return field(default=default, metadata={"unit": "m"})


def _check_ranges(parameters: Any) -> None:
    """Raise ParameterError if a declared parameter of a dataclass is not finite or outside its range."""
    for declared in fields(parameters):
        value, limits = getattr(parameters, declared.name), declared.metadata
        named = value._asdict() if isinstance(value, Corners) else {} if value is None else {"": value}
        for corner, number in named.items():
            name = f"{declared.name}.{corner}" if corner else declared.name
            if not np.isfinite(number):
                raise ParameterError(f"{name} is {float(number)}; give a finite number [{limits['unit']}]")
            if "above" in limits and number <= limits["above"]:
                raise ParameterError(f"{name} is {number:g} {limits['unit']}; it must be above zero")
            if "least" in limits and number < limits["least"]:
                raise ParameterError(f"{name} is {number:g} {limits['unit']}; it must not be negative")


# ==== Equations of motion as a state space with named outputs ========================================================


def state_matrices(mass: Array, damping: Array, stiffness: Array, load: Array) -> tuple[Array, Array]:
    """Return A and B of `x' = A x + B u` with `x = (q, q')` for `M q'' + C q' + K q = L u` (Eq 4.2, 5.19).

        A = [[0, I], [-M^-1 K, -M^-1 C]],    B = [[0], [M^-1 L]]

    `mass` is the diagonal of M (n,), so zeros of C (n, n), K (n, n) and L (n, m) are exact zeros of A and B.
    """
    n = len(mass)
    inverse = 1.0 / mass[:, None]
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse * stiffness, -inverse * damping]])
    return A, np.vstack([np.zeros_like(load), inverse * load])


class Outputs:
    """Builder of output equations, one group of rows after the other."""

    def __init__(self, A: Array, B: Array) -> None:
        """Store the matrices A (2n, 2n) and B (2n, m) of the state equation."""
        self._A, self._B = A, B
        self._n = len(A) // 2
        self._channels: list[Channel] = []
        self._C: list[Array] = []
        self._D: list[Array] = []

    def _add(self, names: Sequence[str], unit: str, C: Array, D: Array | None) -> None:
        self._channels += [Channel(name, unit) for name in names]
        self._C.append(C)
        self._D.append(np.zeros((len(C), self._B.shape[1])) if D is None else D)

    def add_position(self, names: Sequence[str], unit: str, rows: Array, D: Array | None = None) -> None:
        """Add `y = rows q + D u`, with rows (k, n)."""
        self._add(names, unit, np.hstack([rows, np.zeros_like(rows)]), D)

    def add_velocity(self, names: Sequence[str], rows: Array) -> None:
        """Add `y = rows q'` [m/s], which depends on the state alone."""
        self._add(names, "m/s", np.hstack([np.zeros_like(rows), rows]), None)

    def add_acceleration(self, names: Sequence[str], rows: Array) -> None:
        """Add `y = rows q''` [m/s2], from the lower half of the state equation, with its direct terms."""
        self._add(names, "m/s2", rows @ self._A[self._n :], rows @ self._B[self._n :])

    def model(self, inputs: Iterable[Channel], name: str) -> StateSpace:
        """Return the state space with all outputs added so far."""
        C, D = np.vstack(self._C), np.vstack(self._D)
        return StateSpace(self._A, self._B, C, D, tuple(inputs), tuple(self._channels), None, name)


# ==== The quarter car: one corner of a chassis and one wheel (dissertation section 4.1) ==============================


@dataclass(frozen=True, slots=True)
class QuarterCar:
    """Parameters of the quarter car; stiffness and damping are wheel rates."""

    sprung_mass: float = positive("kg")  #: Sprung mass m_1 [kg].
    unsprung_mass: float = positive("kg")  #: Unsprung mass m_2 [kg].
    suspension_stiffness: float = not_negative("N/m")  #: Suspension stiffness k [N/m].
    tire_stiffness: float = positive("N/m")  #: Tire stiffness k_t [N/m].
    #: Rate c of the linear damper [N.s/m]; only `with_damper` uses it.
    damping: float = not_negative("N.s/m", default=0.0)

    def __post_init__(self) -> None:
        _check_ranges(self)

    def coupled(self) -> StateSpace:
        """Return the car for coupling to a shock, without its own damper (Eq 4.1 with c = 0)."""
        return self._state_space(0.0, "quarter_car")

    def with_damper(self) -> StateSpace:
        """Return the car with its linear damper, for frequency responses and modes.

        The values of Table 4.1 give 3.039 Hz with 5.82 % and 18.452 Hz with 40.16 % damping. Table 4.2 prints
        3.04/6.10 and 18.44/42.19. These correspond to a damper of 17.5 lbf/(in/s) instead of the 16.67 of Table 4.1
        (and, in the last digit, to masses computed with 386 in/s2 instead of the standard gravity).
        """
        return self._state_space(self.damping, "quarter_car_with_damper")

    def _state_space(self, c: float, name: str) -> StateSpace:
        """Return Eq 4.2 and 4.6: `M w'' + C w' + K w = L u`, w = (w_1, w_2), u = (y_R, F_A, F_S)."""
        k, kt = self.suspension_stiffness, self.tire_stiffness
        A, B = state_matrices(
            np.array([self.sprung_mass, self.unsprung_mass]),
            np.array([[c, -c], [-c, c]]),
            np.array([[k, -k], [-k, k + kt]]),
            np.array([[0.0, -1.0, 1.0], [kt, 0.0, -1.0]]),
        )
        chassis, wheel = np.array([[1.0, 0.0]]), np.array([[0.0, 1.0]])
        road = np.array([[1.0, 0.0, 0.0]])
        outputs = Outputs(A, B)
        outputs.add_velocity(["velocity"], wheel - chassis)
        outputs.add_position(["displacement"], "m", wheel - chassis)
        outputs.add_position(["tire_force"], "N", -kt * wheel, kt * road)
        outputs.add_position(["spring_force"], "N", k * (wheel - chassis))
        outputs.add_position(["ride_height"], "m", chassis, -road)
        outputs.add_acceleration(["hub_acceleration"], wheel)
        outputs.add_acceleration(["chassis_acceleration"], chassis)
        outputs.add_position(["wheel_position"], "m", wheel)
        outputs.add_position(["chassis_position"], "m", chassis)
        return outputs.model((Channel("road", "m"), Channel("aero_force", "N"), Channel("force", "N")), name)


# ==== The seven-DOF car: heave, roll and pitch of the chassis, and four wheels (dissertation section 5.1) ============
# The coordinates are Z = (z, theta, phi, z_2 of lf, rf, lr, rr). Roll is positive if the left side rises, pitch if the
# rear rises.

#: Distance from axle to nose and from axle to spoiler [m]. The dissertation does not give them; with 45 in, a car with
#: a wheelbase of 110 in is 200 in long.
DEFAULT_OVERHANG = 45 * 0.0254

_INPUTS = (
    *(Channel(f"{corner}.road", "m") for corner in CORNERS),
    Channel("heave_force", "N"),
    Channel("roll_moment", "N.m"),
    Channel("pitch_moment", "N.m"),
    *(Channel(f"{corner}.force", "N") for corner in CORNERS),
)
_ROAD, _EXTERNAL, _FORCE = slice(0, 4), slice(4, 7), slice(7, 11)
_CHASSIS, _WHEELS = slice(0, 3), slice(3, 7)


@dataclass(frozen=True, slots=True)
class SevenDof:
    """Parameters of the seven-DOF car; stiffness and damping are wheel rates."""

    track_width: float = positive("m")  #: Track width t of both axles [m].
    cg_to_front_axle: float = positive("m")  #: Distance a from the centre of gravity to the front axle [m].
    cg_to_rear_axle: float = positive("m")  #: Distance b from the centre of gravity to the rear axle [m].
    sprung_mass: float = positive("kg")  #: Sprung mass M [kg].
    roll_inertia: float = positive("kg.m2")  #: Roll inertia J_theta [kg.m2].
    pitch_inertia: float = positive("kg.m2")  #: Pitch inertia J_phi [kg.m2].
    #: Unsprung mass m_t of each corner [kg].
    unsprung_mass: Corners = positive("kg")  # noqa: RUF009
    #: Spring rate k of each corner [N/m].
    spring_rate: Corners = not_negative("N/m")  # noqa: RUF009
    #: Tire stiffness k_t of each corner [N/m].
    tire_stiffness: Corners = positive("N/m")  # noqa: RUF009
    #: Rate c of the linear damper of each corner [N.s/m]; only `with_damper` uses it.
    damping: Corners = not_negative("N.s/m", default=Corners.same(0.0))  # noqa: RUF009
    #: Roll moment per relative roll angle k_R^F [N.m/rad]; not in Table 5.1.
    front_anti_roll_rate: float = not_negative("N.m/rad", default=0.0)
    #: Roll moment per relative roll angle k_R^R [N.m/rad]; not in Table 5.1.
    rear_anti_roll_rate: float = not_negative("N.m/rad", default=0.0)
    #: Distance l_1 from the front axle to the nose, where the front ride height is defined [m].
    front_overhang: float = _either_sign(DEFAULT_OVERHANG)
    #: Distance l_2 from the rear axle to the spoiler, where the rear ride height is defined [m].
    rear_overhang: float = _either_sign(DEFAULT_OVERHANG)
    #: Distance of the driver's accelerometer ahead of the centre of gravity [m], or None.
    driver_ahead_of_cg: float | None = _either_sign(None)
    #: Distance of the driver's accelerometer left of the centreline [m], or None.
    driver_left_of_centreline: float | None = _either_sign(None)

    def __post_init__(self) -> None:
        _check_ranges(self)
        if (self.driver_ahead_of_cg is None) != (self.driver_left_of_centreline is None):
            raise ParameterError(
                "the driver's position has only one coordinate; give both driver_ahead_of_cg and "
                "driver_left_of_centreline, or neither"
            )

    @property
    def wheelbase(self) -> float:
        """Wheelbase l = a + b [m]."""
        return self.cg_to_front_axle + self.cg_to_rear_axle

    @property
    def corner_heights(self) -> Array:
        """T (4, 3) of Eq 5.1: chassis heights at the corners from heave, roll and pitch."""
        half = self.track_width / 2.0
        a, b = self.cg_to_front_axle, self.cg_to_rear_axle
        return np.array([[1.0, half, -a], [1.0, -half, -a], [1.0, half, b], [1.0, -half, b]])

    def coupled(self) -> StateSpace:
        """Return the car for coupling to shocks, without its own dampers (Eq 5.19 with C_s = 0)."""
        return self._state_space(Corners.same(0.0), "seven_dof")

    def with_damper(self) -> StateSpace:
        """Return the car with its linear dampers (Eq 5.19), for frequency responses and modes."""
        return self._state_space(self.damping, "seven_dof_with_damper")

    def _state_space(self, damping: Corners, name: str) -> StateSpace:
        mass = np.array([self.sprung_mass, self.roll_inertia, self.pitch_inertia, *self.unsprung_mass])
        strut = np.hstack([-self.corner_heights, np.eye(4)])  # compression of the suspension, z_2 - T Phi = S Z
        L = np.zeros((7, len(_INPUTS)))  # Eq 5.17
        L[_WHEELS, _ROAD] = np.diag(self.tire_stiffness)
        L[_CHASSIS, _EXTERNAL] = np.eye(3)
        L[:, _FORCE] = -strut.T
        A, B = state_matrices(mass, _branch(strut, damping), self._stiffness(strut), L)
        return self._outputs(strut, Outputs(A, B)).model(_INPUTS, name)

    def _stiffness(self, strut: Array) -> Array:
        """Return K of Eq 5.18: springs, tires and anti-roll bars."""
        K = _branch(strut, self.spring_rate)
        K[_WHEELS, _WHEELS] += np.diag(self.tire_stiffness)
        K1 = self._anti_roll_forces()
        return np.asarray(K + np.vstack([-self.corner_heights.T @ K1, K1]))

    def _anti_roll_forces(self) -> Array:
        """Return K_1 (4, 7) of Eq 5.13: suspension forces of the anti-roll bars from Z."""
        t = self.track_width
        K1 = np.zeros((4, 7))
        for left, rate in ((0, self.front_anti_roll_rate), (2, self.rear_anti_roll_rate)):
            right = np.zeros(7)
            right[[1, 3 + left, 4 + left]] = rate / t, -rate / t**2, rate / t**2
            K1[left], K1[left + 1] = -right, right
        return K1

    def _outputs(self, strut: Array, outputs: Outputs) -> Outputs:
        """Add the outputs; Eq 5.20 is missing in print, so they are derived from the coordinates."""
        chassis, wheels = np.hstack([self.corner_heights, np.zeros((4, 4))]), np.eye(7)[_WHEELS]
        tire, road = np.diag(self.tire_stiffness), np.eye(len(_INPUTS))[_ROAD]
        outputs.add_velocity(_at_corners("velocity"), strut)
        outputs.add_position(_at_corners("displacement"), "m", strut)
        outputs.add_position(_at_corners("tire_force"), "N", -tire @ wheels, tire @ road)
        outputs.add_position(_at_corners("spring_force"), "N", np.diag(self.spring_rate) @ strut)
        outputs.add_acceleration(_at_corners("hub_acceleration"), wheels)
        outputs.add_acceleration(_at_corners("chassis_acceleration"), chassis)
        self._add_ride_heights(outputs)
        outputs.add_position(["heave"], "m", np.eye(7)[0:1])
        outputs.add_position(["roll", "pitch"], "rad", np.eye(7)[1:3])
        outputs.add_position(_at_corners("wheel_position"), "m", wheels)
        outputs.add_position(_at_corners("chassis_position"), "m", chassis)
        if self.driver_ahead_of_cg is not None and self.driver_left_of_centreline is not None:
            seat = _chassis_point(self.driver_ahead_of_cg, self.driver_left_of_centreline)
            outputs.add_acceleration(["driver.acceleration"], seat)
        return outputs

    def _add_ride_heights(self, outputs: Outputs) -> None:
        """Add the heights of nose and spoiler above the plane through the wheelloaders."""
        front, rear = self.front_overhang, self.rear_overhang
        ends = {
            "front.ride_height": (self.cg_to_front_axle + front, -front),
            "rear.ride_height": (-self.cg_to_rear_axle - rear, self.wheelbase + rear),
        }
        for name, (ahead_of_cg, behind_front_axle) in ends.items():
            share = behind_front_axle / self.wheelbase  # weight of the rear road height at this point
            road = np.zeros((1, len(_INPUTS)))
            road[0, _ROAD] = Corners.axles((1.0 - share) / 2.0, share / 2.0)
            outputs.add_position([name], "m", _chassis_point(ahead_of_cg, 0.0), -road)


Parameters = QuarterCar | SevenDof


def _branch(strut: Array, rate: Corners) -> Array:
    """Return `S^T diag(rate) S`, the terms of Eq 5.18 for springs or dampers between chassis and wheels."""
    return np.asarray(strut.T @ (np.array(rate)[:, None] * strut))


def _at_corners(quantity: str) -> list[str]:
    return [f"{corner}.{quantity}" for corner in CORNERS]


def _chassis_point(ahead: float, left: float) -> Array:
    """Return the row (1, 7) that gives the height of a point of the chassis: `z + left theta - ahead phi`."""
    return np.array([[1.0, left, -ahead, 0.0, 0.0, 0.0, 0.0]])


# ==== Plausibility: figures that every car has in a known range, whatever its class ==================================


class Usual(NamedTuple):
    """Usual range of a figure, in its unit."""

    low: float
    high: float
    unit: str
    gross: float = 1.5  #: Factor beyond the range from which a figure is that of no car.


#: Usual ranges, from karts (Lot and Dal Bianco 2016: tires of 61 to 65 N/mm, wheelbase 1.045 m) to sedans and
#: high-downforce cars. Ride frequencies of the springs alone are 0.5 to 1.5 Hz in passenger cars, 1.5 to 2 Hz in sedan
#: race cars and 3 to 5 Hz and more with high downforce (Giaraffa, OptimumG, Springs and Dampers, part 1); here the tire
#: is in series. The other ranges are our own, with a margin about the cars of tests/vehicle/test_plausibility.py.
USUAL = {
    "ride frequency": Usual(0.5, 8.0, "Hz"),
    "wheel-hop frequency": Usual(6.0, 32.0, "Hz"),
    "damping ratio": Usual(0.03, 2.0, "1", inf),  # for modes only: coupled cars have the damping of their shocks
    "spring over tire stiffness": Usual(0.03, 2.5, "1"),
    "tire stiffness": Usual(50.0, 600.0, "N/mm"),
    "sprung mass": Usual(20.0, 700.0, "kg"),
    "unsprung mass": Usual(2.5, 90.0, "kg"),
    "wheelbase": Usual(0.9, 4.2, "m"),
    "wheelbase over track": Usual(0.8, 2.6, "1"),
    "front share of the sprung mass": Usual(30.0, 70.0, "%"),
    "radius of gyration in roll over track": Usual(0.2, 0.6, "1"),
    "radius of gyration in pitch over wheelbase": Usual(0.2, 0.6, "1"),
}


class Mistake(NamedTuple):
    """Numbers in one unit that were written with another."""

    parameters: tuple[str, ...]  #: Names of the parameters.
    meant: str  #: Unit of the numbers.
    typed: str  #: Unit that was written.

    @property
    def factor(self) -> float:
        """Factor that corrects the parameters."""
        return float(convert(1.0, self.meant, self.typed))


_SPRINGS, _TIRES = ("spring_rate", "suspension_stiffness"), ("tire_stiffness",)
_PAIRS = (
    *((names, "lbf/in", "N/mm") for names in (_TIRES, _SPRINGS, _SPRINGS + _TIRES)),
    (("sprung_mass", "unsprung_mass"), "lbm", "kg"),
    (("track_width", "cg_to_front_axle", "cg_to_rear_axle"), "in", "cm"),
    (("damping",), "lbf.s/in", "N.s/m"),
    (("damping",), "lbf.s/in", "N.s/mm"),
    (("roll_inertia", "pitch_inertia"), "lbm.in2", "kg.m2"),
)
#: Mistakes to try, each in both directions; of those that explain equally many figures, the first is named.
MISTAKES = tuple(chain.from_iterable((Mistake(n, a, b), Mistake(n, b, a)) for n, a, b in _PAIRS))


@dataclass(frozen=True, slots=True)
class Doubt:
    """Figures outside their usual range that have one cause."""

    summary: str  #: The figures with their usual ranges.
    remedy: str  #: What to do.
    is_gross: bool  #: Whether a figure is that of no car.


class _Figure(NamedTuple):
    """A figure of a car at a corner (or ""), in the unit of its range."""

    name: str
    place: str
    value: float

    @property
    def excess(self) -> float:
        """Factor beyond the usual range."""
        low, high, *_ = USUAL[self.name]
        return max(low / self.value, self.value / high)

    def __str__(self) -> str:
        low, high, unit, _ = USUAL[self.name]
        shown = "" if unit == "1" else f" {unit}"
        return f"{self.place} {self.name} {_number(self.value)}{shown} (usual: {low:g} to {high:g}{shown})".lstrip()


def _number(value: float) -> str:
    return f"{value:.3g}" if value < 999.5 else f"{value:.0f}"


def doubts(parameters: Parameters) -> tuple[Doubt, ...]:
    """Return what is implausible in a vehicle's parameters; of each figure, the corner farthest from its range.

    Figures that one mistake of units explains are one doubt, whose remedy names the mistake.
    """
    outside = _outside(parameters)
    tried = {mistake: {figure.name for figure in _outside(_corrected(parameters, mistake))}
             for mistake in MISTAKES if not _is_of_one_side(parameters, mistake)}  # fmt: skip
    sound = [mistake for mistake, left in tried.items() if left < {figure.name for figure in outside}]
    cause = min(sound, key=lambda mistake: len(tried[mistake]), default=None)
    explained = [figure for figure in outside if cause and figure.name not in tried[cause]]
    result = [_doubt(explained, _remedy(parameters, cause))] if cause else []
    alone = "check the value and its unit: rates are wheel rates (docs/reference/vehicle_file.md)"
    return (*result, *(_doubt([figure], alone) for figure in outside if figure not in explained))


def _doubt(figures: list[_Figure], remedy: str) -> Doubt:
    return Doubt(", ".join(map(str, figures)), remedy, any(f.excess > USUAL[f.name].gross for f in figures))


def _remedy(parameters: Parameters, cause: Mistake) -> str:
    names = [name for name in cause.parameters if hasattr(parameters, name)]
    value, unit = getattr(parameters, names[0]), type(parameters).__dataclass_fields__[names[0]].metadata["unit"]
    number = convert(value[0] if isinstance(value, Corners) else value, unit, cause.typed)
    right = convert(number, cause.meant, cause.typed)
    return (
        f"correct the unit of {' and '.join(names)}, which look{'s' * (len(names) == 1)} like {cause.meant} typed as "
        f"{cause.typed}: {_number(number)} {cause.meant} = {_number(right)} {cause.typed}"
    )


def _is_of_one_side(parameters: Parameters, mistake: Mistake) -> bool:
    """Return whether left and right differ by more than a factor of 2: a unit is that of both sides."""
    values = [getattr(parameters, name, None) for name in mistake.parameters]
    pairs = [pair for v in values if isinstance(v, Corners) for pair in ((v.lf, v.rf), (v.lr, v.rr))]
    return any(max(pair) > 2.0 * min(pair) for pair in pairs)


def scaled(parameters: Parameters, name: str, factor: float) -> Parameters:
    """Return parameters of which one is multiplied by a factor, at all corners."""
    value = getattr(parameters, name)
    new = Corners(*(factor * part for part in value)) if isinstance(value, Corners) else factor * value
    changed: dict[str, Any] = {name: new}
    return replace(parameters, **changed)


def _corrected(parameters: Parameters, mistake: Mistake) -> Parameters:
    for name in mistake.parameters:
        if hasattr(parameters, name):
            parameters = scaled(parameters, name, mistake.factor)
    return parameters


def _outside(parameters: Parameters) -> list[_Figure]:
    """Return the figures outside their usual ranges, in the order of the ranges."""
    worst: dict[str, _Figure] = {}
    for figure in _figures(parameters):
        if figure.excess > (worst[figure.name].excess if figure.name in worst else 1.0):
            worst[figure.name] = figure
    return [worst[name] for name in USUAL if name in worst]


def _figures(parameters: Parameters) -> Iterator[_Figure]:
    """Yield all figures of a vehicle; damping of 0 is not stated, and a spring of 0 has no frequency."""
    for place, sprung, unsprung, spring, tire, damping in _corners(parameters):
        yield _Figure("sprung mass", place, sprung)
        yield _Figure("unsprung mass", place, unsprung)
        yield _Figure("tire stiffness", place, convert(tire, "N/m", "N/mm"))
        yield _Figure("wheel-hop frequency", place, sqrt((spring + tire) / unsprung) / (2.0 * pi))
        if spring:
            yield _Figure("ride frequency", place, sqrt(spring * tire / (spring + tire) / sprung) / (2.0 * pi))
            yield _Figure("spring over tire stiffness", place, spring / tire)
        if spring and damping:
            yield _Figure("damping ratio", place, damping / (2.0 * sqrt(spring * sprung)))
    if isinstance(parameters, SevenDof):
        base, mass = parameters.wheelbase, parameters.sprung_mass
        yield _Figure("wheelbase", "", base)
        yield _Figure("wheelbase over track", "", base / parameters.track_width)
        yield _Figure("front share of the sprung mass", "", 100.0 * parameters.cg_to_rear_axle / base)
        roll, pitch = (sqrt(inertia / mass) for inertia in (parameters.roll_inertia, parameters.pitch_inertia))
        yield _Figure("radius of gyration in roll over track", "", roll / parameters.track_width)
        yield _Figure("radius of gyration in pitch over wheelbase", "", pitch / base)


def _corners(parameters: Parameters) -> list[tuple[str, float, float, float, float, float]]:
    """Return place, sprung mass, unsprung mass, spring rate, tire stiffness and damping of each corner."""
    p = parameters
    if isinstance(p, QuarterCar):
        return [("", p.sprung_mass, p.unsprung_mass, p.suspension_stiffness, p.tire_stiffness, p.damping)]
    front = p.cg_to_rear_axle / p.wheelbase
    sprung = [0.5 * p.sprung_mass * share for share in Corners.axles(front, 1.0 - front)]
    return list(zip(CORNERS, sprung, p.unsprung_mass, p.spring_rate, p.tire_stiffness, p.damping, strict=True))
