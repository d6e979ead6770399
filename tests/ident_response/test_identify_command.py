"""Tests of `eightpost identify`: the vehicle that it writes, and its messages for bad files."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from eightpost.__main__ import main
from eightpost.ident.vehicle.vehicle_fit import read_fit
from eightpost.rig import RigTest
from eightpost.shock import Shock, read_shock, write_shock
from eightpost.signals import TimeSeries
from eightpost.vehicle import read_vehicle

from .rig_tests import BASELINE


@pytest.fixture(scope="module")
def files(quarter_car, tmp_path_factory):
    """Rig files of the first 25 s of the quarter car's two tests."""
    folder = tmp_path_factory.mktemp("rig")
    found = []
    for name, record in zip(("soft", "baseline")[::-1], quarter_car.records, strict=True):
        found.append(folder / f"{name}.parquet")
        RigTest(record.window(0.0, 25.0)).write(found[-1])
    return found[::-1]


def _identify(*words):
    return CliRunner().invoke(main, ["identify", *[str(word) for word in words]])


@pytest.fixture(scope="module")
def done(files, tmp_path_factory):
    car = tmp_path_factory.mktemp("out") / "corner.json"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("eightpost.app.show.INTERVAL", 0.0)
        return _identify(*files, "-o", car, "--plot", "main", "-v"), car


def test_two_files_give_a_vehicle_with_fit_and_plots(done):
    result, car = done
    assert result.exit_code == 0, result.output
    fit = read_fit(car)
    assert set(fit.sources) == {"soft.parquet", "baseline.parquet"}
    assert {"velocity.png", "tire_force.png", "stabilisation.png"} <= {
        path.name for path in (car.parent / "corner_plots").iterdir()
    }


def test_the_progress_moves_from_the_first_file_on_and_has_no_long_standstill(done):
    result, _ = done
    before, after = result.output.split("decimated to")
    shares = [[int(share) for share in re.findall(r"identifying: (\d+)%", text)] for text in (before, after)]
    assert 8 in shares[0] and max(shares[0]) == 15
    assert shares[1] == sorted(shares[1]) and shares[1][-1] == 100
    steps = np.diff(sorted({15, *shares[1]}))
    assert steps.size > 30 and steps.max() <= 20


def test_the_baseline_does_not_depend_on_the_order_of_the_files(done):
    result, car = done
    assert "baseline baseline.parquet" in result.output
    # At 250 Hz, central differences give velocities that are 1 % low at 10 Hz and 9 % low at 30 Hz.
    assert read_fit(car).vehicle.baseline_damping[""] == pytest.approx(BASELINE, rel=0.05)


def test_decisions_are_printed(done):
    for said in (
        "decimated to 125 Hz",
        "misfit of the",
        "the loop is stable",
        "states from",
        "uncertainty of the worst output",
        "friction at the ports",
        "Estimator: local polynomials",
        "The model was fitted up to",
    ):
        assert said in " ".join(done[0].output.split()), said


@pytest.mark.nightly
def test_a_preparation_file_replaces_rate_and_settling(files, tmp_path):
    (tmp_path / "prep.toml").write_text('rate = "62.5 Hz"\nsettling = "4 s"\n')
    result = _identify(
        *files,
        "--preparation",
        tmp_path / "prep.toml",
        "--plot",
        "none",
        "--recipe",
        "boggs",
        "-o",
        tmp_path / "c.json",
    )
    assert result.exit_code in (0, 1), result.output
    assert "decimated to 62.5 Hz" in " ".join(result.output.split())


def test_the_input_of_a_coupled_identified_vehicle_is_the_whole_shock_force(done):
    vehicle = read_vehicle(done[1])
    frequency = np.arange(2.0, 5.0, 0.01)
    peaks = [
        np.abs(model.select(inputs=["road"], outputs=["tire_force"]).frequency_response(frequency)).max()
        for model in (vehicle.coupled(), vehicle.with_damper())
    ]
    assert peaks[0] > 3.0 * peaks[1]  # without its damper the car rings


@pytest.mark.repeated(2)
@pytest.mark.parametrize(
    ("words", "said"),
    [
        (lambda files: [files[0]], "cannot separate shock forces from their causes"),
        (lambda files: [*files, "-o", "car.toml"], "ends in .json"),
        (lambda files: [*files, "--baseline", "other.parquet"], "not one of the RIG files"),
        (lambda files: [*files, "--rate", "7 s"], "--rate"),
        (lambda files: [*files, "--output-channels", "spin"], "no output spin"),
    ],
)
def test_unusable_arguments_exit_2_with_the_reason(files, tmp_path, words, said):
    given = words(files)
    output = [] if "-o" in given else ["-o", tmp_path / "car.json"]
    result = _identify(*given, *output)
    assert result.exit_code == 2, result.output
    assert said in " ".join(result.output.split())
    assert not (tmp_path / "car.json").exists()


@pytest.mark.nightly
def test_a_model_far_from_its_data_exits_1(quarter_car, tmp_path):
    generator = np.random.default_rng(3)
    for name, record in zip(("a", "b"), quarter_car.records, strict=True):
        wild = record["tire_force"].std() * generator.standard_normal(len(record))
        series = TimeSeries.from_channels(
            record.time, {n: (u, record[n]) for n, u in zip(record.names, record.units, strict=True)}
        ).with_channel("ride_height", "m", 1e-6 * wild)
        RigTest(series).write(tmp_path / f"{name}.parquet")
    result = _identify(tmp_path / "a.parquet", tmp_path / "b.parquet", "-o", tmp_path / "car.json", "--plot", "none")
    assert result.exit_code == 1, result.output
    assert "ride_height" in result.output


def test_measured_forces_are_compared_with_the_laws_of_given_shocks(files, tmp_path):
    law = read_shock(Path(__file__).parents[2] / "examples" / "bank" / "B_B.json").law
    write_shock(Shock("other", replace(law, port=replace(law.port, motion_ratio=2.0))), tmp_path / "other.json")
    result = _identify(*files, "--set", f"shocks={tmp_path / 'other.json'}", "-o", tmp_path / "corner.json")
    assert result.exit_code == 2
    assert "no given shock has the force of force" in " ".join(result.output.split())
