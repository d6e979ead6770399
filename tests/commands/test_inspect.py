"""`eightpost inspect` shows the content of a file; exit codes: 0 nothing suspicious, 1 warnings, 2 refused."""

import re
from pathlib import Path

import pytest
from click.testing import CliRunner

from eightpost.__main__ import main

DATA = Path(__file__).parents[2] / "examples" / "data"


def inspect(*words):
    shown = CliRunner().invoke(main, ["inspect", *map(str, words)], env={"COLUMNS": "200"})
    return shown.exit_code, shown.output


@pytest.mark.nightly
def test_a_suspicious_sample_is_a_warning_with_exit_code_1(tmp_path):
    lines = (DATA / "dyno_C.csv").read_text().splitlines()
    header = next(i for i, line in enumerate(lines) if "[" in line)
    cells = lines[header + 3000].split(",")
    column = next(i for i, name in enumerate(lines[header].split(",")) if "orce" in name)
    cells[column] = "9000"
    lines[header + 3000] = ",".join(cells)
    path = tmp_path / "spike.csv"
    path.write_text("\n".join(lines))
    code, shown = inspect(path)
    assert code == 1, shown
    assert re.search(r"warning the force jumps: by \S+ N at 1.5 s", shown)


def test_the_content_of_a_refused_file_is_shown_before_the_error(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("Test,7\nt [s],v [m/s],F\n0,1,2\n1,2,3\n")
    code, shown = inspect(path, "-v")
    assert code == 2
    assert "Test | 7" in shown
    assert "columns  t [s], v [m/s], F (no unit)" in shown
    assert "error: " in shown
    assert "--channel 'force=[unit]'" in " ".join(shown.split())


def test_a_shock_file_is_shown_in_the_units_of_the_user(monkeypatch):
    monkeypatch.setenv("EIGHTPOST_UNITS", "si")
    path = DATA.parent / "bank" / "AA_B.json"
    metric = inspect(path)[1]
    assert "lag_full_force 44.48 N" in metric
    assert "186.6 N and -386.4 N at 100 mm/s" in metric
    assert "displacement -38.1 to 35.5 mm" in metric
    monkeypatch.setenv("EIGHTPOST_UNITS", "us")
    customary = inspect(path)[1]
    assert "lag_full_force 10 lbf" in customary
    assert "41.95 lbf and -86.86 lbf at 3.94 in/s" in customary
    assert "displacement -1.5 to 1.4 in" in customary
    assert "temperature 110 to 113 degF" in customary


def test_a_drive_file_is_shown_as_one(tmp_path: Path) -> None:
    code, shown = inspect(DATA.parent / "identified" / "lap.parquet")
    assert code == 0, shown
    text = " ".join(shown.split())
    assert "8251 samples" in text and "33 s at 250 Hz, 8 channels: a drive file, which has" in text
    assert "lf.road -0.221 to 0.2231 in" in text
    (tmp_path / "drive.csv").write_text("time [s],road [mm],load [lbf]\n0,1,2\n1,2,3\n", encoding="utf-8")
    code, shown = inspect(tmp_path / "drive.csv", "--channel", "heave_force=load", "-v")
    assert code == 0 and "1 s at 1 Hz, 2 channels: a drive file" in shown
    assert "heave_force" in shown and "lbf" in shown


def test_a_rig_file_with_a_column_that_is_not_named_is_no_drive_file(tmp_path: Path) -> None:
    (tmp_path / "rig.csv").write_text("time [s],road [mm],load [lbf]\n0,1,2\n1,2,3\n", encoding="utf-8")
    code, shown = inspect(tmp_path / "rig.csv")
    assert code == 2 and "channel 'tire_force': a rig test needs this channel" in shown


def test_a_peak_velocity_table_is_shown_by_setting(tmp_path):
    path = tmp_path / "valve.csv"
    path.write_text("clicks,speed [m/s],comp [N],reb [N]\n3,0.1,100,200\n3,0.2,150,300\n6,0.1,50,100\n6,0.2,80,160\n")
    code, shown = inspect(path)
    assert code == 0, shown
    expected = "peak-velocity table clicks 6: 2 speeds, 100 to 200 mm/s; compression to 80 N, rebound to -160 N"
    assert expected in " ".join(shown.split())


def test_the_first_tables_of_many_are_shown(tmp_path: Path) -> None:
    path = tmp_path / "valve.csv"
    rows = [f"{clicks},{speed},{1000 * speed},{2000 * speed}" for clicks in range(6) for speed in (0.1, 0.2)]
    path.write_text("\n".join(["clicks,speed [m/s],comp [N],reb [N]", *rows]), encoding="utf-8")
    _, shown = inspect(path)
    assert shown.count("peak-velocity table") == 4 and "4 of 6 tables; -v shows all" in shown
    assert inspect(path, "-v")[1].count("peak-velocity table") == 6
