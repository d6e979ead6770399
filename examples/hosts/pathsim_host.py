"""PathSim as the host: its own car with shock FMUs, car.fmu with PathSim's own dampers, or FMUs only; RK4.

    python examples/hosts/pathsim_host.py [--steps 8 4 2 1] [--seconds 10]

Needs pathsim and pathsim-fmi. `update` of a block is called in every stage, `sample` after every accepted step: loop C.
Pitfalls (PathSim 0.27, pathsim-fmi 0.1):

- PathSim decides from the slope of the outputs at the start whether they depend on the inputs, and ignores the FMU's
  model structure. The slope of an LPNL2 shock is zero at rest, so its force would arrive one evaluation late: at 2 ms
  an error of 0.49 % instead of 0.01 %, without a warning. Model-exchange blocks state `__len__` here.
- RK4 integrates the states of the shock too, so with model exchange a step must be below 2.8 time constants of the
  shock (4.1 ms here). The shock of loop C is exact at any step.
- Co-simulation blocks step one after the other, and each gets the new outputs of those before it: one loop A in either
  order. Their outputs are recorded at the start of the step, but belong to its end.
- Inputs of co-simulation blocks are held. The road of half a step later has half the error; a tire force is still
  that of the held road.
- car.fmu passes forces to accelerations, so PathSim iterates on an algebraic loop that does not exist: twice the cost.
- Ports have the names of the FMU's variables, but a connection of several ports needs a list of names.
- Without `start_values` the car starts at another load. Blocks for FMUs in pathsim itself are deprecated.
"""

import numpy as np
import reference
from fmpy.fmi1 import FMICallException
from pathsim import Connection, Simulation
from pathsim.blocks import DynamicalFunction, DynamicalSystem, Scope
from pathsim.blocks._block import Block
from pathsim.solvers import RK4
from pathsim_fmi import CoSimulationFMU, ModelExchangeFMU
from reference import Case, Motion

from cosim import ForceLaw
from eightpost.corners import CORNERS
from eightpost.shock import read_shock
from eightpost.vehicle import read_vehicle

CAR = reference.car()
DRIVEN = (*(f"{corner}.road" for corner in CORNERS), "heave_force", "roll_moment", "pitch_moment")


class Shocks(Block):
    """Shock FMUs as a force law: inputs are four velocities and four displacements, outputs four forces."""

    def __init__(self, law):
        super().__init__()
        self.law = law
        law.start(0.0, np.zeros(4), CAR.S @ CAR.equilibrium())

    def update(self, t):
        """Evaluate the force in a stage."""
        motion = self.inputs.to_array()
        self.outputs.update_from_array(self.law.force(t, motion[:4], motion[4:]))

    def sample(self, t, dt):
        """Accept the end of a step."""
        motion = self.inputs.to_array()
        self.law.accept(t, motion[:4], motion[4:])


class Exchange(ModelExchangeFMU):
    """A block for model exchange whose outputs depend on its inputs."""

    def __len__(self):
        """Return the length of the algebraic path: PathSim would derive 0 from the slope at rest."""
        return 1


def block_of(path, kind, step, **start):
    """Return a block for an FMU: `kind` is CoSimulationFMU or Exchange."""
    options = {"dt": step} if kind is CoSimulationFMU else {}
    return kind(str(path), start_values=start, **options)


class Damper(DynamicalSystem):
    """PathSim's own damper, the law LPNL2: force = F_s + alpha (F_lag - F_s), tau F_lag' = F_s(v) - F_lag."""

    __len__ = Exchange.__len__

    def __init__(self):
        law = read_shock(reference.SHOCK).law

        def rate(lagged, motion, _):
            return (law.static_force(motion[0]) - lagged) / law.time_constant

        def force(lagged, motion, _):
            static = law.static_force(motion[0])
            return static + law.lag_weight(static) * (lagged - static)

        super().__init__(rate, force, initial_value=np.zeros(1))


def own_car(case: Case, kind) -> Motion:
    """Connect a car in PathSim with shocks: FMUs of a kind, or one block of four force laws."""

    def slope(state, force, time):
        return np.concatenate([state[7:], CAR.acceleration(time, state[:7], state[7:], force)])

    def seen(state, _, time):
        return np.concatenate([CAR.S @ state[7:], CAR.S @ state[:7], CAR.tire_force(time, state[:7])])

    car = DynamicalSystem(slope, seen, initial_value=np.concatenate([CAR.equilibrium(), np.zeros(7)]))
    if kind is ForceLaw:
        with ForceLaw(case.shock, corners=CORNERS) as law:
            shocks = Shocks(law)
            wires = [Connection(car[0:8], shocks[0:8]), Connection(shocks[0:4], car[0:4])]
            return simulate(case, [car, shocks], wires, car[0:4], car[8:12])
    shocks = [block_of(case.shock, kind, case.step) for _ in CORNERS]
    wires = [Connection(car[i, 4 + i], shocks[i]["velocity", "displacement"]) for i in range(4)]
    wires += [Connection(shocks[i]["force"], car[i]) for i in range(4)]
    return simulate(case, [car, *shocks], wires, car[0:4], car[8:12])


def car_fmu(case: Case, kind, dampers=None) -> Motion:
    """Connect car.fmu with shock FMUs of the same kind, or with PathSim's own dampers."""
    car = block_of(case.car_fmu, kind, case.step, **dict(zip(DRIVEN, reference.track()(0.0), strict=True)))
    ahead = 0.5 * case.step if kind is CoSimulationFMU else 0.0
    road = DynamicalFunction(lambda _, t: reference.track()(t + ahead))
    shocks = [dampers() if dampers else block_of(case.shock, kind, case.step) for _ in CORNERS]
    wires = [Connection(road[0:7], car[DRIVEN])]
    for corner, shock in zip(CORNERS, shocks, strict=True):
        ports = ["velocity"] if dampers else ["velocity", "displacement"]
        wires.append(Connection(car[[f"{corner}.{p}" for p in ports]], shock[0] if dampers else shock[ports]))
        wires.append(Connection(shock[0 if dampers else "force"], car[f"{corner}.force"]))
    seen = (car[[f"{corner}.{name}" for corner in CORNERS]] for name in ("velocity", "tire_force"))
    found = simulate(case, [road, car, *shocks], wires, *seen)
    static = read_vehicle(reference.CAR).static
    still = np.array([[static[f"{corner}.tire_force"]] for corner in CORNERS])
    late = case.step if kind is CoSimulationFMU else 0.0
    return Motion(found.time + late, found.velocity, found.tire_force - still)


def simulate(case: Case, blocks, wires, *seen) -> Motion:
    """Run, and return what the ports of shock velocities and tire forces had at each step."""
    scope = Scope()
    wires += [Connection(port, scope[4 * k : 4 * k + 4]) for k, port in enumerate(seen)]
    try:
        Simulation([*blocks, scope], wires, dt=case.step, Solver=RK4, log=False).run(case.seconds, adaptive=False)
    except FMICallException as refused:
        raise ArithmeticError(f"PathSim: {refused}") from refused
    time, rows = scope.read()
    return Motion(np.array(time), np.array(rows[:4]), np.array(rows[4:]))


HOST = "PathSim, RK4"
LOOPS = {
    "A": lambda case: own_car(case, CoSimulationFMU),
    "C": lambda case: own_car(case, ForceLaw),
    "ME": lambda case: own_car(case, Exchange),
    "A, FMUs only": lambda case: car_fmu(case, CoSimulationFMU),
    "ME, FMUs only": lambda case: car_fmu(case, Exchange),
    "A, car.fmu": lambda case: car_fmu(case, CoSimulationFMU, Damper),
    "ME, car.fmu": lambda case: car_fmu(case, Exchange, Damper),
}

if __name__ == "__main__":
    reference.main(HOST, LOOPS, package="pathsim")
