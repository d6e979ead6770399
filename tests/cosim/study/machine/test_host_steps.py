"""Printed steps of a stiff quarter car are those at which an independent host has the stated errors."""

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.signal import lsim

from builder.build import build
from cosim.study.host_steps import LIMITS, LOOPS, HostSteps, host_steps
from cosim.system_file import read_case
from eightpost.app.exchange import check
from eightpost.errors import InputError
from eightpost.shock import Polylinear, Shock, StaticCurve, write_shock
from eightpost.signals import Drivefile

TRACK = Path(__file__).resolve().parents[4] / "examples" / "data" / "track.parquet"

#: Sprung and unsprung mass [kg], suspension and tire stiffness [N/m], damping [N.s/m].
SPRUNG, WHEEL, SPRING, TIRE, DAMPING = 300.0, 38.0, 120e3, 250e3, 14e3

#: Start and end of the comparison, and the step of the exact solution [s].
BEGIN, END, FINE = 0.5, 2.5, 1e-4

CAR = f"""
schema = 1
model = "quarter_car"
name = "stiff"

[parameters]
sprung_weight = "{SPRUNG * 9.80665} N"
unsprung_weight = "{WHEEL * 9.80665} N"
suspension_stiffness = "{SPRING} N/m"
tire_stiffness = "{TIRE} N/m"
damping = "0 N.s/m"
"""

#: States: sprung position and velocity, those of the wheel; the force of the damper and the road act on them.
A = np.array(
    [
        [0.0, 1.0, 0.0, 0.0],
        [-SPRING / SPRUNG, 0.0, SPRING / SPRUNG, 0.0],
        [0.0, 0.0, 0.0, 1.0],
        [SPRING / WHEEL, 0.0, -(SPRING + TIRE) / WHEEL, 0.0],
    ]
)
FORCE, ROAD = np.array([0.0, 1.0 / SPRUNG, 0.0, -1.0 / WHEEL]), np.array([0.0, 0.0, 0.0, TIRE / WHEEL])
VELOCITY = np.array([0.0, -1.0, 0.0, 1.0])


def line(slope: float) -> StaticCurve:
    """Return a straight curve [N.s/m]."""
    speed = 0.2
    inner, outer = (slope * speed, *[0.0] * 14), (slope * speed, slope * speed, 0.0, 0.0)
    rebound = tuple(-value for value in outer)
    return StaticCurve(inner, outer, rebound, speed, 0.01, 3.0, 3.0, slope, slope)


@pytest.fixture(scope="module")
def system(tmp_path_factory):
    """Return a function of the scenario that writes a system file of the stiff car."""
    folder = tmp_path_factory.mktemp("stiff")
    (folder / "car.toml").write_text(CAR)
    write_shock(Shock("damper", Polylinear(line(DAMPING))), folder / "damper.json")
    build([folder / "car.toml", folder / "damper.json"], folder)

    def write(scenario):
        parts = (
            '[components]\ncar = { fmu = "car.fmu", inputs = { aero_force = 0.0 } }\ndamper = { fmu = "damper.fmu" }\n'
        )
        head = f'schema = 1\nname = "stiff"\nbond = [{{ between = ["car", "damper"] }}]\n{parts}\n[scenario]\n'
        (folder / "system.toml").write_text(head + scenario)
        return folder / "system.toml"

    return write


DRIVEN = f"""
drivefile = "{TRACK.as_posix()}"
stop = "4 s"
targets = {{ "lf.road" = "car.road" }}
"""


def road(times):
    series = Drivefile.read(TRACK).series
    return np.interp(times, series.time, series["lf.road"])


def at_rest(first):
    return np.linalg.solve(A, -ROAD * first)


def tire_force_in_a_host(loop, step):
    """Return time and tire force of a host; the linear damper's force is known without an FMU."""
    count, car = int(END / step + 1e-9), A if loop != "C" else A + np.outer(FORCE, DAMPING * VELOCITY)
    x, force, *heights = np.split(np.eye(8), [4, 5, 6, 7])  # a step of Runge and Kutta by start, held force and road
    a = car @ x + np.outer(FORCE, force) + np.outer(ROAD, heights[0])
    b = car @ (x + 0.5 * step * a) + np.outer(FORCE, force) + np.outer(ROAD, heights[1])
    c = car @ (x + 0.5 * step * b) + np.outer(FORCE, force) + np.outer(ROAD, heights[1])
    d = car @ (x + step * c) + np.outer(FORCE, force) + np.outer(ROAD, heights[2])
    after = x + step / 6.0 * (a + 2.0 * (b + c) + d)
    height = road(0.5 * step * np.arange(2 * count + 1))
    driven = np.lib.stride_tricks.sliding_window_view(height, 3)[::2] @ after[:, 5:].T
    rows, old = [at_rest(height[0])], 0.0
    for moved in driven:
        now = DAMPING * (VELOCITY @ rows[-1])
        held = {"J": old, "A": now, "B": 1.5 * now - 0.5 * old, "C": 0.0}[loop]
        rows.append(after[:, :4] @ rows[-1] + after[:, 4] * held + moved)
        old = now
    times = step * np.arange(count + 1)
    return times, TIRE * (road(times) - np.array(rows)[:, 2])


@pytest.fixture(scope="module")
def exact():
    times = np.arange(round(END / FINE) + 1) * FINE
    height = road(times)
    closed = A + np.outer(FORCE, DAMPING * VELOCITY)
    _, _, states = lsim((closed, ROAD[:, None], np.eye(4), np.zeros((4, 1))), height, times, X0=at_rest(height[0]))
    return times, TIRE * (height - states[:, 2])


def error(loop, step, exact):
    """Return the error of the tire force in percent of its standard deviation."""
    times, found = tire_force_in_a_host(loop, step)
    true, after = np.interp(times, *exact), times >= BEGIN - 1e-9
    spread = exact[1][exact[0] >= BEGIN - 1e-9].std()
    return 100.0 * np.sqrt(np.mean((found - true)[after] ** 2)) / spread


@pytest.fixture(scope="module")
def steps(system):
    return host_steps(read_case(system(DRIVEN)))


@pytest.mark.slow
@pytest.mark.parametrize("loop", LOOPS)
def test_an_independent_host_has_at_most_the_error_of_a_printed_step_and_more_at_twice_it(loop, steps, exact):
    assert steps.damping == pytest.approx((DAMPING,), rel=1e-6)
    for limit, step in zip(LIMITS, steps.steps[loop], strict=True):
        assert not step or error(loop, step, exact) <= 1.01 * limit
        with np.errstate(all="ignore"):
            assert step > 0.5 * steps.stable[loop] or error(loop, max(2.0 * step, FINE), exact) > limit


@pytest.mark.slow
@pytest.mark.parametrize("loop", LOOPS)
def test_a_loop_is_bounded_below_its_limit_of_stability_and_grows_above_it(loop, steps):
    below, above = (tire_force_in_a_host(loop, share * steps.stable[loop])[1] for share in (0.97, 1.05))
    assert np.abs(below).max() < 1e5
    assert np.abs(above).max() > 1e6


@pytest.mark.slow
def test_no_printed_step_is_above_the_limit_of_stability(steps, unchanged):
    assert all(step <= steps.stable[loop] for loop in LOOPS for step in steps.steps[loop])
    assert steps.steps["C"][0] > steps.steps["A"][0] > steps.steps["J"][0]
    unchanged(steps, relative=1e-3)


def test_a_drive_that_does_not_move_the_car_is_refused(system):
    path = system('stop = "0.02 s"\n')
    path.write_text(path.read_text().replace("aero_force = 0.0", "aero_force = 0.0, road = 0.0"))
    with pytest.raises(InputError, match=r"the first 0\.02 s of the drive do not move every corner"):
        host_steps(read_case(path))


def test_the_command_prints_a_line_for_each_loop_on_at_most_twelve_lines(system, monkeypatch):
    steps = dict.fromkeys(LOOPS, (4e-3, 1e-3, 0.0))
    found = HostSteps("car", "tire force", 2.0, (DAMPING,), dict.fromkeys(LOOPS, 0.0071199), steps)
    monkeypatch.setattr("cosim.study.host_steps.host_steps", lambda case: found)
    ran = CliRunner().invoke(check, [str(system(DRIVEN))])
    assert ran.exit_code == 0 and len(ran.output.splitlines()) <= 12
    for loop in LOOPS:
        (row,) = (line for line in ran.output.splitlines() if line.startswith(f"{loop} ") and "ms" in line)
        assert row.split() == [loop, *["7.12", "ms", "4", "ms", "1", "ms", "below", "0.1", "ms"]]
    document = json.loads(CliRunner().invoke(check, ["--json", str(system(DRIVEN))]).stdout)
    (steps,) = document["host_steps"].values()
    assert steps["steps"]["C"] == [4e-3, 1e-3, 0.0] and document["reports"] == []


def test_a_system_without_a_vehicle_of_this_project_is_refused(system):
    path = system(DRIVEN)
    path.write_text(path.read_text().replace('["car", "damper"] }', '["car", "damper"], displacement = false }'))
    path.write_text(path.read_text().replace('damper.fmu" }', 'damper.fmu", inputs = { displacement = 0.0 } }'))
    with pytest.raises(
        InputError, match="an input of the shock at car has other sources than the vehicle; host steps need one vehicle"
    ):
        host_steps(read_case(path))
