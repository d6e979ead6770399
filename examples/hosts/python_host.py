"""A Runge-Kutta integrator of fourth order in Python as the host, with cosim.ForceLaw and the loops A and B.

python examples/hosts/python_host.py [--steps 8 4 2 1] [--seconds 10]
"""

import numpy as np
import reference
from reference import Case, Motion, runge_kutta

from cosim import ExtrapolatedForce, ForceLaw, HeldForce
from eightpost.corners import CORNERS

CAR = reference.car()


def shock_motion(state):
    """Return shock velocities and displacements (4,) of a state (q, q')."""
    return CAR.S @ state[7:], CAR.S @ state[:7]


def slope(time, state, force):
    """Return (q', q'') of the car."""
    return np.concatenate([state[7:], CAR.acceleration(time, state[:7], state[7:], force)])


def with_force_law(case: Case) -> Motion:
    """Ask for the force in every stage, and accept the end of every step (loop C)."""
    rows = [np.concatenate([CAR.equilibrium(), np.zeros(7)])]
    h = case.step
    with ForceLaw(case.shock, corners=CORNERS) as law:
        law.start(0.0, *shock_motion(rows[0]))
        for k in range(case.count):
            rows.append(runge_kutta(lambda t, y: slope(t, y, law.force(t, *shock_motion(y))), k * h, rows[-1], h))
            law.accept((k + 1) * h, *shock_motion(rows[-1]))
    return reference.motion(CAR, np.arange(len(rows)) * case.step, np.array(rows))


def with_held_force(case: Case, kind) -> Motion:
    """Hold one force over every step (loops A and B)."""
    rows = [np.concatenate([CAR.equilibrium(), np.zeros(7)])]
    with kind(case.shock, corners=CORNERS) as loop:
        loop.start(0.0, *shock_motion(rows[0]))
        for k in range(case.count):
            force = loop.step(k * case.step, case.step, *shock_motion(rows[-1]))
            rows.append(runge_kutta(lambda t, y, f=force: slope(t, y, f), k * case.step, rows[-1], case.step))
    return reference.motion(CAR, np.arange(len(rows)) * case.step, np.array(rows))


HOST = "Python, RK4"
LOOPS = {
    "A": lambda case: with_held_force(case, HeldForce),
    "B": lambda case: with_held_force(case, ExtrapolatedForce),
    "C": with_force_law,
}

if __name__ == "__main__":
    reference.main(HOST, LOOPS)
