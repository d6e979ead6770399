"""Uncertainty of measures and models, and what the errors of several fits have in common."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from math import inf
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from builder.reference import validity_of
from eightpost.errors import InputError
from eightpost.shock import read_shock
from eightpost.uncertainty import (
    BLOCKS,
    LIMITS,
    FittedParameter,
    LeftOutBlocks,
    MeasuredLevel,
    MeasureUncertainty,
    correlation_of,
    local_features,
    separation,
    setup_distance,
    square_root,
    unseen,
)
from eightpost.validity import ModelUncertainty, ParameterUncertainty, Validity, judged
from eightpost.verdict import Verdict
from eightpost.virtual import Actuator, random_multisine

# ---- From the fit to the documents that FMUs contain ----------------------------------------------------------------

BANK = Path(__file__).resolve().parents[1] / "examples" / "bank"


def test_an_uncertainty_survives_its_document_with_open_limits_and_unknown_copies():
    stated = ModelUncertainty(
        {"lf.tire_force": MeasureUncertainty(0.01, 0.2)},
        (ParameterUncertainty("lag", 1e-3, None, 0.0, inf), ParameterUncertainty("scale", 0.0, 0.0)),
        ("a sentence",),
        LeftOutBlocks.of(np.linspace(0.1, 0.2, 9), {"lag": np.arange(9.0)}),
    )
    validity = Validity(Verdict([]), (), stated)
    assert Validity.from_json(json.loads(json.dumps(validity.to_json(), allow_nan=False))) == validity
    assert Validity.from_json(Validity(Verdict([])).to_json()).uncertainty is None
    assert Validity.with_verdict(validity, Verdict([])).uncertainty == stated


@pytest.mark.parametrize(
    ("document", "what"),
    [
        (3, "must be an object, not int"),
        ({"left_out_blocks": []}, "left_out_blocks: must be an object"),
        ({"left_out_blocks": {"velocity [m/s]": [0.1, 0.2], "changes": {"lag": [0.0, 0.0]}}}, "not all of them 0"),
        ({"measures": {"a": {"common": -1.0, "own": 0.1}}}, "numbers of 0 or more"),
        ({"measures": {"a": {"common": 1.0}}}, "own"),
        ({"parameters": [{"name": "lag"}]}, "deviation"),
        ({"left_out_blocks": {"velocity [m/s]": [0.1], "changes": {"lag": [1.0, 2.0]}}}, "lag must be 1 finite"),
        ({"parameters": [{"name": "lag", "deviation": -1.0}]}, "the parameter 'lag': deviation is -1.0"),
    ],
)
def test_a_document_that_is_no_uncertainty_is_refused(document, what):
    with pytest.raises(InputError, match=what):
        ModelUncertainty.from_json(document)


def test_the_fmu_of_a_fitted_shock_states_the_standard_errors_of_its_fit():
    shock = read_shock(BANK / "C_C.json")
    known = validity_of(shock).uncertainty
    assert known is not None
    found = {one.name: one for one in known.parameters}
    assert set(found) == {"time_constant", "lag_zero_force", "compression_scale", "rebound_scale"}
    assert found["time_constant"].deviation == pytest.approx(shock.fit["parameters"]["time_constant"]["standard_error"])
    assert found["time_constant"].copies is None
    pooled = judged(
        shock, fit={**shock.fit, "between_builds": {"parameters": {"time_constant": {"standard_deviation": 2e-4}}}}
    )
    again = validity_of(pooled).uncertainty
    assert again is not None and {one.name: one.copies for one in again.parameters}["time_constant"] == 2e-4


def test_a_shock_whose_fit_states_nothing_or_nonsense_has_an_unknown_uncertainty():
    shock = read_shock(BANK / "C_C.json")
    assert validity_of(replace(shock, fit={})).uncertainty is None
    assert validity_of(replace(shock, fit={"parameters": {"time_constant": 3}, "curve_band": {}})).uncertainty is None


# ---- Changes of fits when a block is left out -----------------------------------------------------------------------

VELOCITY = np.linspace(0.1, 0.3, 60)


def blocks(**changes: np.ndarray) -> LeftOutBlocks:
    return LeftOutBlocks.of(VELOCITY, changes)


def parameters(*parts: LeftOutBlocks | None, name: str = "lag") -> list[FittedParameter]:
    return [FittedParameter(part, name) for part in parts]


def orthonormal(count: int) -> np.ndarray:
    """Return changes of 60 blocks that are not correlated at all, with a mean of 0."""
    drawn = np.random.default_rng(2).standard_normal((60, count))
    return np.linalg.qr(np.column_stack([np.ones(60), drawn]))[0].T[1:]


def velocities(seed: int, *, gain: float = 1.0, noise: float = 0.0, late: int = 0, duration: float = 6.0) -> np.ndarray:
    """Return the RMS velocities of blocks of 0.3 s of a random test, as a dynamometer measures them."""
    motion = Actuator().follow(random_multisine(seed, duration=duration).series)
    rate = (len(motion) - 1) / motion.duration
    velocity = gain * np.gradient(motion["displacement"], motion.time)[late:]
    velocity += noise * velocity.std() * np.random.default_rng(seed).standard_normal(velocity.size)
    count = int((duration - 0.5) / 0.3)
    return np.sqrt(np.mean(velocity[: count * int(0.3 * rate)].reshape(count, -1) ** 2, axis=1))


# ---- The same test --------------------------------------------------------------------------------------------------


def test_the_same_signal_is_recognised_in_spite_of_noise_another_gain_and_a_late_start():
    first = LeftOutBlocks.of(velocities(1), {})
    for how in ({"noise": 0.1}, {"gain": 0.95}, {"late": 20}):
        assert first.has_the_test_of(LeftOutBlocks.of(velocities(1, **how), {})), how


def test_another_signal_of_the_same_kind_another_length_and_another_amplitude_are_other_tests():
    first = LeftOutBlocks.of(velocities(1), {})
    others = [velocities(seed) for seed in range(2, 8)] + [velocities(1, duration=7.0), 0.8 * velocities(1)]
    assert not any(first.has_the_test_of(LeftOutBlocks.of(other, {})) for other in others)


# ---- Correlation ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("shared", [0.3, 0.8, 1.0])
def test_fits_of_the_same_test_have_the_correlation_of_their_changes(shared):
    """It is lowered by the share of its square that independent changes of 60 blocks would have on average."""
    common, *own = orthonormal(3)
    first, second = (np.sqrt(shared) * common + np.sqrt(1.0 - shared) * one for one in own)
    found = correlation_of(parameters(blocks(lag=2.0 * first), blocks(lag=0.1 * second)))
    by_chance = (1.0 - shared**2) ** 2 / 59.0
    assert found[0, 1] == pytest.approx(shared * (1.0 - by_chance / shared**2), abs=1e-3)
    assert found[0, 1] == found[1, 0]


def test_changes_that_have_nothing_in_common_count_as_independent():
    """A single correlation of 60 random changes reaches 0.3."""
    changes = np.random.default_rng(3).standard_normal((8, 60))
    found = correlation_of(parameters(*(blocks(lag=one) for one in changes)))
    assert np.abs(found - np.eye(8)).max() < 0.1
    assert np.abs(np.corrcoef(changes) - np.eye(8)).max() > 0.3


def test_other_tests_other_parameters_and_files_without_changes_are_independent():
    change = np.sin(np.arange(60.0))
    here, there = blocks(lag=change, stop=change), LeftOutBlocks.of(VELOCITY[::-1], {"lag": change})
    named = [*parameters(here, there, None), FittedParameter(here, "stop"), FittedParameter(here, "unknown")]
    np.testing.assert_array_equal(correlation_of(named), np.eye(5))
    both = correlation_of([*parameters(here, there, here), *parameters(there)])
    np.testing.assert_allclose(both, [[1, 0, 1, 0], [0, 1, 0, 1], [1, 0, 1, 0], [0, 1, 0, 1]], atol=1e-3)


def test_builds_of_one_fit_have_one_error_also_beside_other_builds():
    changes = np.random.default_rng(3).standard_normal((6, 20))
    parts = [LeftOutBlocks.of(0.1 + np.arange(20.0), {"lag": one}) for one in (changes[0], *changes)]
    found = correlation_of(parameters(*parts))
    assert found[0, 1] == 1.0
    np.testing.assert_array_equal(found[0], found[1])
    assert np.abs(found[0, 2:]).max() < 0.5


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**31), count=st.integers(2, 12), size=st.integers(8, 30), rank=st.integers(1, 12))
def test_a_correlation_has_a_root_and_modes_that_keep_the_variance(seed, count, size, rank):
    """Also if there are more parameters than blocks, or fewer independent changes than parameters."""
    generator = np.random.default_rng(seed)
    changes = generator.standard_normal((count, rank)) @ generator.standard_normal((rank, size))
    velocity = 0.1 + generator.random(size)
    found = correlation_of(parameters(*(LeftOutBlocks.of(velocity, {"lag": one}) for one in changes)))
    root = square_root(found)
    np.testing.assert_allclose(root @ root.T, found, atol=1e-3)
    np.testing.assert_allclose(np.sum(root**2, axis=1), 1.0, atol=1e-3)


# ---- What is kept ---------------------------------------------------------------------------------------------------


def test_blocks_of_a_long_test_are_joined_so_that_the_changes_of_each_join_add():
    velocity, change = np.repeat([0.1, 0.3], 10 * BLOCKS), np.repeat(np.sin(np.arange(BLOCKS)), 20)
    found = LeftOutBlocks.of(velocity, {"lag": change})
    assert found.velocity == (0.1,) * (BLOCKS // 2) + (0.3,) * (BLOCKS // 2)
    expected = np.sin(np.arange(BLOCKS)) - np.mean(np.sin(np.arange(BLOCKS)))
    np.testing.assert_allclose(found.changes["lag"], expected / np.linalg.norm(expected), atol=1e-4)


def test_a_parameter_that_does_not_change_or_is_not_known_is_omitted():
    found = blocks(lag=np.zeros(60), stop=np.full(60, np.nan), stiff=np.arange(60.0))
    assert set(found.changes) == {"stiff"}


# ---- Number by number, and the limits that decide ------------------------------------------------------------------

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


@pytest.mark.parametrize(("share", "counted"), [(0.0, 1.0), (0.001, 0.8), (0.004, 0.2), (0.005, 0.0)])
def test_power_above_the_tests_counts_by_what_its_band_lacks_there(share: float, counted: float) -> None:
    tests, drive = np.zeros(len(LIMITS) + 1), np.zeros(len(LIMITS) + 1)
    tests[[3, 7]], drive[[3, 7]] = (1.0 - share, share), (0.9, 0.1)
    assert unseen(drive, tests) == pytest.approx(0.1 * counted)


def test_products_of_the_features_of_setups_are_the_same(unchanged: Callable[..., None]) -> None:
    positions = np.random.default_rng(1).normal(0.0, 0.004, (6, 33))
    found = {count: local_features(positions[:, :count]) for count in (0, 1, 3, 31, 32, 33)}
    unchanged({f"{count} measures": features @ features.T for count, features in found.items()})


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
