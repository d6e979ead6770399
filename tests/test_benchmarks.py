"""The table of engines: a short run of each type of engine gives a row, and the figures of the rows are right."""

import json
import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks import case as cases
from benchmarks.engines import c_loop, fmpy_loop, runs
from benchmarks.engines.runs import Diverged, Job, Recording, row
from benchmarks.table import markdown
from eightpost.signals import TimeSeries

pytestmark = pytest.mark.nightly

ROOT = Path(__file__).resolve().parents[1]
KEYS = {
    "engine", "scheme", "damping", "rate_hz", "us_per_step", "error_velocity_percent", "error_tire_force_percent",
}  # fmt: skip


@pytest.mark.nightly
def test_a_run_of_one_engine_leaves_rows_whose_errors_fall_with_the_rate(tmp_path):
    told = tmp_path / "rows.json"
    options = ["--quick", "--engines", "fmpy", "--damping", "full", "--stop", "1.2", "--json", str(told)]
    ran = subprocess.run(
        [sys.executable, "-m", "benchmarks.engines", *options], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert ran.returncode == 0, ran.stderr[-2000:]
    rows = json.loads(told.read_text())
    assert [set(one) for one in rows] == [KEYS] * len(rows)
    assert {(one["engine"], one["scheme"], one["damping"]) for one in rows} == {
        ("fmpy", scheme, "full") for scheme in fmpy_loop.SCHEMES
    }
    by_rate = {one["rate_hz"]: one for one in rows if one["scheme"] == "jacobi, held"}
    assert all(one["us_per_step"] > 0.0 for one in rows if one["error_velocity_percent"] is not None)
    assert by_rate[4000.0]["error_tire_force_percent"] < by_rate[1000.0]["error_tire_force_percent"] < 100.0
    assert ran.stdout.startswith("| engine | scheme |")


def test_a_diverged_run_has_neither_errors_nor_a_cost():
    found = row(None, ("fmpy", "jacobi, held", "full", 125.0), Diverged("fmi2DoStep failed"))
    assert set(found) == KEYS
    assert found["us_per_step"] is found["error_velocity_percent"] is found["error_tire_force_percent"] is None
    assert "diverges | diverges" in markdown([found])


@pytest.fixture
def solved():
    """Return a case with known signals: 2 s of sines, without a run."""
    time = np.arange(0.0, 2.0, 0.008)
    signal = np.sin(2.0 * np.pi * 5.0 * time) * np.ones((4, 1))
    return cases.Case(None, None, 2.0, time, signal, 1e3 * signal)


def recorded(case, factor):
    static = cases.read_vehicle(ROOT / "examples" / "car.toml").static
    totals = factor * case.tire_force + np.array([[static[f"{c}.tire_force"]] for c in cases.CORNERS])
    return Recording(case.time, np.vstack([factor * case.velocity, totals]), 1e-3, 1000, 125.0)


@pytest.mark.parametrize(("factor", "expected"), [(1.0, 0.0), (1.1, 10.0), (0.5, 50.0)])
def test_errors_are_in_percent_of_the_signals_standard_deviation(solved, factor, expected):
    found = row(solved, ("fmpy", "jacobi, held", "full", 125.0), recorded(solved, factor))
    for name in ("error_velocity_percent", "error_tire_force_percent"):
        assert found[name] == pytest.approx(expected, rel=1e-2, abs=1e-9)
    assert found["us_per_step"] == pytest.approx(1.0)


@pytest.mark.parametrize("seconds", [0.0, -1e-3])
def test_an_invalid_time_gives_no_cost(solved, seconds):
    found = row(solved, ("fmpy", "jacobi, held", "full", 125.0), replace(recorded(solved, 1.1), seconds=seconds))
    assert found["us_per_step"] is None
    assert markdown([found]).splitlines()[-1] == "| fmpy | jacobi, held | full | 125 | - | - | 10 | 10 |"


def test_the_cost_of_the_default_is_the_time_of_its_runs(monkeypatch):
    """Check that the cost is the stepping time of the fastest call, divided by the steps of its last run."""
    names, took = runs.NAMES, iter((0.5, 0.3, *[0.4] * 100))
    scenarios = []

    def run(_system, scenario, **_options):
        scenarios.append(scenario)
        time = np.linspace(0.0, scenario.stop, 5)
        series = TimeSeries(time, np.zeros((len(names), 5)), names, ("1",) * len(names))
        return SimpleNamespace(series=series, stepping_seconds=next(took), steps=2000, partial=False)

    monkeypatch.setattr(runs.cosim, "run", run)
    found = runs.run_default(None, cases.track(), 2.0, repeats=3)
    assert (found.seconds, found.steps, found.rate) == (0.3, 2000, 1000.0)
    assert {scenario.stop for scenario in scenarios} == {2.0}


@pytest.mark.nightly
def test_the_loop_in_c_and_the_one_over_fmpy_are_the_same_schemes(tmp_path):
    cases.build_fmus(cases.fitted_law(), tmp_path)
    for scheme in fmpy_loop.SCHEMES:
        values = []
        for engine in (c_loop, fmpy_loop):
            work = tmp_path / f"{engine.__name__} {scheme}"
            work.mkdir()
            found = engine.run(Job(tmp_path, cases.track(), scheme, 500.0, 1.0, work))
            assert found.seconds > 0.0
            assert found.steps == 500
            values.append(found.values)
        assert np.ptp(values[0], axis=1).min() > 1e-3
        np.testing.assert_allclose(values[0], values[1], rtol=1e-9, atol=1e-9)


def test_a_run_with_an_error_of_ten_standard_deviations_counts_as_diverged(solved):
    found = row(solved, ("fmpy", "jacobi, held", "full", 125.0), recorded(solved, 12.0))
    assert found["error_velocity_percent"] is found["us_per_step"] is None


def test_the_split_shock_and_the_dampers_give_the_whole_curve_together():
    law = cases.fitted_law()
    rest, rate = cases.split_law(law)
    assert rate > 0.0
    for velocity in (-1.0, -0.5, -0.381, -0.1, 0.0, 0.05, 0.381, 0.6, 0.9):
        together = rest.curve.force(velocity) + rate * velocity
        assert math.isclose(together, law.curve.force(velocity), rel_tol=1e-9, abs_tol=1e-6)
