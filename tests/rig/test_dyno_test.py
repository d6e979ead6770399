"""Dynamometer files are recognised, checked for faults, and completed with derived channels."""

from pathlib import Path

import numpy as np
import pytest

from eightpost import errors
from eightpost.files import sha256_of
from eightpost.rig.dyno_test import DynoConditions, DynoTest, read_dyno_test
from eightpost.signals import ChannelMap, MappedChannel, TimeSeries, write_csv, write_series

TIME = np.arange(1001) / 500.0
OMEGA = 2.0 * np.pi * 2.0
X, V = 0.02 * np.sin(OMEGA * TIME), 0.02 * OMEGA * np.cos(OMEGA * TIME)
F = 2000.0 * V + 100.0


def dyno_file(folder: Path, header: str, *columns: np.ndarray) -> Path:
    path = folder / "run.csv"
    lines = [",".join(f"{value:.9g}" for value in row) for row in zip(*columns, strict=True)]
    path.write_text("\n".join([header, *lines]) + "\n")
    return path


@pytest.mark.parametrize(
    "header",
    [
        "time [s],displacement [m],velocity [m/s],force [N]",
        "t_s,x_m,v_m_s,F_N",
        "Time (s),Position (m),Vel (m/s),Load (N)",
        "TIME [s],Travel [m],V [m/s],Shock Force [N]",
        "T [s],disp [m],vel [m/s],f [N]",
    ],
)
def test_the_usual_names_are_recognised(tmp_path, header):
    test = read_dyno_test(dyno_file(tmp_path, header, TIME, X, V, F))
    assert set(test.series.names) == {"velocity", "force", "displacement"}
    np.testing.assert_allclose(test.series["force"], F, rtol=1e-8)
    np.testing.assert_allclose(test.series["velocity"], V, atol=1e-9)


def test_file_digest_and_conditions_are_stored(tmp_path):
    path = dyno_file(tmp_path, "t [s],x [m],v [m/s],F [N],T [degC]", TIME, X, V, F, TIME + 20.0)
    conditions = DynoConditions(build="1", clicks="1 from closed", gas_pressure=3.4e5)
    test = read_dyno_test(path, conditions=conditions)
    assert (test.source, test.sha256, test.conditions) == (path, sha256_of(path), conditions)
    assert test.derived == ()
    np.testing.assert_allclose(test.series["temperature"], TIME + 293.15)


def test_other_columns_need_no_unit_and_no_numbers(tmp_path):
    path = dyno_file(tmp_path, "t [s],trigger,v [m/s],F [N]", TIME, np.zeros(TIME.size), V, F)
    path.write_text(path.read_text().replace(",0,", ",off,"))
    assert read_dyno_test(path).series.names == ("velocity", "force")


def test_a_missing_velocity_is_derived_and_reported(tmp_path):
    test = read_dyno_test(dyno_file(tmp_path, "t_s,x_m,F_N", TIME, X, F))
    assert test.derived == ("velocity from displacement, low-pass 50 Hz and central differences",)
    np.testing.assert_allclose(test.series["velocity"][50:-50], V[50:-50], atol=1e-3 * V.max())


def test_the_cut_off_frequency_depends_on_the_sample_rate_and_can_be_given(tmp_path):
    path = dyno_file(tmp_path, "t_s,x_m,F_N", 5.0 * TIME, X, F)
    assert "low-pass 40 Hz" in read_dyno_test(path).derived[0]
    assert "low-pass 12 Hz" in read_dyno_test(path, cutoff=12.0).derived[0]


def test_uneven_time_is_resampled_before_velocity_is_derived(tmp_path):
    uneven = TIME + 0.004 * np.sin(3.0 * TIME)
    x = 0.02 * np.sin(OMEGA * uneven)
    test = read_dyno_test(dyno_file(tmp_path, "t_s,x_m,F_N", uneven, x, F))
    assert test.derived[0].startswith("resampled to an even 500")
    assert test.series.is_uniform


def test_a_channel_map_takes_precedence_over_the_usual_names(tmp_path):
    path = dyno_file(tmp_path, "t [s],v [m/s],F [N],cell 2", TIME, V, F, -F / 1000.0)
    mapping = ChannelMap({"force": MappedChannel("cell 2", unit="kN", gain=-1.0)})
    test = read_dyno_test(path, channel_map=mapping)
    np.testing.assert_allclose(test.series["force"], F, rtol=1e-7)


def test_of_two_columns_for_one_channel_the_first_is_read_and_named(tmp_path):
    path = dyno_file(tmp_path, "t [s],v [m/s],Force [N],Load [N]", TIME, V, F, 2.0 * F)
    test = read_dyno_test(path)
    np.testing.assert_allclose(test.series["force"], F, rtol=1e-7)
    assert any("'Force' was read, and not 'Load'" in note for note in test.remarks)


def test_a_channel_with_the_wrong_sign_is_refused_and_accepted_if_flipped(tmp_path):
    path = dyno_file(tmp_path, "t [s],v [m/s],F [N]", TIME, V, -F)
    with pytest.raises(errors.WrongSignError, match=r"run\.csv, line 1, channel 'force'.*-1\.000.*--channel force=-"):
        read_dyno_test(path)
    np.testing.assert_allclose(read_dyno_test(path, flip=["force"]).series["force"], F, rtol=1e-8)


def test_units_may_be_given(tmp_path):
    path = dyno_file(tmp_path, "t,v,F", TIME, V, F)
    units = {"time": "s", "velocity": "m/s", "force": "kN"}
    np.testing.assert_allclose(read_dyno_test(path, units=units).series["force"], 1000.0 * F)


def one_changed(values: np.ndarray, value: float) -> np.ndarray:
    copy = values.copy()
    copy[100] = value
    return copy


FAULTS = {
    "no force": ("t [s],v [m/s],P [bar]", (TIME, V, F), errors.MissingChannelError, "line 1, channel 'force'"),
    "no motion": ("t [s],F [N]", (TIME, F), errors.MissingChannelError, "--channel displacement=COLUMN.*t, F"),
    "no time": ("a [s],v [m/s],F [N]", (TIME, V, F), errors.MissingChannelError, "line 1, channel 'time'"),
    "no unit": ("t [s],v,F [N]", (TIME, V, F), errors.MissingUnitError, r"'velocity'.*--channel 'velocity=\[unit\]'"),
    "force in mm": ("t [s],v [m/s],F [mm]", (TIME, V, F), errors.UnknownUnitError, "'force'.*'mm' cannot.*'N'"),
    "NaN": ("t [s],v [m/s],F [N]", (TIME, V, one_changed(F, np.nan)), errors.NotANumberError, "line 102.*'force'"),
    "backward": (
        "t [s],v [m/s],F [N]", (one_changed(TIME, 0.0), V, F), errors.BackwardTimeError, "line 102.*'time'",
    ),
    "duplicate": (
        "t [s],v [m/s],F [N]", (one_changed(TIME, TIME[99]), V, F), errors.DuplicateTimeError, "line 102.*'time'",
    ),
    "gap": (
        "t [s],v [m/s],F [N]", (np.where(TIME > 1.0, TIME + 1.0, TIME), V, F), errors.TimeGapError,
        "line 503.*gap of 1.002 s",
    ),
    "few samples": (
        "t [s],v [m/s],F [N]", (TIME[:1001:10], V[:1001:10], F[:1001:10]), errors.TooShortError, "101 samples",
    ),
    "short": ("t [s],v [m/s],F [N]", (TIME / 5.0, V, F), errors.TooShortError, "over 0.4 s; at least"),
    "constant": ("t [s],v [m/s],F [N]", (TIME, V, 0.0 * F + 7.0), errors.ConstantChannelError, "'force'.*nt at 7 "),
    "clipped": (
        "t [s],v [m/s],F [N]", (TIME, V, np.minimum(F, 500.0)), errors.ClippedChannelError,
        "'force'.*highest value 500",
    ),
    "displacement the other way": (
        "t [s],x [m],v [m/s],F [N]", (TIME, -X, V, F), errors.WrongSignError, "'displacement'.*--channel displa",
    ),
}  # fmt: skip


@pytest.mark.repeated(2)
@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_has_its_own_error_with_file_place_and_advice(tmp_path, fault):
    header, columns, error, message = FAULTS[fault]
    with pytest.raises(error, match=r"run\.csv.*" + message) as caught:
        read_dyno_test(dyno_file(tmp_path, header, *columns))
    assert type(caught.value) is error


def test_a_test_without_force_is_refused():
    with pytest.raises(errors.MissingChannelError, match="'force'"):
        DynoTest(TimeSeries.from_channels(TIME, {"velocity": ("m/s", V)}))


def test_dynamometer_files_may_be_parquet_or_mat(tmp_path):
    series = TimeSeries.from_channels(TIME, {"velocity": ("m/s", V), "force": ("N", F)})
    for suffix in (".parquet", ".mat"):
        write_series(series, tmp_path / f"a{suffix}")
        np.testing.assert_array_equal(read_dyno_test(tmp_path / f"a{suffix}").series["force"], F)


def test_the_field_units_convert_exactly(tmp_path):
    series = TimeSeries.from_channels(TIME, {"velocity": ("m/s", V), "force": ("N", F)})
    write_csv(series, tmp_path / "us.csv", units={"velocity": "in/s", "force": "lbf"})
    np.testing.assert_allclose(read_dyno_test(tmp_path / "us.csv").series["force"], F, rtol=1e-14)
