"""The quarter car: one corner of a chassis and one wheel (dissertation section 4.1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from eightpost.vehicle.statespace import Channel, StateSpace
from eightpost.vehicle.structural import Outputs, check_ranges, not_negative, positive, state_matrices

INPUTS = (Channel("road", "m"), Channel("aero_force", "N"), Channel("force", "N"))


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
        """Check the ranges."""
        check_ranges(self)


def coupled(parameters: QuarterCar) -> StateSpace:
    """Return the quarter car for coupling to a shock, without its own damper (Eq 4.1 with c = 0)."""
    return _state_space(parameters, 0.0, "quarter_car")


def with_damper(parameters: QuarterCar) -> StateSpace:
    """Return the quarter car with its linear damper, for frequency responses and modes.

    The values of Table 4.1 give 3.039 Hz with 5.82 % and 18.452 Hz with 40.16 % damping. Table 4.2 prints
    3.04/6.10 and 18.44/42.19. These correspond to a damper of 17.5 lbf/(in/s) instead of the 16.67 of Table 4.1 (and,
    in the last digit, to masses computed with 386 in/s2 instead of the standard gravity).
    """
    return _state_space(parameters, parameters.damping, "quarter_car_with_damper")


def _state_space(parameters: QuarterCar, c: float, name: str) -> StateSpace:
    """Return Eq 4.2 and 4.6 as a state space: `M w'' + C w' + K w = L u`, w = (w_1, w_2), u = (y_R, F_A, F_S)."""
    m1, m2 = parameters.sprung_mass, parameters.unsprung_mass
    k, kt = parameters.suspension_stiffness, parameters.tire_stiffness
    A, B = state_matrices(
        np.array([m1, m2]),
        np.array([[c, -c], [-c, c]]),
        np.array([[k, -k], [-k, k + kt]]),
        np.array([[0.0, -1.0, 1.0], [kt, 0.0, -1.0]]),
    )
    chassis, wheel = np.array([[1.0, 0.0]]), np.array([[0.0, 1.0]])
    road = np.array([[1.0, 0.0, 0.0]])
    outputs = Outputs(A, B)
    outputs.add_velocity(["velocity"], "m/s", wheel - chassis)
    outputs.add_position(["displacement"], "m", wheel - chassis)
    outputs.add_position(["tire_force"], "N", -kt * wheel, kt * road)
    outputs.add_position(["spring_force"], "N", k * (wheel - chassis))
    outputs.add_position(["ride_height"], "m", chassis, -road)
    outputs.add_acceleration(["hub_acceleration"], "m/s2", wheel)
    outputs.add_acceleration(["chassis_acceleration"], "m/s2", chassis)
    outputs.add_position(["wheel_position"], "m", wheel)
    outputs.add_position(["chassis_position"], "m", chassis)
    return outputs.model(INPUTS, name)
