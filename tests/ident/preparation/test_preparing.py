"""Tests of the preparation: decimation, math channels and synchronisation keep the band, and every step is reported."""

import re
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import cheby1, sosfreqz

from eightpost.corners import CORNERS
from eightpost.errors import ConstantChannelError, InputError, MissingChannelError, ParameterError, TooShortError
from eightpost.ident.preparation import (
    Decimation,
    Preparation,
    advance_channels,
    check_lost_channels,
    drifts,
    prepare,
    read_preparation,
    record_lags,
)
from eightpost.ident.vehicle.estimators import LocalPolynomial, estimate_response
from eightpost.ident.vehicle.frequency_response import contribution_error, response_of
from eightpost.rig import RigTest
from eightpost.rig.geometry import displacement_modes, force_modes
from eightpost.rig.motion import delay_of
from eightpost.signals import TimeSeries
from eightpost.virtual.drivefiles import sine_drive
from eightpost.virtual.program import quarter_truth, run_test, stand_in_truth
from eightpost.virtual.shocks import LinearDamper
from tests.unchanged import refusals

from ..linear_rig import RATE, car, record, spectrum


@pytest.fixture(scope="module")
def quarter():
    return record("quarter_car")


@pytest.fixture(scope="module")
def seven():
    return record("seven_dof", seconds=8.0)


def with_channels(test, **changes):
    """Return a test with replaced channels; a double underscore stands for the dot in a name."""
    series = test.series
    for name, values in changes.items():
        series = series.with_channel(name.replace("__", "."), series.unit(name.replace("__", ".")), values)
    return replace(test, series=series)


def test_decimation_keeps_the_band_and_adds_no_aliases():
    decimation = Decimation(125.0)
    time = np.arange(25000) / RATE
    for frequency in (0.5, 5.0, 20.0, 45.0):
        kept = decimation.apply(np.sin(2.0 * np.pi * frequency * time), RATE)[200:-200]
        np.testing.assert_allclose(kept, np.sin(2.0 * np.pi * frequency * time[::10][200:-200]), atol=1.2e-3)
    for frequency in (75.0, 100.0, 130.0):
        folded = decimation.apply(np.sin(2.0 * np.pi * frequency * time), RATE)[200:-200]
        assert np.abs(folded).max() < 1e-3


def test_the_filter_is_that_of_6_4_1_run_twice():
    decimation = Decimation(125.0, ripple=0.05)
    impulse = np.zeros(8001)
    impulse[4000] = 10.0
    found = np.abs(np.fft.rfft(decimation.apply(impulse, RATE)))
    lines = np.fft.rfftfreq(801, 1.0 / 125.0)
    gain = np.abs(sosfreqz(cheby1(8, 0.05, 0.8 * 62.5, fs=RATE, output="sos"), lines, fs=RATE)[1]) ** 2
    inside = lines < 45.0
    np.testing.assert_allclose(found[inside], gain[inside], rtol=2e-3)


def test_a_rate_that_is_not_a_multiple_is_rejected_with_possible_rates():
    with pytest.raises(ParameterError, match=r"1000 Hz cannot be decimated to 300 Hz.*333\.333 or 250 Hz"):
        Decimation(300.0).factor(1000.0)
    with pytest.raises(ParameterError, match="not a multiple"):
        Decimation(125.0).factor(100.0)
    assert Decimation(125.0).factor(1250.3) == 10


def test_responses_of_prepared_records_are_those_of_the_car(quarter):
    prepared = prepare([record("quarter_car", seconds=100.0, noise=1e-4)])
    assert prepared.rate == pytest.approx(125.0)
    outputs = ("velocity", "tire_force")
    found = estimate_response(
        prepared.records, inputs=["road", "aero_force"], outputs=outputs, recipe=LocalPolynomial(high=4.0)
    )
    truth = response_of(car("quarter_car").select(inputs=found.input_names, outputs=outputs), found.frequency)
    assert contribution_error(found, truth, [[0.004**2], [500.0**2]]).max() < 5e-3


def test_means_are_removed_and_stored(quarter):
    lifted = with_channels(quarter, tire_force=quarter.series["tire_force"] + 3000.0)
    prepared = prepare([lifted])
    assert prepared.means[0]["tire_force"] == pytest.approx(lifted.series["tire_force"].mean())
    assert abs(prepared.records[0]["tire_force"].mean()) < 1e-2 * prepared.records[0]["tire_force"].std()


def test_shock_velocities_are_computed_from_the_potentiometer_before_decimation(quarter):
    wrong = with_channels(quarter, velocity=np.zeros(len(quarter.series)))
    velocity = prepare([wrong]).records[0]["velocity"][100:-100]
    truth = quarter.series["velocity"][::10][100:-100]
    assert np.std(velocity - truth) < 0.02 * np.std(truth)


def test_measured_velocities_are_kept_on_request(quarter):
    doubled = with_channels(quarter, velocity=2.0 * quarter.series["velocity"])
    own, derived = (
        prepare([doubled], Preparation(pot_cutoff=cutoff)).records[0]["velocity"] for cutoff in (None, 50.0)
    )
    assert np.std(own) == pytest.approx(2.0 * np.std(derived), rel=0.02)


def test_modes_follow_the_transforms_and_rigid_heave_is_heave():
    geometry = stand_in_truth().geometry
    generator, size = np.random.default_rng(2), 10_000
    heave, load = generator.standard_normal(size), generator.standard_normal((4, size))
    base = record("seven_dof", seconds=size / RATE).series
    for corner, row in zip(CORNERS, load, strict=True):
        base = base.with_channel(f"{corner}.aero_position", "m", heave).with_channel(f"{corner}.aero", "N", row)
        base = base.with_channel(f"{corner}.road", "m", heave)
    made = prepare([RigTest(base)], Preparation(Decimation(RATE), geometry=geometry)).records[0]
    np.testing.assert_allclose(made["aero.heave"], heave - heave.mean(), atol=1e-12)
    for name in ("aero.pitch", "aero.roll", "aero.warp", "front.ride_height", "rear.ride_height"):
        np.testing.assert_allclose(made[name], 0.0, atol=1e-12)
    assert displacement_modes(geometry).shape == (4, 4)
    expected = -(force_modes(geometry) @ load)[2]
    np.testing.assert_allclose(made["aero.roll_moment"], expected - expected.mean(), atol=1e-9)


@pytest.mark.parametrize("seconds", [-0.0131, 0.0004, 0.0077])
def test_a_lag_is_found_to_a_tenth_of_a_sample(seconds):
    samples = 12_500
    generator = np.random.default_rng(1)
    drawn = spectrum(samples, 20.0, generator)
    late = drawn * np.exp(-2j * np.pi * np.fft.rfftfreq(samples, 1.0 / RATE) * seconds)
    lag, correlation, _ = delay_of(np.fft.irfft(late, samples), np.fft.irfft(drawn, samples), RATE, band=20.0)
    assert lag == pytest.approx(seconds, abs=0.1 / RATE)
    assert correlation > 0.98


@pytest.mark.parametrize("name", ["quarter_car", "seven_dof"])
def test_a_record_in_step_has_no_notable_lag(name, request):
    test = request.getfixturevalue("quarter" if name == "quarter_car" else "seven")
    lags = record_lags(test.series, test.corners)
    assert len(lags) == 2 * len(test.corners) + 1
    assert not any(lag.is_notable for lag in lags)
    assert not prepare([test]).notes


def test_a_slow_sine_with_a_flat_correlation_is_not_reported_as_out_of_step():
    """At 1 Hz the pot acceleration of Table 4.4's test barely exceeds its noise: a lag of 10 ms is not significant."""
    truth = quarter_truth()
    slow = run_test(truth, sine_drive(truth, 1.0, 0.0254), [LinearDamper(3000.0)], seed=0).series
    lags = [*record_lags(slow, ("",)), *drifts(slow, ("",))]
    assert max(abs(lag.seconds) for lag in lags) > 2e-3
    assert not any(lag.is_notable for lag in lags)


def test_inboard_shocks_of_a_solid_axle_are_in_step_if_only_one_wheel_moves():
    test = record("seven_dof", seconds=8.0, active=("lr.road",))
    left, right = test.series["lr.displacement"], test.series["rr.displacement"]
    inboard = with_channels(
        test, lr__displacement=0.76 * left + 0.24 * right, rr__displacement=0.24 * left + 0.76 * right
    )
    lags = record_lags(inboard.series, CORNERS)
    assert not any(lag.is_notable for lag in lags)
    assert {lag.channel for lag in lags if lag.correlation > 0.99} > {"lr.displacement", "rr.displacement"}


def test_a_late_logger_is_reported_and_corrected_on_request(seven):
    late = [f"{corner}.{quantity}" for corner in CORNERS for quantity in ("hub_acceleration", "chassis_acceleration")]
    test = replace(seven, series=advance_channels(seven.series, dict.fromkeys(late, -0.0123)))
    prepared = prepare([test])
    pots = [lag for lag in prepared.lags[0] if lag.is_notable]
    assert [lag.channel for lag in pots] == [f"{corner}.displacement" for corner in CORNERS]
    np.testing.assert_allclose([lag.seconds for lag in pots], -0.0123, atol=1e-4)
    assert "lf.displacement is 12.30 ms ahead of the accelerometers" in prepared.notes[0]
    corrected = prepare([test], Preparation(delays=dict.fromkeys(late, 0.0123)))
    assert corrected.notes == ()
    assert "lf.hub_acceleration advanced by 12.3 ms" in corrected.steps


def test_samples_that_a_logger_lost_are_reported_as_a_drift(seven):
    force = seven.series["lf.displacement"]
    lost = np.concatenate((np.delete(force, np.arange(5000, 5020)), np.full(20, force[-1])))
    test = with_channels(seven, lf__displacement=lost)
    (drift,) = [d for d in drifts(test.series, test.corners) if d.channel == "lf.displacement"]
    assert drift.seconds == pytest.approx(-20 / RATE, abs=1e-3)
    assert any("logger lost samples" in note for note in prepare([test]).notes)


def test_runs_of_the_same_drive_are_synchronised(quarter):
    series = quarter.series
    kept = slice(337, None)
    later = RigTest(TimeSeries(series.time[: len(series) - 337], series.values[:, kept], series.names, series.units))
    prepared = prepare([quarter, later], Preparation(same_start="road"))
    first, second = prepared.records
    assert prepared.lags[1][-1].seconds == pytest.approx(-337 / RATE, abs=0.02 / RATE)
    assert len(first) == len(second)


def test_records_of_different_drives_are_not_synchronised(quarter):
    with pytest.raises(InputError, match=r"its road is not that of the first record.*omit same_start"):
        prepare([quarter, record("quarter_car", seed=9)], Preparation(same_start="road"))


def test_a_channel_that_fails_during_the_record_is_reported_with_the_time(seven):
    broken = seven.series["rr.hub_acceleration"].copy()
    broken[4000:6000] = broken[4000]
    with pytest.raises(ConstantChannelError, match=r"rr\.hub_acceleration.*from 3\.2 s to 4\.799 s.*cable"):
        prepare([with_channels(seven, rr__hub_acceleration=broken)])


def test_a_car_at_rest_is_not_reported_as_a_broken_cable(seven):
    series = seven.series
    rest = TimeSeries(series.time, np.where(series.time < 2.0, 0.0, series.values), series.names, series.units)
    check_lost_channels(rest, CORNERS)


def test_tests_of_two_cars_no_test_and_short_tests_are_rejected(quarter, seven):
    with pytest.raises(InputError, match="other corners"):
        prepare([quarter, seven])
    with pytest.raises(InputError, match="give one or more"):
        prepare([])
    with pytest.raises(TooShortError, match="75 samples are left"):
        prepare([quarter], Preparation(settling=9.4))
    with pytest.raises(TooShortError, match="the settling is 20 s"):
        prepare([quarter], Preparation(settling=20.0))
    with pytest.raises(ParameterError, match="settling must not be negative"):
        Preparation(settling=-1.0)


def test_a_delay_of_an_unknown_channel_is_rejected(quarter):
    with pytest.raises(MissingChannelError, match="front_left"):
        prepare([quarter], Preparation(delays={"front_left": 0.01}))


def test_channels_that_not_all_records_have_are_omitted_and_reported(quarter):
    fewer = replace(quarter, series=quarter.series.select([n for n in quarter.series.names if n != "ride_height"]))
    prepared = prepare([quarter, fewer])
    assert "ride_height" not in prepared.channels
    assert any("omitted, because not all records have them: ride_height" in note for note in prepared.notes)


def test_a_record_that_is_given_twice_is_refused_under_whatever_name(quarter):
    one, copy = (replace(quarter, source=Path(f"{name}.csv"), sha256="a1") for name in ("base", "copy"))
    with pytest.raises(InputError, match=r"copy.csv is the same record as base.csv; give every test once"):
        prepare([one, copy])
    with pytest.raises(InputError, match=r"base.csv is the same record as base.csv"):
        prepare([one, replace(one, source=Path("other/base.csv"))])
    assert len(prepare([quarter, quarter]).records) == 2  # records in memory have no digest


def test_what_was_left_out_while_reading_is_a_note(quarter):
    test = replace(quarter, source=Path("base.csv"), notes=("the last sample was left out",))
    assert "base.csv: the last sample was left out" in prepare([test]).notes


def written(folder, text):
    (folder / "prep.toml").write_text(text)
    return folder / "prep.toml"


def test_the_example_of_the_page_is_read(tmp_path):
    page = (Path(__file__).parents[3] / "docs" / "how_to" / "rig_data.md").read_text()
    (block,) = re.findall(r"```toml\n(.*?)```", page, re.DOTALL)
    how = read_preparation(written(tmp_path, block))
    assert (how.decimation.rate, how.pot_cutoff, how.settling, how.same_start) == (125.0, 50.0, 2.0, "lf.road")
    assert how.delays == {"lf.hub_acceleration": pytest.approx(0.0123)}
    assert how.geometry is not None
    assert how.geometry.rear_aero == pytest.approx(45 * 0.0254)


def test_a_file_without_entries_is_the_default_and_own_keeps_velocities(tmp_path):
    assert read_preparation(written(tmp_path, "# as it is")) == Preparation()
    assert read_preparation(written(tmp_path, "pot_cutoff = 'own'")).pot_cutoff is None


WRONG = (
    "",
    "rate = 125",
    "rate = '125'",
    "rate = '125 N'",
    "rate = '1e999 Hz'",
    "rate = '0 Hz'",
    "speed = '1 s'",
    "pot_cutoff = 'its own'",
    "[geometry]\nfront_axle = '60 in'",
    "[geometry]\nfront_axel = '60 in'",
    "delays = 3",
    "[delays]\n'lf.force' = 0.004",
    "same_start = 3",
    "settling = '-1 s'",
)


def test_an_invalid_preparation_is_rejected_with_line_and_key(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, unchanged: Callable[..., None]
) -> None:
    monkeypatch.chdir(tmp_path)

    def read(text: str) -> Preparation:
        return read_preparation(written(Path(), text))

    unchanged(refusals({text.replace("\n", " / "): partial(read, text) for text in WRONG}))
