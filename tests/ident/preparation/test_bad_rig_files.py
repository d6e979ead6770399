"""Tests that `eightpost inspect` and `eightpost identify` report faults of rig files, with the place and a remedy."""

import re
from collections.abc import Callable

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.typing import NDArray

from eightpost.__main__ import main
from eightpost.ident.preparation import advance_channels, prepare
from eightpost.rig import RigTest
from eightpost.signals import TimeSeries, formats, parquet_file, raw_record
from eightpost.signals.timeseries import StoredSeries

from ..linear_rig import record

Array = NDArray[np.float64]
Change = Callable[[dict[str, Array]], None]


def run(*words):
    done = CliRunner().invoke(main, [str(word) for word in words], env={"COLUMNS": "250"})
    return done.exit_code, " ".join(done.output.split())


@pytest.fixture(scope="module")
def good():
    return record("seven_dof", seconds=6.0).series


def written(series, path, change=None, keep=slice(None)):
    rows = dict(zip(series.names, series.values.copy(), strict=True))
    if change is not None:
        change(rows)
    values = np.stack([row[keep] for row in rows.values()])
    RigTest(TimeSeries(series.time[keep], values, series.names, series.units)).write(path)
    return path


def dead(rows):
    rows["rf.force"][:] = 12.0


def dies(rows):
    rows["rf.hub_acceleration"][3000:] = rows["rf.hub_acceleration"][3000]


def swapped(rows):
    rows["lf.force"], rows["rf.force"] = rows["rf.force"], rows["lf.force"]


def reversed_(rows):
    rows["lr.displacement"] *= -1.0


def clipped(rows):
    rows["rr.tire_force"] = np.minimum(rows["rr.tire_force"], np.quantile(rows["rr.tire_force"], 0.95))


def held(rows):
    rows["lf.tire_force"] = np.repeat(rows["lf.tire_force"][::10], 10)[: rows["lf.road"].size]


FAULTS = {
    "a dead channel": (dead, slice(None), ("'rf.force'", "constant at 12", "cable")),
    "a channel that dies": (dies, slice(None), ("'rf.hub_acceleration'", "from 2.4 s to 5.999 s", "cable or a logger")),
    "swapped corners": (swapped, slice(None), ("'lf.force'", "matches rf.velocity", "exchange the columns")),
    "a wrong sign": (reversed_, slice(None), ("'lr.", "has the wrong sign", "--channel")),
    "a clipped load cell": (clipped, slice(None), ("'rr.tire_force'", "highest value", "larger range")),
    "dropped samples": (None, np.delete(np.arange(7500), np.arange(900, 907)), ("gap of 0.0064 s", "fill the gaps")),
    "mismatched rates": (held, slice(None), ("'lf.tire_force'", "every 10 samples", "125 Hz", "export both")),
    "too short a record": (None, slice(0, 2500), ("over 1.999 s", "record longer")),
}  # fmt: skip


@pytest.mark.repeated(2)
@pytest.mark.parametrize("fault", FAULTS)
def test_inspect_rejects_the_file_with_the_place_and_a_remedy(good, tmp_path, fault):
    change, keep, words = FAULTS[fault]
    path = written(good, tmp_path / "rig.parquet", change, keep)
    code, said = run("inspect", path)
    assert code == 2, said
    for word in (f"error: {path}", *words):
        assert word in said


def test_identify_rejects_the_same_files(good, tmp_path):
    change, keep, words = FAULTS["a wrong sign"]
    fine, bad = written(good, tmp_path / "good.parquet"), written(good, tmp_path / "bad.parquet", change, keep)
    code, said = run("identify", bad, fine, "-o", tmp_path / "car.json")
    assert code == 2, said
    for word in (f"error: {bad}", *words):
        assert word in said
    assert not (tmp_path / "car.json").exists()


def test_a_good_file_is_shown_and_is_in_step(good, tmp_path):
    code, said = run("-v", "inspect", written(good, tmp_path / "rig.parquet"))
    assert code == 0, said
    assert "5.999 s at 1250 Hz, corners lf rf lr rr" in said
    assert re.search(r"tire_force is 0\.0\d ms (ahead of|behind) the accelerometers", said)
    assert "No warnings." in said


def test_inspect_keeps_no_channel_of_a_large_file_and_shows_what_it_shows_of_a_small_one(good, tmp_path, monkeypatch):
    path, read = written(good, tmp_path / "rig.parquet"), StoredSeries.__getattr__

    def at_most_two(series, name):
        assert len(series.names) <= 2
        return read(series, name)

    expected = run("-v", "inspect", path)
    monkeypatch.setattr(StoredSeries, "__getattr__", at_most_two)
    for module in (formats, parquet_file, raw_record):
        monkeypatch.setattr(module, "IN_MEMORY", 1)
    path = path.rename(tmp_path / "two.parquet")
    assert run("-v", "inspect", path) == (expected[0], expected[1].replace("rig.parquet", "two.parquet"))


def test_a_late_logger_is_a_warning(good, tmp_path):
    names = [name for name in good.names if name.endswith("acceleration")]
    late = advance_channels(good, dict.fromkeys(names, -0.02))
    code, said = run("inspect", written(late, tmp_path / "rig.parquet"))
    assert code == 1, said
    assert re.search(r"warning lf\.displacement is (20\.0|19\.9)\d ms ahead of the accelerometers", said)
    assert "delays (docs/how_to/rig_data.md)" in said


def test_a_teams_file_is_recognised_as_rig_data_by_its_map(good, tmp_path):
    names = {name: name.replace(".", "_").upper() for name in good.names}
    RigTest(TimeSeries(good.time, good.values, tuple(names.values()), good.units)).write(tmp_path / "team.parquet")
    lines = [f'[channels."{ours}"]\nsource = "{source}"' for ours, source in names.items()]
    (tmp_path / "map.toml").write_text("\n".join(lines))
    code, said = run("inspect", tmp_path / "team.parquet", "--map", tmp_path / "map.toml")
    assert code == 0, said
    assert "corners lf rf lr rr" in said


def test_records_of_two_rates_are_decimated_to_one_rate(good):
    slow = TimeSeries(good.time[::2], good.values[:, ::2], good.names, good.units)
    first, second = prepare([RigTest(good), RigTest(slow)]).records
    inside = slice(50, -50)
    wrong = first["lf.tire_force"][inside] - second["lf.tire_force"][inside]
    assert wrong.std() < 0.01 * first["lf.tire_force"].std()
