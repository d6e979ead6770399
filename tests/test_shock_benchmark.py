"""The table of shock laws: one short run gives rows, and the Bouc-Wen model is correct."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from benchmarks.bouc_wen import BoucWen, fit_bouc_wen, hysteresis, predict
from benchmarks.measured_laws import REST, RUN, SPEED, TIME, regrets, rests
from benchmarks.measured_laws import summary as regret_summary
from benchmarks.measured_tables import lag_table
from benchmarks.printed_shocks import CONFIGURATIONS, TABLE_3_4
from benchmarks.shock_records import BOUC_WEN, Case
from benchmarks.shock_rows import FIGURES, Bench, FailedFit, FitErrors
from benchmarks.shock_tables import gains_table, less, markdown, summary, table_3_5, virtual
from eightpost.ident.shock.record import prepare
from eightpost.rig import DynoTest
from eightpost.signals import TimeSeries

pytestmark = pytest.mark.nightly

ROOT = Path(__file__).resolve().parents[1]
KEYS = {"record", "law", "fit_percent", "validation_percent", "seconds"}
WEN = BoucWen(1500.0, 800.0, 4e4, 30.0, reach=2e-3, share=0.7, exponent=1.6, reference=0.0)


@pytest.mark.slow
def test_a_run_of_one_configuration_leaves_a_row_for_each_law(tmp_path):
    program, told = ROOT / "benchmarks" / "shock_fit.py", tmp_path / "rows.json"
    options = ["--quick", "--configurations", "1", "--laws", "polylinear,lpf1", "--json", str(told)]
    ran = subprocess.run(
        [sys.executable, str(program), *options], cwd=tmp_path, capture_output=True, text=True, check=False,
        env={"PATH": "", "OMP_NUM_THREADS": "1"},
    )  # fmt: skip
    assert ran.returncode == 0, ran.stderr[-2000:]
    static, lagged = json.loads(told.read_text())
    assert set(static) == set(lagged) == KEYS
    assert (static["record"], static["law"], lagged["law"]) == ("configuration 1", "polylinear", "lpf1")
    assert lagged["validation_percent"] < 0.65 * static["validation_percent"] < 10.0
    assert all(0.8 < one["validation_percent"] / one["fit_percent"] < 1.5 for one in (static, lagged))
    assert all(one["seconds"] > 0.0 for one in (static, lagged))


def motion(seed, duration=4.0, rate=300.0):
    """Return displacement [m] and velocity [m/s] of six sines at 0.4 to 3 Hz, at most 15 mm."""
    generator = np.random.default_rng(seed)
    time = np.arange(round(duration * rate) + 1) / rate
    angles = 2.0 * np.pi * np.outer(np.linspace(0.4, 3.0, 6), time) + generator.uniform(0.0, 6.3, (6, 1))
    channels = {
        "displacement": ("m", 2.5e-3 * np.sin(angles).sum(axis=0)),
        "velocity": ("m/s", 2.5e-3 * np.gradient(np.sin(angles), 1.0 / rate, axis=1).sum(axis=0)),
    }
    return TimeSeries.from_channels(time, channels)


def test_the_hysteresis_follows_wens_equation():
    series = motion(1)

    def slope(time, z):
        v = np.interp(time, series.time, series["velocity"])
        beta, gamma = WEN.share / WEN.reach**WEN.exponent, (1.0 - WEN.share) / WEN.reach**WEN.exponent
        size = abs(z[0])
        return [v - beta * abs(v) * size ** (WEN.exponent - 1.0) * z[0] - gamma * v * size**WEN.exponent]

    exact = solve_ivp(slope, (0.0, series.duration), [0.0], t_eval=series.time, rtol=1e-8, atol=1e-12, max_step=2e-3)
    found = hysteresis(series["velocity"], 1.0 / 300.0, np.array([WEN.reach, WEN.share, WEN.exponent]))
    # Only samples in which the velocity changes its sign differ, because their displacement is integrated as a whole.
    assert np.abs(found - exact.y[0]).max() < 5e-3 * WEN.reach


@pytest.mark.nightly  # every change: that a campaign leaves rows, and that the hysteresis follows its equation
def test_bouc_wen_is_recovered_from_its_own_records_and_predicts_another_run():
    series = [motion(seed) for seed in (1, 2, 3)]
    forces = [WEN.force(one) + zero for one, zero in zip(series, (0.0, 50.0, -20.0), strict=True)]
    tests = [DynoTest(one.with_channel("force", "N", force)) for one, force in zip(series, forces, strict=True)]
    fit = fit_bouc_wen(tests[:2])
    assert fit.rms < 0.01 * fit.deviation
    assert len(fit.costs) >= 10
    assert fit.law.damping == pytest.approx(WEN.damping, rel=0.05)
    held_out = prepare(tests[2])
    assert np.std(predict(fit.law, held_out) - held_out.measured) < 0.015 * held_out.deviation


def found(law, rms, offset=0.0, **changed):
    case = replace(Case("configuration 5", (), None, configuration=5), **changed)
    return FitErrors(
        case, law, fit_rms=rms, fit_deviation=1000.0, rms=rms, offset=offset, deviation=1000.0, seconds=1.0
    )


def test_errors_are_about_their_mean_only_where_the_load_cells_zero_is_unknown():
    assert found("lpf1", 50.0, 30.0).row()["validation_percent"] == pytest.approx(5.0)
    assert found("lpf1", 50.0, 30.0, about_mean=True).row()["validation_percent"] == pytest.approx(4.0)


def test_a_law_that_cannot_be_fitted_has_a_row_without_figures():
    refused = FailedFit(Case("configuration 11", (), None, configuration=11), "lpnl2", "the curve falls, and so on")
    assert set(refused.row()) == KEYS
    assert [refused.row()[name] for name in FIGURES] == [None] * 3
    assert "not fitted: the curve falls |" in markdown([refused])


def test_a_parameter_at_a_bound_is_marked():
    parameters = {"time_constant": 0.05, "lag_full_force": 93.3, "lag_zero_force": 95.7}
    lagged = replace(
        found("lpnl2", 50.0, about_mean=True), parameters=parameters, at_bound=frozenset(["time_constant"])
    )
    assert lag_table([lagged]).splitlines()[-1] == "| configuration 5 | - | 50 (bound) | 93.3 | 95.7 |"


def test_the_dissertations_recipe_fits_its_own_laws():
    laws = ("lpnl2", "hysteresis", BOUC_WEN)
    assert Bench((1,), laws, quick=True, recipe="boggs").fitted == ("lpnl2",)
    assert Bench((1,), laws, quick=True).fitted == laws


def test_the_tables_show_the_printed_figures_too():
    errors = virtual([found("polylinear", 200.0), found("lpf1", 100.0), found("lpnl2", 101.0, cavitates=True)])
    assert less(errors[0].rms, "lpf1") == pytest.approx(50.0)
    # Table 3.5, build 2, 1 click, 50 psi.
    assert "| 41.5 |" in table_3_5(errors)
    assert table_3_5(errors).splitlines()[-1].endswith("| 22.7 | 22.7 | 21.2 |")
    assert "| 5 | 225 | yes |" in gains_table(errors)
    assert any("1.010 (configuration 5); required: at most 1.005" in line for line in summary(errors))


def test_the_regret_of_a_law_is_its_error_over_the_smallest_one():
    errors = {"polylinear": 8.0, "lpf1": 4.0, "lpnl2": 2.08, "hysteresis": 2.0}
    found = [(kind, "", errors) for kind in (TIME, RUN, REST, SPEED)] + [(TIME, "", errors | {"lpf1": None})]
    np.testing.assert_allclose(regrets(found, "lpnl2"), 0.04)
    assert regrets(found, "lpf1").tolist() == [1.0] * 4 + [np.inf]
    assert f"| {RUN} | LPNL2 | 2.08 | 1 of 1 | 4 | 4 | 4 |" in regret_summary(found)
    assert f"| {TIME} | Hysteresis (default) | 2 | 2 of 2 | 0 | 0 | 0 |" in regret_summary(found)


def test_a_part_has_a_rest_if_the_shock_stands_still_for_more_than_moments():
    series = motion(1)
    moving = series.time < 2.0
    still = series.with_channel("velocity", "m/s", np.where(moving, series["velocity"], 0.0))
    test = DynoTest(still.with_channel("force", "N", still["velocity"]))
    parts = ((0.0, 1.9), (1.0, 2.1), (1.0, 2.0), (0.0, 4.0))
    assert [rests(test, ends) for ends in parts] == [False, True, False, True]


def test_the_printed_tables_agree_with_the_text():
    """3.4.1: dynamic laws 45 to 75 % better, LPNL2 never worse than LPF1; 3.3.4: reductions of Table 3.4."""
    assert [c.number for c in CONFIGURATIONS] == list(range(1, 13))
    less = [1.0 - c.rms_lbf[law] / c.rms_lbf["polylinear"] for c in CONFIGURATIONS for law in ("lpf1", "lpnl2")]
    assert np.round(min(less), 2) >= 0.45
    assert np.round(max(less), 2) <= 0.75
    assert all(c.rms_lbf["lpnl2"] <= c.rms_lbf["lpf1"] for c in CONFIGURATIONS)
    for law, row in TABLE_3_4.items():
        if law != "polylinear":
            reduction = 100.0 * (1.0 - row.rms_lbf / TABLE_3_4["polylinear"].rms_lbf)
            assert reduction == pytest.approx(row.percent_less_than_static, abs=0.2)
        assert row.percent_of_deviation == pytest.approx(100.0 * row.rms_lbf / 366.5, abs=0.05)
