"""Dynamometer files are recognised, checked for faults, and completed with derived channels."""

from pathlib import Path

import numpy as np
import pytest

from eightpost import errors
from eightpost.files import sha256_of
from eightpost.rig.columns import is_named
from eightpost.rig.dyno_test import DynoConditions, DynoTest, read_dyno_test
from eightpost.signals import ChannelMap, MappedChannel, TimeSeries

TIME = np.arange(1001) / 500.0
OMEGA = 2.0 * np.pi * 2.0
X, V = 0.02 * np.sin(OMEGA * TIME), 0.02 * OMEGA * np.cos(OMEGA * TIME)
F = 2000.0 * V + 100.0


def dyno_file(folder: Path, header: str, *columns: np.ndarray) -> Path:
    path = folder / "run.csv"
    lines = [",".join(f"{value:.9g}" for value in row) for row in zip(*columns, strict=True)]
    path.write_text("\n".join([header, *lines]) + "\n")
    return path


@pytest.mark.parametrize("header", ["TIME [s],Travel [m],V [m/s],Shock Force [N]", "T [s],disp [m],vel [m/s],f [N]"])
def test_the_usual_names_are_recognised(tmp_path, header):
    test = read_dyno_test(dyno_file(tmp_path, header, TIME, X, V, F))
    assert set(test.series.names) == {"velocity", "force", "displacement"}
    np.testing.assert_allclose(test.series["force"], F, rtol=1e-8)
    np.testing.assert_allclose(test.series["velocity"], V, atol=1e-9)


@pytest.mark.parametrize("words", [
    "time displacement velocity force", "Zeit Weg Geschwindigkeit Kraft", "Temps Déplacement Vitesse Effort",
    "Tempo Corsa Velocità Forza", "Tiempo Desplazamiento Velocidad Fuerza", "Tempo Deslocamento Velocidade Força",
    "Tijd Verplaatsing Snelheid Kracht", "Tid Förskjutning Hastighet Kraft", "時間 変位 速度 荷重", "时间 位移 速度 力",
    "시간 변위 속도 하중",
])  # fmt: skip
def test_channels_have_usual_names_in_eleven_languages(words):
    for name, channel in zip(words.split(), ("time", "displacement", "velocity", "force"), strict=True):
        assert [is_named(name, one) for one in ("time", "displacement", "velocity", "force")].count(True) == 1
        assert is_named(name, channel)


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


FAULTS = {
    "no motion": ("t [s],F [N]", (TIME, F), errors.MissingChannelError, "--channel displacement=COLUMN.*t, F"),
    "no unit": ("t [s],v,F [N]", (TIME, V, F), errors.MissingUnitError, r"'velocity'.*--channel 'velocity=\[unit\]'"),
    "few samples": (
        "t [s],v [m/s],F [N]", (TIME[:1001:10], V[:1001:10], F[:1001:10]), errors.TooShortError, "101 samples",
    ),
    "short": ("t [s],v [m/s],F [N]", (TIME / 5.0, V, F), errors.TooShortError, "over 0.4 s; at least"),
}  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_has_its_own_error_with_file_place_and_advice(tmp_path, fault):
    header, columns, error, message = FAULTS[fault]
    with pytest.raises(error, match=r"run\.csv.*" + message) as caught:
        read_dyno_test(dyno_file(tmp_path, header, *columns))
    assert type(caught.value) is error


def test_a_test_without_force_is_refused():
    with pytest.raises(errors.MissingChannelError, match="'force'"):
        DynoTest(TimeSeries.from_channels(TIME, {"velocity": ("m/s", V)}))
