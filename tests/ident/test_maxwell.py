"""Fits of Maxwell's law: known shocks are recovered, and the fitted curve always rises."""

from __future__ import annotations

import numpy as np
import pytest

from eightpost.ident import fit_shock
from eightpost.ident.shock.curve import curve_forces
from eightpost.shock import Lpf1, Maxwell


@pytest.mark.nightly
def test_stiffness_and_curve_come_back(curve, law_record):
    fit = fit_shock(law_record(Maxwell(curve, 4e6), 1), "maxwell")
    assert fit.converged
    assert fit.parameter("series_stiffness").value == pytest.approx(4e6, rel=0.02)
    assert fit.percent < 0.2
    velocity = np.linspace(-0.6, 0.6, 200)
    true = curve_forces(curve, velocity)
    assert np.abs(curve_forces(fit.shock.law.curve, velocity) - true).max() < 0.02 * np.abs(true).max()


@pytest.mark.nightly
def test_the_curve_rises_everywhere_although_the_unconstrained_fit_would_fall(curve, law_record):
    """The record is slow and sampled at 500 Hz, and the shock's force falls a little in the narrow transition."""
    record = falling(law_record(Lpf1(curve, 5e-3), 4, rate=500.0, slower=6.0))
    stepped = fit_shock(record, "maxwell", curve="polynomial")
    assert stepped.shock.law.curve.falls_at() is None
    assert fit_shock(record, "maxwell", curve="knots").shock.law.curve.falls_at() is None
    assert any("constrained to rise everywhere" in change for change in stepped.changes)


def falling(test):
    """Return the record with a force that falls by a tenth of its range near 0.6 of its peak speed."""
    velocity, force = test.series["velocity"], test.series["force"]
    fast = 0.6 * min(velocity.max(), -velocity.min())
    drop = 0.1 * np.ptp(force) * 0.5 * (1.0 + np.tanh((np.abs(velocity) - fast) / (0.02 * fast)))
    return type(test)(test.series.with_channel("force", "N", force - np.sign(velocity) * drop))
