"""Bias of responses from noise of the measured inputs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from eightpost.ident.vehicle.estimators import H1, LocalPolynomial, input_noise
from eightpost.ident.vehicle.experiment import Record, Records
from eightpost.vehicle import Channel

RATE, COUNT = 125.0, 50_000
INPUTS = (Channel("road", "m"), Channel("force", "N"))


def records(noise, *, seed=3):
    """Return a test with a gain of 2 from road and 3 from force, driven below 30 Hz, with white noise on the inputs.

    The force follows the road, apart from a tenth of its amplitude.
    """
    generator = np.random.default_rng(seed)
    spectra = np.fft.rfft(generator.standard_normal((2, COUNT)), axis=1)
    spectra[:, np.fft.rfftfreq(COUNT, 1.0 / RATE) > 30.0] = 0.0
    road, own = np.fft.irfft(spectra, COUNT, axis=1)
    force = road + 0.1 * own
    y = 2.0 * road + 3.0 * force
    u = np.stack([road, force]) + noise * generator.standard_normal((2, COUNT))
    return Records((Record(u, y[None]),), RATE, INPUTS, (Channel("y", "m"),))


def test_without_noise_there_is_no_bias():
    assert max(input_noise(records(0.0), (1.0, 25.0)).bias.values()) < 1e-6


def test_the_stated_bias_is_that_of_noise_in_the_force_only():
    """Compare with the estimate: the force's own part is small, so its noise matters and that of the road does not."""
    plain, noise = records(0.0), 0.04
    u = plain.tests[0].u.copy()
    u[1] += noise * np.random.default_rng(5).standard_normal(COUNT)
    noisy = Records((Record(u, plain.tests[0].y),), RATE, INPUTS, plain.outputs)
    response = LocalPolynomial(half_width=1.0, spacing=0.5, high=25.0).estimate(noisy)
    inside = (response.frequency > 2.0) & (response.frequency < 24.0)
    found = 1.0 - np.median(response.H[0, 1, inside].real) / 3.0
    stated = input_noise(noisy, (1.0, 25.0)).bias
    assert stated["force"] == pytest.approx(found, rel=0.25)
    assert 0.05 < found < 0.2
    assert stated["road"] < 1e-3


def test_frequencies_without_drive_do_not_count():
    noisy = records(0.02)
    driven, all_of_them = (input_noise(noisy, (1.0, high)).bias for high in (28.0, 0.5 * RATE))
    assert all_of_them == pytest.approx(driven, rel=0.1)


@pytest.mark.parametrize(("recipe", "name"), [(LocalPolynomial(), "local polynomials"), (H1(None), "H1")])
def test_the_sentence_names_the_estimator_and_the_direction_of_its_bias(recipe, name):
    noise = input_noise(records(0.01), (1.0, 25.0))
    sentence = noise.summary(recipe)
    assert sentence.startswith(f"Estimator: {name}")
    assert "makes its responses too small: if the noise" in sentence
    assert "force" in sentence
    assert replace(noise, bias={}).summary(recipe).endswith("makes its responses too small.")
