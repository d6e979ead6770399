"""Rig records have the channels of Table 6.1, are written and read, and faults are refused."""

import numpy as np
import pytest
from click.testing import CliRunner

from eightpost.__main__ import main
from eightpost.corners import CORNERS
from eightpost.errors import (
    ClippedChannelError,
    ConstantChannelError,
    MissingChannelError,
    TimeGapError,
    TooShortError,
    WrongSignError,
)
from eightpost.files import sha256_of
from eightpost.rig import MismatchedRateError, RigConditions, RigTest, read_rig_test
from eightpost.rig.rig_test import check_rig_record
from eightpost.signals import ChannelMap, TimeSeries
from eightpost.virtual import NO_DRIFT, LinearDamper, RigSensors, random_drive, run_test, stand_in_truth

SHOCKS = (LinearDamper(3500.0),) * 4


@pytest.fixture(scope="module")
def record():
    car = stand_in_truth()
    conditions = RigConditions(drivefile="random", shocks=("20 lbf.s/in",) * 4, synthetic="SYNTHETIC")
    return run_test(car, random_drive(car, 1, duration=4.5), SHOCKS, lead=0.5, conditions=conditions)


def changed(record, tmp_path, changes, *, keep=slice(None)):
    """Write the record with some channels replaced and samples omitted."""
    series = record.series
    channels = {n: (u, row) for n, u, row in zip(series.names, series.units, series.values, strict=True)}
    for name, values in changes.items():
        channels[name] = (series.unit(name), values)
    channels = {n: (u, row[keep]) for n, (u, row) in channels.items()}
    path = tmp_path / "rig.parquet"
    RigTest(TimeSeries.from_channels(series.time[keep], channels)).write(path)
    return path


@pytest.mark.slow
def test_a_file_that_was_cut_off_in_its_last_sample_says_so(record, tmp_path):
    path = tmp_path / "rig.csv"
    short = RigTest(record.series.window(0.0, 5.0))
    short.write(path)
    assert read_rig_test(path).notes == ()
    path.write_text(path.read_text(encoding="utf-8")[:-200], encoding="utf-8")
    cut = read_rig_test(path)
    assert any("the last sample" in note and "not complete" in note for note in cut.notes)
    assert len(cut.series) == len(short.series) - 1
    assert "not complete" in CliRunner().invoke(main, ["inspect", str(path)]).output


@pytest.mark.repeated
@pytest.mark.parametrize("actuator", ["lf.road", "rr.road", "lr.aero"])
def test_a_test_of_one_actuator_is_accepted_although_the_others_are_at_rest(tmp_path, actuator):
    car = stand_in_truth()
    single = run_test(car, random_drive(car, 1, duration=8.0, active=(actuator,)), SHOCKS, lead=0.5)
    single.write(tmp_path / "single.parquet")
    assert read_rig_test(tmp_path / "single.parquet").series.names == single.series.names


def test_a_record_has_the_62_channels_of_table_6_1(record):
    assert len(record.series.names) == 62
    assert record.series.sample_rate == pytest.approx(1250.0)


def test_a_record_is_read_back_from_its_file_with_conditions_and_digest(record, tmp_path):
    path = tmp_path / "rig.parquet"
    record.write(path)
    again = read_rig_test(path)
    assert again.conditions == record.conditions
    assert again.sha256 == sha256_of(path)
    assert again.series.names == record.series.names
    assert again.series["lf.tire_force"] == pytest.approx(record.series["lf.tire_force"], rel=1e-6)


def test_heave_of_the_aeroloaders_is_the_chassis_height_over_the_reference_point(record):
    series = record.series
    mean = np.mean([series[f"{c}.aero"] for c in CORNERS], axis=0)
    assert series["aero.heave_force"] == pytest.approx(-4.0 * mean)
    assert (
        np.corrcoef(series["aero.heave"], np.mean([series[f"{c}.aero_position"] for c in CORNERS], axis=0))[0, 1] > 0.9
    )


def test_the_derived_shock_velocity_is_the_slope_of_the_potentiometer(record):
    series = record.series
    moved = np.cumsum(series["lr.velocity"]) / 1250.0
    pot = series["lr.displacement"]
    assert np.std(moved - moved.mean() - pot + pot.mean()) < 0.05 * np.std(pot)


def test_runs_are_identical_without_noise_and_drift_and_differ_with_them():
    car = stand_in_truth()
    drive = random_drive(car, 1, duration=0.2)

    def run(seed, **options):
        return run_test(car, drive, SHOCKS, seed=seed, lead=0.1, **options).series.values

    quiet = {"sensors": RigSensors.perfect(), "drift": NO_DRIFT}
    assert np.array_equal(run(1, **quiet), run(2, **quiet))
    assert np.array_equal(run(1), run(1))
    assert not np.array_equal(run(1), run(2))


def test_a_file_of_another_program_is_read_with_a_short_channel_map(record, tmp_path):
    series = record.series
    names = [f"{c}.{q}" for c in CORNERS for q in ("road", "tire_force", "force", "displacement")]
    own = {name.replace(".", "_").upper(): ("m" if series.unit(name) == "m" else "N", series[name]) for name in names}
    own["LF_FORCE"] = ("N", -series["lf.force"])
    path = tmp_path / "team.parquet"
    RigTest(TimeSeries.from_channels(series.time, own)).write(path)
    lines = [f'[channels."{n}"]\nsource = "{n.replace(".", "_").upper()}"' for n in names]
    text = "\n".join(lines).replace('source = "LF_FORCE"', 'source = "LF_FORCE"\ngain = -1.0')
    (tmp_path / "map.toml").write_text(text)
    test = read_rig_test(path, channel_map=ChannelMap.read(tmp_path / "map.toml"))
    assert test.series["lf.force"] == pytest.approx(series["lf.force"], rel=1e-5)
    assert any(text.startswith("lf.velocity from lf.displacement") for text in test.derived)


def test_the_map_beside_records_is_read_for_those_with_its_columns(record, tmp_path):
    (tmp_path / "rig_map.toml").write_text('[channels."lf.road"]\nsource = "Left [m]"\ngain = -1.0')
    series = record.series
    record.write(tmp_path / "rig.parquet")
    assert read_rig_test(tmp_path / "rig.parquet").series["lf.road"] == pytest.approx(series["lf.road"], rel=1e-5)
    names = {name: name.replace("lf.road_command", "Left") for name in series.names if name != "lf.road"}
    path = tmp_path / "own.parquet"
    RigTest(TimeSeries.from_channels(series.time, {names[n]: (series.unit(n), series[n]) for n in names})).write(path)
    test = read_rig_test(path, needs=(("tire_force",),), flip=["lf.road"])
    assert test.series["lf.road"] == pytest.approx(series["lf.road_command"], rel=1e-5)
    assert "lf.road" not in read_rig_test(path, channel_map=ChannelMap(), needs=(("tire_force",),)).series


def test_the_error_lists_a_missing_channel_and_the_existing_ones(record, tmp_path):
    path = tmp_path / "rig.parquet"
    RigTest(record.series.select([n for n in record.series.names if n != "rf.force"])).write(path)
    with pytest.raises(MissingChannelError, match=r"rf\.force.*name its column"):
        read_rig_test(path)


def test_a_record_with_fewer_needs_is_read_and_names_what_it_could_not_check(record, tmp_path):
    path = tmp_path / "rig.parquet"
    hubs = [f"{corner}.hub_acceleration" for corner in CORNERS]
    RigTest(record.series.select([*hubs, *(f"{corner}.velocity" for corner in CORNERS), "lf.force"])).write(path)
    test = read_rig_test(path, needs=())
    assert test.corners == CORNERS and test.derived == ()
    assert {*hubs, "lf.force"} <= set(test.unchecked)
    assert read_rig_test(changed(record, tmp_path, {})).unchecked == ()


def test_a_velocity_that_was_derived_from_a_displacement_is_no_check_of_it(record, tmp_path):
    path, pots = tmp_path / "rig.parquet", tuple(f"{corner}.displacement" for corner in CORNERS)
    RigTest(record.series.select(pots)).write(path)
    assert read_rig_test(path, needs=()).unchecked == pots
    RigTest(record.series.select([*pots, *(f"{corner}.force" for corner in CORNERS)])).write(path)
    assert read_rig_test(path, needs=()).unchecked == ()


def test_a_record_with_fewer_needs_still_has_its_channels_checked(record, tmp_path):
    path = tmp_path / "rig.parquet"
    reversed_force = {"lr.force": ("N", -record.series["lr.force"])}
    names = [f"{corner}.{name}" for corner in CORNERS for name in ("force", "velocity")]
    channels = {name: (record.series.unit(name), record.series[name]) for name in names} | reversed_force
    RigTest(TimeSeries.from_channels(record.series.time, channels)).write(path)
    with pytest.raises(WrongSignError, match=r"lr\.force.*wrong sign"):
        read_rig_test(path, needs=())


def test_a_file_without_a_channel_of_a_rig_is_refused_with_its_columns(tmp_path):
    path = tmp_path / "rig.csv"
    path.write_text("time [s],speed [m/s]\n" + "".join(f"{k / 500},{k}\n" for k in range(3000)))
    with pytest.raises(MissingChannelError, match=r"no channel of a rig; the file has: time, speed; name its columns"):
        read_rig_test(path, needs=())


#: Changed channels, samples that remain, and the error.
BROKEN = {
    "constant": (lambda s: {"rf.hub_acceleration": np.full(len(s), 0.1)}, slice(None),
                 ConstantChannelError, r"rf\.hub_acceleration.*cable"),
    "clipped": (lambda s: {"rr.tire_force": np.minimum(s["rr.tire_force"], np.quantile(s["rr.tire_force"], 0.95))},
                slice(None), ClippedChannelError, r"rr\.tire_force.*highest.*larger range"),
    "slower logger": (lambda s: {"lf.displacement": np.repeat(s["lf.displacement"][::5], 5)[: len(s)]}, slice(None),
                      MismatchedRateError, r"lf\.displacement.*every 5 samples.*250 Hz.*1250 Hz"),
    "dropped samples": (lambda s: {}, np.r_[0:2000, 2010:5000], TimeGapError, r"gap of 0\.0088 s"),
    "short": (lambda s: {}, slice(0, 2001), TooShortError, r"over 1\.6 s"),
}  # fmt: skip


@pytest.mark.parametrize("fault", BROKEN)
def test_a_record_with_a_fault_is_refused_with_its_channel(fault, record, tmp_path):
    change, keep, error, message = BROKEN[fault]
    with pytest.raises(error, match=message):
        read_rig_test(changed(record, tmp_path, change(record.series), keep=keep))


def test_a_reversed_channel_is_flipped_by_its_name(record, tmp_path):
    path = changed(record, tmp_path, {"lr.force": -record.series["lr.force"]})
    assert read_rig_test(path, flip=["lr.force"]).series["lr.force"] == pytest.approx(
        record.series["lr.force"], rel=1e-5
    )


def test_noise_of_a_car_at_rest_is_not_a_wrong_sign():
    generator, time = np.random.default_rng(4), np.arange(6000) / 1250.0
    names = ("road", "tire_force", "force", "displacement", "velocity")
    channels = {n: ({"road": "m", "displacement": "m", "velocity": "m/s"}.get(n, "N"), 0.0 * time) for n in names}
    channels = {n: (unit, generator.standard_normal(time.size)) for n, (unit, _) in channels.items()}
    check_rig_record(TimeSeries.from_channels(time, channels), ("",))
