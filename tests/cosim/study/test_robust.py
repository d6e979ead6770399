"""Spreads of constructed measures: certain and uncertain differences, and properties of the draws."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pyarrow.parquet
import pytest

from cosim.study.choice import robust
from cosim.study.choice.assess import Knowledge
from cosim.study.choice.certainty import Effect, VehicleSource
from cosim.study.choice.compare import usable_deviation, write_comparisons
from cosim.study.choice.rig_day import Measured, comparisons
from cosim.study.choice.robust import (
    Spread,
    Uncertain,
    Uncertainty,
    drawn_studies,
    knowledge_of,
    linearity_check,
    read_uncertainty,
    run_draws,
    spreads_of,
    write_spreads,
)
from cosim.study.choice.sources import UncertainParameter, error_sources
from cosim.study.definition import Term
from cosim.study.running.sweep import Sweep, run_study
from eightpost.api.study_folder import StudyFolder
from eightpost.errors import FileFormatError
from eightpost.shock import Hysteresis, read_shock, write_shock
from eightpost.shock.file import fitted_parameters
from eightpost.uncertainty import LeftOutBlocks
from eightpost.validity import ParameterUncertainty, judged
from eightpost.verdict import Verdict
from tests.shock.example_curve import knot_curve
from tests.unchanged import refusals

from .constructed import independent, result, study
from .coupled import InProcess
from .coupled import study as coupled_study

COVARIANCE = np.array([[4e-4, -1e-4], [-1e-4, 1e-4]])
SHOCK = Uncertain("C/B", ("compression_scale", "rebound_scale"), np.array([1.0, 1.0]), COVARIANCE)


def parameters(studies, build: str, name: str) -> np.ndarray:
    return np.array([drawn.bank[build].parameters[name] for drawn in studies])


def test_draws_have_the_covariance_that_they_are_drawn_from():
    studies = drawn_studies(study(("front",)), [SHOCK], draws=2000)
    drawn = np.stack([parameters(studies, "C/B", name) for name in SHOCK.names])
    np.testing.assert_allclose(drawn.mean(axis=1), 1.0, atol=1e-4)
    np.testing.assert_allclose(np.cov(drawn), COVARIANCE, rtol=0.1)


def test_parts_with_the_same_test_are_drawn_with_the_correlation_of_their_fits():
    blocks = LeftOutBlocks.of(np.linspace(0.1, 0.2, 20), {"compression_scale": np.sin(np.arange(20.0))})
    names, values, covariance = ("rebound_scale", "compression_scale"), np.ones(2), np.diag([9e-4, 1e-4])
    parts = [Uncertain(build, names, values, covariance, left_out=blocks) for build in ("C/B", "C/C")]
    studies = drawn_studies(study(("front",)), parts, draws=500)
    drawn = np.stack([parameters(studies, build, name) for build in ("C/B", "C/C") for name in names])
    np.testing.assert_allclose(drawn[1], drawn[3])  # one error
    np.testing.assert_allclose(drawn.std(axis=1), [0.03, 0.01, 0.03, 0.01], rtol=0.05)
    assert np.abs(np.corrcoef(drawn)[[0, 0, 1], [1, 2, 2]]).max() < 0.15


def test_only_uncertain_parts_are_drawn_and_one_may_have_two_uncertainties():
    lag, car = independent("C/B", {"time_constant": (1e-3, 1e-5)}), independent("car", {"lf.friction_force": (60, 5)})
    for drawn in drawn_studies(study(("front",)), [SHOCK, lag, car], draws=3):
        assert set(drawn.bank["C/B"].parameters) == {*SHOCK.names, "time_constant"}
        assert not drawn.bank["C/C"].parameters
        assert set(drawn.vehicle.parameters) == {"lf.friction_force"}


def test_a_spread_contains_the_setups_that_every_draw_has():
    def front(scale: float):
        return lambda digits: scale * digits.sum(axis=1)

    nominal = result({"front": front(1.0)})
    draws = [result({"front": front(s)}, kept=np.array(k)) for s, k in ((0.9, [0, 3, 8]), (1.1, [0, 1, 3, 8]))]
    (found,) = spreads_of(nominal, draws, [8, 3, 0, 5])
    assert found.setups.tolist() == [0, 3, 8]
    np.testing.assert_allclose(found.values, [0.0, 3.0, 2.0])
    np.testing.assert_allclose(found.draws, np.outer([0.9, 1.1], found.values))


@pytest.mark.parametrize("drawn", [True, False])
def test_the_file_of_spreads_has_the_objective_and_the_stated_noise_of_each_measure(tmp_path, drawn):
    measures = {"front": lambda digits: 1.0 + digits.sum(axis=1), "rear": lambda digits: 2.0 + digits[:, 0]}
    nominal = result(measures, objective=(Term("front", 2.0, "m"), Term("rear", 3.0, "mm")), failed=(1,))
    spreads = spreads_of(nominal, [nominal, nominal] if drawn else [], [0, 1, 8])
    write_spreads(spreads, tmp_path / "robust.parquet", nominal, Uncertainty(run_to_run={"front": 0.5}, runs=4))
    table = pyarrow.parquet.read_table(tmp_path / "robust.parquet")
    assert table.schema.metadata == {b"study": nominal.provenance.digest.encode()}
    rows = {row["measure"]: row for row in table.to_pylist()}
    assert [(name, row["run_to_run"], row["runs"]) for name, row in rows.items()] == [
        ("objective", 1.0, 4), ("front", 0.5, 4), ("rear", 0.0, 4),
    ]  # fmt: skip
    levels = 2.0 * nominal.values("front") + 3000.0 * nominal.values("rear")
    np.testing.assert_allclose(rows["objective"]["values"], levels[[0, 1, 8]])
    assert np.isnan(rows["rear"]["values"][1]) and rows["rear"]["setups"] == [0, 1, 8]
    assert len(rows["front"]["draws"]) == (2 if drawn else 0)


# ==== Effects of the entries of an uncertainty file, and the check of linear effects by simulated draws ==============

STUDY = result({"a": lambda digits: 1.0 + digits.sum(axis=1)}, builds=("B/B", "C/C"))

#: Values in the study, and ln(changed / nominal) of the measure by a deviation of the parameter at each corner.
VALUES, SLOPES = {"lag": 1.0, "scale": 2.0, "gas": 3.0}, {"lag": 0.03, "scale": 0.04, "gas": 0.05}


@pytest.fixture
def known(monkeypatch):
    """A function of an uncertainty file's entries for a study whose FMUs state `lag` and `gas` of B/B, and no C/C."""
    stated = [UncertainParameter("B/B", VALUES[name], ParameterUncertainty(name, 0.1)) for name in ("lag", "gas")]

    def effects_of(_result, parameters, _sweep, _workers, _progress, *, vehicles):
        cars = [Effect("car", path.name, 1.0, 0.0, {"a": 0.2}, {}) for path in vehicles]
        return *map(effect, parameters), *cars

    def effect(one):
        name, corners = one.stated.name, STUDY.study.corners
        at = {corner: {one.part: {"a": SLOPES[name]}} for corner in corners}
        return Effect(one.part, name, one.stated.deviation, 0.0, {}, at)

    def values(_fmu, _parameters, names):
        return {name: VALUES[name] for name in names if name in VALUES}

    monkeypatch.setattr(robust, "stated_parameters", lambda _: (stated, ("C/C",), ("a note",)))
    monkeypatch.setattr(robust, "effects_of", effects_of)
    monkeypatch.setattr(robust, "parameter_values", values)
    return lambda *parts, vehicles=(): knowledge_of(
        STUDY, Uncertainty(parts, vehicles=vehicles), {"a": 0.5}, None, None
    )


def test_an_entry_of_the_file_replaces_what_the_fmu_states_about_the_same_parameter(known):
    found = known(independent("B/B", {"lag": (1.0, 0.2)}), independent("C/C", {"scale": (2.0, 0.3)}))
    rows = [(one.part, one.parameter, one.deviation) for one in found.effects]
    assert rows == [("B/B", "gas", 0.1), ("B/B", "lag", 0.2), ("C/C", "scale", 0.3)]
    assert (found.unstated, found.run_to_run, found.notes) == ((), {"a": 0.5}, ("a note",))


def test_a_value_of_the_file_more_than_a_deviation_from_the_studys_is_reported(known):
    near, far = (known(independent("B/B", {"lag": (value, 0.2)})).notes for value in (1.15, 1.25))
    assert near == ("a note",)
    assert far[1:] == (
        "B/B: the study has lag = 1, the uncertainty file 1.25; only its deviation is used",
    )  # fmt: skip


@pytest.mark.parametrize("correlation", [-0.6, 0.0, 0.5, 1.0])
def test_correlated_parameters_change_a_setup_with_the_variance_of_their_covariance(known, correlation):
    deviations = np.array([0.2, 0.3])
    covariance = np.outer(deviations, deviations) * np.array([[1.0, correlation], [correlation, 1.0]])
    entry = Uncertain("B/B", ("lag", "scale"), np.array([1.0, 2.0]), covariance)
    sources = error_sources(STUDY, known(entry).effects)
    row = STUDY.row(dict.fromkeys(STUDY.study.corners, "B/B"))
    lag, scale, gas = (4.0 * SLOPES[name] for name in ("lag", "scale", "gas"))  # at four corners
    expected = lag**2 + scale**2 + 2.0 * correlation * lag * scale + gas**2
    assert sources.shock_covariance(np.array([row]), 0, 0) == pytest.approx(expected)


def test_combinations_of_correlated_parameters_are_named_after_both(known):
    entry = Uncertain("B/B", ("lag", "scale"), np.array([1.0, 2.0]), np.array([[0.04, 0.03], [0.03, 0.09]]))
    names = [one.parameter for one in known(entry).effects]
    assert names == ["gas", "lag and scale, combination 1", "lag and scale, combination 2"]


def test_the_vehicles_uncertainty_is_the_models_unless_the_file_adds_to_it_or_replaces_it(known):
    car = independent("car", {"scale": (2.0, 0.1)})
    assert known().vehicle is VehicleSource.MODEL
    assert known(car).vehicle is VehicleSource.ADDED
    replaced = known(car, vehicles=(Path("other.fmu"),))
    assert replaced.vehicle is VehicleSource.REPLACED and replaced.effects[-1].parameter == "other.fmu"


@pytest.fixture
def checked():
    """A function of the simulated deviations of four setups, for a lag of B/B at the right rear corner."""
    lag = Effect("B/B", "lag", 1.0, 0.0, {}, {"rr": {"B/B": {"a": 0.1}}})
    setups = STUDY.setups[:4]  # B/B, C/C at rr in turn; the levels are 1, 2, 2, 3
    levels = STUDY.values("a")[:4]

    def check(*deviations, measure="a", values=levels):
        draws = levels + np.outer([-1.0, 0.0, 1.0], deviations)
        return linearity_check(STUDY, Knowledge((lag,)), [Spread(measure, setups, values, draws)])

    return check


def test_draws_that_follow_the_linear_effects_differ_from_them_by_nothing(checked):
    # ln(changed / nominal) = 0.1 for B/B at rr: the leader and the third setup (level 2) vary, the other two do not
    assert STUDY.builds("rr")[:4] == ["B/B", "C/C", "B/B", "C/C"]
    found = checked(0.1, 0.0, 0.2, 0.0)
    assert found.linear == pytest.approx(0.1) and found.simulated == pytest.approx(found.linear) and found.draws == 3


def test_the_largest_difference_from_the_linear_effects_is_stated_by_its_setup(checked):
    found = checked(0.1, 0.0, 0.2, 0.3)  # the last one varies by 0.2 against the leader, not by the 0.1 of the effect
    assert (found.setup, found.linear, found.simulated) == pytest.approx((STUDY.setups[3], 0.1, 0.2))
    assert found.summary().endswith(f"differs most for setup {STUDY.setups[3]}, a: -50 %")
    too_wide = checked(0.1, 0.06, 0.2, 0.0)
    assert (too_wide.setup, too_wide.summary()[-6:]) == (STUDY.setups[1], "+150 %")


def test_a_difference_that_hardly_varies_is_not_checked(checked):
    assert checked(0.1, 0.095, 0.2, 0.0).setup != STUDY.setups[1]  # by 0.005, a twentieth of the others


def test_without_draws_of_a_measure_of_the_study_nothing_is_checked(checked):
    assert checked(0.1, 0.0, 0.2, 0.0, measure="objective") is None
    assert checked(0.1, 0.0, 0.2, 0.0, values=np.full(4, np.nan)) is None
    assert (
        linearity_check(STUDY, Knowledge(), [Spread("a", STUDY.setups, STUDY.values("a"), np.empty((0, 16)))]) is None
    )


# ==== Uncertainty of a fitted shock, as parameters of its FMU ========================================================

BANK = Path(__file__).resolve().parents[3] / "examples" / "bank"


def document(build: str) -> dict:
    return json.loads((BANK / f"{build}.json").read_text())


@pytest.fixture
def free(tmp_path) -> Path:
    """Return a shipped build, changed as if its fit had ended within all bounds."""
    shock = read_shock(BANK / "AA_B.json")
    fitted = document("AA_B")["fit"]["parameters"]
    fitted["lag_full_force"] |= {"at_bound": "", "standard_error": 20.0}
    write_shock(judged(shock, fit={**shock.fit, "parameters": fitted}), tmp_path / "free.json")
    return tmp_path / "free.json"


def test_parameters_vary_by_their_standard_errors(free):
    found = fitted_parameters(read_shock(free))
    fitted = json.loads(free.read_text())["fit"]["parameters"]
    assert found.names == ("time_constant", "lag_full_force", "lag_zero_force", "compression_scale", "rebound_scale")
    errors = [fitted[name]["standard_error"] for name in found.names[:3]]
    np.testing.assert_allclose(np.sqrt(found.covariance.diagonal()[:3]), errors)
    assert found.held == ()


def test_every_element_of_a_fitted_parameter_varies_under_the_name_of_its_fmu_variable():
    """The time constants of Hysteresis are elements of one parameter."""
    shock = read_shock(BANK / "C_C.json")
    entry = {"value": 0.01, "standard_error": 0.001, "bounds": [3e-4, 0.2], "at_bound": "", "unit": "s"}
    fitted = {**{f"time_constant[{k}]": entry for k in (1, 2, 3)}, "gas_preload": entry}
    law = Hysteresis(knot_curve(), (0.0,) * 25, (0.01,) * 3)
    found = fitted_parameters(judged(shock, law=law, fit={**shock.fit, "parameters": fitted}))
    assert found.names[:3] == ("time_constant[1]", "time_constant[2]", "time_constant[3]")
    assert "gas_preload" not in found.names  # of the port: the vehicle moves about rest


def test_a_parameter_at_a_bound_is_held_and_reported():
    found = fitted_parameters(read_shock(BANK / "C_C.json"))
    assert "lag_full_force" not in found.names
    assert found.held == ("lag_full_force is kept at its fitted value: the fit ended at its lower bound",)


def test_the_scales_have_the_deviations_that_the_fit_derives_from_its_covariance():
    found = fitted_parameters(read_shock(BANK / "C_C.json"))
    deviation = dict(zip(found.names, np.sqrt(found.covariance.diagonal()), strict=True))
    stated = document("C_C")["fit"]["curve_band"]["factor_half_width"]
    assert list(stated) == ["compression_scale", "rebound_scale"]
    for name, half_width in stated.items():
        assert 1.96 * deviation[name] == pytest.approx(half_width, rel=1e-4)


def test_a_band_without_factors_counts_as_correlated_over_all_velocities():
    """If the force of a side is scaled by 1 ± sigma, the band has this relative width at every velocity."""
    shock, band = read_shock(BANK / "C_C.json"), document("C_C")["fit"]["curve_band"]
    del band["factor_half_width"]
    found = fitted_parameters(judged(shock, fit={**shock.fit, "curve_band": band}))
    velocity, force, half = (np.array(band[key]) for key in ("velocity [m/s]", "force [N]", "half_width [N]"))
    deviation = dict(zip(found.names, np.sqrt(found.covariance.diagonal()), strict=True))
    for name, side in (("compression_scale", velocity > 0), ("rebound_scale", velocity < 0)):
        energy = [np.sum((1.96 * deviation[name] * force[side]) ** 2), np.sum(half[side] ** 2)]
        assert energy[0] == pytest.approx(energy[1], rel=1e-3)


def test_draws_are_limited_to_the_bounds_of_the_fit(free):
    fit = fitted_parameters(read_shock(free))
    found = Uncertain("AA/B", fit.names, fit.values, fit.covariance, fit.lowest, fit.highest)
    drawn = found.at(100.0 * np.random.default_rng(1).normal(size=(50, 5)))
    low, high = document("AA_B")["fit"]["parameters"]["time_constant"]["bounds"]
    assert drawn[:, 0].min() == pytest.approx(low)
    assert drawn[:, 0].max() == pytest.approx(high)


def test_a_fit_that_an_uncertainty_file_names_is_drawn_with_what_it_has_in_common_with_others(free):
    blocks = LeftOutBlocks.of(np.linspace(0.1, 0.2, 20), {"rebound_scale": np.sin(np.arange(20.0))})
    shock = read_shock(free)
    write_shock(judged(shock, fit={**shock.fit, **blocks.section()}), free)
    folder = StudyFolder(free.parent, study(("front",)))
    (part,) = folder._fits({"AA/B": free})
    assert part.left_out == blocks
    write_shock(replace(shock, fit={**shock.fit, **blocks.section()}), free)
    with pytest.raises(FileFormatError, match="or was edited after the fit"):
        list(folder._fits({"AA/B": free}))


def test_a_shock_without_a_fit_states_no_uncertainty(shocks):
    assert fitted_parameters(shocks["lpf1"]) is None


# ==== Draws run with FMUs, and uncertainty files =====================================================================

#: The static force of the stiff build has a standard deviation of 10 %.
STIFF = independent("stiff", {"compression_scale": (2.0, 0.2), "rebound_scale": (2.0, 0.2)})


@pytest.fixture(scope="module")
def exhaustive(fmus, tmp_path_factory):
    folder = tmp_path_factory.mktemp("exhaustive")
    return folder, run_study(coupled_study(fmus), folder, InProcess())


def drawn_results(result, folder, part, count, setups, workers=None):
    """Return the results of setups with draws of one part."""
    sweep = Sweep(result.study, folder)
    return list(run_draws(result, sweep, workers or InProcess(), Uncertainty((part,)), setups, count))


def test_small_errors_change_a_measure_according_to_its_slope(fmus, exhaustive):
    """Two similar draws are compared with a finite difference of the study itself."""
    folder, nominal = exhaustive
    car = independent("middle", {"compression_scale": (1.0, 0.01)})
    baseline = nominal.study.baseline_setup.index
    draws = drawn_results(nominal, folder, car, 5, [baseline])
    scales = [drawn.study.bank["middle"].parameters["compression_scale"] for drawn in draws]
    levels = [drawn.values("total tire force")[0] for drawn in draws]
    slope = np.polyfit(scales, levels, 1)[0]
    bank = dict(nominal.study.bank)
    ends = []
    for scale in (0.99, 1.01):
        bank["middle"] = replace(bank["middle"], parameters={"compression_scale": scale, "rebound_scale": 1.0})
        changed = replace(nominal, study=replace(nominal.study, bank=bank))
        same = independent("soft", {"compression_scale": (0.5, 0.0)})
        ends.append(drawn_results(changed, folder, same, 2, [baseline])[0])
    difference = (ends[1].values("total tire force")[0] - ends[0].values("total tire force")[0]) / 0.02
    assert slope == pytest.approx(difference, rel=0.05)


def test_draws_that_were_run_are_not_run_again(exhaustive, tmp_path):
    _, nominal = exhaustive
    first, again = InProcess(), InProcess()
    for workers in (first, again):
        assert len(drawn_results(nominal, tmp_path, STIFF, 2, [0, 1], workers)) == 2
    assert len(first.ran) == 4
    assert again.ran == []


def test_there_are_no_draws_if_nothing_is_uncertain(exhaustive, tmp_path):
    _, nominal = exhaustive
    sweep = Sweep(nominal.study, tmp_path)
    assert list(run_draws(nominal, sweep, InProcess(), Uncertainty(), [0], 2)) == []


def front(digits: np.ndarray) -> np.ndarray:
    return 1.0 + digits.sum(axis=1)


def test_the_run_to_run_deviation_is_read_from_a_comparison(tmp_path):
    setups = np.array([0, 0, 100, 2000])
    made = result({"front": front, "rear": front})
    found = comparisons(made, Measured(setups, {n: np.array([1.0, 3.0, 5.0, 9.0]) for n in ("front", "rear")}, {}))
    write_comparisons(found, {"front": "m", "rear": "m"}, tmp_path / "comparison.json", Verdict())
    path = tmp_path / "uncertain.toml"
    path.write_text('schema = 1\ncompared = "comparison.json"\n[run_to_run]\nrear = 0.5\n')
    noise = read_uncertainty(path, made).run_to_run
    assert noise == {"front": pytest.approx(usable_deviation(np.sqrt(2.0), 1)), "rear": 0.5}


def test_the_file_of_the_documentation_is_read(tmp_path):
    page = (Path(__file__).resolve().parents[3] / "docs" / "how_to" / "study_choice.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```toml\n(.*?)```", page, re.DOTALL)
    (tmp_path / "uncertain.toml").write_text(block)
    found = read_uncertainty(tmp_path / "uncertain.toml", result({"front ride height, RMS": front}))
    assert [part.part for part in found.parts] == ["car"]
    assert set(found.fits) == {"C/B"}
    assert found.run_to_run["front ride height, RMS"] == pytest.approx(2.54e-5)


def test_uncertainties_that_are_none_are_refused_by_name(tmp_path, known, unchanged):
    made, path = result({"front": front}), tmp_path / "uncertain.toml"
    found = comparisons(made, Measured(np.array([0, 100, 2000]), {"front": np.array([1.0, 5.0, 9.0])}, {}))
    write_comparisons(found, {"front": "m"}, tmp_path / "comparison.json", Verdict())

    def read(text):
        path.write_text(text)
        return read_uncertainty(path, made)

    texts = {
        "schema 2": "schema = 2", "a number": "schema = 1\nrun_to_run = 3", "no TOML": "schema = [",
        "no such build": 'schema = 1\n[fits]\n"D/D" = "d.json"',
        "no such measure": "schema = 1\n[run_to_run]\nfrnt = 1.0",
        "another dimension": 'schema = 1\n[run_to_run]\nfront = "1 lbf"',
        "a matrix of another size": 'schema = 1\n[[uncertain]]\npart = "C/B"\ncorrelation = [[1.0, 0.5]]\n'
        "parameters = { time_constant = { value = 1.0, deviation = 1.0 } }",
        "no setup twice": 'schema = 1\ncompared = "comparison.json"\n',
    }  # fmt: skip
    covariances = {"not symmetric": [[1.0, 0.5], [0.0, 1.0]], "negative": [[1.0, 2.0], [2.0, 1.0]], "larger": np.eye(3)}
    unchanged(refusals({
        **{name: partial(read, text) for name, text in texts.items()},
        **{name: partial(Uncertain, "C/B", SHOCK.names, np.ones(2), np.array(covariance))
           for name, covariance in covariances.items()},
        "no such part": lambda: known(independent("D/D", {"lag": (1.0, 0.1)})),
        "no such parameter": lambda: known(independent("C/C", {"none_such": (1.0, 0.1)})),
    }))  # fmt: skip
