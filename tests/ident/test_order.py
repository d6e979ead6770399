"""Cross-validation in closed form agrees with repeated fits without each block."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from eightpost.ident.shock.joint import _choose_order, _left_out_errors
from eightpost.ident.shock.runs import prepare_runs
from eightpost.ident.shock.uncertainty import blocks_of
from eightpost.shock import Lpf1


@pytest.fixture(scope="module")
def runs(curve, law_record):
    runs = prepare_runs([law_record(Lpf1(curve, 1.3e-3), 1)])
    return runs.weighted(np.random.default_rng(0).uniform(0.2, 1.0, runs.weights.size))


@pytest.fixture(scope="module")
def columns(runs):
    """Return powers of the velocity at the rows, low-passed."""
    speed = runs.velocity / np.abs(runs.velocity).max()
    return runs.rows(np.array([speed**k for k in range(1, 16)])).T


def test_the_left_out_error_is_that_of_fits_without_each_block(runs, columns):
    root = np.sqrt(runs.weights)
    expected = []
    for count in (3, 9):
        design, target, errors = root[:, None] * columns[:, :count], root * runs.target, []
        for block in blocks_of(runs):
            kept = np.ones(target.size, dtype=bool)
            kept[block] = False
            weights = np.linalg.lstsq(design[kept], target[kept], rcond=None)[0]
            errors.append(target[block] - design[block] @ weights)
        expected.append(np.sqrt(np.mean(np.concatenate(errors) ** 2)))
    np.testing.assert_allclose(_left_out_errors(runs, columns, [3, 9]), expected, rtol=1e-6)


def test_a_column_that_one_block_alone_determines_does_not_spoil_the_error(runs, columns):
    """A column that is not 0 in one row only cannot be predicted there, and changes nothing elsewhere."""
    alone = np.zeros((columns.shape[0], 1))
    alone[700] = 1.0
    plain, more = (
        _left_out_errors(runs, c, [c.shape[1]])[0] for c in (columns[:, :5], np.hstack([alone, columns[:, :5]]))
    )
    assert more == pytest.approx(plain, rel=0.02)


def test_the_chosen_order_is_the_next_above_the_lowest_that_predicts_as_well(runs, columns):
    """For a force of the fifth order with noise the seventh is chosen, except for a few draws of noise."""
    generator = np.random.default_rng(1)
    truth = columns[:, :5] @ np.array([900.0, 100.0, -300.0, 50.0, 400.0])
    orders = [
        _choose_order(with_force(runs, truth + 2.0 * generator.standard_normal(truth.size)), columns) for _ in range(9)
    ]
    assert min(orders) == 7
    assert np.median(orders) == 7


def with_force(runs, force):
    """Return the runs with another force at the rows."""
    values = runs.first.record["force"].copy()
    values[runs.filters[0].rows] = force
    record = runs.first.record.with_channel("force", "N", values)
    return replace(runs, prepared=(replace(runs.first, record=record),))
