"""A sketch on a part of the samples saves time without changing the result."""

from __future__ import annotations

import numpy as np
import pytest

from eightpost.ident import fit_shock
from eightpost.ident.shock.curve import knot_basis
from eightpost.ident.shock.dynamics import FadingLag, dynamics_for
from eightpost.ident.shock.force import ForceModel, gas_columns, limits_for
from eightpost.ident.shock.law_fit import _sketched
from eightpost.ident.shock.problem import FitModel
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
def model(digressive_record):
    runs = prepare_runs([digressive_record(1)])
    dynamics = dynamics_for(LAWS["lpnl2"], limits_for(runs.measured, runs.rate))
    return ForceModel(runs, knot_basis(runs.velocity, runs.inside), gas_columns(runs, "estimate")[0], dynamics)


def test_a_model_at_other_weights_has_the_same_curve(model):
    coarse, weights = model.coarse, np.linspace(0.0, 1.0, model.runs.weights.size)
    weighed = model.weighted(weights)
    assert weighed.basis is model.basis and weighed.coarse.basis is coarse.basis
    np.testing.assert_array_equal(weighed.coarse.runs.weights, weights)
    np.testing.assert_array_equal(weighed.curve_rows(), model.curve_rows())
    assert model.runs.weights.min() == 1.0


def test_a_law_that_is_linear_in_its_curve_is_not_sketched(model):
    whole = FitModel((model,))
    assert _sketched(whole).model.first is model.coarse
    lpf1 = whole.with_dynamics(dynamics_for(LAWS["lpf1"], model.dynamics.limits))
    assert _sketched(lpf1).model is lpf1
