"""Effects of uncertain parameters, compared with runs of setups whose shocks are changed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cosim.study.choice.assess import certainty_of
from cosim.study.choice.certainty import Effect, Status
from cosim.study.choice.robust import Uncertain, Uncertainty, knowledge_of
from cosim.study.choice.sources import UncertainParameter, effects_of, error_sources, stated_parameters
from cosim.study.running.evaluator import coupling_of
from cosim.study.running.sweep import Sweep, run_study
from eightpost.uncertainty import LeftOutBlocks
from eightpost.validity import ModelUncertainty, ParameterUncertainty, Validity
from eightpost.verdict import Verdict

from .coupled import InProcess, study

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


@pytest.mark.nightly
def test_correlated_parameters_have_the_variance_of_their_covariance(small):
    """Two scales of one build that are fully correlated act as one parameter."""
    sweep, result = small
    names = ("compression_scale", "rebound_scale")

    def known(correlation: float):
        covariance = 0.02**2 * np.array([[1.0, correlation], [correlation, 1.0]])
        return knowledge_of(
            result, Uncertainty((Uncertain("stiff", names, np.full(2, 2.0), covariance),)), {}, sweep, InProcess()
        )

    rows = np.arange(len(result))
    parts = error_sources(result, known(0.0).effects)
    together, half = (error_sources(result, known(value).effects) for value in (1.0, 0.5))
    each = parts.by_parameter(rows, 0)
    np.testing.assert_allclose(together.shock_covariance(rows, 0, 0), each.sum(axis=1) ** 2, rtol=1e-9, atol=1e-18)
    expected = np.sum(each**2, axis=1) + each[:, 0] * each[:, 1]
    np.testing.assert_allclose(half.shock_covariance(rows, 0, 0), expected, rtol=1e-9, atol=1e-18)
