"""The coupled FMUs against independent solutions of the same equations; docs/explanation/coupling.md has the table."""

from dataclasses import replace
from pathlib import Path

import control
import numpy as np
import pytest

import cosim
from benchmarks import case
from benchmarks.engines.runs import measure
from eightpost.corners import CORNERS
from eightpost.shock import Lpf1, Lpnl2, Polylinear, Port, StaticCurve
from eightpost.signals import Drivefile
from eightpost.vehicle import read_vehicle
from eightpost.vehicle.kernel import equilibrium

ROOT = Path(__file__).resolve().parents[2]
LOADS = ("heave_force", "roll_moment", "pitch_moment")
STEPS = (0.002, 0.001, 0.0005)
#: Coupling steps of the linear table in docs/explanation/coupling.md [s].
LINEAR_STEPS = (0.002, 0.001, 0.0005, 0.00025)


@pytest.fixture(scope="module")
def build_fmus():
    """Build car.fmu and a law's shock.fmu: build_fmus(law, folder)."""
    return case.build_fmus


@pytest.fixture(scope="module")
def drive():
    return Drivefile.read(ROOT / "examples" / "data" / "track.parquet")


@pytest.fixture(scope="module")
def damped(build_fmus, drive, shocks, tmp_path_factory):
    """A case with all damping in LPNL2 shocks with gas springs, on 4 s of the track, and the folder of its FMUs."""
    law = replace(shocks["lpnl2"].law, port=Port(gas_preload=50.0, gas_stiffness=700.0))
    assert isinstance(law, Lpnl2)
    folder = tmp_path_factory.mktemp("accuracy")
    build_fmus(law, folder)
    return case.make_case(law, drive, 4.0), folder


@pytest.fixture(scope="module")
def errors(damped):
    """Rows of errors by scheme and step."""
    solved, folder = damped
    schemes = {"gauss-seidel": cosim.GaussSeidel(), "jacobi": cosim.Jacobi()}
    return {
        (name, step): measure(solved, folder, algorithm, step) for name, algorithm in schemes.items() for step in STEPS
    }


def test_gauss_seidel_at_1_ms_has_errors_below_half_a_percent_in_shock_velocity_and_tire_force(errors):
    row = errors["gauss-seidel", 0.001]
    assert row["error_velocity_percent"] < 0.5
    assert row["error_tire_force_percent"] < 0.5


def load_system(folder):
    """Load the car with a shock on every corner from the folder of their FMUs."""
    files = {"car": folder / "car.fmu"} | dict.fromkeys(CORNERS, folder / "shock.fmu")
    return cosim.System.load(files, [cosim.Bond.between(f"car.{c}", c) for c in CORNERS])


def linear_curve(rate):
    """F_s = rate * v in every piece of the curve."""
    v = 0.4
    outer = (rate * v, rate * v, 0.0, 0.0)
    return StaticCurve(
        inner=(rate * v, *[0.0] * 14),
        compression=outer,
        rebound=tuple(-c for c in outer),
        transition_speed=v,
        transition_width=0.01,
        compression_speed=9.0,
        rebound_speed=9.0,
        compression_slope=rate,
        rebound_slope=rate,
    )


def closed_loop(car, damper, drive, stop):
    """Outputs by name of python-control's closed loop: the car's state space with a linear damper in feedback."""
    ports = [car.input_names.index(f"{c}.force") for c in CORNERS]
    velocities = [car.output_names.index(f"{c}.velocity") for c in CORNERS]
    pick, place = np.eye(len(car.outputs))[velocities], np.eye(len(car.inputs))[:, ports]
    plant = control.ss(car.A, car.B, car.C, car.D)
    through = control.ss([], [], [], place) * damper * control.ss([], [], [], pick)
    loop = control.feedback(plant, through, sign=1)
    series = drive.series.window(0.0, stop)
    u = np.stack([series[name] if name in series else np.zeros(len(series)) for name in car.input_names])
    start = np.concatenate([equilibrium(car.A, car.B, u[:, 0]), np.zeros(loop.nstates - car.A.shape[0])])
    return dict(
        zip(car.output_names, np.asarray(control.forced_response(loop, series.time, u, start).outputs), strict=True)
    )


def linear_errors(build_fmus, drive, law, damper, folder, steps):
    """Worst corner's error in percent of the standard deviation, by quantity and step."""
    build_fmus(law, folder)
    car = read_vehicle(ROOT / "examples" / "car.toml").coupled()
    expected = closed_loop(car, damper, drive, 4.0)
    channels = tuple(f"car.{c}.{quantity}" for c in CORNERS for quantity in ("velocity", "tire_force"))
    errors = {"velocity": [], "tire_force": []}
    for step in steps:
        scenario = cosim.Scenario(4.0, drive, record=channels, record_step=0.002)
        series = cosim.run(load_system(folder), scenario, step=step, compared=False).series
        for quantity, rows in errors.items():
            names = [f"{c}.{quantity}" for c in CORNERS]
            rows.append(max(100 * np.std(series[f"car.{n}"] - expected[n]) / np.std(expected[n]) for n in names))
    return {quantity: np.array(rows) for quantity, rows in errors.items()}


@pytest.mark.slow
def test_coupled_fmus_with_linear_shocks_match_the_closed_loop_of_python_control(build_fmus, drive, tmp_path):
    """The front damper of Table 5.1 without lag: errors below 1 % at 1 ms, third order."""
    rate = 16.67 * 175.12683524647636
    law, damper = Polylinear(linear_curve(rate)), control.ss([], [], [], rate * np.eye(4))
    check_linear(linear_errors(build_fmus, drive, law, damper, tmp_path, LINEAR_STEPS))


@pytest.mark.nightly
def test_coupled_fmus_with_linear_lagged_shocks_match_the_closed_loop_of_python_control(build_fmus, drive, tmp_path):
    """30 lbf/(in/s) behind a lag of 1.3 ms."""
    rate, tau = 30.0 * 175.12683524647636, 0.0013
    damper = control.ss(-np.eye(4) / tau, np.eye(4) / tau, rate * np.eye(4), 0)
    law = Lpf1(linear_curve(rate), tau)
    check_linear(linear_errors(build_fmus, drive, law, damper, tmp_path, LINEAR_STEPS))


def check_linear(errors):
    assert errors["velocity"][1] < 1.0
    assert errors["tire_force"][1] < 1.0
    for rows in errors.values():
        assert -np.diff(np.log2(rows)) == pytest.approx(3.0, abs=0.1)


@pytest.mark.nightly
def test_a_coupled_run_starts_in_the_cars_equilibrium_including_the_gas_force(build_fmus, shocks, tmp_path):
    """Gas force pushes each corner of the chassis up against its spring: x = -F / (k_s + k_gas) at zero load."""
    law = replace(shocks["lpnl2"].law, port=Port(gas_preload=500.0, gas_stiffness=700.0))
    build_fmus(law, tmp_path)
    system = load_system(tmp_path)
    loads = {f"car.{name}": 0.0 for name in (*LOADS, *(f"{c}.road" for c in CORNERS))}
    system = cosim.System(system.components, system.bonds, constants=loads)
    record = tuple(f"car.{c}.{name}" for c in CORNERS for name in ("displacement", "velocity", "tire_force"))
    series = cosim.run(system, cosim.Scenario(0.5, record=record), step=1e-3, compared=False).series
    rates = read_vehicle(ROOT / "examples" / "car.toml").parameters.spring_rate
    for c, rate in zip(CORNERS, rates, strict=True):
        displacement = series[f"car.{c}.displacement"]
        assert displacement[0] == pytest.approx(-500.0 / (rate + 700.0), rel=1e-9)
        assert np.ptp(displacement) < 1e-12
        assert np.abs(series[f"car.{c}.velocity"]).max() < 1e-9
        assert np.ptp(series[f"car.{c}.tire_force"]) < 1e-6
