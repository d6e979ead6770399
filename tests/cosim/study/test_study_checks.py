"""Invalid studies are refused before any simulation."""

from dataclasses import replace

import pytest

from cosim.study import Build, Drive, Measure, Term, Vehicle
from cosim.study.running.sweep import Sweep
from eightpost.corners import CORNERS
from eightpost.errors import FmuError, InputError, StepError, WiringError

HEIGHT = ("car.front.ride_height",)


@pytest.fixture
def refused(small_study, tmp_path):
    """Return a function refused(error, message, **changes) that checks that a study is refused."""

    def check(error, message, **changes):
        with pytest.raises(error, match=message):
            Sweep(small_study(**changes), tmp_path / "out")
        assert not (tmp_path / "out").exists()

    return check


def test_a_corner_without_a_shock_is_refused(refused):
    refused(InputError, "rr has no shock", corners=dict.fromkeys(CORNERS[:3], ("soft",)))


def test_a_corner_that_the_vehicle_does_not_have_is_refused(refused):
    refused(InputError, "no port 'middle'", corners=dict.fromkeys((*CORNERS, "middle"), ("soft",)))


def test_a_build_with_a_missing_file_is_refused(refused, tmp_path):
    bank = {"soft": Build(tmp_path / "none.fmu"), "stiff": Build(tmp_path / "none.fmu")}
    refused(FmuError, "none.fmu", bank=bank)


def test_a_build_that_is_not_a_shock_is_refused(refused, fmus):
    refused(WiringError, "has no variable 'velocity'", bank=dict.fromkeys(("soft", "stiff"), Build(fmus["seven_dof"])))


def test_a_parameter_that_a_shock_does_not_have_is_refused(refused, fmus):
    bank = {"soft": Build(fmus["lpnl2"]), "stiff": Build(fmus["lpnl2"], {"stifness": 1.0})}
    refused(WiringError, "no variable 'stifness'", bank=bank)


def test_a_measure_of_an_unknown_channel_is_refused(refused):
    message = r"measure 'camber': car\.lf\.camber: component 'car' has no variable 'lf.camber'"
    refused(WiringError, message, measures=(Measure("camber", ("car.lf.camber",)),))


def test_a_measure_with_a_display_unit_of_another_dimension_is_refused(refused):
    refused(
        InputError, "cannot be converted to the display unit 'lbf'", measures=(Measure("h", HEIGHT, display="lbf"),)
    )


def test_an_objective_with_a_weight_unit_of_another_dimension_is_refused(refused):
    terms = (Term("front ride height, RMS", 1.0, "lbf"),)
    refused(InputError, "cannot be converted to 'lbf', the unit of its weight", objective=terms)


@pytest.mark.parametrize("statistic", ["mean", "variation", "maximum", "rms_with_mean"])
def test_a_mean_is_refused_if_the_vehicles_gain_at_0_hz_is_not_trusted(refused, fmus, statistic):
    untrusted = Vehicle(fmus["seven_dof"], means_trusted=False)
    refused(InputError, "no trusted gain at 0 Hz", vehicle=untrusted, measures=(Measure("h", HEIGHT, statistic),))


def test_measures_independent_of_the_mean_need_no_trusted_gain_at_0_hz(small_study, fmus, tmp_path):
    untrusted = Vehicle(fmus["seven_dof"], means_trusted=False)
    measures = (Measure("r", HEIGHT), Measure("p", HEIGHT, "peak"), Measure("m", HEIGHT, "mean", band=(0.5, 9.0)))
    assert Sweep(small_study(vehicle=untrusted, measures=measures), tmp_path / "out").left == 16


def test_a_section_beyond_the_run_is_refused(refused):
    refused(InputError, "section 1 to 9 s must lie", measures=(Measure("h", HEIGHT, section=(1.0, 9.0)),))


def test_a_band_above_the_recorded_frequencies_is_refused(refused):
    refused(InputError, "smaller record_step", measures=(Measure("h", HEIGHT, band=(1.0, 200.0)),))


def test_a_user_defined_measure_that_does_not_exist_is_refused(refused):
    refused(InputError, "no Python file", measures=(Measure("h", HEIGHT, function="none.py:f"),))


def test_a_run_beyond_the_end_of_its_drive_file_is_refused(refused, small_study):
    drive = small_study().drives[0]
    refused(InputError, "contains 0 to 30 s", drives=(replace(drive, start=28.0),))


def test_a_drive_with_an_unknown_target_is_refused(refused, small_study):
    drive = small_study().drives[0]
    refused(WiringError, "nowhere", drives=(replace(drive, targets={"lf.road": "car.nowhere"}),))


def test_a_study_without_drives_or_with_duplicate_drive_names_is_refused(refused, small_study):
    drive: Drive = small_study().drives[0]
    refused(InputError, "has no drive", drives=())
    refused(InputError, "two drives are called 'track'", drives=(drive, drive))


def test_an_fmu_that_fails_in_every_setup_ends_the_study_with_its_message(small_study, here, fmus, tmp_path):
    bad = Build(fmus["lpnl2"], {"lag_full_force": 2000.0, "lag_zero_force": 1000.0})
    sweep = Sweep(small_study(bank={"soft": bad, "stiff": bad}), tmp_path / "out")
    with pytest.raises(StepError, match=r"no setup could be run.*lag_zero_force"):
        sweep.coupling(here)
