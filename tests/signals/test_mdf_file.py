"""MDF files are read with one time axis and with the units in the file."""

import sys

import numpy as np
import pytest

from eightpost.errors import FileFormatError
from eightpost.rig import read_dyno_tests
from eightpost.signals import read_record, read_records, read_series

TIME = np.arange(500) / 250.0
FORCE = np.round(100.0 * np.cos(TIME)).astype(np.int16)


@pytest.fixture
def asammdf():
    return pytest.importorskip("asammdf", reason="asammdf is an extra: pip install 'eightpost[mdf]'")


def written(asammdf, path, *groups, version="4.10", comment=""):
    with asammdf.MDF(version=version) as mdf:
        for group in groups:
            mdf.append([asammdf.Signal(values, time, name=name, unit=unit) for name, unit, time, values in group])
        mdf.header.comment = comment
        mdf.save(path, overwrite=True)
    return path


@pytest.mark.parametrize(("suffix", "version"), [(".mf4", "4.10"), (".mdf", "3.30")])
def test_channels_of_one_time_axis_are_read_in_si(asammdf, tmp_path, suffix, version):
    groups = [("x", "mm", TIME, np.sin(TIME)), ("F", "kN", TIME, FORCE)], [("T", "degC", TIME, TIME + 20.0)]
    series = read_series(written(asammdf, tmp_path / f"run{suffix}", *groups, version=version))
    np.testing.assert_allclose(series.time, TIME)
    np.testing.assert_allclose(series["x"], np.sin(TIME) / 1000.0)
    np.testing.assert_allclose(series["F"], 1000.0 * FORCE)
    np.testing.assert_allclose(series["T"], TIME + 293.15)


def test_the_comment_of_the_file_is_its_preamble(asammdf, tmp_path):
    group = [("x", "mm", TIME, np.sin(TIME))]
    path = written(asammdf, tmp_path / "run.mf4", group, comment="Shock ID: A & B\nGas: 50 psi")
    assert read_record(path).preamble == (("Shock ID: A & B",), ("Gas: 50 psi",))


def test_each_time_axis_is_a_table_and_the_first_has_all_temperatures(asammdf, tmp_path):
    slow = TIME[::50]
    groups = (
        [("T", "degC", slow, 20.0 + slow), ("U", "V", slow, slow)],
        [("x", "mm", TIME, np.sin(TIME)), ("F", "N", TIME, FORCE)],
        [("a", "m/s2", TIME + 1e-4, FORCE)],
    )
    first, *others = read_records(written(asammdf, tmp_path / "run.mf4", *groups))
    assert first.names == ("time", "x", "F", "T")
    np.testing.assert_allclose(first.columns[3], 20.0 + np.minimum(TIME, slow[-1]), rtol=1e-12)
    assert [table.names for table in others] == [("time", "T", "U"), ("time", "a")]


def test_a_dynamometer_record_is_read_beside_channels_of_other_times(asammdf, tmp_path):
    slow, velocity = TIME[::50], 0.3 * np.cos(15.0 * TIME)
    record = [("velocity", "m/s", TIME, velocity), ("force", "N", TIME, 900.0 * np.tanh(5.0 * velocity))]
    other = [("clicks", "", slow, 0.0 * slow), ("voltage", "V", slow, 0.0 * slow), ("rpm", "rpm", slow, slow)]
    (test,) = read_dyno_tests(written(asammdf, tmp_path / "run.mf4", other, record))
    np.testing.assert_allclose(test.series["velocity"], velocity, rtol=1e-12)


def test_a_file_that_is_not_mdf_is_refused(asammdf, tmp_path):
    (tmp_path / "run.mf4").write_bytes(b"nonsense" * 100)
    with pytest.raises(FileFormatError, match=r"run\.mf4: not an MDF file"):
        read_record(tmp_path / "run.mf4")


def test_the_error_without_asammdf_names_the_extra(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "asammdf", None)
    (tmp_path / "run.mf4").write_bytes(b"MDF     ")
    with pytest.raises(FileFormatError, match=r'run\.mf4: .*pip install "eightpost\[mdf\]"'):
        read_record(tmp_path / "run.mf4")
