"""Channels that contradict mechanics are named, with the size of the fault; sound records have no finding."""

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import norm, t

from eightpost.corners import CORNERS
from eightpost.ident.preparation import advance_channels
from eightpost.ident.preparation.channel_faults import RULES, clipped, spikes
from eightpost.ident.preparation.mechanics import (
    HUB,
    SIGNIFICANT,
    Comparison,
    Kind,
    Spectra,
    comparisons,
    few_blocks_factor,
    spectra_of,
)
from eightpost.ident.preparation.plausibility import findings_of, is_broadband, record_findings
from eightpost.signals import TimeSeries
from eightpost.vehicle import read_vehicle
from eightpost.verdict import Grade

from ..linear_rig import DAMPING, record
from .test_bad_rig_files import run, written

WRONG_SCALE, WRONG_SIGN, WRONG_DELAY, SWAPPED, DISCONNECTED, CLIPPED, SPIKES, _ = RULES
QUANTITIES = ("road", "tire_force", "displacement", "velocity", "force", "hub_acceleration", "chassis_acceleration")
CHANNELS = tuple(f"{corner}.{quantity}" for corner in CORNERS for quantity in QUANTITIES)


@pytest.fixture(scope="module")
def sound():
    return record("seven_dof", seconds=24.0).series


def with_row(series, name, values):
    return series.with_channel(name, series.unit(name), values)


def only(found):
    (one,) = found
    return one


@pytest.fixture(scope="module")
def eight_post(sound):
    """Return the record with four aeroloaders instead of loads on the body; their warp moves no rigid body."""
    loads = ("heave_force", "roll_moment", "pitch_moment")
    rows = {name: (sound.unit(name), sound[name]) for name in sound.names if name not in loads}
    up, roll, pitch = (sound[name] / 4.0 for name in loads)
    warp = 7.0 * np.convolve(np.random.default_rng(3).standard_normal(len(sound)), np.ones(200), "same")
    for corner, left, front in zip(CORNERS, (1.0, -1.0, 1.0, -1.0), (1.0, 1.0, -1.0, -1.0), strict=True):
        rows[f"{corner}.aero"] = ("N", -up - left * roll + front * pitch + left * front * warp)
    return TimeSeries.from_channels(sound.time, rows)


def exchanged(series, first, second):
    return with_row(with_row(series, first, series[second]), second, series[first])


@pytest.mark.parametrize("name", ["seven_dof", "quarter_car"])
def test_a_sound_record_has_no_finding(name):
    test = record(name, seconds=24.0, seed=4)
    assert record_findings(test.series, test.corners) == ()


def test_sensors_that_are_late_by_0_6_ms_and_wrong_by_0_8_percent_are_sound(eight_post):
    generator, series = np.random.default_rng(5), eight_post
    for name in CHANNELS:
        series = with_row(series, name, generator.uniform(0.992, 1.008) * series[name])
    late = {name: float(generator.uniform(-6e-4, 0.0)) for name in CHANNELS if not name.endswith("velocity")}
    late |= {f"{corner}.velocity": late[f"{corner}.displacement"] for corner in CORNERS}
    assert record_findings(advance_channels(series, late), CORNERS) == ()


@pytest.mark.parametrize(
    "pair",
    [
        ("front.ride_height", "rear.ride_height"),
        ("rf.chassis_acceleration", "lr.chassis_acceleration"),
        ("rf.aero", "lf.aero"),
    ],
)
def test_two_channels_that_are_swapped_are_named_and_nothing_else(eight_post, pair):
    found = only(record_findings(exchanged(eight_post, *pair), CORNERS))
    assert (found.rule, set(found.channels)) == (SWAPPED, set(pair))


@pytest.mark.parametrize(
    ("name", "size"), [("rr.hub_acceleration", 0.01), ("lr.aero", 1.0), ("lf.road", 1.0), ("rf.force", 1.0)]
)
def test_a_channel_that_carries_noise_is_named_and_not_those_that_depend_on_it(sound, eight_post, name, size):
    series = eight_post if name.endswith("aero") else sound
    noise = size * series[name].std() * np.random.default_rng(0).standard_normal(len(series))
    found = only(record_findings(with_row(series, name, noise), CORNERS))
    assert (found.rule, found.channels) == (DISCONNECTED, (name,))


def test_a_potentiometer_that_reads_10_percent_more_than_its_sibling_is_named(sound):
    """Nothing tells a large left one from a small right one but the balance of forces."""
    series = sound
    for name in ("lf.displacement", "lf.velocity"):
        series = with_row(series, name, 1.1 * sound[name])
    found = only(record_findings(series, CORNERS))
    assert found.rule == WRONG_SCALE
    assert "lf.displacement" in found.figure


def test_the_flat_top_of_one_peak_is_not_clipped(sound):
    values = sound["lf.displacement"].copy()
    values[12_500:12_600] = 1.01 * values.max()
    assert list(clipped(with_row(sound, "lf.displacement", values))) == []


def test_a_value_that_is_repeated_for_60_ms_is_a_dropout(sound):
    name = "rf.tire_force"
    values = sound[name].copy()
    values[12_500:12_576] = values[12_500]
    found = only(record_findings(with_row(sound, name, values), CORNERS))
    assert (found.rule, found.channels) == (SPIKES, (name,))
    assert "repeats one value from 10 s to 10.06 s" in found.figure


def at_all_corners(*quantities):
    return tuple(f"{corner}.{quantity}" for corner in CORNERS for quantity in quantities)


@pytest.mark.parametrize(
    ("channels", "named"),
    [
        (("lf.displacement", "lf.velocity", "lf.force"), "all channels of the shock lf"),
        (at_all_corners("displacement", "velocity", "force"), "force and displacement of all shocks"),
        (at_all_corners("force"), "force of all corners"),
        (at_all_corners("hub_acceleration", "chassis_acceleration"), "all accelerations"),
        (at_all_corners("road", "hub_acceleration", "chassis_acceleration"), "all roads and accelerations"),
    ],
    ids=["one shock", "all shocks", "all forces", "accelerations", "downwards"],
)
def test_a_sign_convention_of_the_team_is_named_as_one_finding(sound, channels, named):
    series = sound
    for name in channels:
        series = with_row(series, name, -sound[name])
    found = [one for one in record_findings(series, CORNERS) if not one.channels[0].endswith("ride_height")]
    assert [(one.rule, set(one.channels)) for one in found] == [(WRONG_SIGN, set(channels))]
    assert f"the sign convention of {named} is reversed: with the opposite one they agree" in only(found).figure
    measured = [name for name in channels if not name.endswith("velocity")]
    assert all(name in only(found).remedy for name in measured)
    assert "velocity" not in only(found).remedy


@pytest.mark.nightly
@settings(max_examples=6, deadline=None)
@given(name=st.sampled_from(CHANNELS), delay=st.floats(4.0, 9.0), late=st.booleans())
def test_a_delay_of_any_channel_is_named_with_its_size(sound, name, delay, late):
    seconds = 1e-3 * (delay if late else -delay)
    found = only(record_findings(advance_channels(sound, {name: -seconds}), CORNERS))
    assert (found.rule, found.channels) == (WRONG_DELAY, (name,))
    assert float(found.remedy.split("delay of ")[1].split(" s")[0]) == pytest.approx(seconds, abs=1.5e-3)


@pytest.mark.parametrize(("share", "is_early"), [(1.0, True), (0.5, False)])
def test_a_force_may_lead_the_more_the_softer_its_shock_is(sound: TimeSeries, share: float, is_early: bool) -> None:
    soft = with_row(sound, "rf.tire_force", sound["rf.tire_force"] - (1.0 - share) * sound["rf.force"])
    soft = advance_channels(with_row(soft, "rf.force", share * soft["rf.force"]), {"rf.force": 1.8e-3})
    spectra = spectra_of(soft)
    assert spectra is not None
    of_others = [one for one in comparisons(spectra, CORNERS) if one.law.startswith(f"{HUB} at")]
    found = only(one for one in of_others if one.kind is Kind.DELAY and "rf.force" in one.effect)
    assert found.value == pytest.approx(-1.7e-3, abs=0.2e-3)
    assert found.is_violated == is_early


@pytest.mark.nightly
def test_a_command_that_carries_noise_is_named(sound):
    """The noise is small within the band, so that the command alone would be that of a corner at rest."""
    commanded, name = sound, "lf.road_command"
    for corner in CORNERS:
        commanded = commanded.with_channel(f"{corner}.road_command", "m", sound[f"{corner}.road"])
    noise = sound["lf.road"].std() * np.random.default_rng(0).standard_normal(len(sound))
    assert record_findings(commanded, CORNERS) == ()
    found = only(record_findings(with_row(commanded, name, noise), CORNERS))
    assert (found.rule, found.channels) == (DISCONNECTED, (name,))


@pytest.mark.parametrize("name", ["rr.displacement", "lr.chassis_acceleration"])
def test_a_spike_of_8_standard_deviations_is_named_with_its_time(sound, name):
    values = sound[name].copy()
    values[12_500] += 8.0 * values.std()
    found = only(record_findings(with_row(sound, name, values), CORNERS))
    assert (found.rule, found.channels) == (SPIKES, (name,))
    assert "at 10 s" in found.figure


def test_a_bump_that_several_channels_see_is_no_spike(sound):
    bumped = sound
    for name in ("lf.tire_force", "lf.hub_acceleration"):
        values = sound[name].copy()
        values[12_500] += 8.0 * values.std()
        bumped = with_row(bumped, name, values)
    assert not [one for one in record_findings(bumped, CORNERS) if one.rule is SPIKES]


def test_friction_that_reverses_is_a_kink_of_an_acceleration_and_no_spike(sound):
    """The force drops within four samples and stays there, or rises to breakaway and drops."""
    kinked, height = sound, 4.0 * float(sound["lf.hub_acceleration"].std())
    for name, shape in (
        ("lf.hub_acceleration", np.clip(np.arange(-3.0, 25_000.0) / 3.0, 0.0, 1.0)),
        ("rr.hub_acceleration", np.exp(-np.arange(25_003.0) / 200.0)),
    ):
        values = sound[name].copy()
        for place in (5000, 12_500, 20_000):
            values[place:] += height * shape[: values.size - place]
        kinked = with_row(kinked, name, values)
    assert list(spikes(kinked)) == []


def test_a_deviation_of_few_blocks_is_exceeded_as_rarely_as_a_known_one():
    for blocks in (6, 9, 16):
        limit = SIGNIFICANT * few_blocks_factor(blocks)
        assert t.sf(limit, blocks - 1) == pytest.approx(norm.sf(SIGNIFICANT), rel=1e-6)
    assert few_blocks_factor(9) > few_blocks_factor(16) > few_blocks_factor(10_000) == pytest.approx(1.0, abs=0.01)


def test_pots_and_load_cells_that_are_swapped_together_are_named(sound):
    series, pair = sound, ("rf", "lr")
    for quantity in ("displacement", "velocity", "force"):
        first, second = (f"{corner}.{quantity}" for corner in pair)
        series = with_row(with_row(series, first, sound[second]), second, sound[first])
    found = only(record_findings(series, CORNERS))
    assert found.rule is SWAPPED
    assert found.figure.startswith(f"{pair[0]} and {pair[1]} are swapped in displacement, velocity, force")


def test_a_test_of_one_actuator_is_not_checked_against_mechanics():
    test = record("seven_dof", seconds=24.0, active=("lr.road",))
    assert record_findings(test.series, CORNERS) == ()


@pytest.mark.parametrize(("noise", "expected"), [(0.1, False), (1.0, True)])
def test_a_drive_is_broadband_unless_one_line_has_most_of_its_power(noise, expected):
    frequencies = 1.0 + np.arange(40.0)
    acceleration = np.where(np.arange(40) == 20, 1.0, np.full((8, 40), noise))
    road = acceleration / (2.0 * np.pi * frequencies) ** 2
    assert is_broadband(Spectra(frequencies, {"road": road, "tire_force": 3e5 * road}), [""]) is expected


@pytest.mark.nightly
def test_inspect_checks_all_forces_by_the_mass_of_the_car(sound, tmp_path):
    path = written(sound, tmp_path / "rig.parquet")
    assert run("inspect", path)[0] == 0
    code, said = run("inspect", path, "--mass", "2300 lbm")
    assert code == 1, said
    named = re.search(r"warning all forces are ([\d.]+) times", said)
    assert named is not None, said
    assert float(named[1]) == pytest.approx(1360.0 / 1043.3, rel=0.03)
    assert run("inspect", path, "--mass", "1360 kg")[0] == 0


@pytest.mark.nightly
def test_identify_marks_a_vehicle_from_wrong_forces_as_not_usable(tmp_path):
    files = []
    for seed, damping in ((1, DAMPING), (2, 1.6 * DAMPING)):
        series = record("quarter_car", seconds=24.0, seed=seed, damping={"": damping}).series
        files.append(written(with_row(series, "tire_force", 1.5 * series["tire_force"]), tmp_path / f"{seed}.parquet"))
    code, said = run("-v", "identify", *files, "-o", tmp_path / "car.json")
    assert code == 1, said
    named = re.search(r"not usable rig record: a channel has the wrong scale: tire_force is ([\d.]+) times", said)
    assert named is not None, said
    assert float(named[1]) == pytest.approx(1.5, rel=0.03)
    validity = read_vehicle(tmp_path / "car.json").validity
    assert validity is not None
    assert validity.verdict.grades["rig record"] is Grade.NOT_USABLE


def test_a_law_that_no_single_channel_explains_is_stated_once_with_its_worst_figure():
    """Scores of 10, 20 and 30 tolerances: the law that is violated twice is stated with the larger one."""
    gain = Comparison("law a", Kind.GAIN, np.log(1.5), np.log(1.05), 0.0, {"lf.force": 1.0, "rf.force": -1.0})
    late = Comparison("law b", Kind.DELAY, -0.03, 1e-3, 0.0, {"lf.road": 1.0})
    first, second = findings_of([], [gain, gain._replace(value=np.log(0.4)), late, late._replace(value=0.02)])
    assert first.channels == ("lf.force", "rf.force")
    assert first.figure == (
        "lf.force, rf.force contradict law a: a ratio is 0.4 of its expected value (limit 1.05), and no single channel "
        "explains it"
    )
    assert "lf.road contradict law b: a delay is -30 ms (limit 1 ms)" in second.figure
