"""Tests of coherence and variance against their closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from eightpost.ident.vehicle.estimators import H1, LocalPolynomial, estimate_response
from eightpost.ident.vehicle.experiment import Blocks
from eightpost.signals import TimeSeries

RATE, SAMPLES, GAIN = 100.0, 100_000, 3.0


def _series(**channels):
    return TimeSeries.from_channels(np.arange(SAMPLES) / RATE, {name: ("m", row) for name, row in channels.items()})


def _estimate(record, recipe, *inputs):
    return estimate_response([record], inputs=inputs, outputs=["y"], recipe=recipe)


@pytest.fixture
def generator():
    return np.random.default_rng(11)


@pytest.mark.nightly
@pytest.mark.parametrize("recipe", [H1(Blocks(2.0)), LocalPolynomial(spacing=0.5, half_width=0.1)])
def test_the_variance_is_that_of_repeated_estimates(generator, recipe):
    values, variances = [], []
    for _ in range(20):
        u, noise = generator.normal(size=(2, SAMPLES))
        found = _estimate(_series(u=u, y=GAIN * u + noise), recipe, "u")
        assert found.variance is not None
        values.append(found.H[0, 0])
        variances.append(found.variance[0, 0].mean())
    assert np.mean(variances) == pytest.approx(np.mean(np.abs(np.array(values) - GAIN) ** 2), rel=0.15)


def test_h1_is_unbiased_by_output_noise_and_too_small_by_input_noise(generator):
    u, noise = generator.normal(size=(2, SAMPLES))
    for record, gain in (
        (_series(u=u, y=GAIN * (u + 0.5 * noise)), GAIN),
        (_series(u=u + 0.5 * noise, y=GAIN * u), GAIN / 1.25),
    ):
        assert _estimate(record, H1(Blocks(2.0)), "u").H.real.mean() == pytest.approx(gain, rel=0.01)


def test_an_input_is_dropped_where_it_has_no_power(generator):
    wide = generator.normal(size=SAMPLES)
    spectrum = np.fft.rfft(generator.normal(size=SAMPLES))
    spectrum[np.fft.rfftfreq(SAMPLES, 1.0 / RATE) > 5.0] = 0.0
    slow = np.fft.irfft(spectrum)
    found = _estimate(_series(wide=wide, slow=slow, y=wide + slow + 0.1 * generator.normal(size=SAMPLES)),
                      H1(Blocks(4.0)), "wide", "slow")  # fmt: skip
    above = found.frequency > 6.0
    assert found.variance is not None
    assert not found.H[0, 1, above].any()
    assert np.isinf(found.variance[0, 1, above]).all()
    assert found.H[0, 0, above] == pytest.approx(np.ones(above.sum()), abs=0.05)
    assert np.abs(found.H[0, 1, found.frequency < 4.5] - 1.0).max() < 0.05
