"""A run passes if its curve is within the tolerance of the master curve at every speed, and fails otherwise."""

from __future__ import annotations

import numpy as np
import pytest
from click.testing import CliRunner

from eightpost.__main__ import main
from eightpost.errors import InputError
from eightpost.ident.dyno_report.builds import dyno_report
from eightpost.ident.dyno_report.figures import curves_figure
from eightpost.ident.dyno_report.reading import Reading, read_entries, read_limits, read_track
from eightpost.ident.dyno_report.tables import limit_table

from .conftest import sine, valve, viscous

SPEEDS = (0.05, 0.1, 0.2)


def master(path, *, tolerance="tolerance [N]", values=(20.0, 20.0, 40.0, 40.0), rate=2000.0):
    """Write a table of 0.02 to 0.3 m/s with 2000 N.s/m in compression and twice that in rebound."""
    speeds = (0.02, 0.1, 0.2, 0.3)
    head = ["speed [m/s]", "compression [N]", "rebound [N]", *([tolerance] if tolerance else [])]
    rows = [(v, rate * v, -2.0 * rate * v, *([t] if tolerance else [])) for v, t in zip(speeds, values, strict=True)]
    path.write_text("\n".join([",".join(head), *(",".join(f"{cell:g}" for cell in row) for row in rows)]) + "\n")
    return path


def record(path, rate=2000.0):
    """Write a sine of 0.31 m/s of a linear damper."""
    series = sine(valve(viscous(rate), viscous(2.0 * rate)), duration=3.0, rate=400.0)
    rows = zip(series.time, series["displacement"], series["force"], strict=True)
    lines = ["Time [s],Displacement [m],Force [N]", *(f"{t:.6g},{x:.9g},{f:.9g}" for t, x, f in rows)]
    path.write_text("\n".join(lines) + "\n")
    return path


def judged(tmp_path, rate, limits):
    entries = read_entries([record(tmp_path / "run.csv", rate)], Reading())
    return dyno_report(entries, speeds=SPEEDS, limits=limits)


@pytest.mark.parametrize(
    ("rate", "passes"), [(2000.0, (True, True)), (2120.0, (True, False)), (1700.0, (False, False))]
)
def test_a_column_of_tolerances_belongs_to_the_speeds_of_the_master(tmp_path, rate, passes):
    limits = read_limits(master(tmp_path / "master.csv"), Reading(), ())
    assert limits.at(0.15, "rebound") == pytest.approx((600.0, 30.0))
    assert limits.at(0.4, "rebound") is None
    report = judged(tmp_path, rate, limits)
    assert tuple(one.passed for one in report.judgements) == passes
    assert [one.count for one in report.judgements] == [3, 3]
    (table,) = limit_table(report)
    assert ["FAIL" not in row[0] for row in table.rows] == list(passes)


def test_the_judged_speed_is_that_with_the_largest_share_of_the_tolerance(tmp_path):
    limits = read_limits(master(tmp_path / "master.csv", values=(20.0, 20.0, 60.0, 60.0)), Reading(), ())
    compression = judged(tmp_path, 2400.0, limits).judgements[0]
    assert compression.speed == 0.1
    assert compression.deviation == pytest.approx(40.0, rel=0.02)
    assert compression.text == "53.9 lbf at 3.94 in/s, master 45 ± 4.5 lbf"


def test_a_tolerance_in_percent_is_that_of_the_masters_force(tmp_path):
    limits = read_limits(master(tmp_path / "m.csv", tolerance="tol [%]", values=(5.0,) * 4), Reading(), ())
    assert limits.at(0.2, "compression") == pytest.approx((400.0, 20.0))


def test_given_tolerances_belong_to_files_without_one_and_the_larger_counts(tmp_path):
    path = master(tmp_path / "m.csv", tolerance="")
    limits = read_limits(path, Reading(), [(5.0, "%"), (25.0, "N")])
    assert limits.at(0.1, "compression") == pytest.approx((200.0, 25.0))
    assert limits.at(0.3, "rebound") == pytest.approx((1200.0, 60.0))
    run = read_limits(record(tmp_path / "run.csv"), Reading(), [(10.0, "N")])
    assert run.at(0.1, "compression") == pytest.approx((200.0, 10.0), rel=0.01)
    with pytest.raises(InputError, match="has no column of tolerances"):
        read_limits(path, Reading(), ())


def test_a_tolerance_of_another_unit_is_an_error(tmp_path):
    with pytest.raises(InputError, match="needs the unit % or one of force"):
        read_limits(master(tmp_path / "m.csv", tolerance="tolerance [m]"), Reading(), ())


def test_limits_are_a_band_in_both_panels(tmp_path):
    report = judged(tmp_path, 2000.0, read_limits(master(tmp_path / "m.csv"), Reading(), ()))
    traces = [trace for trace in curves_figure(report).content()["data"] if trace["name"] == "limits"]
    assert [trace["xaxis"] for trace in traces] == ["x", "x", "x", "x2", "x2"]
    over_speed = traces[-1]
    assert max(over_speed["y"]) == pytest.approx(1240.0)
    assert min(over_speed["y"]) == pytest.approx(60.0)


@pytest.mark.parametrize(
    ("rate", "code", "text"), [(2010.0, 0, "pass: all curves"), (2400.0, 1, "FAIL: run, compression")]
)
def test_the_command_prints_the_result_and_exits_1_if_a_curve_fails(tmp_path, rate, code, text):
    words = ["report", record(tmp_path / "run.csv", rate), "--limits", master(tmp_path / "m.csv", tolerance=""),
             "--tolerance", "5 %", "--tolerance", "10 N", "--cycle", "last", "-o", tmp_path / "page.html"]  # fmt: skip
    done = CliRunner().invoke(main, list(map(str, words)))
    assert done.exit_code == code, done.output
    assert text in done.output
    html = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "Limits: m.csv" in html
    assert ("Limits: FAIL (run)." in html) == bool(code)
    assert ("Limits: pass." in html) != bool(code)


def test_the_velocity_of_a_track_is_measured_or_the_derivative_of_the_displacement(tmp_path):
    time = np.arange(2000) / 500.0
    path, velocity = 0.01 * np.sin(6.0 * time), 0.06 * np.cos(6.0 * time)
    rows = "\n".join(f"{t:.6g},{1e3 * x:.9g},{v:.9g}" for t, x, v in zip(time, path, velocity, strict=True))
    (tmp_path / "lap.csv").write_text(f"time [s],pot [mm],shaft [m/s]\n{rows}\n")
    assert read_track(tmp_path / "lap.csv") == pytest.approx(velocity, abs=1e-6)
    derived = read_track(tmp_path / "lap.csv", "pot")
    assert derived[100:-100] == pytest.approx(velocity[100:-100], abs=2e-4)
    with pytest.raises(InputError, match=r"the file has: pot \[m\], shaft \[m/s\]"):
        read_track(tmp_path / "lap.csv", "time")
