"""CommonRoad's multi-body car (29 states) as the host, with four shock FMUs: RK4, a slalom with braking on a flat road.

    python examples/hosts/commonroad_host.py [--steps 8 4 2 1] [--seconds 10]

Needs commonroad-vehicle-models. The car is the package's BMW 320i. Pitfalls (commonroad-vehicle-models 3.0):

- There is no damper hook: the model knows one damping coefficient per axle. They are zero here, and `with_forces` adds
  the forces of the shocks to the derivatives. It is exact, because the derivatives are linear in these forces.
- There is no road input: the four tires stand on a plane, so the driver alone moves the shocks.
- z is positive down. The model's `dz_SLF` is positive in extension, so the shock velocity is its negative.
- The function is not pure: it sets a negative wheel speed in the state that it is given to zero. Pass it a list.
- Below 0.1 m/s another model takes over: the errors hold for a car that drives.
- The slip of the wheels limits the step of explicit integrators: below 25 m/s, 8 ms is too large.
- The lateral force of a tire jumps where its camber changes sign, so the car alone, without any coupling, is of first
  order: 0.02 % at 1 ms.
- `init_mb` is not in equilibrium: the car settles in the first second, which does not count here.
"""

import math
from functools import cache

import numpy as np
import reference
from reference import Case, Motion, runge_kutta
from vehiclemodels.init_mb import init_mb
from vehiclemodels.parameters_vehicle2 import parameters_vehicle2
from vehiclemodels.vehicle_dynamics_mb import vehicle_dynamics_mb

from cosim import ExtrapolatedForce, ForceLaw, HeldForce
from eightpost.corners import CORNERS
from eightpost.shock import read_shock

PARAMETERS = parameters_vehicle2()
PARAMETERS.K_sdf = PARAMETERS.K_sdr = 0.0
SPEED = 40.0

#: For each axle: distance ahead of the center of mass, track width, roll inertia, mass, and the place of its roll angle
#: in the state, which is followed by roll rate, lateral speed, height and vertical speed.
P = PARAMETERS
AXLES = ((P.a, P.T_f, P.I_uf, P.m_uf, 13), (-P.b, P.T_r, P.I_ur, P.m_ur, 18))


def driver(time):
    """Return the rate of the steering angle [rad/s] and the acceleration that the driver wants [m/s2]."""
    slalom = 0.06 * math.cos(2.0 * math.pi * 0.8 * time) + 0.06 * math.cos(2.0 * math.pi * 2.5 * time)
    return [slalom, 1.5 * math.sin(2.0 * math.pi * 1.5 * time)]


def shock_motion(x):
    """Return shock velocities and displacements (4,), positive in compression."""
    velocity, displacement = [], []
    for ahead, width, _, _, at in AXLES:
        for half in (0.5 * width, -0.5 * width):
            velocity.append(x[12] - x[at + 4] - ahead * x[9] - half * (x[7] - x[at + 1]))
            displacement.append(x[11] - x[at + 3] - ahead * x[8] - half * (x[6] - x[at]))
    return np.array(velocity), np.array(displacement)


def tire_force(x):
    """Return the vertical forces of the tires (4,) [N], as the model has them."""
    heights = [
        x[at + 3] + P.R_w * (math.cos(x[at]) - 1.0) - half * math.sin(x[at])
        for _, width, _, _, at in AXLES
        for half in (0.5 * width, -0.5 * width)
    ]
    return P.K_zt * np.array(heights)


def with_forces(x, rates, force):
    """Return the model's derivatives with the forces of the shocks (4,) at the places of its own dampers."""
    rates, up, across = np.array(rates), math.cos(x[6]), math.sin(x[6])
    for (ahead, width, inertia, mass, at), (left, right) in zip(AXLES, (force[:2], force[2:]), strict=True):
        both, roll = left + right, 0.5 * width * (left - right)
        rates[5] += P.I_xz_s / P.I_Phi_s * roll / (P.I_z - P.I_xz_s**2 / P.I_Phi_s)
        rates[7] += roll / (P.I_Phi_s - P.I_xz_s**2 / P.I_z)
        rates[9] += ahead * both / P.I_y_s
        rates[[10, 12]] += np.array([both * across, -both * up]) / P.m_s
        rates[at + 1] -= roll / inertia
        rates[[at + 2, at + 4]] += np.array([-both * across, both * up]) / mass
    return rates


def slope(time, x, force):
    """Return the derivatives of the 29 states."""
    return with_forces(x, vehicle_dynamics_mb(x.tolist(), driver(time), P), force)


def start():
    """Return the state (29,) at the start: straight ahead."""
    return np.array(init_mb([0.0, 0.0, 0.0, SPEED, 0.0, 0.0, 0.0], P), dtype=float)


@cache
def exact(seconds: float, step: float = 0.25e-3) -> Motion:
    """Integrate car and shocks as one system: the laws' own equations, with the lagged forces as states 29 to 32."""
    law, every = read_shock(reference.SHOCK).law, round(reference.GRID / step)

    def whole(time, state):
        static = np.array([law.static_force(v) for v in shock_motion(state)[0].tolist()])
        weight = np.array([law.lag_weight(one) for one in static.tolist()])
        rates = slope(time, state[:29], static + weight * (state[29:] - static))
        return np.concatenate([rates, (static - state[29:]) / law.time_constant])

    rows = [np.concatenate([start(), [law.static_force(v) for v in shock_motion(start())[0].tolist()]])]
    for k in range(round(seconds / step)):
        rows.append(runge_kutta(whole, k * step, rows[-1], step))
    return motion(np.array(rows[::every]), reference.GRID)


def motion(rows, step, truth=None) -> Motion:
    """Return the motion from states (K, 29 or more)."""
    velocity = np.array([shock_motion(x)[0] for x in rows])
    tires = np.array([tire_force(x) for x in rows])
    return Motion(np.arange(len(rows)) * step, velocity.T, tires.T, exact=truth)


def held(case: Case, kind) -> Motion:
    """Hold one force over every step (loops A and B)."""
    rows, h = [start()], case.step
    with kind(case.shock, corners=CORNERS) as loop:
        loop.start(0.0, *shock_motion(rows[0]))
        for k in range(case.count):
            force = loop.step(k * h, h, *shock_motion(rows[-1]))
            rows.append(runge_kutta(lambda t, x, f=force: slope(t, x, f), k * h, rows[-1], h))
    return motion(rows, h, exact(case.seconds))


def evaluated(case: Case) -> Motion:
    """Ask for the force in every stage, and accept the end of every step (loop C)."""
    rows, h = [start()], case.step
    with ForceLaw(case.shock, corners=CORNERS) as law:
        law.start(0.0, *shock_motion(rows[0]))
        for k in range(case.count):
            rows.append(runge_kutta(lambda t, x: slope(t, x, law.force(t, *shock_motion(x))), k * h, rows[-1], h))
            law.accept((k + 1) * h, *shock_motion(rows[-1]))
    return motion(rows, h, exact(case.seconds))


HOST = "CommonRoad, RK4"
LOOPS = {
    "A": lambda case: held(case, HeldForce),
    "B": lambda case: held(case, ExtrapolatedForce),
    "C": evaluated,
}

if __name__ == "__main__":
    reference.main(HOST, LOOPS, package="commonroad-vehicle-models")
