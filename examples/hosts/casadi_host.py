"""CasADi as the host: shock FMUs by model exchange in symbolic models, whose Jacobians come from the FMUs.

    python examples/hosts/casadi_host.py [--steps 8 4 2 1] [--seconds 10]

Needs casadi. `DaeBuilder` makes a CasADi function of an FMU: derivatives and outputs of states and inputs, with
derivatives of any order of call (optimization, implicit integrators). Pitfalls (CasADi 3.8):

- DaeBuilder imports model exchange only, and takes the folder of an unpacked FMU as a string. The folder must exist as
  long as the functions do.
- The host integrates the states of the shock: an explicit method needs a step below 2.8 time constants of the shock
  (4.1 ms here). Use an implicit one (`collocation`, `cvodes`), whose Newton iterations take the FMU's Jacobian.
- Start values are the attributes of the FMU's description. They are for inputs of zero: a start in equilibrium under
  other inputs is up to the host (`at_rest`).
- The outputs of car.fmu are one vector: call it once without forces for the velocities, then with the forces. It is no
  algebraic loop, because velocities do not depend on forces.
- A call that the FMU discards costs a printed line, and CasADi goes on with what it has: check the states.
- A forward derivative in a direction of zeros is that of the direction before. Such directions arise wherever a
  function is called with stored zeros, so Jacobians of a model around the FMU are wrong, and Newton's method fails.
  With the options BY_JACOBIAN they are right to 1e-8.
"""

from functools import partial
from tempfile import TemporaryDirectory

import casadi as ca
import fmpy
import numpy as np
import reference
from reference import Case, Motion

from eightpost.corners import CORNERS
from eightpost.vehicle import read_vehicle

CAR = reference.car()
#: A run with larger states has diverged.
LARGEST = 1e9

#: Derivatives of calls are products with the Jacobian (see the docstring).
BY_JACOBIAN = {"enable_forward": False, "enable_reverse": False}


def function_of(fmu, folder) -> tuple[ca.DaeBuilder, ca.Function]:
    """Return an FMU as a builder and as a function (states, inputs) -> (derivatives, outputs)."""
    name = fmu.stem
    dae = ca.DaeBuilder(name, str(fmpy.extract(str(fmu), f"{folder}/{name}")))
    return dae, dae.create(name, ["x", "u"], ["ode", "y"], BY_JACOBIAN)


def road_table(seconds) -> ca.Function:
    """Return the road and the loads (7,) as a function of time."""
    times = np.arange(round(seconds / reference.GRID) + 20) * reference.GRID
    rows = np.array([reference.track()(t) for t in times.tolist()])
    return ca.interpolant("road", "linear", [times.tolist()], rows.ravel())


def own_car(shock, state, road):
    """Return the derivatives of a car in CasADi's symbols with four shocks: state (q, q', lagged forces)."""
    q, speed, lagged = state[:7], state[7:14], state[14:]
    rates, force = shock.map(4)(lagged.T, ca.horzcat(CAR.S @ speed, CAR.S @ q).T)
    load = ca.vertcat(road[4:], CAR.tire_stiffness * road[:4])
    return ca.vertcat(speed, (load - CAR.K @ q - CAR.S.T @ force.T) / np.diag(CAR.M), rates.T)


def symbolic(case: Case, method: str) -> Motion:
    """Integrate the car in symbols with shock FMUs; `method` is a plugin of CasADi's `integrator`."""
    with TemporaryDirectory() as folder:
        _, shock = function_of(case.shock, folder)
        start = np.concatenate([CAR.equilibrium(), np.zeros(11)])
        rows = integrate(case, method, partial(own_car, shock), start)
    return reference.motion(CAR, np.arange(len(rows)) * case.step, rows)


def integrate(case: Case, method, derivatives, start):
    """Return the states (K, n) at each step: one finite element of `method` for each."""
    state, began, t = ca.MX.sym("x", len(start)), ca.MX.sym("began"), ca.MX.sym("t")
    ode = derivatives(state, road_table(case.seconds)(began + t))
    options = {"number_of_finite_elements": 1}
    if method == "collocation":
        options |= {"rootfinder_options": {"abstol": 1e-9, "abstolStep": 1e-9}}
    problem = {"x": state, "p": began, "t": t, "ode": ode}
    step = ca.integrator("step", method, problem, 0.0, case.step, options)
    rows = [start]
    for k in range(case.count):
        rows.append(np.array(step(x0=rows[-1], p=k * case.step)["xf"]).ravel())
        if not np.abs(rows[-1]).max() < LARGEST:
            raise ArithmeticError(f"CasADi: the run diverged at {k * case.step:g} s")
    return np.array(rows)


def car_fmu(case: Case, method: str) -> Motion:
    """Integrate car.fmu with four shock FMUs."""
    with TemporaryDirectory() as folder:
        _, shock = function_of(case.shock, folder)
        dae, car = function_of(case.car_fmu, folder)
        count = car.size1_in(0)
        places = [[dae.y().index(f"{c}.{n}") for c in CORNERS] for n in ("velocity", "displacement", "tire_force")]

        def whole(state, road):
            _, free = car(state[:count], ca.vertcat(ca.DM.zeros(4), road))
            rates, force = shock.map(4)(state[count:].T, ca.horzcat(free[places[0]], free[places[1]]).T)
            return ca.vertcat(car(state[:count], ca.vertcat(force.T, road))[0], rates.T)

        start = np.concatenate([at_rest(car), np.zeros(4)])
        rows = integrate(case, method, whole, start)
        times = np.arange(len(rows)) * case.step
        roads = np.array([[0.0] * 4 + reference.track()(t).tolist() for t in times.tolist()])
        seen = np.array(car.map(len(rows))(rows[:, :count].T, roads.T)[1])
    static = read_vehicle(reference.CAR).static
    still = np.array([[static[f"{corner}.tire_force"]] for corner in CORNERS])
    return Motion(times, seen[places[0]], seen[places[2]] - still)


def at_rest(car):
    """Return the states of car.fmu in equilibrium under the first road, by one step of Newton.

    The deflections of the bristles of friction, which this car does not have, are among the states and stay at zero.
    """
    inputs = np.concatenate([np.zeros(4), reference.track()(0.0)])
    slope = car.factory("slope", ["x", "u"], ["jac:ode:x"])
    slopes, rates = np.array(slope(0.0, inputs)), np.array(car(0.0, inputs)[0]).ravel()
    return -np.linalg.lstsq(slopes, rates)[0]


HOST = "CasADi"
LOOPS = {
    "ME, RK4": lambda case: symbolic(case, "rk"),
    "ME, collocation": lambda case: symbolic(case, "collocation"),
    "ME, FMUs only, RK4": lambda case: car_fmu(case, "rk"),
}

if __name__ == "__main__":
    reference.main(HOST, LOOPS, package="casadi")
