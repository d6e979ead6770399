"""Synthetic track drive files for the seven-DOF car: rough road and slow body loads (dissertation 6.1.3)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from eightpost.array_types import Array
from eightpost.corners import CORNERS
from eightpost.signals.drivefile import Drivefile
from eightpost.signals.timeseries import TimeSeries
from eightpost.units import convert

if TYPE_CHECKING:
    from numpy.typing import NDArray


#: Table 6.3, wheelloader: frequency [Hz] and relative amplitude [1]; zero above 30 Hz.
WHEELLOADER = (
    (0.0, 1.0), (0.5, 1.0), (1.0, 1.0), (2.0, 0.8), (3.0, 0.7), (5.0, 0.5), (8.0, 0.3), (10.0, 0.3),
    (15.0, 0.3), (20.0, 0.1), (30.0, 0.01),
)  # fmt: skip

#: Table 6.3, aeroloader: frequency [Hz] and relative amplitude [1]; zero above 5 Hz.
AEROLOADER = ((0.0, 1.0), (0.5, 1.0), (3.0, 1.0), (4.0, 0.1), (5.0, 0.01))

#: Time over which a drive file grows from its mean to its full amplitude [s].
TAPER = 1.0

#: Time that is generated before and after the record and cut off, so that the periodic noise does not wrap around [s].
_MARGIN = 5.0


@dataclass(frozen=True, slots=True)
class Track:
    """Parameters of a track drive file, from section 6.1.3 if it gives them, otherwise our own choice."""

    speed: float = 45.0  #: Speed of the car [m/s].
    #: Wheelbase [m]; the rear axle follows the road of the front axle after wheelbase / speed.
    wheelbase: float = convert(110.0, "in", "m")
    track_width: float = convert(70.0, "in", "m")  #: Distance between the wheels of an axle [m].
    #: Ratio [1]; left and right are similar above wavelengths of track_width / coherence_width.
    coherence_width: float = 0.3
    road_peak: float = convert(0.4, "in", "m")  #: Maximum wheelloader displacement [m]; 0.4 in (6.1.3).
    downforce: float = convert(1000.0, "lbf", "N")  #: Mean downforce [N].
    #: Root mean square of the heave force about its mean [N]; 160 lbf, the value per aeroloader in 6.1.3.
    heave_rms: float = convert(160.0, "lbf", "N")
    roll_rms: float = convert(4800.0, "lbf.in", "N.m")  #: Root mean square of the roll moment [N.m].
    pitch_rms: float = convert(8000.0, "lbf.in", "N.m")  #: Root mean square of the pitch moment [N.m].

    @property
    def delay(self) -> float:
        """Time from the front axle to the rear [s]."""
        return self.wheelbase / self.speed

    def likeness(self, frequency: Array) -> Array:
        """Return the coherence (not squared) of the left and right road (K,) [1] at `frequency` (K,) [Hz].

            gamma(f) = exp(-f w / (c v)),  w track width, v speed, c coherence width

        The coherence is one at long wavelengths and decreases with frequency, as on measured roads.
        """
        return np.asarray(np.exp(-frequency * self.track_width / (self.coherence_width * self.speed)))


def track_drivefile(seed: int, *, duration: float = 30.0, rate: float = 500.0, track: Track | None = None) -> Drivefile:
    """Return a synthetic track drive file for the seven-DOF car.

    Gaussian noise is shaped to the spectra of Table 6.3. The four roads have the spectrum of the wheelloaders; left and
    right are similar only at long wavelengths, and the rear axle has the delayed road of the front axle. Heave force
    (about a mean downforce, so negative), roll and pitch moment have the spectrum of the aeroloaders. In the first
    second all channels grow from their means, so that a run can start in equilibrium.

    Args:
        seed: Seed of the noise generator.
        duration: Duration [s].
        rate: Sample rate [Hz], above 60.
        track: Speed, geometry and amplitudes.

    Returns:
        Drive file with `lf.road`, `rf.road`, `lr.road`, `rr.road` [m, up], `heave_force` [N, up],
        `roll_moment` and `pitch_moment` [N.m].

    Raises:
        ValueError: The sample rate is too low for the spectrum.
    """
    if rate <= 60.0:
        raise ValueError(f"the sample rate must be above 60 Hz for a spectrum up to 30 Hz, not {rate:g} Hz")
    track = track or Track()
    generator = np.random.default_rng(seed)
    samples = round(duration * rate) + 1
    noise = _Noise(generator, samples, round(_MARGIN * rate), rate)
    taper = _taper(samples, rate)
    roads = _roads(noise, track) * taper
    roads *= track.road_peak / np.abs(roads).max()
    channels = {f"{corner}.road": ("m", road) for corner, road in zip(CORNERS, roads, strict=True)}
    for name, unit, rms, mean in (
        ("heave_force", "N", track.heave_rms, -track.downforce),
        ("roll_moment", "N.m", track.roll_rms, 0.0),
        ("pitch_moment", "N.m", track.pitch_rms, 0.0),
    ):
        load = noise.cut(noise.shaped(AEROLOADER))
        channels[name] = (unit, mean + taper * load * (rms / np.std(load)))
    return Drivefile(TimeSeries.from_channels(np.arange(samples) / rate, channels))


@dataclass(frozen=True, slots=True, eq=False)
class _Noise:
    """White noise for a record with a margin on both sides, shaped in the frequency domain."""

    generator: np.random.Generator
    samples: int
    margin: int
    rate: float

    @property
    def frequency(self) -> Array:
        return np.asarray(np.fft.rfftfreq(self.samples + 2 * self.margin, 1.0 / self.rate))

    def shaped(self, table: tuple[tuple[float, float], ...]) -> NDArray[np.complex128]:
        """Return the Fourier coefficients (K,) of new zero-mean noise with the amplitude spectrum of a table."""
        white = self.generator.standard_normal(self.samples + 2 * self.margin)
        frequencies, amplitudes = np.array(table).T
        shape = np.interp(self.frequency, frequencies, amplitudes, right=0.0)
        shape[0] = 0.0
        return np.asarray(np.fft.rfft(white) * shape, dtype=np.complex128)

    def cut(self, lines: NDArray[np.complex128]) -> Array:
        """Return the record (N,) of Fourier coefficients (K,) without the margins."""
        whole = np.fft.irfft(lines, self.samples + 2 * self.margin)
        return np.asarray(whole[self.margin : self.margin + self.samples], dtype=np.float64)


def _roads(noise: _Noise, track: Track) -> Array:
    """Return the roads (4, N) under lf, rf, lr, rr, in any unit.

    With a common part c and an opposed part d, left = c + d and right = c - d have the same spectrum. Their coherence
    is gamma if the power of c is (1 + gamma) / 2 and that of d is (1 - gamma) / 2.
    """
    likeness = track.likeness(noise.frequency)
    common = noise.shaped(WHEELLOADER) * np.sqrt(0.5 * (1.0 + likeness))
    opposed = noise.shaped(WHEELLOADER) * np.sqrt(0.5 * (1.0 - likeness))
    later = np.exp(-2j * np.pi * noise.frequency * track.delay)
    sides = (common + opposed, common - opposed)
    return np.stack([noise.cut(side * axle) for axle in (np.ones_like(later), later) for side in sides])


def _taper(samples: int, rate: float) -> Array:
    """Return a raised cosine (N,) that grows from 0 to 1 over the first second."""
    time = np.arange(samples) / rate
    return np.asarray(0.5 - 0.5 * np.cos(np.pi * np.minimum(time / TAPER, 1.0)), dtype=np.float64)
