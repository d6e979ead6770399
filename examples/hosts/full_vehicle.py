"""A full vehicle in MuJoCo drives over the demo's track at 45 m/s; then one corner gets another shock.

    python examples/hosts/full_vehicle.py [--steps 8 4 2 1] [--seconds 4]

The chassis moves freely in space. Each wheel spins on a swing arm, and spring and shock act between tower and arm at
an angle, so the motion ratio depends on the travel. Tires have vertical stiffness and may lift off, and slip with
saturated friction; the rear wheels hold the speed, the driver steers back to the line. Masses, rates and distances are
those of examples/car.toml; the height of the center of gravity, the arms and the friction are assumptions. Each wheel
meets the track where it is: at the record's time x / speed (rear wheels follow the front ones by 62 ms).

The reference is the same model at 0.25 ms with the shocks' law evaluated directly, its state integrated by MuJoCo as
the activation of a filter. The errors are those of the worst corner, % of the standard deviation.
"""

import argparse
import json
import tempfile
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
import reference

from builder.build import build
from cosim import ForceLaw, HeldForce
from eightpost.corners import CORNERS
from eightpost.errors import EightpostError
from eightpost.shock import read_shock

CAR = reference.car()
P = CAR.parameters
SPEED = 45.0  # m/s: the wheelbase in the 62 ms by which the record's rear follows its front
HEIGHT, RADIUS, ARM, SPIN_SHARE = 0.5, 0.33, 0.6, 0.6  # m, m, m, share of the unsprung mass that spins
LONGITUDINAL, LATERAL, FRICTION = 9e4, 7e4, 1.3  # N, N/rad, 1
GRAVITY = 9.80665
SHOCKS = {"A": reference.SHOCK, "B": reference.HERE / "shock_B.json"}
CARS = ("AAAA", "BAAA")  # shocks at lf, rf, lr, rr
SIDE = np.array([1.0, -1.0, 1.0, -1.0])
AHEAD = np.array([P.cg_to_front_axle, P.cg_to_front_axle, -P.cg_to_rear_axle, -P.cg_to_rear_axle])


@dataclass(frozen=True)
class Run:
    """Time (K,) [s], shock velocity (4, K) [m/s], tire force (4, K) [N], and height of the chassis (K,) [m]."""

    time: np.ndarray
    velocity: np.ndarray
    tire_force: np.ndarray
    height: np.ndarray


def static_loads():
    """Return the tire forces (4,) [N] that balance weights and the first loads of the record."""
    heave, roll, pitch = reference.track()(0.0)[4:]
    wheels = GRAVITY * np.array(P.unsprung_mass)
    balance = np.array([np.ones(4), SIDE * P.track_width / 2.0, -AHEAD])
    return np.linalg.lstsq(balance, [GRAVITY * P.sprung_mass - heave, -roll, -pitch], rcond=None)[0] + wheels


def mjcf(step: float) -> str:
    """Return the vehicle as a MuJoCo model, with a filter for each shock's state that applies no force."""
    arms, tendons, motors, filters = "", "", "", ""
    centers = RADIUS - static_loads() / np.array(P.tire_stiffness) - HEIGHT
    for i, corner in enumerate(CORNERS):
        mass, side = P.unsprung_mass[i], SIDE[i]
        inner, spinning = side * (P.track_width / 2.0 - ARM), SPIN_SHARE * mass
        spin = 0.5 * spinning * RADIUS**2
        arms += f"""<site name="{corner}_tower" pos="{AHEAD[i]} {inner + side * 0.75 * ARM} {centers[i] + 0.45}"/>
          <body name="{corner}_arm" pos="{AHEAD[i]} {inner} {centers[i]}">
            <inertial pos="0 {side * ARM} 0" mass="{mass - spinning}" diaginertia="0.5 0.5 0.5"/>
            <joint name="{corner}_arm" type="hinge" axis="{side} 0 0"/>
            <site name="{corner}_foot" pos="0 {side * 0.88 * ARM} 0"/>
            <body name="{corner}" pos="0 {side * ARM} 0">
              <inertial pos="0 0 0" mass="{spinning}" diaginertia="{0.6 * spin} {spin} {0.6 * spin}"/>
              <joint name="{corner}_spin" type="hinge" axis="0 1 0"/>
            </body>
          </body>"""
        tendons += f'<spatial name="{corner}" stiffness="1" springlength="0"><site site="{corner}_tower"/>'
        tendons += f'<site site="{corner}_foot"/></spatial>'
        motors += f'<motor name="{corner}" tendon="{corner}"/>'
        filters += f'<general tendon="{corner}" dyntype="filter" dynprm="1" gainprm="0"/>'
    return f"""<mujoco>
      <option timestep="{step!r}" integrator="RK4" gravity="0 0 {-GRAVITY}"/>
      <worldbody>
        <body name="chassis" pos="0 0 {HEIGHT}">
          <freejoint/>
          <inertial pos="0 0 0" mass="{P.sprung_mass}"
                    diaginertia="{P.roll_inertia} {P.pitch_inertia} {P.pitch_inertia}"/>
          {arms}
        </body>
      </worldbody>
      <tendon>{tendons}</tendon>
      <actuator>{motors}{filters}</actuator>
    </mujoco>"""


class Vehicle:
    """The model at rest in its own frame, rolling at SPEED, held in place by preloaded springs."""

    def __init__(self, step: float, time_constants) -> None:
        self.model = mujoco.MjModel.from_xml_string(mjcf(step))
        self.data = mujoco.MjData(self.model)
        self.model.actuator_dynprm[4:, 0] = time_constants
        self.wheels = [self.model.body(corner).id for corner in CORNERS]
        self.spins = [self.model.joint(f"{corner}_spin").dofadr[0] for corner in CORNERS]
        arms = [self.model.joint(f"{corner}_arm").dofadr[0] for corner in CORNERS]
        self.data.qvel[0], self.data.qvel[self.spins] = SPEED, SPEED / RADIUS
        self.model.tendon_stiffness[:] = 0.0
        mujoco.mj_forward(self.model, self.data)
        self.start, self.length = self.data.xpos[self.wheels, 0].copy(), self.data.ten_length.copy()
        self.push()
        self.data.qacc[:] = 0.0
        mujoco.mj_inverse(self.model, self.data)
        missing = (self.data.qfrc_inverse - self.data.qfrc_applied)[arms]
        self.data.qvel[arms] = 1.0
        mujoco.mj_forward(self.model, self.data)
        lever, self.data.qvel[arms] = self.data.ten_velocity.copy(), 0.0
        preload = missing / lever
        self.model.tendon_stiffness[:] = np.array(P.spring_rate) * (ARM / lever) ** 2
        self.model.tendon_lengthspring[:] = (self.length + preload / self.model.tendon_stiffness)[:, None]

    def push(self) -> np.ndarray:
        """Apply loads, tires, drive and steering at the present point, and return the tire forces (4,) [N]."""
        model, data, motion = self.model, self.data, np.zeros(6)
        forward = data.body("chassis").xmat[[0, 3]] / np.hypot(*data.body("chassis").xmat[[0, 3]])
        data.qfrc_applied[:] = 0.0
        data.qfrc_applied[2:5] = reference.track()(data.time)[4:]
        data.qfrc_applied[self.spins[2:]] = 0.5 * P.sprung_mass * RADIUS * (SPEED - data.qvel[0])
        steer = -0.005 * data.qpos[1] - 0.1 * forward[1]
        vertical = np.zeros(4)
        for i, wheel in enumerate(self.wheels):
            x, y, z = data.xpos[wheel]
            road = reference.track()((x - self.start[i]) / SPEED)[i] - reference.track()(0.0)[i]
            vertical[i] = max(0.0, P.tire_stiffness[i] * (RADIUS + road - z))
            mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, wheel, motion, 0)
            along = motion[3:5] @ forward
            across = motion[4] * forward[0] - motion[3] * forward[1]
            slip = (data.qvel[self.spins[i]] * RADIUS - along) / along
            grip = np.array([LONGITUDINAL * slip, LATERAL * ((steer if i < 2 else 0.0) - across / along)])
            grip *= min(1.0, FRICTION * vertical[i] / max(np.hypot(*grip), 1e-9))
            force = [*(grip[0] * forward + grip[1] * np.array([-forward[1], forward[0]])), vertical[i]]
            mujoco.mj_applyFT(model, data, force, np.zeros(3), [x, y, road], wheel, data.qfrc_applied)
        return vertical

    def run(self, seconds: float, shock_force) -> Run:
        """Drive; `shock_force(data, velocity, displacement, begins)` returns the forces (4,) at every stage."""
        rows, begins = [], True

        def control(_, data):
            nonlocal begins
            tires = self.push()
            velocity = -data.ten_velocity
            if begins:
                rows.append([data.time, *velocity, *tires, data.qpos[2]])
            data.ctrl[:4] = shock_force(data, velocity, self.length - data.ten_length, begins)
            begins = False

        mujoco.set_mjcb_control(control)
        try:
            for _ in range(round(seconds / self.model.opt.timestep) + 1):
                begins = True
                mujoco.mj_step(self.model, self.data)
                if self.data.time == 0.0:
                    raise ArithmeticError("MuJoCo: the motion diverged, and the model was reset")
        finally:
            mujoco.set_mjcb_control(None)
        table = np.array(rows).T
        return Run(table[0], table[1:5], table[5:9], table[9])


def directly(shocks, seconds: float, step: float = 0.25e-3) -> Run:
    """Reference: the laws of the shock files are evaluated in the model, and MuJoCo integrates their states."""
    laws = [read_shock(path).law for path in shocks]

    def force(data, velocity, _displacement, _begins):
        static = np.array([law.static_force(v) for law, v in zip(laws, velocity.tolist(), strict=True)])
        weight = np.array([law.lag_weight(one) for law, one in zip(laws, static.tolist(), strict=True)])
        data.ctrl[4:] = static
        return static + weight * (data.act - static)

    return Vehicle(step, [law.time_constant for law in laws]).run(seconds, force)


def with_force_law(fmus, seconds: float, step: float) -> Run:
    """Loop C."""
    with ForceLaw(fmus, corners=CORNERS) as law:
        law.start(0.0, np.zeros(4), np.zeros(4))

        def force(data, velocity, displacement, begins):
            return (law.accept if begins else law.force)(data.time, velocity, displacement)

        return Vehicle(step, 1.0).run(seconds, force)


def with_held_force(fmus, seconds: float, step: float, late: bool = False) -> Run:
    """Loop A, and J, which holds the force of the last step."""
    with HeldForce(fmus, corners=CORNERS) as loop:
        forces = [loop.start(0.0, np.zeros(4), np.zeros(4))]

        def force(data, velocity, displacement, begins):
            if begins:
                forces.append(loop.step(data.time, step, velocity, displacement))
            return forces[-2 if late else -1]

        return Vehicle(step, 1.0).run(seconds, force)


LOOPS = {"J": lambda *case: with_held_force(*case, late=True), "A": with_held_force, "C": with_force_law}


def errors(found: Run, exact: Run) -> tuple[float, float]:
    """Return the errors of shock velocity and tire force, worst corner after 1 s, % of the standard deviation."""
    every = round(found.time[1] / exact.time[1])
    kept = found.time[: len(exact.time[::every])] >= 1.0
    worst = []
    for ours, true in ((found.velocity, exact.velocity), (found.tire_force, exact.tire_force)):
        rows = true[:, ::every][:, kept]
        missed = ours[:, : len(kept)][:, kept] - rows
        worst.append(float(np.max(np.sqrt(np.mean(missed**2, axis=1)) / np.std(rows, axis=1))) * 100.0)
    return worst[0], worst[1]


def swap_effect(before: Run, after: Run) -> tuple[float, float]:
    """Return the left front tire force's standard deviation after 1 s [N], and its change by the other shock [N]."""
    old, new = (float(np.std(run.tire_force[0, run.time >= 1.0])) for run in (before, after))
    return old, new - old


def fmus_in(folder: Path) -> dict[str, Path]:
    """Build the FMUs of both shocks."""
    for name, path in SHOCKS.items():
        build([path], folder / name)
    return {name: next((folder / name).glob("*.fmu")) for name in SHOCKS}


def main() -> None:
    """Print the errors of every loop and step, and the effect of another shock at the left front."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=float, nargs="+", default=[8, 4, 2, 1], help="steps [ms]")
    parser.add_argument("--seconds", type=float, default=4.0, help="duration of each run [s]; default 4")
    parser.add_argument("--json", type=Path, help="file for the results")
    options = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        fmus = fmus_in(Path(folder))
        before, after = (directly([SHOCKS[one] for one in car], options.seconds) for car in CARS)
        effect = swap_effect(before, after)
        print(f"lf tire force: {effect[0]:.1f} N with shock A, {effect[1]:+.1f} N with shock B (reference, 0.25 ms)")
        for loop, step in ((loop, 1e-3 * step) for loop in LOOPS for step in options.steps):
            try:
                runs = [LOOPS[loop]([fmus[one] for one in car], options.seconds, step) for car in CARS]
            except (ArithmeticError, EightpostError):
                print(f"loop {loop}, {1e3 * step:g} ms: diverges")
                continue
            worst, found = errors(runs[1], after), swap_effect(*runs)
            rows.append([loop, step, *worst, *found])
            print(
                f"loop {loop}, {1e3 * step:g} ms: errors {worst[0]:.3g} % (shock velocity), {worst[1]:.3g} % "
                f"(tire force); lf: {found[0]:.1f} N, {found[1]:+.1f} N",
                flush=True,
            )
    record = {"columns": ["loop", "step", "velocity", "tire_force", "lf_deviation", "lf_change"]}
    record |= {"seconds": options.seconds, "reference": effect, "rows": rows}
    if options.json:
        options.json.write_text(json.dumps(record, indent=1) + "\n")


if __name__ == "__main__":
    main()
