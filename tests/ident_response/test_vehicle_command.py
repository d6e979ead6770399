"""Tests of `eightpost vehicle` and of its parameter study."""

import numpy as np
import pytest
from click.testing import CliRunner

from eightpost.__main__ import main
from eightpost.errors import InputError
from eightpost.ident.vehicle.frequency_response import read_response
from eightpost.ident.vehicle.variants import variants_of
from eightpost.vehicle import StructuralVehicle, read_vehicle, shipped

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
