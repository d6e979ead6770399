"""Comparison with other packages: vector fitting of scikit-rf, and a response estimated by pyFRF."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

import cosim
from builder.build import build
from eightpost.ident.vehicle.common_pole_fit import CommonPoleFit
from eightpost.ident.vehicle.frequency_response import FrequencyResponse, response_of
from eightpost.shock import Polylinear, Shock, StaticCurve, write_shock
from eightpost.signals import Drivefile, TimeSeries
from eightpost.vehicle import IdentifiedVehicle, add_port_damping, discretise, write_vehicle

from .conftest import BASELINE, FREQUENCY, noisy


def test_vector_fitting_finds_the_same_poles(quarter_car):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        skrf = pytest.importorskip("skrf", reason="scikit-rf is not installed")
        fitting = pytest.importorskip("skrf.vectorFitting", reason="this scikit-rf has no vector fitting")
    response = response_of(quarter_car, FREQUENCY).select(inputs=["road", "force"], outputs=["velocity", "tire_force"])
    scale = np.abs(response.H).max(axis=2)
    network = skrf.Network(f=FREQUENCY, f_unit="Hz", s=(response.H / scale[:, :, None]).transpose(2, 0, 1), z0=1.0)
    peer = fitting.VectorFitting(network)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        peer.vector_fit(n_poles_real=0, n_poles_cmplx=2, fit_constant=True, fit_proportional=False)
    poles = CommonPoleFit(high=19.9).fit(response).model.poles()
    expected = np.sort_complex(np.asarray(peer.poles))
    np.testing.assert_allclose(np.sort_complex(poles[poles.imag > 0.0]), expected, rtol=1e-5)


def test_the_fit_of_a_response_estimated_by_pyfrf_has_the_modes_of_the_car(quarter_car):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        pyfrf = pytest.importorskip("pyFRF", reason="pyFRF is not installed")
    rate, samples = 100, 2**16
    generator = np.random.default_rng(5)
    lines = np.fft.rfftfreq(samples, 1.0 / rate)
    spectrum = np.exp(2j * np.pi * generator.random(lines.size)) * (lines > 0.0)
    road = np.fft.irfft(spectrum)  # periodic: its response has no leakage
    answers = quarter_car.select(inputs=["road"]).frequency_response(lines)[:, 0]
    outputs = np.fft.irfft(answers * spectrum, axis=1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        peer = pyfrf.FRF(rate, exc=road[None, None], resp=outputs[None], exc_type="d", resp_type="d", window="none")
        H = np.asarray(peer.get_H1()).reshape(len(outputs), -1)
    frequency = np.asarray(peer.get_f_axis())
    kept = (frequency > 0.1) & (frequency < 20.0)
    chosen = np.flatnonzero(kept)[::64]
    response = FrequencyResponse(
        frequency[chosen], H[:, None, chosen], quarter_car.select(inputs=["road"]).inputs, quarter_car.outputs
    )
    found = CommonPoleFit(high=19.9, order=4).fit(response)
    np.testing.assert_allclose(np.array(found.model.modes()), np.array(quarter_car.modes()), rtol=1e-4)


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
