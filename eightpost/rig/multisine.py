"""Random multisine of the shock dynamometer (dissertation 3.2.3)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eightpost.signals.drivefile import Drivefile
from eightpost.signals.timeseries import TimeSeries

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

#: Table 3.2: frequency [Hz] and relative amplitude of the displacement [1].
TABLE_3_2 = (
    (0.1, 1.0), (1.0, 1.0), (2.0, 0.8), (3.0, 0.7), (4.0, 0.5), (5.0, 0.3), (8.0, 0.2), (10.0, 0.1),
    (20.0, 0.05), (30.0, 0.01),
)  # fmt: skip

#: Spacing of the sines [Hz]; the signal repeats every 1 / SPACING = 10 s.
SPACING = 0.1


def multisine_spectrum() -> tuple[Array, Array]:
    """Return the frequencies (300,) [Hz] and relative amplitudes (300,) [1] of Table 3.2 in steps of 0.1 Hz."""
    frequencies = SPACING * np.arange(1, 301, dtype=np.float64)
    table = np.array(TABLE_3_2)
    return frequencies, np.interp(frequencies, table[:, 0], table[:, 1])


def random_multisine(
    seed: int, *, duration: float = 30.0, rate: float = 2000.0, peak: float = 0.0254, draws: int = 50
) -> Drivefile:
    """Return a random displacement command for the dynamometer (Eq 3.26).

        x(t) = scale * sum_i A_i sin(2 pi f_i t + phi_i)

    The phases are uniformly random. Of `draws` draws, the one with the lowest crest factor is used and scaled to the
    peak.

    Args:
        seed: Seed of the phases.
        duration: Duration [s]; 30 in the dissertation. The signal repeats every 10 s.
        rate: Sample rate [Hz], above 60 and a multiple of 0.1.
        peak: Maximum magnitude over a period [m]; 1 in in the dissertation.
        draws: Number of phase draws.

    Returns:
        Drive file with the channel `displacement` [m].

    Raises:
        ValueError: The sample rate is too low for 30 Hz, or 10 s are not a whole number of samples.
    """
    count = round(rate / SPACING)
    if rate <= 60.0 or abs(count * SPACING - rate) > 1e-9 * rate:
        raise ValueError(f"the rate must be above 60 Hz and a multiple of 0.1 Hz, not {rate:g} Hz")
    generator = np.random.default_rng(seed)
    period = min((_period(generator, count) for _ in range(draws)), key=crest_factor)
    samples = np.arange(round(duration * rate) + 1)
    values = np.resize(period * (peak / np.abs(period).max()), samples.size)
    return Drivefile(TimeSeries.from_channels(samples / rate, {"displacement": ("m", values)}))


def _period(generator: np.random.Generator, count: int) -> Array:
    """Return one period (count,) of the unscaled sum for a new draw of phases."""
    _, amplitudes = multisine_spectrum()
    phases = generator.uniform(0.0, 2.0 * np.pi, amplitudes.size)
    lines = np.zeros(count // 2 + 1, dtype=np.complex128)
    # A sin(w t + phi) is the real part of -i A exp(i phi) exp(i w t).
    lines[1 : amplitudes.size + 1] = -0.5j * count * amplitudes * np.exp(1j * phases)
    return np.fft.irfft(lines, count)


def crest_factor(values: Array) -> float:
    """Return the peak magnitude of `values` (N,) over their root mean square [1]."""
    return float(np.abs(values).max() / np.sqrt(np.mean(values**2)))
