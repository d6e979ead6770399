"""The FMU of an identified car, coupled with shock FMUs, gives the same result as the closed loop of the library."""

from dataclasses import replace

import numpy as np
import pytest

import cosim
from builder.build import build
from eightpost.ident.vehicle.common_pole_fit import CommonPoleFit
from eightpost.shock import Polylinear, Shock, StaticCurve, write_shock
from eightpost.signals import Drivefile, TimeSeries
from eightpost.vehicle import IdentifiedVehicle, add_port_damping, discretise, write_vehicle

from .conftest import BASELINE, noisy

ALTERNATE = 0.6 * BASELINE
RATE, STOP = 125.0, 1.0
JUDGED = ("velocity", "tire_force")


def _line(rate):
    """F = rate v."""
    inner, speed = (rate * 0.4, *[0.0] * 14), 0.4
    return StaticCurve(
        inner, (rate * speed, rate * speed, 0.0, 0.0), (-rate * speed, -rate * speed, 0.0, 0.0), speed, 0.01, 5.0, 5.0,
        rate, rate,
    )  # fmt: skip


@pytest.fixture(scope="module")
def vehicle(quarter_car):
    """Vehicle identified from an estimate with 1 % noise, so its poles differ from those of the truth."""
    return IdentifiedVehicle("car", CommonPoleFit().fit(noisy(quarter_car, 0.01, 3)).model, {"": BASELINE})


@pytest.fixture(scope="module")
def drive():
    time = np.arange(round(STOP * RATE) + 1) / RATE
    generator = np.random.default_rng(5)
    tones = [(f, 0.004 / f * generator.uniform(0.5, 1.0), generator.uniform(0.0, 6.0)) for f in (1.1, 2.3, 4.7, 9.1)]
    road = sum(a * (np.sin(2.0 * np.pi * f * time + p) - np.sin(p)) for f, a, p in tones)
    return TimeSeries.from_channels(time, {"road": ("m", np.asarray(road))})


@pytest.fixture(scope="module")
def fmus(vehicle, tmp_path_factory):
    """Return the FMUs of the car and of a straight shock, whose closed loop is known exactly."""
    folder = tmp_path_factory.mktemp("identified")
    write_shock(Shock("shock", Polylinear(_line(ALTERNATE))), folder / "shock.json")
    write_vehicle(folder / "car.json", vehicle)
    return {b.path.stem: b.path for b in build(sorted(folder.glob("*.json")), folder / "fmus")}


def coupled(fmus, drive, step):
    system = cosim.System.load(fmus, bonds=[cosim.Bond.between("car", "shock")])
    series = TimeSeries.from_channels(drive.time, {"road": ("m", drive["road"])})
    record = tuple(f"car.{name}" for name in JUDGED)
    system = replace(system, constants={"car.aero_force": 0.0})
    scenario = cosim.Scenario(STOP, Drivefile(series), record=record, record_step=1.0 / RATE)
    return cosim.run(system, scenario, algorithm=cosim.Implicit(tolerance=1e-12), step=step).series


def closed_loop(vehicle, drive):
    """Return the outputs of the car with the straight shock, stepped exactly for a road linear between samples."""
    model = discretise(add_port_damping(vehicle.state_space, {"": ALTERNATE - BASELINE}), 1.0 / RATE, "first")
    road, x, outputs = model.input_names.index("road"), np.zeros(len(model.A)), []
    for value in drive["road"]:
        outputs.append(model.C @ x + model.D[:, road] * value)
        x = model.A @ x + model.B[:, road] * value
    return dict(zip(model.output_names, np.array(outputs).T, strict=True))


def difference(found, expected, name):
    """Return the RMS difference relative to the standard deviation."""
    return float(np.std(found[f"car.{name}"] - expected[name]) / np.std(expected[name]))


def test_with_a_straight_shock_the_coupled_fmus_equal_the_exact_closed_loop(fmus, vehicle, drive):
    found, exact = coupled(fmus, drive, 2e-5), closed_loop(vehicle, drive)
    for name in JUDGED:
        assert difference(found, exact, name) < 1e-9
