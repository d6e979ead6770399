"""Uncertainties of measures and the correlation of fits, number by number, and the limits that decide on them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from eightpost.uncertainty import (
    LIMITS,
    FittedParameter,
    LeftOutBlocks,
    MeasuredLevel,
    MeasureUncertainty,
    band_shares,
    correlation_of,
    local_features,
    separation,
    setup_distance,
    square_root,
    unseen,
)

SHARES = np.array(
    [[1, 2, 4, 8, 6, 3, 2, 1, 1, 0.5, 0], [1, 1, 2, 3, 8, 9, 5, 4, 2, 1, 1], [9, 5, 2, 1, 0, 0, 0, 0, 0, 0, 0]]
)
SHARES = SHARES / SHARES.sum(axis=1, keepdims=True)


def _levels(error: float) -> list[MeasuredLevel]:
    return [
        MeasuredLevel(error, 0.01, 0.08, tuple(SHARES[0])),
        MeasuredLevel(error + 0.02, 0.02, 0.05, tuple(SHARES[1])),
    ]


def test_the_uncertainty_of_a_measure_is_the_same_on_every_drive(unchanged: Callable[..., None]) -> None:
    found = {}
    for error in (0.0, 0.03, -0.15):
        known = MeasureUncertainty.of_levels(_levels(error), 0.2)
        for k, shares in enumerate(SHARES):
            on = known.on_drive(shares.tolist())
            found[f"error {error} on drive {k}"] = [on.common, on.own, on.bias]
        found[f"error {error}"] = {
            "intervals": [known.interval(10.0, level, distance=0.03, change=0.1) for level in (0.5, 0.9, 0.99)],
            "widths": [known.half_width(apart) for apart in (0.0, 0.05, 1.0)],
            "below": [known.probability_below(first, 1.0, distance=0.05) for first in (0.8, 0.99, 1.0, 1.3)],
        }
    found["separations"] = [separation(d, c) for d in (0.0, 0.01, 0.1) for c in (-0.02, 0.0, 0.3)]
    found["unseen"] = [unseen(first, second) for first in SHARES for second in SHARES]
    found["distance"] = setup_distance({"a": 1.0, "b": 2.0}, {"a": 1.1, "b": 1.7})
    unchanged(found)


def test_products_of_the_features_of_setups_are_the_same(unchanged: Callable[..., None]) -> None:
    positions = np.random.default_rng(1).normal(0.0, 0.004, (6, 33))
    found = {count: local_features(positions[:, :count]) for count in (0, 1, 3, 31, 32, 33)}
    unchanged({f"{count} measures": features @ features.T for count, features in found.items()})


def test_power_belongs_to_the_band_from_its_lower_limit_on() -> None:
    frequency = np.array([0.1, *LIMITS, 100.0])
    power = 2.0 ** np.arange(len(frequency))
    shares = band_shares(np.stack([power, 3.0 * power]), frequency)
    np.testing.assert_array_equal(
        shares, [[*power[:-2], power[-2] + power[-1]], [*(3.0 * power[:-2]), 3.0 * (power[-2] + power[-1])]]
    )


def _blocks(seed: int, count: int = 40, common: float = 1.0) -> LeftOutBlocks:
    same, own = np.random.default_rng(1), np.random.default_rng(seed)
    velocity = 0.2 + 0.1 * same.uniform(size=count)
    shared = same.normal(size=(2, count))
    changes = {name: common * shared[k] + own.normal(size=count) for k, name in enumerate(("slope", "lag"))}
    return LeftOutBlocks.of(velocity, {**changes, "fixed": np.ones(count)})


def test_the_correlation_of_fits_is_the_same(unchanged: Callable[..., None]) -> None:
    parts = [_blocks(2), _blocks(3), _blocks(4, common=0.3), _blocks(5, 250), _blocks(6, 7), _blocks(7, 7)]
    parameters = [FittedParameter(part, name) for part in (*parts, None, parts[0]) for name in ("slope", "lag", "none")]
    found = correlation_of(parameters)
    unchanged({
        "correlation": found, "row": found[0], "root": square_root(found)[0],
        "sections": [part.section() for part in (parts[4],)], "blocks": [len(part.velocity) for part in parts],
    })  # fmt: skip


@pytest.mark.parametrize(
    ("factor", "count", "same"), [(1.09, 40, True), (1.12, 40, False), (1.0, 8, True), (1.0, 7, False)]
)
def test_two_tests_are_the_same_up_to_a_tenth_of_their_velocities_and_from_eight_blocks(
    factor: float, count: int, same: bool
) -> None:
    first = _blocks(2, count)
    other = LeftOutBlocks(tuple(factor * value for value in first.velocity), first.changes)
    assert first.has_the_test_of(other) is other.has_the_test_of(first) is same
