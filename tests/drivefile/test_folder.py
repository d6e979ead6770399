"""An iteration in a folder: it resumes to the bit, and its two verbs serve a rig as they serve the virtual one."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest
from click.testing import CliRunner

from eightpost.__main__ import main
from eightpost.drivefile import IterationFolder
from eightpost.drivefile.page import verdict_of
from eightpost.signals import Drivefile, TimeSeries, read_series
from eightpost.signals.formats import write_series
from eightpost.units import convert
from eightpost.vehicle import shipped
from eightpost.verdict import Grade
from eightpost.virtual import RigSensors, quarter_truth, run_test
from eightpost.virtual.shocks import LinearDamper
from tests.drawn import figures_of, rows_of_page
from tests.unchanged import refusals

#: The damper of Table 4.1, so that the linear car of the table is the car on the rig.
DAMPER = "16.67 lbf.s/in"
CHANNELS = ["hub_acceleration", "displacement"]


def eightpost(*words, code=0):
    shown = CliRunner().invoke(main, [str(word) for word in words])
    assert shown.exit_code == code, shown.output
    return " ".join(shown.output.split())


@pytest.fixture(scope="module")
def track(tmp_path_factory):
    """A record of the quarter car on a road: only the two channels that a drive file reproduces."""
    folder = tmp_path_factory.mktemp("track")
    car, count = quarter_truth(), 12 * 1250
    time = np.arange(count) / 1250.0
    generator = np.random.default_rng(8)
    frequency = np.arange(1.0, 15.0, 0.37)
    phase = generator.uniform(0.0, 2.0 * np.pi, frequency.size)
    road = (0.004 / frequency[:, None] * np.sin(2.0 * np.pi * frequency[:, None] * time + phase[:, None])).sum(axis=0)
    drive = TimeSeries.from_channels(time, {"road": ("m", road), "aero_force": ("N", np.zeros(count))})
    damper = LinearDamper(convert(16.67, "lbf.s/in", "N.s/m"))
    record = run_test(car, Drivefile(drive), [damper], sensors=RigSensors.perfect()).series.select(CHANNELS)
    write_series(record, folder / "track.parquet")
    return folder / "track.parquet"


@pytest.fixture(scope="module")
def iteration(track, tmp_path_factory):
    """An iteration with three passes on the virtual rig."""
    folder = tmp_path_factory.mktemp("iteration") / "lap"
    eightpost("drivefile", "start", track, "--car", shipped("quarter_car"), "-o", folder, "--format", "csv")
    eightpost("drivefile", "simulate", folder, *RIG, "--passes", 3)
    return folder


RIG = ("--car", "quarter_car", "--shock", DAMPER, "--noise", "none")


def copy_of(iteration, place, passes):
    """Copy an iteration, and remove the passes after the first ones and the drive that would follow."""
    shutil.copytree(iteration, place)
    for number in range(passes + 1, 10):
        shutil.rmtree(place / f"pass_{number:02d}", ignore_errors=True)
    return place


def test_the_best_drive_and_the_next_one_are_written(iteration):
    errors = json.loads((iteration / "pass_03" / "errors.json").read_text())
    best = read_series(iteration / "best_drive.parquet")
    assert np.array_equal(best.values, read_series(iteration / f"pass_{errors['best']:02d}" / "drive.parquet").values)
    assert (iteration / "pass_04" / "drive.csv").is_file()


def test_the_page_and_the_files_of_an_iteration(iteration, unchanged):
    unchanged(rows_of_page(iteration / "report.html"), "page", relative=1e-3)
    unchanged(figures_of(iteration / "report.html"), "figures", relative=1e-3)
    unchanged({path.parent.name: path for path in sorted(iteration.glob("*/errors.json"))}, "errors", relative=1e-3)


@pytest.mark.slow
def test_an_interrupted_iteration_resumes_to_the_bit(iteration, tmp_path):
    copy = copy_of(iteration, tmp_path / "copy", 2)
    eightpost("drivefile", "next", copy)
    eightpost("drivefile", "simulate", copy, *RIG, "--passes", 3)
    for number in (3, 4):
        name = f"pass_{number:02d}/drive.parquet"
        assert (copy / name).read_bytes() == (iteration / name).read_bytes()


def test_a_record_that_is_given_again_is_no_record_of_the_next_pass(iteration, tmp_path):
    copy, records = copy_of(iteration, tmp_path / "copy", 2), [iteration / f"pass_0{k}" / "rig.parquet" for k in (1, 2)]
    shutil.copytree(iteration / "pass_03", copy / "pass_03")
    (copy / "pass_03" / "record.parquet").unlink()
    assert "is the record of pass 2 already" in eightpost("drivefile", "next", copy, "--record", records[1])
    assert not (copy / "pass_03" / "record.parquet").exists()
    assert (copy / "pass_03/drive.parquet").read_bytes() == (iteration / "pass_03/drive.parquet").read_bytes()
    assert "it is the record of pass 1;" in eightpost("drivefile", "next", copy, "--record", records[0], code=2)


@pytest.mark.nightly
def test_the_two_verbs_do_with_a_rig_what_simulate_does(iteration, track, tmp_path):
    folder = tmp_path / "rig"
    eightpost("drivefile", "start", track, "--car", shipped("quarter_car"), "-o", folder)
    for number in (1, 2, 3):
        name = f"pass_{number:02d}/drive.parquet"
        assert (folder / name).read_bytes() == (iteration / name).read_bytes()
        eightpost("drivefile", "next", folder, "--record", iteration / f"pass_{number:02d}" / "rig.parquet")
    assert (folder / "pass_04/drive.parquet").read_bytes() == (iteration / "pass_04/drive.parquet").read_bytes()


def changed(iteration, path, change):
    """Write the rig's record of the first pass after a change of its series."""
    record = read_series(iteration / "pass_01" / "rig.parquet")
    write_series(change(record), path)
    return path


@pytest.mark.repeated
@pytest.mark.parametrize("commands", [True, False])
def test_a_record_of_a_logger_that_started_earlier_is_synchronised(iteration, tmp_path, commands):
    copy = copy_of(iteration, tmp_path / "copy", 1)
    (copy / "pass_01" / "record.parquet").unlink()

    def earlier(record):
        kept = [name for name in record.names if commands or not name.endswith("_command")]
        record = record.select(kept)
        time = np.arange(len(record) + 1250) / 1250.0
        return TimeSeries(time, np.pad(record.values, ((0, 0), (1250, 0)), mode="edge"), record.names, record.units)

    shown = eightpost("drivefile", "next", copy, "--record", changed(iteration, tmp_path / "late.parquet", earlier))
    assert "before the drive file" in shown
    found, known = (read_series(place / "pass_01" / "record.parquet") for place in (copy, iteration))
    # Without commands, the lag of the wheelloaders (2 ms) is attributed to the logger.
    difference = np.std(found.values[1] - known.values[1]) / np.std(known.values[1])
    assert difference < (1e-9 if commands else 0.1)


def test_records_that_do_not_fit_are_refused_with_a_reason(iteration, track, tmp_path, unchanged):
    copy = copy_of(iteration, tmp_path / "copy", 1)
    (copy / "pass_01" / "record.parquet").unlink()
    other = np.random.default_rng(1)
    changes = {
        "another drive": lambda r: r.with_channel("road_command", "m", 0.003 * other.standard_normal(len(r))),
        "another sign": lambda r: r.with_channel("displacement", "m", -r["displacement"]),
        "a part": lambda r: r.window(0.0, 12.0),
        "no displacement": lambda r: r.select([n for n in r.names if n != "displacement"]),
    }  # fmt: skip
    paths = {name: changed(iteration, tmp_path / f"{name}.parquet", change) for name, change in changes.items()}
    found = {name: eightpost("drivefile", "next", copy, "--record", path, code=2) for name, path in paths.items()}
    eightpost("drivefile", "next", copy, "--record", paths["another sign"], "--flip", "displacement")
    copy = copy_of(iteration, tmp_path / "whole", 3)
    again = ("drivefile", "start", track, "--car", shipped("quarter_car"), "-o", copy)
    found |= {
        "a second record": eightpost("drivefile", "next", copy, "--record", paths["a part"], code=2),
        "a second start": eightpost(*again, code=2), "no iteration": eightpost("drivefile", "next", tmp_path, code=2),
    }  # fmt: skip
    (copy / "iteration.json").write_text('{"kind": "drivefile_iteration", "schema": 1}')
    unchanged(found | {"no state": eightpost("drivefile", "next", copy, code=2)})


def test_a_state_that_does_not_fit_its_files_is_refused(iteration, tmp_path, unchanged):
    copy = copy_of(iteration, tmp_path / "copy", 3)
    text = (copy / "iteration.json").read_text()

    def read(change):
        change(state := json.loads(text))
        (copy / "iteration.json").write_text(json.dumps(state))
        return IterationFolder.read(copy)

    unchanged(refusals({
        "a row more": lambda: read(lambda s: s["static"].append(s["static"][0])),
        "half the band": lambda: read(lambda s: s.update(high=0.5 * s["high"])),
        "a wide band": lambda: read(lambda s: s.update(high=1e6)),
        "a format": lambda: read(lambda s: s.update(format="x")),
        "no number": lambda: read(lambda s: s["settings"].update(gain="most")),
    }))  # fmt: skip


def test_an_iteration_whose_state_was_edited_is_unknown(iteration, tmp_path):
    copy = copy_of(iteration, tmp_path / "copy", 3)
    assert verdict_of(IterationFolder.read(copy)).grade is Grade.USABLE
    content = json.loads((copy / "iteration.json").read_text())
    content["settings"]["acceleration"] *= 2.0
    (copy / "iteration.json").write_text(json.dumps(content))
    verdict = verdict_of(IterationFolder.read(copy))
    assert verdict.grade is Grade.UNKNOWN and verdict.reasons[0].origin == "iteration.json"
    del content["judged"]
    (copy / "iteration.json").write_text(json.dumps(content))
    assert verdict_of(IterationFolder.read(copy)).grade is Grade.USABLE


def test_the_virtual_rig_takes_the_seed_of_the_car(iteration, tmp_path):
    copy = copy_of(iteration, tmp_path / "copy", 2)
    shown = eightpost("drivefile", "simulate", copy, *RIG, "--car-seed", 4, "--passes", 3, code=2)
    assert "has no random parameters" in shown
