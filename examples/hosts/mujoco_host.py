"""MuJoCo as the host: the car is an MJCF model, the shocks are actuators on its tendons.

    python examples/hosts/mujoco_host.py [--steps 8 4 2 1] [--seconds 10]

The control callback runs in every stage of the Runge-Kutta method, so loop C fits: it asks for the force at the stage,
and the first call in a step is at the point that the last step accepted.

Pitfalls:

- The defaults are a step of 2 ms and the semi-implicit Euler method: of first order, with any loop. Choose RK4.
- The implicit integrators do not see the damping in a callback: `implicitfast` has the same errors as Euler.
- `mj_step` leaves tendon lengths and velocities of its last stage, not of its end; `mj_step1` or the first callback of
  the next step gives those. `mj_step1` and `mj_step2` do not support RK4, so a force that is held must be set before
  `mj_step`, or in its first callback.
- If the motion diverges, `mj_step` sets the state back to the start, time 0 included, and continues with a warning in
  MUJOCO_LOG.TXT. Check the time.
- A callback is global: remove it after the run.
- Roll and pitch are nested hinges. With equal inertias about y and z, and pitch outside, they have the constant mass
  matrix of the linear car. The other order needs an inertia that the compiler refuses.
"""

import mujoco
import numpy as np
import reference
from reference import Case, Motion

from cosim import ExtrapolatedForce, ForceLaw, HeldForce
from eightpost.corners import CORNERS

CAR = reference.car()
JOINTS = ("heave", "pitch", "roll", *CORNERS)
ORDER = [0, 2, 1, 3, 4, 5, 6]  # MuJoCo's coordinates in the order of the reference


def mjcf(step: float, integrator: str) -> str:
    """Return the car as a MuJoCo model: tendons combine coordinates linearly, as the rows of S do."""
    p = CAR.parameters
    wheels = "".join(
        f'<body><inertial pos="0 0 0" mass="{mass!r}" diaginertia="1 1 1"/>'
        f'<joint name="{corner}" type="slide" axis="0 0 1" stiffness="{tire!r}"/></body>'
        for corner, mass, tire in zip(CORNERS, p.unsprung_mass, p.tire_stiffness, strict=True)
    )
    tendons, motors = "", ""
    for corner, rate, row in zip(CORNERS, p.spring_rate, CAR.S[:, ORDER], strict=True):
        parts = zip(JOINTS, row.tolist(), strict=True)
        terms = "".join(f'<joint joint="{name}" coef="{value!r}"/>' for name, value in parts if value)
        tendons += f'<fixed name="{corner}" stiffness="{rate!r}" springlength="0">{terms}</fixed>'
        motors += f'<motor tendon="{corner}" gear="-1"/>'
    return f"""<mujoco>
      <option timestep="{step!r}" integrator="{integrator}" gravity="0 0 0"/>
      <worldbody>
        <body>
          <inertial pos="0 0 0" mass="{p.sprung_mass!r}"
                    diaginertia="{p.roll_inertia!r} {p.pitch_inertia!r} {p.pitch_inertia!r}"/>
          <joint name="heave" type="slide" axis="0 0 1"/>
          <joint name="pitch" type="hinge" axis="0 1 0"/>
          <joint name="roll" type="hinge" axis="1 0 0"/>
        </body>
        {wheels}
      </worldbody>
      <tendon>{tendons}</tendon>
      <actuator>{motors}</actuator>
    </mujoco>"""


def drive(case: Case, shock_force, integrator: str) -> Motion:
    """Run the model; `shock_force(time, velocity, displacement, begins)` returns the forces (4,) for every stage.

    `begins` is True at the first stage of a step, which is at the end of the last one.
    """
    model = mujoco.MjModel.from_xml_string(mjcf(case.step, integrator))
    data, road = mujoco.MjData(model), np.zeros(7)
    data.qpos[:] = CAR.equilibrium()[ORDER]
    begins = True

    def control(_, data):
        nonlocal begins
        road[:] = CAR.load(data.time)
        data.qfrc_applied[:] = road[ORDER]
        data.ctrl[:] = shock_force(data.time, data.ten_velocity, data.ten_length, begins)
        begins = False

    rows = [np.concatenate([data.qpos[ORDER], data.qvel[ORDER]])]
    mujoco.set_mjcb_control(control)
    try:
        for _ in range(case.count):
            begins = True
            mujoco.mj_step(model, data)
            if data.time < 0.5 * case.step:
                raise ArithmeticError("MuJoCo: the motion diverged, and the model was reset")
            rows.append(np.concatenate([data.qpos[ORDER], data.qvel[ORDER]]))
    finally:
        mujoco.set_mjcb_control(None)
    return reference.motion(CAR, np.arange(len(rows)) * case.step, np.array(rows))


def with_force_law(case: Case, integrator: str = "RK4") -> Motion:
    """Loop C: accept the point where a step begins, and ask for the force at every other stage."""
    with ForceLaw(case.shock, corners=CORNERS) as law:
        law.start(0.0, np.zeros(4), CAR.S @ CAR.equilibrium())
        return drive(case, lambda t, v, d, begins: (law.accept if begins else law.force)(t, v, d), integrator)


def with_held_force(case: Case, kind=HeldForce, late: bool = False, integrator: str = "RK4") -> Motion:
    """Hold one force over every step: loops A and B, and J, where it is the force of the last step."""
    with kind(case.shock, corners=CORNERS) as loop:
        forces = [loop.start(0.0, np.zeros(4), CAR.S @ CAR.equilibrium())]

        def held(time, velocity, displacement, begins):
            if begins:
                forces.append(loop.step(time, case.step, velocity, displacement))
            return forces[-2 if late else -1]

        return drive(case, held, integrator)


LOOPS = {
    "J": lambda case: with_held_force(case, late=True),
    "A": with_held_force,
    "B": lambda case: with_held_force(case, ExtrapolatedForce),
    "C": with_force_law,
    "A, default Euler": lambda case: with_held_force(case, integrator="Euler"),
    "C, default Euler": lambda case: with_force_law(case, "Euler"),
    "C, implicitfast": lambda case: with_force_law(case, "implicitfast"),
}

if __name__ == "__main__":
    reference.main("MuJoCo, RK4", LOOPS, package="mujoco")
