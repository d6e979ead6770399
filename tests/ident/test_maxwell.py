"""Maxwell's law is fitted to what it describes, and gives a curve that it takes to what it does not."""

from __future__ import annotations

import numpy as np
import pytest

from eightpost.ident import fit_shock
from eightpost.ident.shock.curve.basis import curve_forces
from eightpost.shock import Lpf1, Maxwell


def test_stiffness_and_curve_come_back(curve, law_record):
    fit = fit_shock(law_record(Maxwell(curve, 4e6), 1), "maxwell")
    assert fit.converged
    assert fit.parameter("series_stiffness").value == pytest.approx(4e6, rel=0.02)
    assert fit.percent < 0.2
    velocity = np.linspace(-0.6, 0.6, 200)
    true = curve_forces(curve, velocity)
    assert np.abs(curve_forces(fit.shock.law.curve, velocity) - true).max() < 0.02 * np.abs(true).max()


def test_the_curve_rises_all_over_where_the_record_alone_would_not_let_it(curve, law_record):
    """Slow and sampled at 500 Hz; a shock that gives way a little at its transition, where a blend is narrow."""
    stepped = fit_shock(falling(law_record(Lpf1(curve, 5e-3), 4, rate=500.0, slower=6.0)), "maxwell")
    assert stepped.shock.law.curve.falls_at() is None
    assert any("constrained to rise everywhere" in change for change in stepped.changes)


def falling(test):
    """The record with a force that falls by a tenth of its range about 0.6 of its speed."""
    velocity, force = test.series["velocity"], test.series["force"]
    fast = 0.6 * min(velocity.max(), -velocity.min())
    drop = 0.1 * np.ptp(force) * 0.5 * (1.0 + np.tanh((np.abs(velocity) - fast) / (0.02 * fast)))
    return type(test)(test.series.with_channel("force", "N", force - np.sign(velocity) * drop))
