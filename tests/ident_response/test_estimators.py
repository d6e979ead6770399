"""Tests of estimated frequency responses, compared with the exact ones of the car that was tested."""

from __future__ import annotations

import numpy as np
import pytest

from eightpost.errors import InputError
from eightpost.ident.vehicle.estimators import H1, LocalPolynomial, SameDrive, estimate_response
from eightpost.ident.vehicle.experiment import Blocks
from eightpost.ident.vehicle.frequency_response import contribution_error, response_of


def _estimate(rig, recipe):
    found = estimate_response(
        rig.records, inputs=rig.inputs, outputs=rig.outputs, recipe=recipe, baseline_damping=rig.damping
    )
    return found.band(0.3, 25.0)


def _errors(rig, found):
    return contribution_error(found, response_of(rig.truth, found.frequency), rig.input_power(found.frequency))


def test_the_local_polynomial_method_is_within_a_tenth_of_a_percent_for_the_quarter_car(quarter_car):
    assert _errors(quarter_car, _estimate(quarter_car, LocalPolynomial(degree=4, spacing=0.1))).max() < 1e-3


def test_the_local_polynomial_method_is_within_half_a_percent_for_the_seven_dof_car(seven_dof):
    assert _errors(seven_dof, _estimate(seven_dof, LocalPolynomial(spacing=0.2))).max() < 5e-3


@pytest.mark.repeated
@pytest.mark.parametrize("window", ["hann", "hamming"])
def test_the_leakage_of_windowed_blocks_decreases_with_their_length(quarter_car, window):
    lengths = (2.5, 5.0, 10.0, 20.0)
    errors = [_errors(quarter_car, _estimate(quarter_car, H1(Blocks(length, window)))).max() for length in lengths]
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] < 0.25 * errors[0]


def test_short_windows_overestimate_damping(quarter_car):
    found = _estimate(quarter_car, H1(Blocks(4.0, "hamming")))
    near = np.abs(found.frequency - 3.04) < 0.13
    truth = response_of(quarter_car.truth, found.frequency)
    measured, exact = (r.between("ride_height", "aero_force")[near] for r in (found, truth))
    assert np.abs(measured).max() < 0.97 * np.abs(exact).max()


def test_the_estimate_from_one_drive_agrees_with_the_global_one(quarter_car):
    blocks = Blocks(10.0)
    recipes = (SameDrive(H1(blocks), ("force",)), H1(blocks))
    errors, together = (_errors(quarter_car, _estimate(quarter_car, r)).max() for r in recipes)
    assert errors < 3.0 * together


def test_the_two_experiment_method_with_local_polynomials_is_within_half_a_percent(quarter_car):
    recipe = SameDrive(LocalPolynomial(spacing=0.1), ("force",))
    assert _errors(quarter_car, _estimate(quarter_car, recipe)).max() < 5e-3


def test_forces_of_linear_shocks_alone_are_rejected_as_dependent(quarter_car):
    with pytest.raises(InputError, match="depend linearly"):
        estimate_response(
            quarter_car.records[:1],
            inputs=quarter_car.inputs,
            outputs=quarter_car.outputs,
            recipe=LocalPolynomial(spacing=0.2),
        )
