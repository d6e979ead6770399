"""Rig runs update the certainty of a study, and its file; compared with a dense joint distribution."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pyarrow.parquet
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from cosim.study.choice.assess import Knowledge, certainty_of
from cosim.study.choice.certainty import (
    Contradiction,
    Effect,
    Status,
    certainty_reasons,
    read_certainty,
    write_certainty,
)
from cosim.study.choice.compare import usable_deviation
from cosim.study.choice.posterior import Observations, Posterior
from cosim.study.choice.rig_day import MeasuredRun, with_rig_runs
from cosim.study.choice.robust import Uncertain, Uncertainty, knowledge_of
from cosim.study.choice.sources import UncertainParameter, effects_of, error_sources, stated_parameters
from cosim.study.definition import Term
from cosim.study.running.evaluator import coupling_of
from cosim.study.running.sweep import Sweep, run_study
from eightpost.corners import CORNERS
from eightpost.signals import TimeSeries
from eightpost.uncertainty import LeftOutBlocks, local_features, separation
from eightpost.validity import ModelUncertainty, ParameterUncertainty, Validity
from eightpost.verdict import Verdict
from tests.unchanged import refusals

from .assessed import NOISE, assessed, lag, paired, run, two_setups
from .coupled import InProcess, study


@pytest.mark.nightly
def test_conditioning_equals_that_of_an_independently_built_joint_normal_distribution():
    """Given the scales, medians and variances of all levels are those of the dense joint distribution."""
    study = assessed({"a": lambda d: np.exp(0.01 * d[:, 2] - 0.02 * d[:, 3]), "b": lambda d: np.exp(0.03 * d[:, 3])})
    fits = paired(lag("C/C", 0.01, 0.5), lag("B/C", -0.02, 0.0, "lr", "b"), 0.6)
    effects = (*fits, Effect("car", "k", 1.0, 0.0, {"a": 0.01}, {}))
    sources = error_sources(study, effects)
    at, runs, errors = np.array([[3, 0], [40, 1]]).T, np.arange(2), np.array([[0.02, -0.01], [0.003, 0.004]])
    seen = Observations(*at, runs, *errors)
    posterior = Posterior(sources, seen)
    scales = posterior.scales.typical
    rows = np.array([3, 40, 700])
    x = np.log(np.stack([study.values("a"), study.values("b")], axis=1)) / np.sqrt(2.0)
    x -= x.mean(axis=0)
    z = np.hstack([x, local_features(x)])[rows]
    level = np.sqrt(2.0) * x[rows]  # logarithms of the measures themselves
    builds = [study.setup(int(row)).builds for row in rows]

    def column(m: int) -> np.ndarray:
        """Loadings of the standard normal variables: own of a and b, fit C/C, copy C/C, rest of B/C, k."""
        gradient = 0.5 * scales.own[m] * np.column_stack([z, level[:, m]])
        own = np.zeros((3, 2 * gradient.shape[1]))
        own[:, m * gradient.shape[1] : (m + 1) * gradient.shape[1]] = gradient
        c = np.array([m == 0 and one["rr"] == "C/C" for one in builds], dtype=float)
        b = np.array([m == 1 and one["lr"] == "B/C" for one in builds], dtype=float)
        shared = 0.01 * c - 0.6 * 0.02 * b
        return np.column_stack([own, shared, 0.005 * c, -0.8 * 0.02 * b, np.full(3, 0.01 * (m == 0))])

    loadings = [column(m) for m in range(2)]
    at_levels = np.stack([loadings[0][0], loadings[1][1]])
    inverse = np.linalg.inv(at_levels @ at_levels.T + np.diag([0.003**2, 0.004**2]))
    for m in range(2):
        weights = np.zeros(sources.predicted.shape)
        weights[:, m] = 1.0
        middle, student, normal = posterior.moments(weights)
        gain = loadings[m] @ at_levels.T @ inverse
        np.testing.assert_allclose(middle[rows], gain @ seen.changes, atol=1e-12)
        variance = np.sum(loadings[m] ** 2, axis=1) - np.sum(gain * (loadings[m] @ at_levels.T), axis=1)
        np.testing.assert_allclose((student + normal)[rows], variance, atol=1e-12)
        drawn = posterior.draw(scales, 40_000, np.random.default_rng(2))
        errors = sources.errors(drawn, rows, m)
        apart = np.abs(errors.mean(axis=0) - gain @ seen.changes)
        assert np.all(apart < 5.0 * np.sqrt(variance / len(errors)) + 1e-12)
        np.testing.assert_allclose(errors.var(axis=0), variance, rtol=0.05, atol=1e-7)


@pytest.mark.parametrize(("stated", "expected"), [({}, np.sqrt(2e-6 / 2.0)), ({"a": 0.01}, 0.01)])
def test_later_repeats_replace_a_run_to_run_deviation_unless_it_is_stated(tmp_path, stated, expected):
    """Two runs of setup 0 that agree by chance, then two of setup 1 that differ by 0.002."""
    study = two_setups(0.01)
    known = Knowledge(run_to_run=stated)
    for setup, levels in ((0, (1.0, 1.0)), (1, (1.01, 1.012))):
        for k, level in enumerate(levels):
            file = tmp_path / f"{setup}_{k}.csv"
            file.write_text(str(file))
            time = np.arange(0.0, 30.001, 0.01)
            wave = np.sqrt(2.0) * level * np.sin(2.0 * np.pi * time)
            series = TimeSeries.from_channels(time, {"o0": ("1", wave)})
            known = with_rig_runs(study, known, [MeasuredRun(file, setup, "lap")], lambda _, s=series: s)[0]
    factor = 1.0 if stated else usable_deviation(1.0, 2)
    assert known.run_to_run["a"] == pytest.approx(factor * expected, rel=0.01)


def test_a_rig_run_of_both_setups_decides_between_them():
    study = two_setups(0.01, (0.02, 2.0))
    before = certainty_of(study)
    known = Knowledge(run_to_run={"a": 0.001}, runs=(run(0, a=1.01), run(1, a=1.0)))
    after = certainty_of(study, known)
    assert before.best[0] == pytest.approx(stats.t.cdf(0.01 / (2.0 * separation(0.01, 0.01)), 4), abs=NOISE)
    assert after.best[0] < 0.01
    low, high = after.levels["a"].interval(0.95)
    assert low[0] < 1.01 < high[0] and np.log(high / low)[0] < 4.0 * 2.8 * 0.001


@pytest.mark.nightly
def test_a_record_that_contradicts_the_prediction_is_named():
    study = assessed({"a": lambda d: np.exp(0.02 * d.sum(axis=1))}, (0.005, 0.05))
    levels = study.values("a")
    runs = (run(0, a=float(levels[0])), run(7, a=float(levels[7])), run(2400, a=1.3 * float(levels[2400])))
    found = certainty_of(study, Knowledge(run_to_run={"a": 1e-3}, runs=runs))
    (worst,) = found.contradictions
    assert isinstance(worst, Contradiction) and (worst.file, worst.used) == ("run_2400.csv", False)
    assert worst.measured == pytest.approx(1.3 * worst.predicted)
    assert any(one.origin == "run_2400.csv" for one in certainty_reasons(found))
    without = certainty_of(study, Knowledge(run_to_run={"a": 1e-3}, runs=runs[:2]))
    np.testing.assert_allclose(found.levels["a"].expected, without.levels["a"].expected, rtol=1e-9)


@pytest.mark.repeated
@pytest.mark.parametrize(("good", "wrong"), [(0, 7), (7, 0)])
def test_of_two_equal_setups_with_different_levels_the_one_far_from_the_prediction_is_left_out(good, wrong):
    """Each of the two is impossible given the other one, which alone does not say which record is wrong."""
    study = assessed({"a": lambda d: np.exp(0.02 * d[:, 3] + 0.05 * d[:, 0])}, (0.01, 0.02))  # lr has no effect
    levels = study.values("a")
    near = [run(setup, a=factor * float(levels[setup])) for setup, factor in ((good, 1.0), (wrong, 1.05))]
    found = certainty_of(study, Knowledge(runs=(run(1200, a=float(levels[1200])), *near)))
    assert [(one.file, one.used) for one in found.contradictions] == [(f"run_{wrong}.csv", False)]


@pytest.mark.nightly
def test_rig_runs_that_agree_with_each_other_but_not_with_the_prediction_are_named_and_used():
    study = assessed({"a": lambda d: np.exp(0.02 * d.sum(axis=1))}, (0.02, 0.02))
    levels = study.values("a")
    runs = tuple(run(k, a=1.2 * float(levels[k])) for k in (0, 7, 2400))
    found = certainty_of(study, Knowledge(run_to_run={"a": 1e-3}, runs=runs))
    assert [one.used for one in found.contradictions] == [True, True, True]
    np.testing.assert_allclose(found.levels["a"].expected, 1.2 * levels, rtol=0.01)


@pytest.mark.nightly
@settings(max_examples=4, deadline=None)
@given(st.permutations([0, 1, 2]))
def test_the_order_of_rig_runs_does_not_matter(order):
    study = two_setups(0.01, (0.02, 1.0))
    runs = (run(0, a=1.01), run(1, a=1.0), replace(run(1, a=1.002), digest="again"))
    one, other = (
        certainty_of(study, Knowledge(run_to_run={"a": 0.002}, runs=tuple(runs[k] for k in places)))
        for places in ((0, 1, 2), order)
    )
    np.testing.assert_allclose(one.levels["a"].half_widths, other.levels["a"].half_widths, rtol=1e-9)
    assert one.best[0] == pytest.approx(other.best[0], abs=NOISE)


@pytest.mark.parametrize("difference", [0.1, -0.1])
def test_trade_offs_are_those_against_the_baseline_and_none_if_it_leads_itself(difference):
    study = two_setups(difference, (0.0, 0.01))
    (lead,) = certainty_of(study).ties
    setups = {("B/B",) * 4: 0, ("B/B", "B/B", "B/B", "C/C"): 1}
    for builds, setup in setups.items():
        at = replace(study, study=replace(study.study, baseline=dict(zip(CORNERS, builds, strict=True))))
        assert bool(certainty_of(at).trade_offs) == (setup != lead)


# ---- File ------------------------------------------------------------------------------------------------------------


def test_a_certainty_is_read_back_from_its_file(tmp_path, unchanged):
    study = two_setups(0.01, (0.02, 1.0), objective=(Term("a", 2.0, "m"),))
    known = Knowledge(
        paired(lag("C/C", 0.01, 0.5), lag("B/C", 0.02), 0.7), ("B/B",), {"a": 0.001}, (run(0, a=1.5),), ("a note",)
    )
    kept = certainty_of(study, known)
    write_certainty(kept, tmp_path / "certainty.parquet")
    found = read_certainty(tmp_path / "certainty.parquet", digest=study.provenance.digest)
    assert Knowledge.of(found) == known
    for name in ("ties", "tests", "trade_offs", "contributions", "contradictions", "remarks", "criterion", "draws"):
        assert getattr(found, name) == getattr(kept, name)
    np.testing.assert_allclose(found.best, kept.best, rtol=1e-6)
    for name, levels in kept.levels.items():
        np.testing.assert_array_equal(found.levels[name].expected, levels.expected)
        np.testing.assert_allclose(found.levels[name].half_widths, levels.half_widths, rtol=1e-6)
    study.save(tmp_path / "results.parquet")
    unchanged(refusals({
        "another study": lambda: read_certainty(tmp_path / "certainty.parquet", digest="other"),
        "no certainty": lambda: read_certainty(tmp_path / "results.parquet"),
        "no such interval": lambda: found.levels["a"].interval(0.9),
    }))  # fmt: skip


def test_effects_of_an_earlier_version_are_independent(tmp_path):
    """Their entries in the header have no correlations."""
    effects = (lag("C/C", 0.01), lag("B/B", 0.02))
    path = tmp_path / "certainty.parquet"
    write_certainty(certainty_of(two_setups(0.01), Knowledge(effects)), path)
    table = pyarrow.parquet.read_table(path)
    header = json.loads(table.schema.metadata[b"eightpost"])
    for entry in header["effects"]:
        del entry["correlations"]
    pyarrow.parquet.write_table(table.replace_schema_metadata({"eightpost": json.dumps(header)}), path)
    assert read_certainty(path).effects == effects


# ==== Effects of uncertain parameters, compared with runs of setups whose shocks are changed =========================

SCALE = UncertainParameter("stiff", 2.0, ParameterUncertainty("compression_scale", 0.01, 0.005))

MEASURES = ("total tire force", "front ride height")


@pytest.fixture(scope="module")
def small(fmus, tmp_path_factory):
    """Return sweep and result of a study of four setups of the builds middle and stiff."""
    folder = tmp_path_factory.mktemp("small")
    two = study(fmus)
    builds = ("middle", "stiff")
    two = replace(
        two, bank={name: two.bank[name] for name in builds}, corners=dict.fromkeys(two.corners, builds), settling=0.5
    )
    return Sweep(two, folder), run_study(two, folder, InProcess())


@pytest.fixture(scope="module")
def effect(small):
    sweep, result = small
    (found,) = effects_of(result, [SCALE], sweep, InProcess())
    return found


def largest(effect: Effect, name: str) -> float:
    """Return the largest change of a measure by a stiff shock at one corner."""
    return max(abs(builds["stiff"][name]) for builds in effect.changes.values())


@pytest.mark.parametrize("corner", ["lf", "rr"])
def test_an_effect_is_the_change_of_the_best_setup_with_a_changed_shock_at_one_corner(small, effect, corner):
    sweep, result = small
    stiff = result.study.bank["stiff"]
    changed = replace(stiff, parameters={**stiff.parameters, "compression_scale": 2.01})
    best = result.setup(int(result.ranking()[0])).builds
    free = replace(
        result.study,
        bank={**result.study.bank, "changed": changed},
        corners={name: (best[name],) for name in best} | {corner: ("stiff", "changed")},
        alike=(),
        baseline={},
    )
    run = sweep.variant(free, sweep.folder).request(InProcess(), coupling_of(result), free.space.indices.tolist())
    assert run.builds(corner) == ["stiff", "changed"]
    for name in MEASURES:
        nominal, other = run.values(name)
        assert effect.changes[corner]["stiff"][name] == pytest.approx(np.log(other / nominal), rel=1e-9)


def test_setups_without_the_build_have_no_error_and_copies_are_in_units_of_the_fit(small, effect):
    _, result = small
    sources = error_sources(result, [effect])
    middle = np.flatnonzero(result.setups == result.study.baseline_setup.index)
    assert sources.by_parameter(middle, 0).tolist() == [[0.0]]
    assert effect.copies == pytest.approx(0.5)
    assert set(effect.changes) == set(result.study.corners)


def test_runs_of_effects_are_not_repeated(small, effect):
    sweep, result = small
    workers = InProcess()
    assert effects_of(result, [SCALE], sweep, workers) == (effect,)
    assert workers.ran == []


def test_a_value_beyond_the_limit_is_changed_downwards_with_the_same_slope(small, effect):
    sweep, result = small
    limited = replace(SCALE, stated=replace(SCALE.stated, highest=2.005))
    (found,) = effects_of(result, [limited], sweep, InProcess())
    assert limited.changed == pytest.approx(1.99)
    for corner in result.study.corners:
        for name in MEASURES:
            up, down = (one.changes[corner]["stiff"][name] for one in (effect, found))
            assert down == pytest.approx(up, abs=0.05 * largest(effect, name))


@pytest.mark.nightly
def test_a_parameter_of_the_vehicle_has_an_effect_on_all_setups_and_another_one_with_each_build(small):
    sweep, result = small
    car = Uncertain("car", ("lf.friction_force",), np.array([0.0]), np.array([[20.0**2]]))
    known = knowledge_of(result, Uncertainty((car,)), {}, sweep, InProcess())
    (found,) = known.effects
    assert abs(found.shared["total tire force"]) > 1e-5
    assert {build for builds in found.changes.values() for build in builds} == {"middle", "stiff"}
    assert found.changes["lf"]["stiff"] != found.changes["lf"]["middle"]
    certainty = certainty_of(result, known)
    states = {one.name: one.status for one in certainty.contributions}
    assert states["vehicle"] is Status.INCLUDED
    assert certainty.levels["total tire force"].basis == "file"


@pytest.mark.nightly
def test_builds_whose_fits_had_the_same_test_have_correlated_errors(small, effect):
    sweep, result = small
    change = np.sin(np.arange(60.0))
    blocks, other = (LeftOutBlocks.of(velocity, {"compression_scale": change}) for velocity in np.eye(2, 60) + 0.1)

    def correlations(*left_out: LeftOutBlocks | None) -> list[dict[str, float]]:
        parts = tuple(
            Uncertain(build, ("compression_scale",), np.array([value]), np.array([[0.01**2]]), left_out=given)
            for build, value, given in zip(("stiff", "middle"), (2.0, 1.0), left_out, strict=True)
        )
        found = knowledge_of(result, Uncertainty(parts), {}, sweep, InProcess()).effects
        assert found[0].changes == effect.changes
        return [one.correlations for one in found]

    assert correlations(blocks, blocks) == [{"middle": 1.0}, {"stiff": 1.0}]
    assert correlations(blocks, other) == correlations(blocks, None) == [{}, {}]


def test_builds_state_their_parameters_and_those_that_state_nothing_are_unknown(small):
    _, result = small
    blocks = LeftOutBlocks.of(np.linspace(0.1, 0.2, 20), {"compression_scale": np.sin(np.arange(20.0))})
    stated = ModelUncertainty(
        parameters=(ParameterUncertainty("compression_scale", 0.01), ParameterUncertainty("none_such", 1.0)),
        held=("time_constant is kept at its fitted value: the fit ended at its lower bound",),
        left_out=blocks,
    )
    fmu = str(next(iter(result.study.bank.values())).fmu)
    models = {fmu: Validity(Verdict([]), (), stated).to_json()}
    known = replace(result, provenance=replace(result.provenance, models=models))
    found, unknown, notes = stated_parameters(known)
    assert [(one.part, one.value, one.stated.deviation) for one in found] == [
        ("middle", 1.0, 0.01),
        ("stiff", 2.0, 0.02),  # a scale is uncertain relative to its value
    ]
    assert [one.left_out for one in found] == [blocks, blocks]
    assert unknown == ("middle", "stiff")  # a parameter that the FMU does not have
    assert notes == (
        "middle, stiff: time_constant is kept at its fitted value: the fit ended at its lower bound",
        "middle, stiff: the FMU has no parameter none_such",
    )
    assert stated_parameters(result)[1] == ("middle", "stiff")
