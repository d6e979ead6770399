"""The closed-form Jacobians that the optimiser runs on are derivatives."""

from __future__ import annotations

import numpy as np
import pytest

from eightpost.ident.shock.basis import CurveBasis, working_basis
from eightpost.ident.shock.dynamics import dynamics_for
from eightpost.ident.shock.force_model import ForceModel
from eightpost.ident.shock.gas import gas_columns
from eightpost.ident.shock.limits import limits_for
from eightpost.ident.shock.preparation import prepare
from eightpost.ident.shock.problem import Problem
from eightpost.shock import Lpf1

THETA = {"polylinear": [], "lpf1": [1.4e-3], "lpnl2": [1.4e-3, 500.0, 0.3]}


@pytest.fixture(scope="module")
def prepared(curve, law_record):
    return prepare(law_record(Lpf1(curve, 1.3e-3), 1))


@pytest.fixture(params=THETA)
def case(request, prepared):
    basis = CurveBasis(prepared.transition_speed, prepared.transition_width)
    working = working_basis(basis, prepared.record["velocity"], basis.ties(compression="free", rebound="free"))
    limits = limits_for(prepared.measured, prepared.rate)
    columns, _ = gas_columns(prepared, "estimate")
    model = ForceModel(prepared, working, columns, dynamics_for(request.param, limits))
    linear, *_ = np.linalg.lstsq(model.linear_columns, prepared.record["force"], rcond=None)
    return Problem(model, fall_weight=30.0), np.append(linear, THETA[request.param])


def test_the_jacobian_is_the_central_difference(case):
    problem, parameters = case
    found = problem.jacobian(parameters)
    for number, scale in enumerate(problem.model.scale()):
        small = np.zeros(parameters.size)
        small[number] = 1e-5 * scale
        expected = (problem.residual(parameters + small) - problem.residual(parameters - small)) / (2e-5 * scale)
        error = np.linalg.norm(found[:, number] - expected) / np.linalg.norm(expected)
        assert error < 2e-3, (number, error)  # alpha has corners: a few samples change sides within the difference


def test_values_of_lpnl2_come_back_and_keep_their_order(prepared):
    dynamics = dynamics_for("lpnl2", limits_for(prepared.measured, prepared.rate))
    np.testing.assert_allclose(dynamics.values(dynamics.theta(1e-3, 400.0, 900.0)), (1e-3, 400.0, 900.0))
    (_, low, _), (_, high, _) = dynamics.bounds()
    for full in (low, 0.5 * (low + high), high):
        for share in (0.0, 0.5, 1.0):
            _, first, second = dynamics.values(np.array([1e-3, full, share]))
            assert dynamics.limits.gap * (1 - 1e-9) <= second - first
            assert second <= dynamics.limits.force[1] * (1 + 1e-12)
