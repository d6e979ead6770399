"""`eightpost study`: its output, files and exit codes."""

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import click
import pytest
from click.testing import CliRunner
from rich.console import Console

from cosim.study import StudyResult
from cosim.study.running.sweep import study_digest
from cosim.study.study_file import read_study
from eightpost.__main__ import main
from eightpost.app.study import show_study
from eightpost.errors import FileFormatError

TRACK = Path(__file__).resolve().parents[2] / "examples" / "data" / "track.parquet"

TEXT = """
name = "two builds in front"
families = ["numbers"]
settling = "1 s"
baseline = "stiff"

[vehicle]
fmu = "{car}"
means = "trusted"

[bank]
soft = {{ fmu = "{shock}", parameters = {{ compression_scale = 0.5, rebound_scale = 0.5 }} }}
stiff = "{shock}"

[corners]
lf = ["soft", "stiff"]
rf = ["stiff"]
lr = ["stiff"]
rr = ["stiff"]

[[drive]]
file = "{track}"
stop = "3 s"

[[objective]]
measure = "grip number"
"""


@pytest.fixture
def file(tmp_path, fmus) -> Path:
    path = tmp_path / "study.toml"
    path.write_text(TEXT.format(car=fmus["seven_dof"], shock=fmus["lpnl2"], track=TRACK))
    return path


@pytest.mark.slow
def test_a_study_is_run_ranked_and_written_and_the_second_call_runs_nothing(file, tmp_path):
    options = ["study", str(file), "-o", str(tmp_path / "out"), "--workers", "1", "--trace", "0"]
    done = CliRunner().invoke(main, ["-v", *options])
    assert done.exit_code == 0, done.output
    shown = " ".join(done.output.split())
    for expected in ("2 setups, 2 to be run", "the first 1 s are left out", "step and largest error of",
                     "objective", "stiff stiff stiff stiff", "results.parquet", "report.html",
                     "traces/0.parquet"):  # fmt: skip
        assert expected in shown
    for name in ("results.parquet", "report.html", "traces/0.parquet"):
        assert (tmp_path / "out" / name).is_file()
    result = StudyResult.load(tmp_path / "out" / "results.parquet")
    assert result.done.all() and result.baseline_row == 1
    again = CliRunner().invoke(main, [*options, "--rank", "aero number"])
    assert again.exit_code == 0 and "2 setups, 0 to be run" in again.output


def test_units_of_a_study_are_read_and_belong_to_no_digest(file):
    plain = read_study(file)
    file.write_text(f'units = "si"\n{file.read_text()}')
    stated = read_study(file)
    assert (plain.units, stated.units) == ("", "si")
    assert study_digest(stated, {}) == study_digest(plain, {})
    file.write_text(file.read_text().replace('"si"', '"metric"'))
    with pytest.raises(FileFormatError, match="units"):
        read_study(file)


def test_the_channels_that_drive_are_named_if_a_record_has_others(file, capsys):
    study = read_study(file)
    lap = replace(study.drives[0], name="lap", start=1.0, targets={"lf.road": "car.lf.road", "rf.road": "car.rf.road"})
    both = replace(study, drives=(study.drives[0], lap))
    with click.Context(click.Command("eightpost")) as context:
        context.params["verbose"] = True
        show_study(Console(width=400), SimpleNamespace(study=both, left=0))
    shown = " ".join(capsys.readouterr().out.split())
    assert "track.parquet by its lf.road, rf.road, 1 to 4 s; the first 1 s are left out of every measure" in shown
    assert "track.parquet, 0 to 3 s; the first" in shown


@pytest.mark.parametrize("verb", ["study", "optimise", "shapes"])
def test_a_study_never_replaces_its_drive_file_and_runs_nothing(file, tmp_path, verb):
    drive = tmp_path / "out" / "results.parquet"
    drive.parent.mkdir()
    shutil.copy(TRACK, drive)
    file.write_text(file.read_text().replace(str(TRACK), str(drive)))
    ran = CliRunner().invoke(main, [verb, str(file), "-o", str(tmp_path / "out")])
    assert ran.exit_code == 2 and "results.parquet is an input of this command" in ran.output, ran.output
    assert drive.read_bytes() == TRACK.read_bytes() and list(drive.parent.iterdir()) == [drive]


@pytest.mark.nightly
@pytest.mark.skipif(sys.platform == "win32", reason="Ctrl-C is sent to a group of processes as a POSIX terminal does")
def test_ctrl_c_in_the_terminal_keeps_the_results_so_far_and_the_next_call_resumes(file, tmp_path):
    fmu = re.search(r'stiff = ("[^"]*")', file.read_text())[1]
    names = [f"scale_{k}" for k in range(3)]
    bank = [
        f"{name} = {{ fmu = {fmu}, parameters = {{ rebound_scale = {0.6 + 0.1 * k} }} }}"
        for k, name in enumerate(names)
    ]
    text = re.sub(r"\[corners\].*?\n\n", "", file.read_text(), flags=re.DOTALL)
    file.write_text(text.replace("[bank]", "\n".join(("[bank]", *bank))).replace('stop = "3 s"', 'stop = "10 s"'))
    out = tmp_path / "out"
    command = [sys.executable, "-m", "eightpost", "study", str(file), "-o", str(out), "--workers", "2"]
    called = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, process_group=0)
    while called.poll() is None and not list(out.glob("chunks/*/chunk_*")):
        time.sleep(0.05)
    os.killpg(called.pid, signal.SIGINT)
    output, _ = called.communicate(timeout=120)
    assert called.returncode == 1 and "partial" in output and "Traceback" not in output, output
    first = StudyResult.load(out / "results.parquet")
    assert first.partial and first.done.all() and 0 < len(first) < 625
    again = CliRunner().invoke(main, [*command[3:-1], "1"])  # one worker is enough: the result is the same
    assert again.exit_code == 0 and f"625 setups, {625 - len(first)} to be run" in again.output


@pytest.mark.parametrize(("old", "new", "options", "expected"), [
    ('lf = ["soft", ', 'lf = ["sofd", ', (), "line 16: corners: lf allows 'sofd'"),
    ('rr = ["stiff"]', "", (), "rr has no shock"), ('"grip number"', '"grip numbr"', (), "did you mean 'grip number'"),
    ("", "", ("--rank", "speed"), "there is no measure 'speed'"), ("", "", ("--trace", "2"), "there is no setup 2"),
])  # fmt: skip
def test_a_bad_study_exits_2_with_a_message_before_anything_runs(file, tmp_path, old, new, options, expected):
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new, 1) if old else text)
    ended = CliRunner().invoke(main, ["study", str(file), "-o", str(tmp_path / "out"), *options])
    assert ended.exit_code == 2
    assert expected in " ".join(ended.stderr.split())
    assert not (tmp_path / "out").exists()
