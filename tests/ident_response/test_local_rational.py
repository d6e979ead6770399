"""Local models chosen by validation: lightly damped structures drawn at random, and the two cars."""

from __future__ import annotations

import numpy as np
import pytest

from eightpost.errors import InputError, ParameterError, TooShortError
from eightpost.ident.response import (
    FrequencyResponse,
    LocalPolynomial,
    LocalRational,
    Recipe,
    estimate_response,
    gather,
)

from .light_structures import INPUTS, OUTPUTS, Structure, structure
from .test_estimators import _errors, _estimate

pytestmark = pytest.mark.nightly

DRAWS = range(6)


@pytest.fixture(scope="module", params=[0.01, 0.2], ids=["1 % noise", "20 % noise"])
def structures(request: pytest.FixtureRequest) -> list[Structure]:
    return [structure(seed, request.param) for seed in DRAWS]


def estimated(one: Structure, recipe: Recipe) -> FrequencyResponse:
    return estimate_response(one.records, inputs=INPUTS, outputs=OUTPUTS, recipe=recipe)


def error(one: Structure, response: FrequencyResponse) -> float:
    truth = one.truth(response.frequency)
    return float(np.linalg.norm(response.H - truth) / np.linalg.norm(truth))


def share_inside(one: Structure, response: FrequencyResponse) -> float:
    """Return the share of responses inside their 95 % circles."""
    assert response.variance is not None
    off = np.abs(response.H - one.truth(response.frequency)) ** 2
    return float(np.mean(off < -np.log(0.05) * response.variance))


@pytest.fixture(scope="module")
def chosen(structures: list[Structure]) -> list[FrequencyResponse]:
    return [estimated(one, LocalRational(spacing=0.1)) for one in structures]


@pytest.mark.repeated
def test_the_worst_structure_has_a_quarter_of_the_error_of_a_fixed_polynomial(
    structures: list[Structure], chosen: list[FrequencyResponse]
) -> None:
    fixed = [error(one, estimated(one, LocalPolynomial(spacing=0.1))) for one in structures]
    mine = [error(one, response) for one, response in zip(structures, chosen, strict=True)]
    assert max(mine) < 0.08
    assert max(mine) < 0.25 * max(fixed)
    assert all(after < before for after, before in zip(mine, fixed, strict=True))


def test_the_variance_is_honest_after_the_choice(structures: list[Structure], chosen: list[FrequencyResponse]) -> None:
    inside = [share_inside(one, response) for one, response in zip(structures, chosen, strict=True)]
    assert min(inside) > 0.88
    assert 0.90 < np.mean(inside) < 0.97


@pytest.mark.nightly
def test_it_loses_nothing_on_a_car(seven_dof) -> None:  # type: ignore[no-untyped-def]
    recipes = (LocalPolynomial(spacing=1.5, high=20.0), LocalRational(spacing=1.5, high=20.0))
    fixed, mine = (_errors(seven_dof, _estimate(seven_dof, recipe)) for recipe in recipes)
    assert mine.max() <= 1.02 * fixed.max()
    assert np.median(mine) <= 1.02 * np.median(fixed)


def test_too_coarse_a_record_is_reported_with_the_error_and_a_remedy() -> None:
    one = structure(3, 0.01)
    fine = LocalRational(spacing=0.1).validated(gather(one.records, INPUTS, OUTPUTS))
    assert not fine.findings()
    short = [record.window(0.0, 6.0) for record in one.records]
    coarse = LocalRational(spacing=0.2).validated(gather(short, INPUTS, OUTPUTS))
    findings = coarse.findings()
    assert findings
    assert all("Hz" in line and "%" in line and "longer records" in line for line in findings)


def test_impossible_choices_and_records_are_refused() -> None:
    with pytest.raises(ParameterError, match="order must be at least 1"):
        LocalRational(order=0)
    one = structure(1)
    with pytest.raises(TooShortError, match="give longer records"):
        estimated(one, LocalRational(high=0.1))
    same = [record.with_channel("u2", "1", record["u1"]) for record in one.records]
    with pytest.raises(InputError, match="depend linearly"):
        estimate_response(same, inputs=INPUTS, outputs=OUTPUTS, recipe=LocalRational(spacing=0.5))


def test_an_input_without_power_is_dropped() -> None:
    one = structure(1)
    silent = [record.with_channel("u2", "1", 1e-9 * record["u2"]) for record in one.records]
    low = [record.with_channel("u2", "1", np.cumsum(record["u2"]) * 1e-9) for record in silent]
    response = estimate_response(low, inputs=INPUTS, outputs=OUTPUTS, recipe=LocalRational(spacing=0.5))
    dropped = response.H[:, 1] == 0.0
    assert dropped.any()
    assert response.variance is not None
    assert np.isinf(response.variance[:, 1][dropped]).all()
