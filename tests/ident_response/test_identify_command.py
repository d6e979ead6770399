"""Tests of `eightpost identify`: the vehicle that it writes, and its messages for bad files."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from eightpost.__main__ import main
from eightpost.errors import InputError
from eightpost.ident.vehicle.frequency_response import read_response
from eightpost.ident.vehicle.variants import variants_of
from eightpost.ident.vehicle.vehicle_fit import read_fit
from eightpost.rig import RigTest
from eightpost.shock import Shock, read_shock, write_shock
from eightpost.signals import TimeSeries
from eightpost.vehicle import StructuralVehicle, read_vehicle, shipped

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
    options = ("--plot", "none", "--set", "recipe=boggs", "-v", "-o", tmp_path / "c.json")
    result = _identify(*files, "--preparation", tmp_path / "prep.toml", *options)
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


F = np.linspace(0.1, 25.0, 500)


def _vehicle(*words):
    return CliRunner().invoke(main, ["vehicle", *[str(word) for word in words]])


def _quarter_car():
    found = read_vehicle(shipped("quarter_car"))
    assert isinstance(found, StructuralVehicle)
    return found


def test_damping_reduces_the_resonance_and_increases_the_response_above_it_as_in_fig_4_2():
    soft, hard = variants_of(_quarter_car(), "damping", [0.5, 3.0], F).values()
    low, high = (np.abs(variant.response.between("tire_force", "road")) for variant in (soft, hard))
    assert high[np.argmin(np.abs(F - 3.0))] < low[np.argmin(np.abs(F - 3.0))]
    assert high[np.argmin(np.abs(F - 8.0))] > low[np.argmin(np.abs(F - 8.0))]


def test_stiffness_increases_the_frequency_and_reduces_the_damping_ratio_as_in_fig_4_4():
    variants = variants_of(_quarter_car(), "suspension_stiffness", [0.5, 1.0, 3.0], F)
    modes = [variant.modes[0] for variant in variants.values()]
    assert [m.frequency_hz for m in modes] == sorted(m.frequency_hz for m in modes)
    assert [m.damping_ratio for m in modes] == sorted((m.damping_ratio for m in modes), reverse=True)


@pytest.mark.nightly
def test_the_command_prints_the_modes_and_writes_plots_and_responses(tmp_path):
    done = _vehicle(shipped("quarter_car"), "-o", tmp_path)
    assert done.exit_code == 0, done.output
    assert "3.039 Hz 5.82 %" in done.output
    assert "18.452 Hz 40.16 %" in done.output
    for name in ("velocity", "tire_force", "ride_height"):
        assert (tmp_path / f"{name}.png").read_bytes()[:4] == b"\x89PNG"
    response = read_response(tmp_path / "response.npz")
    model = _quarter_car().with_damper()
    np.testing.assert_array_equal(response.H, model.frequency_response(response.frequency))


def test_the_command_warns_of_pounds_per_inch_typed_as_newtons_per_millimetre(tmp_path):
    text = shipped("quarter_car").read_text(encoding="utf-8")
    (tmp_path / "car.toml").write_text(text.replace('lbf/in"', 'N/mm"'), encoding="utf-8")
    for path, warns in ((tmp_path / "car.toml", True), (shipped("quarter_car"), False)):
        done = _vehicle(path, "--output", "none", "-o", tmp_path)
        shown = " ".join(done.output.split())
        assert ("which look like lbf/in typed as N/mm: 1280 lbf/in = 224 N/mm" in shown) is warns
        assert ("warning: wheel-hop frequency 43.8 Hz" in shown) is warns


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--vary", "colour"], "has no parameter 'colour'"),
        (["--vary", "damping", "--factors", "a,b"], "give numbers separated by commas"),
        (["--output", "rf.velocity"], "unknown output 'rf.velocity'"),
        (["--high", "-1 Hz"], "give a frequency"),
    ],
)
def test_wrong_arguments_exit_2_with_a_remedy(tmp_path, words, message):
    done = _vehicle(shipped("quarter_car"), *words, "-o", tmp_path)
    assert done.exit_code == 2
    assert message in " ".join(done.output.split())


def test_a_parameter_that_is_not_given_cannot_be_varied():
    car = read_vehicle(shipped("seven_dof"))
    assert isinstance(car, StructuralVehicle)
    with pytest.raises(InputError, match="cannot be varied"):
        variants_of(car, "driver_ahead_of_cg", [1.0], F)
