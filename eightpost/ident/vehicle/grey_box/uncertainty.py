"""Uncertainty due to noise of every output of a grey-box car, from models with drawn parameters."""

from __future__ import annotations

import numpy as np

from eightpost.array_types import Array
from eightpost.ident.output_error import OutputErrorFit
from eightpost.ident.response import FrequencyResponse
from eightpost.ident.vehicle.common_poles.deviations import relative_deviations
from eightpost.ident.vehicle.experiment import Experiment
from eightpost.ident.vehicle.grey_box.vehicle import linear_model
from eightpost.ident.vehicle.trust import OutputTrust
from eightpost.signals import TimeSeries
from eightpost.vehicle import StateSpace


def sampled_cars(fit: OutputErrorFit, experiment: Experiment, count: int, *, seed: int = 0) -> tuple[StateSpace, ...]:
    """Return linear models with parameters drawn from the covariance of a fit, within their bounds.

    Args:
        fit: Fit of the car.
        experiment: Inputs, shock forces and outputs of the tests.
        count: Number of models.
        seed: Seed of the parameters.
    """
    power, axes = np.linalg.eigh(fit.covariance)
    drawn = np.random.default_rng(seed).standard_normal((count, power.size)) * np.sqrt(np.maximum(power, 0.0))
    table = fit.table
    values = [table.values(table.inside(fit.theta + axes @ row)) for row in drawn]
    return tuple(linear_model(dict(zip(table.names, map(float, row), strict=True)), experiment) for row in values)


def output_trust(
    fit: OutputErrorFit,
    test: TimeSeries,
    experiment: Experiment,
    response: FrequencyResponse,
    band: tuple[float, float],
    *,
    samples: int,
) -> dict[str, OutputTrust]:
    """Return the uncertainty of every output.

    Args:
        fit: Fit of the car.
        test: Test that drives the setups.
        experiment: Inputs, shock forces and outputs of the tests.
        response: Response of the tests with its variance, which the misfit is relative to.
        band: Lowest and highest frequency of the fit [Hz].
        samples: Number of models with drawn parameters that give the standard deviations; at least 2.
    """
    model = linear_model(fit.values, experiment)
    deviations = relative_deviations(model, sampled_cars(fit, experiment, samples), test, experiment, band)
    rows = zip(model.output_names, *deviations, _misfit(model, response, band), strict=True)
    return {name: OutputTrust(float(a), float(b), float(c)) for name, a, b, c in rows}


def _misfit(model: StateSpace, response: FrequencyResponse, band: tuple[float, float]) -> Array:
    """Return the RMS of model minus response in standard deviations of the response (p,)."""
    inside = (response.frequency >= band[0]) & (response.frequency <= band[1])
    assert response.variance is not None
    variance = response.variance[..., inside]
    apart = np.abs(model.frequency_response(response.frequency[inside]) - response.H[..., inside]) ** 2
    known = np.isfinite(variance) & (variance > 0.0)
    parts = np.divide(apart, variance, out=np.zeros_like(apart), where=known)
    return np.asarray(np.sqrt(parts.sum(axis=(1, 2)) / np.maximum(known.sum(axis=(1, 2)), 1)))
