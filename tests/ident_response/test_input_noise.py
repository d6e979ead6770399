"""Bias of responses from noise of the measured inputs."""

from __future__ import annotations

import numpy as np
import pytest

from eightpost.ident.response import H1, H2, Hv, LocalPolynomial
from eightpost.ident.response.input_noise import input_noise
from eightpost.ident.response.records import Record, Records
from eightpost.vehicle import Channel

RATE, COUNT = 125.0, 50_000
INPUTS = (Channel("road", "m"), Channel("force", "N"))


def records(noise: float, *, seed: int = 3) -> Records:
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


def test_without_noise_there_is_no_bias() -> None:
    assert max(input_noise(records(0.0), (1.0, 25.0)).bias.values()) < 1e-6


def test_the_stated_bias_is_that_of_noise_in_the_force_only() -> None:
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


def test_frequencies_at_which_an_input_is_not_driven_do_not_count() -> None:
    """The road ends at 8 Hz, of a band to 25 Hz: noise alone would be a bias of 1. An input of noise alone has none."""
    generator = np.random.default_rng(3)
    spectrum = np.fft.rfft(generator.standard_normal(COUNT))
    spectrum[np.fft.rfftfreq(COUNT, 1.0 / RATE) > 8.0] = 0.0
    u = np.stack([np.fft.irfft(spectrum, COUNT), np.zeros(COUNT)]) + 0.04 * generator.standard_normal((2, COUNT))
    bias = input_noise(Records((Record(u, u[:1]),), RATE, INPUTS, (Channel("y", "m"),)), (1.0, 25.0)).bias
    assert bias == {"road": pytest.approx(0.04**2, rel=0.1)}


@pytest.mark.parametrize(
    ("recipe", "text"),
    [(LocalPolynomial(), "too small"), (H1(None), "too small"), (H2(None), "too large"), (Hv(None), "between")],
)
def test_the_sentence_names_the_estimator_and_the_direction_of_its_bias(recipe, text) -> None:
    sentence = input_noise(records(0.01), (1.0, 25.0)).summary(recipe)
    assert text in sentence
    assert sentence.startswith("Estimator: ")
    assert ("force" in sentence) is (text == "too small")
