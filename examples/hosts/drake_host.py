"""Drake as the host: the car is a MultibodyPlant, springs and shocks are systems in its diagram.

    python examples/hosts/drake_host.py [--steps 8 4 2 1] [--seconds 10]

Loop C: an output port calculates the force at any trial point of the integrator, and a per-step event accepts the point
where the next step begins. The integrator may reject steps: the last loop has error control.

Pitfalls:

- An output port depends on all inputs of its system unless `prerequisites_of_calc` names what it needs. If the car is a
  LeafSystem whose velocity port does not name its state, Drake reports an algebraic loop that does not exist. The state
  port of MultibodyPlant is declared; here the declarations only state what is meant.
- A port's value is cached. The force law's accepted point lies outside of the context, which is harmless as long as
  the force at a point does not change when that point is accepted. Use one law per context.
- MultibodyPlant(time_step=0.0) is the continuous model. With a time step it is a discrete one with its own method of
  first order, and the simulator's integrator has no effect.
- A step is only an upper limit, unless set_fixed_step_mode(True). Held forces need a periodic event of the same period.
- The order of the plant's coordinates is its own: ask each joint for its position_start().
"""

import numpy as np
import reference
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import PrismaticJoint, RevoluteJoint, RotationalInertia, SpatialInertia, UnitInertia
from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from reference import Case, Motion

from cosim import ExtrapolatedForce, ForceLaw, HeldForce
from eightpost.corners import CORNERS

CAR = reference.car()


def inertia(mass, roll=1.0, pitch=1.0):
    """Return the inertia of a body about its center of gravity; that about z equals that about y."""
    own = RotationalInertia(roll, pitch, pitch)
    return SpatialInertia(mass, np.zeros(3), UnitInertia(*(own.get_moments() / mass)))


def plant_of_car():
    """Return the car as a continuous plant, and the order of its coordinates."""
    p, plant = CAR.parameters, MultibodyPlant(time_step=0.0)
    plant.mutable_gravity_field().set_gravity_vector(np.zeros(3))
    carriers = [plant.AddRigidBody(name, SpatialInertia.Zero()) for name in ("heave_carrier", "pitch_carrier")]
    body = plant.AddRigidBody("body", inertia(p.sprung_mass, p.roll_inertia, p.pitch_inertia))
    frames = [plant.world_frame(), *(one.body_frame() for one in (*carriers, body))]
    joints = [
        plant.AddJoint(PrismaticJoint("heave", frames[0], frames[1], [0, 0, 1])),
        plant.AddJoint(RevoluteJoint("roll", frames[2], frames[3], [1, 0, 0])),
        plant.AddJoint(RevoluteJoint("pitch", frames[1], frames[2], [0, 1, 0])),
    ]
    for corner, mass in zip(CORNERS, p.unsprung_mass, strict=True):
        wheel = plant.AddRigidBody(corner, inertia(mass))
        joints.append(plant.AddJoint(PrismaticJoint(f"wheel_{corner}", frames[0], wheel.body_frame(), [0, 0, 1])))
    plant.Finalize()
    return plant, [joint.position_start() for joint in joints]


class Suspension(LeafSystem):
    """Generalized forces of springs, tires, road and shocks, from the plant's state and the shock forces."""

    def __init__(self, order):
        super().__init__()
        self.state, self.shocks = self.DeclareVectorInputPort("state", 14), self.DeclareVectorInputPort("shocks", 4)
        self.order = order
        self.DeclareVectorOutputPort("forces", 7, self.calculate)

    def calculate(self, context, output):
        """Calculate the forces."""
        q = self.state.Eval(context)[self.order]
        total = CAR.load(context.get_time()) - CAR.K @ q - CAR.S.T @ self.shocks.Eval(context)
        values = np.empty(7)
        values[self.order] = total
        output.SetFromVector(values)


class Shocks(LeafSystem):
    """Shock forces (4,) from the plant's state."""

    def __init__(self, order):
        super().__init__()
        self.state, self.order = self.DeclareVectorInputPort("state", 14), np.array(order)

    def measure(self, context):
        """Return shock velocities and displacements (4,)."""
        state = self.state.Eval(context)
        return CAR.S @ state[self.order + 7], CAR.S @ state[self.order]


class ForceLawShocks(Shocks):
    """Loop C."""

    def __init__(self, order, law):
        super().__init__(order)
        self.law = law
        needed = {self.time_ticket(), self.input_port_ticket(self.state.get_index())}
        self.DeclareVectorOutputPort("forces", 4, self.calculate, prerequisites_of_calc=needed)
        self.DeclarePerStepPublishEvent(self.accept)

    def calculate(self, context, output):
        """Ask for the forces at a trial point."""
        output.SetFromVector(self.law.force(context.get_time(), *self.measure(context)))

    def accept(self, context):
        """Accept the point where the next step begins."""
        self.law.accept(context.get_time(), *self.measure(context))


class HeldShocks(Shocks):
    """Loops A and B, and J, which holds the force of the last step; the state is (force now, force before)."""

    def __init__(self, order, loop, step, late):
        super().__init__(order)
        self.loop, self.step, self.late = loop, step, late
        index = self.DeclareDiscreteState(8)
        self.DeclarePeriodicDiscreteUpdateEvent(step, 0.0, self.update)
        needed = {self.discrete_state_ticket(index)}
        self.DeclareVectorOutputPort("forces", 4, self.calculate, prerequisites_of_calc=needed)

    def update(self, context, values):
        """Store the forces for the next step."""
        before = context.get_discrete_state_vector().value()[:4]
        now = self.loop.step(context.get_time(), self.step, *self.measure(context))
        values.get_mutable_vector().SetFromVector(np.concatenate([now, before]))

    def calculate(self, context, output):
        """Output the forces in the state."""
        forces = context.get_discrete_state_vector().value()
        output.SetFromVector(forces[4:] if self.late else forces[:4])


def run(case: Case, scheme: str, make, accuracy: float | None = None) -> Motion:
    """Simulate the diagram with the shocks that `make(order)` returns."""
    builder, (plant, order) = DiagramBuilder(), plant_of_car()
    plant, suspension, shocks = (builder.AddSystem(one) for one in (plant, Suspension(order), make(order)))
    builder.Connect(plant.get_state_output_port(), suspension.state)
    builder.Connect(plant.get_state_output_port(), shocks.state)
    builder.Connect(shocks.get_output_port(), suspension.shocks)
    builder.Connect(suspension.get_output_port(), plant.get_applied_generalized_force_input_port())
    simulator = Simulator(builder.Build())
    integrator = ResetIntegratorFromFlags(simulator, scheme, case.step)
    integrator.set_fixed_step_mode(accuracy is None)
    if accuracy is not None:
        integrator.set_target_accuracy(accuracy)
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    start, places = np.empty(7), np.array([*order, *(7 + k for k in order)])
    start[order] = CAR.equilibrium()
    plant.SetPositions(context, start)
    simulator.Initialize()
    rows = []
    for k in range(case.count + 1):
        simulator.AdvanceTo(k * case.step)
        rows.append(plant.GetPositionsAndVelocities(context)[places])
    return reference.motion(CAR, np.arange(len(rows)) * case.step, np.array(rows))


def with_force_law(case: Case, accuracy: float | None = None) -> Motion:
    """Loop C, with fixed steps or with error control."""
    with ForceLaw(case.shock, corners=CORNERS) as law:
        law.start(0.0, np.zeros(4), CAR.S @ CAR.equilibrium())
        return run(case, "runge_kutta3", lambda order: ForceLawShocks(order, law), accuracy)


def with_held_force(case: Case, kind=HeldForce, late: bool = False) -> Motion:
    """Loops A and B, and J."""
    with kind(case.shock, corners=CORNERS) as loop:
        loop.start(0.0, np.zeros(4), CAR.S @ CAR.equilibrium())
        return run(case, "runge_kutta3", lambda order: HeldShocks(order, loop, case.step, late))


LOOPS = {
    "J": lambda case: with_held_force(case, late=True),
    "A": with_held_force,
    "B": lambda case: with_held_force(case, ExtrapolatedForce),
    "C": with_force_law,
    "C, error control 1e-4": lambda case: with_force_law(case, 1e-4),
}

if __name__ == "__main__":
    reference.main("Drake, RK3", LOOPS, package="drake")
