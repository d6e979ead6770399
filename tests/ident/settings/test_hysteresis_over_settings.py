"""The law `hysteresis` over settings: both curves depend on the clicks, lag and stop are common."""

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from eightpost.ident.shock.hysteresis import HysteresisProblem
from eightpost.ident.shock.runs import prepare_runs
from eightpost.ident.shock.settings import fit_settings, held_out_percent
from eightpost.ident.shock.settings_table import SettingsTable
from eightpost.shock import Axis, Hysteresis, Port, read_shock, write_shock
from tests.ident.dyno_records import DIGRESSIVE, SHARES, curve_of, record_of

CLICKS = (0.0, 10.0, 20.0, 28.0)
STOP = {"stop_stiffness": 1e5, "stop_yield": 4e-4, "stop_time": 2e-2}


def true_law(clicks, stop=None):
    """Clicks from hard soften rebound, and more so the part that lags."""
    open_ = 1.0 - (1.0 - clicks / 28.0) ** 2
    slope = DIGRESSIVE * np.where(SHARES < 0.0, 1.0 - 0.5 * open_, 1.0)
    lagged = slope * np.where(SHARES < 0.0, 0.7 - 0.4 * open_, 0.7)
    port = Port(gas_preload=150.0, gas_stiffness=900.0)
    return Hysteresis(curve_of(slope), tuple(lagged.tolist()), (6e-3, 4e-3, 8e-3), **(stop or {}), port=port)


@lru_cache
def record(clicks, seed, stop=False):
    return record_of(true_law(clicks, STOP if stop else None), seed)


def table(clicks, stop=False):
    axis = Axis("rebound", clicks, clicks[len(clicks) // 2], counted="from full hard", lowest=0.0, highest=28.0)
    tests = tuple((record(value, k, stop),) for k, value in enumerate(clicks))
    files = tuple(Path(f"rebound_{value:g}.csv") for value in clicks)
    return SettingsTable("shock", "hysteresis", "estimate", (axis,), tuple((c,) for c in clicks), tests, files)


@pytest.fixture(scope="module")
def fit():
    return fit_settings(table(CLICKS))


@pytest.mark.parametrize("clicks", [5.0, 15.0, 24.0])
def test_a_setting_between_the_measured_ones_is_predicted_as_well_as_the_noise_allows(fit, clicks):
    found = fit.shock.at(clicks={"rebound": clicks}).law
    runs = prepare_runs([record(clicks, 7)])
    noise = held_out_percent(true_law(clicks), runs)
    assert held_out_percent(found, runs) < np.hypot(noise, 0.3)
    assert found.time_constant[1] == pytest.approx(4e-3, rel=0.05)


def test_a_lagged_part_that_kept_its_share_of_the_curve_would_predict_worse(fit):
    settings, runs = fit.settings, prepare_runs([record(24.0, 7)])
    terms = tuple(replace(t, deviations=tuple((*r[:25], r[-1]) for r in t.deviations)) for t in settings.terms)
    shared = replace(settings, parameters=(), terms=terms)
    errors = [held_out_percent(one.law_at(fit.shock.law, (24.0,)), runs) for one in (settings, shared)]
    assert errors[1] > 1.3 * errors[0]


def test_the_lagged_curve_follows_the_clicks_and_is_stored(fit, tmp_path):
    write_shock(fit.shock, tmp_path / "shock.json")
    shock = read_shock(tmp_path / "shock.json")
    assert shock.settings.parameters == ("lagged_slope",)
    for clicks in (0.0, 28.0):
        found, truth = shock.at(clicks={"rebound": clicks}).law, true_law(clicks)
        rebound = slice(4, 9)  # knots with many samples
        shares = [np.sum(law.lagged_slope[rebound]) / np.sum(law.curve.knot_slope[rebound]) for law in (found, truth)]
        assert shares[0] == pytest.approx(shares[1], abs=0.06)


def test_the_bands_cover_the_true_curves(fit):
    covered = []
    for clicks in (0.0, 5.0, 15.0, 28.0):
        found, truth = fit.shock.at(clicks={"rebound": clicks}), true_law(clicks).curve
        band = found.fit["curve_band"]
        inner = np.abs(np.array(band["velocity [m/s]"])) < 0.6
        error = np.array(band["force [N]"]) - [truth.force(v) for v in band["velocity [m/s]"]]
        covered.append(np.mean(np.abs(error)[inner] <= np.array(band["half_width [N]"])[inner]))
    assert np.mean(covered) > 0.9


@pytest.fixture(scope="module")
def with_stop():
    return fit_settings(table((0.0, 28.0), stop=True))


@pytest.mark.nightly
def test_all_settings_share_a_stop_that_the_records_show(with_stop):
    for clicks in (0.0, 28.0):
        law = with_stop.shock.at(clicks={"rebound": clicks}).law
        assert law.stop_stiffness * law.stop_yield == pytest.approx(40.0, rel=0.05)  # six noises: 38.6 to 39.8
        assert law.stop_time == pytest.approx(2e-2, rel=0.02)  # six noises: within 0.7 %


@pytest.mark.nightly
def test_the_normal_equations_of_the_joint_search_have_the_gradient_of_its_cost(with_stop):
    problem = HysteresisProblem(with_stop.joint.model, is_thin=True)
    assert problem.shared.size == 2  # stop and gas stiffness
    at = np.array([*np.log([5e-3, 4e-3, 6e-3, 4e-4, 2e-2]), 0.05, 0.02])
    _, right = problem.at(at).normal_equations
    for number, step in enumerate(1e-4 * np.eye(at.size)):
        slope = (problem.at(at + step).cost - problem.at(at - step).cost) / 2e-4
        assert slope == pytest.approx(-2.0 * right[number], rel=0.02, abs=1e-3 * problem.at(at).cost)
