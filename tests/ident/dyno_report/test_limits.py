"""A run passes if its curve is within the tolerance of the master curve at every speed, and fails otherwise."""

import numpy as np
import pytest
from click.testing import CliRunner

from eightpost.__main__ import main
from eightpost.errors import InputError, TooShortError
from eightpost.ident.dyno_report.builds import Reading, dyno_report, read_entries, read_limits, read_track
from eightpost.ident.dyno_report.entry import entry_of_test
from eightpost.ident.dyno_report.figures import curves_figure
from eightpost.ident.dyno_report.page import limit_table

from .conftest import run, sine, valve, viscous

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
    compression = judged(tmp_path, 2410.0, limits).judgements[0]
    assert compression.speed == 0.1
    assert compression.deviation == pytest.approx(41.0, rel=0.02)
    assert compression.text == "54.2 lbf at 3.94 in/s, master 45 ± 4.5 lbf"


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
    ("rate", "code", "text"), [(2010.0, 0, "pass: all judged curves"), (2400.0, 1, "FAIL: run, compression")]
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
    with pytest.raises(InputError, match=r"the file has: time \[s\], pot \[mm\], shaft \[m/s\]"):
        read_track(tmp_path / "lap.csv", "time")


@pytest.mark.parametrize("tolerance", [0.0, -20.0])
def test_a_tolerance_that_is_not_positive_is_an_error(tmp_path, tolerance):
    with pytest.raises(InputError, match=f"a tolerance must be above 0, not {tolerance:g}"):
        read_limits(master(tmp_path / "m.csv", values=(20.0, tolerance, 20.0, 20.0)), Reading(), ())


def test_curves_that_reach_no_speed_of_the_master_are_not_judged_and_pass_nothing(tmp_path):
    path = tmp_path / "m.csv"
    path.write_text("speed [m/s],compression [N],rebound [N],tolerance [N]\n3,100,-100,5\n4,200,-200,5\n")
    words = ["report", record(tmp_path / "run.csv"), "--limits", path, "-o", tmp_path / "page.html"]
    done = CliRunner().invoke(main, list(map(str, words)))
    assert done.exit_code == 1, done.output
    assert "not judged: run, which has no measured curve" in done.output
    assert "pass" not in done.output
    assert "Limits: not judged." in (tmp_path / "page.html").read_text(encoding="utf-8")
    table = master(tmp_path / "table.csv", tolerance="")
    entries = read_entries([tmp_path / "run.csv", table], Reading())
    judged = dyno_report(entries, speeds=SPEEDS, limits=read_limits(master(tmp_path / "near.csv"), Reading(), ()))
    assert judged.unjudged == ()
    assert dyno_report(entries, speeds=SPEEDS).unjudged == ()


def test_a_cycle_of_a_motion_that_is_not_one_steady_cycle_is_named_as_not_shown():
    series = sine(valve(viscous(2000.0), viscous(2000.0)), duration=0.75)
    shown = [entry_of_test(run(series), "a", "a", cycle=cycle).notes for cycle in ("mean", "last", 3)]
    assert [any("all cycles are shown" in note for note in notes) for notes in shown] == [False, True, True]
    steady = sine(valve(viscous(2000.0), viscous(2000.0)), duration=3.0)
    assert not any("all cycles" in note for note in entry_of_test(run(steady), "a", "a", cycle="last").notes)


def lap(path, columns):
    """Write a record of 4 s with columns by header."""
    time = np.arange(2000) / 500.0
    rows = zip(time, *(values * np.sin(6.0 * time) for values in columns.values()), strict=True)
    path.write_text("\n".join([",".join(["time [s]", *columns]), *(",".join(f"{v:.6g}" for v in r) for r in rows)]))
    return path


def test_a_track_whose_columns_do_not_show_the_shaft_needs_its_name(tmp_path):
    """Two shafts, or the speed of the car, give no histogram by chance; other columns may be incomplete."""
    two = lap(tmp_path / "two.csv", {"lf [mm/s]": 100.0, "rf [mm/s]": 50.0})
    with pytest.raises(InputError, match=r"2 columns have a unit of velocity or length; name one"):
        read_track(two)
    assert np.abs(read_track(two, "rf")).max() == pytest.approx(0.05, rel=0.01)
    car = lap(tmp_path / "car.csv", {"GPS [km/h]": 150.0, "pot [mm]": 10.0, "fuel [%]": np.nan})
    with pytest.raises(InputError, match=r"'GPS' reaches 41.7 m/s, which no shaft does"):
        read_track(car)
    assert np.abs(read_track(car, "pot")).max() == pytest.approx(0.06, rel=0.01)


def test_a_track_of_a_few_samples_is_too_short(tmp_path):
    (tmp_path / "lap.csv").write_text("time [s],pot [mm]\n0,1\n0.01,2\n0.02,3\n")
    with pytest.raises(TooShortError, match="has 3 samples"):
        read_track(tmp_path / "lap.csv")
