"""Drive file iteration on linear rigs, where the result of every pass is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from eightpost.drivefile import Limits, Pass, Settings, Status, advance
from eightpost.drivefile.iteration import PATIENCE
from eightpost.drivefile.page import _reach_table, error_table

from .conftest import problem_of, random_car, rig_of


def totals(outcomes):
    return [errors.total for errors in outcomes[-1].errors]


def test_an_exact_response_finds_the_roads_in_one_pass(quarter, settings):
    rig, drive = quarter
    outcomes = rig.passes(problem_of(rig, settings), 1)
    assert totals(outcomes)[0] < 1e-3
    assert outcomes[-1].status is Status.CONVERGED
    lines = rig.target.lines
    found, road = (lines.spectrum(rows[:1])[lines.frequency > 1.0] for rows in (outcomes[0].drive, drive))
    # Slower roads move the whole car, which no channel shows.
    assert np.linalg.norm(found - road) < 2e-3 * np.linalg.norm(road)


@pytest.mark.parametrize(("gain", "wrong"), [(1.0, 1.25), (0.5, 1.0), (0.8, 0.7), (0.6, 1.3 * np.exp(0.5j))])
def test_each_pass_multiplies_the_error_by_one_minus_gain_over_the_error_of_the_response(
    quarter, settings, gain, wrong
):
    """With H = w H_true the error after n passes is (1 - K / w)^n of the target at every line."""
    rig, _ = quarter
    found = totals(rig.passes(problem_of(rig, replace(settings, gain=gain), factor=wrong), 4))
    assert found == pytest.approx([abs(1.0 - gain / wrong) ** n for n in range(1, 5)], rel=0.02, abs=1e-3)


def test_the_correction_finds_the_factor_of_a_wrong_response(quarter, settings):
    rig, _ = quarter
    wrong = 0.7 * np.exp(0.3j)
    for is_updated, largest in ((False, 1.0), (True, 5e-3)):
        found = totals(rig.passes(problem_of(rig, replace(settings, is_updated=is_updated), factor=wrong), 4))
        assert found[-1] < largest
    assert found[-1] < 0.2 * abs(1.0 - 1.0 / wrong) ** 4


@pytest.mark.repeated
@pytest.mark.parametrize("seed", range(60, 63))
def test_another_car_on_another_road_converges_with_the_response_of_the_car_of_table_5_1(seven_dof, seed):
    """Masses, springs, tires and dampers differ by 20 %; these seeds were not used for any choice."""
    rig, _ = rig_of(random_car(seed), seed)
    outcomes = rig.passes(problem_of(rig, Settings(has_means=False), seven_dof[0].vehicle), 8)
    assert outcomes[-1].status is Status.CONVERGED, totals(outcomes)
    assert min(totals(outcomes)) < 0.012


def test_a_reversed_response_is_reported_as_divergence_and_the_gains_are_halved(quarter, settings):
    rig, _ = quarter
    outcomes = rig.passes(problem_of(rig, settings, factor=-1.0), PATIENCE)
    assert [one.status for one in outcomes] == [Status.RUNNING] * PATIENCE + [Status.DIVERGED]
    assert totals(outcomes) == pytest.approx([2.0, 1.5, 1.25], rel=0.02)  # 1 + K of a rig at rest, K = 1, 1/2, 1/4
    assert outcomes[-1].best == -1


def test_after_a_rejected_pass_the_best_drive_is_continued(quarter, settings):
    rig, _ = quarter
    problem = problem_of(rig, replace(settings, gain=0.5))
    first = advance(problem, [])
    good = Pass(first.drive, rig.play(first.drive))
    spoilt = Pass(5.0 * first.drive, rig.play(5.0 * first.drive))
    after_good, after_both = advance(problem, [good]), advance(problem, [good, spoilt])
    assert (after_both.best, after_both.rejections) == (0, 1)
    step = after_good.drive - good.drive
    assert after_both.drive - good.drive == pytest.approx(0.5 * step, abs=1e-9 + 1e-6 * np.abs(step).max())


def test_a_channel_that_no_drive_can_reach_stalls_the_iteration(seven_dof):
    """Seven inputs cannot reproduce independent noise in eight channels."""
    rig, _ = seven_dof
    series = rig.target.series
    noise = np.random.default_rng(3).standard_normal(series.values.shape)
    values = series.values + 0.3 * series.values.std(axis=1, keepdims=True) * noise
    noisy = rig.with_target(values)
    problem = problem_of(noisy, Settings(has_means=False))
    outcomes = noisy.passes(problem, 8)
    assert Status.STALLED in {one.status for one in outcomes}
    assert outcomes[-1].status is not Status.CONVERGED
    passes, shares = error_table(problem, outcomes[-1]), _reach_table(problem, outcomes[-1])
    assert [row[0] for row in passes.rows] == [str(k) for k in range(1, len(outcomes[-1].errors) + 1)]
    assert [row[1].value for row in shares.rows] == pytest.approx(100.0 * outcomes[-1].unreachable)


def test_mean_displacements_are_reproduced_by_steady_loads(seven_dof, settings):
    rig, _ = seven_dof
    loads = np.array([0.0] * 4 + [-3000.0, 200.0, 400.0])
    loaded = rig.with_target(rig.target.series.values + (rig.start.static @ loads)[:, None])
    problem = problem_of(loaded, replace(settings, has_means=True))
    outcomes = loaded.passes(problem, 1)
    assert outcomes[-1].drive[:, 0] == pytest.approx(loads, abs=5.0)
    assert max(map(abs, outcomes[-1].errors[-1].means.values())) < 0.01


def test_a_limited_stroke_is_named_with_its_time_and_prevents_convergence(quarter, settings):
    rig, drive = quarter
    stroke = 0.5 * float(np.abs(drive[0]).max())
    outcomes = rig.passes(problem_of(rig, replace(settings, limits=Limits(stroke=stroke))), 6)
    assert all(np.abs(one.drive[0]).max() <= stroke * (1.0 + 1e-9) for one in outcomes)
    assert outcomes[-1].status is not Status.CONVERGED
    first = outcomes[0].hits[0]
    assert (first.name, first.kind, first.unit) == ("road", "stroke", "m")
    assert first.time == pytest.approx(float(np.argmax(np.abs(drive[0]))) / rig.target.rate, abs=0.02)
    assert first.wanted == pytest.approx(2.0 * stroke, rel=0.05)
