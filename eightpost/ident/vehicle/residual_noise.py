"""Noise in the residual of a free-running simulation: that of the measured outputs, and that of the inputs."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from eightpost.array_types import Array
from eightpost.corners import channel
from eightpost.signals import TimeSeries
from eightpost.vehicle import StateSpace

#: Highest frequency below the edge of the decimation's filter, relative to the sample rate [1].
HIGHEST = 0.39

#: Width of the bands in which the noise of a channel is sought [Hz].
_BAND = 5.0

#: Number of frequencies at which the model's response is evaluated.
_FREQUENCIES = 200


def residual_noise(
    model: StateSpace, test: TimeSeries, slopes: Mapping[str, float], combined: Array
) -> tuple[Array, Array]:
    """Return the expected power of noise at each line of the spectra of measured outputs (q,) and residuals (q, K).

    The noise of a channel is white, with the lowest mean power over bands of 5 Hz. With `u` the inputs of the rig and
    `F - c v` the force of a port, the residual of an output y contains

        e = H n_u + H_F (n_F - c n_v) - n_y

    Args:
        model: Model with the linear dampers c at its ports.
        test: Record of a test.
        slopes: Damping c of every port [N.s/m].
        combined: Sums of outputs that are judged (q, p), such as the identity.
    """
    power = {name: _floor(test[name], test.sample_rate) for name in test.names}
    names, lines = model.output_names, np.fft.rfftfreq(len(test), 1.0 / test.sample_rate)
    coarse = np.linspace(lines[1], lines[-1], _FREQUENCIES)
    H = np.einsum("qp,pmk->mqk", combined, model.frequency_response(coarse))
    H = dict(zip(model.input_names, H, strict=True))
    # Response of the residual to the noise of each channel: an output's own noise, an input, or both for a velocity.
    gains = {name: -combined[:, [k]] + np.zeros(coarse.size) for k, name in enumerate(names)}
    for name in [name for name in H if name in test]:
        gains[name] = gains.get(name, 0.0) + H[name]
    for port, slope in slopes.items():
        velocity = channel(port, "velocity")
        gains[velocity] = gains.get(velocity, 0.0) - slope * H[channel(port, "force")]
    found = np.sum([power[name] * np.abs(gain) ** 2 for name, gain in gains.items()], axis=0)
    measured = combined**2 @ np.array([power[name] for name in names])
    return measured, np.stack([np.interp(lines, coarse, row) for row in found])


def spectral_power(rows: Array) -> Array:
    """Return the power of the lines of the spectra of signals (p, N) without means, with a Hann window (p, K)."""
    centred = rows - rows.mean(axis=1, keepdims=True)
    return np.asarray(np.abs(np.fft.rfft(centred * np.hanning(rows.shape[1]), axis=1)) ** 2)


def _floor(values: Array, rate: float) -> float:
    """Return the lowest mean power of a signal's lines over bands of 5 Hz: white noise is not below it."""
    power = spectral_power(values[None])[0]
    frequency = np.fft.rfftfreq(values.size, 1.0 / rate)
    power = power[frequency <= HIGHEST * rate]
    width = min(max(1, round(_BAND / frequency[1])), power.size)
    count = power.size // width
    return float(power[: count * width].reshape(count, width).mean(axis=1).min())
