"""A sketch on a part of the samples saves time without changing the result."""

from __future__ import annotations

import numpy as np
import pytest

from eightpost.ident import fit_shock
from eightpost.ident.shock.closed import FadingLag, dynamics_for
from eightpost.ident.shock.force import Models
from eightpost.ident.shock.gas import gas_columns
from eightpost.ident.shock.joint import _sketched
from eightpost.ident.shock.limits import limits_for
from eightpost.ident.shock.runs import prepare_runs
from eightpost.rig.dyno_test import DynoTest
from eightpost.shock import LAWS


@pytest.fixture(scope="module")
def faulty(digressive_record):
    """Return a record of a digressive valve whose force is constant for 30 ms, twice."""
    test = digressive_record(1)
    force = test.series["force"].copy()
    for start in (4000, 9000):
        force[start : start + 60] = force[start]
    return DynoTest(test.series.with_channel("force", "N", force))


@pytest.mark.nightly
@pytest.mark.parametrize("fault", [False, True])
def test_the_fit_is_that_on_all_samples(fault, digressive_record, faulty, monkeypatch):
    test = faulty if fault else digressive_record(1)
    quick = fit_shock(test, "lpnl2")
    monkeypatch.setattr(FadingLag, "is_costly", False)
    slow = fit_shock(test, "lpnl2")
    assert (quick.downweighted > 0) is fault
    assert quick.percent == pytest.approx(slow.percent, rel=1e-3)
    for parameter in slow.parameters:
        low, high = parameter.interval or (-np.inf, np.inf)
        assert low <= quick.parameter(parameter.name).value <= high


@pytest.fixture(scope="module")
def models(digressive_record):
    runs = prepare_runs([digressive_record(1)])
    dynamics = dynamics_for(LAWS["lpnl2"], limits_for(runs.measured, runs.rate))
    return Models(runs, gas_columns(runs, "estimate")[0], dynamics)


def test_models_at_other_weights_have_the_same_curves(models):
    plain, weights = models("slope", 9), np.linspace(0.0, 1.0, models.runs.weights.size)
    weighed = models.weighted(weights)("slope", 9)
    assert weighed.has_curve_of(plain)
    assert weighed.coarse.has_curve_of(plain)
    np.testing.assert_array_equal(weighed.coarse.runs.weights, weights)
    np.testing.assert_array_equal(weighed.curve_rows(), plain.curve_rows())
    assert models("slope", 9).runs.weights.min() == 1.0
    assert not models("free", 9).has_curve_of(plain)


def test_a_law_that_is_linear_in_its_curve_is_not_sketched(models):
    whole = models("slope", 9)
    assert _sketched(whole).model is whole.coarse
    lpf1 = whole.with_dynamics(dynamics_for(LAWS["lpf1"], whole.dynamics.limits))
    assert _sketched(lpf1).model is lpf1
