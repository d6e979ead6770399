"""Exudyn as the host: the car is an object with mass and stiffness matrices, its forces are a user function.

    python examples/hosts/exudyn_host.py [--steps 8 4 2 1] [--seconds 10]

The implicit integrator (generalized alpha, the default) calls the user function in every Newton iteration and for its
numerical Jacobian, always with the end of the step as the time. Loop C fits: trial points have no side effects.

Pitfalls:

- A user function that steps an FMU by doStep without rollback advances it several times in every step.
- Implicit integrators weigh the forces at both ends of a step, so a held force acts half a step later than in an
  explicit one. Loops A and B lose accuracy by that: B must extrapolate by a whole step (2 F - F_old) to be of second
  order.
- The pre-step user function gets the time of the end of the step, but the state of its start.
- The post-step user function must return True, or the run stops. It is also called once before the first step.
- Newton's method may cycle at a kink of the shock's curve (once in 1000 steps of 2 ms). Exudyn then halves the step
  for a while, without notice (adaptiveStep). Loop C follows any step; loops with a fixed step do not.
- The default spectral radius is 0.9, a numerical damping of less than a tenth of the error here.
"""

import exudyn as exu
import numpy as np
import reference
from exudyn.itemInterface import NodeGenericODE2, ObjectGenericODE2
from reference import Case, Motion

from cosim import ExtrapolatedForce, ForceLaw, HeldForce
from eightpost.corners import CORNERS

CAR = reference.car()
IMPLICIT, EXPLICIT = exu.DynamicSolverType.GeneralizedAlpha, exu.DynamicSolverType.RK44


def settings(case: Case):
    """Return settings for fixed steps without files."""
    made = exu.SimulationSettings()
    made.timeIntegration.numberOfSteps, made.timeIntegration.endTime = case.count, case.count * case.step
    made.timeIntegration.automaticStepSize = False
    made.timeIntegration.generalizedAlpha.computeInitialAccelerations = True
    made.solution.file.write = False
    return made


def simulate(case: Case, force, before, after, solver=IMPLICIT) -> Motion:
    """Simulate the car.

    Args:
        case: The run.
        force: Function of time, shock velocity and displacement (4,) that returns shock forces (4,).
        before: The same, called before every step with the time of its start.
        after: The same, called after every step.
        solver: Integrator.
    """
    system = exu.SystemContainer().AddSystem()
    start = CAR.equilibrium()
    node = system.AddNode(
        NodeGenericODE2(
            numberOfODE2Coordinates=7, referenceCoordinates=np.zeros(7), initialCoordinates=start,
            initialCoordinates_t=np.zeros(7),
        )
    )  # fmt: skip
    times, rows = [0.0], [np.concatenate([start, np.zeros(7)])]

    def forces(_, t, _item, q, speed):
        q, speed = np.array(q), np.array(speed)
        return CAR.load(t) - CAR.S.T @ force(t, CAR.S @ speed, CAR.S @ q)

    def pre_step(*_):
        before(times[-1], CAR.S @ rows[-1][7:], CAR.S @ rows[-1][:7])
        return True

    def post_step(_, t):
        if t == times[-1]:
            return True  # the call before the first step
        kinds = (exu.OutputVariableType.Coordinates, exu.OutputVariableType.Coordinates_t)
        rows.append(np.concatenate([system.GetNodeOutput(node, kind) for kind in kinds]))
        times.append(t)
        after(t, CAR.S @ rows[-1][7:], CAR.S @ rows[-1][:7])
        return True

    system.AddObject(
        ObjectGenericODE2(nodeNumbers=[node], massMatrix=CAR.M, stiffnessMatrix=CAR.K, forceUserFunction=forces)
    )
    system.SetPreStepUserFunction(pre_step)
    system.SetPostStepUserFunction(post_step)
    system.Assemble()
    if not system.SolveDynamic(settings(case), solverType=solver, showHints=False):
        raise ArithmeticError("Exudyn: the run failed")
    return reference.motion(CAR, np.array(times), np.array(rows))


def nothing(*_):
    """Do nothing before or after a step."""


def with_force_law(case: Case, solver=IMPLICIT) -> Motion:
    """Loop C: ask for the force in every evaluation, and accept the end of every step."""
    with ForceLaw(case.shock, corners=CORNERS) as law:
        law.start(0.0, np.zeros(4), CAR.S @ CAR.equilibrium())
        return simulate(case, lambda t, v, d: law.force(max(t, law.time), v, d), nothing, law.accept, solver)


def with_held_force(case: Case, kind=HeldForce, used=lambda now, _: now, solver=IMPLICIT) -> Motion:
    """Loops A, B and J: hold `used(force, last force)` over every step."""
    with kind(case.shock, corners=CORNERS) as loop:
        first = loop.start(0.0, np.zeros(4), CAR.S @ CAR.equilibrium())
        pair = [first, first]

        def before(time, velocity, displacement):
            pair[:] = loop.step(time, case.step, velocity, displacement), pair[0]

        return simulate(case, lambda *_: used(*pair), before, nothing, solver)


LOOPS = {
    "J": lambda case: with_held_force(case, used=lambda _, last: last),
    "A": with_held_force,
    "B": lambda case: with_held_force(case, ExtrapolatedForce),
    "B, to the end of the step": lambda case: with_held_force(
        case, ExtrapolatedForce, lambda now, last: 1.5 * now - 0.5 * last
    ),
    "C": with_force_law,
    "A, explicit RK44": lambda case: with_held_force(case, solver=EXPLICIT),
    "C, explicit RK44": lambda case: with_force_law(case, EXPLICIT),
}

if __name__ == "__main__":
    reference.main("Exudyn, generalized alpha", LOOPS, package="exudyn")
