"""Drive files of the virtual rigs and of a synthetic track."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.signal import fftconvolve, firwin2

from eightpost.array_types import Array
from eightpost.corners import CORNERS
from eightpost.errors import ParameterError
from eightpost.rig.geometry import aeroloader_forces
from eightpost.signals.drivefile import Drivefile
from eightpost.signals.timeseries import TimeSeries
from eightpost.units import convert

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.virtual.car import AnyCar


# ---- Track for the seven-DOF car: rough road and slow body loads (dissertation 6.1.3) -------------------------------

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
    taper = 0.5 - 0.5 * np.cos(np.pi * np.minimum(np.arange(samples) / rate / TAPER, 1.0))
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
        return np.asarray(np.fft.rfftfreq(self.samples + 2 * self.margin, 1.0 / self.rate), dtype=np.float64)

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


#: Sample rate of the rig's records (6.1.5) [Hz], and integration steps per sample, which give 5 kHz.
RATE, STEPS = 1250.0, 4

#: Duration of the lead-in before each record, in which the car comes into motion [s]; it is not recorded.
LEAD = 6.0


# ---- Drive files of the quarter-car rig (4.5.1) and of the 8-post rig (6.1.3) with commands at 1250 Hz --------------

_INCH = convert(1.0, "in", "m")
_POUND = convert(1.0, "lbf", "N")

#: Table 4.3: frequency [Hz] and relative amplitude [1] of the quarter-car rig's random test; zero above 20 Hz.
TABLE_4_3 = (
    (0.0, 0.0), (0.1, 1.0), (1.0, 1.0), (2.0, 0.8), (3.0, 0.7), (5.0, 0.5), (8.0, 0.3), (10.0, 0.3), (15.0, 0.3),
    (20.0, 0.1), (20.1, 0.0),
)  # fmt: skip

#: Table 4.4: frequency [Hz] and amplitude [in].
TABLE_4_4 = ((1.0, 1.0), (2.8, 0.6), (3.5, 0.5), (5.0, 0.4), (9.0, 0.4), (12.0, 0.3))

#: Table 6.2: frequency [Hz] and amplitude [in] for heave, and for pitch and roll.
HEAVE_SINES = (
    (1.0, 1.0), (2.0, 1.0), (4.0, 0.7), (6.0, 0.5), (8.0, 0.3), (10.0, 0.3), (15.0, 0.1), (20.0, 0.05),
)  # fmt: skip
TILT_SINES = ((1.0, 1.0), (2.0, 0.7), (3.0, 0.5), (5.0, 0.5), (6.0, 0.3))

#: Signs of lf, rf, lr, rr in each mode: heave up, nose down, left up, front left up and rear left down.
SIGNS = {"heave": (1, 1, 1, 1), "pitch": (-1, -1, 1, 1), "roll": (1, -1, 1, -1), "warp": (1, -1, -1, 1)}

#: Peak amplitudes of the wheelloaders [m] and of the aeroloaders about their mean [N] (6.1.3).
ROAD_PEAK, AERO_PEAK = 0.4 * _INCH, 560.0 * _POUND

#: Mean aeroloader force, front and rear [N]. Our own choice: about 1 in of travel with the stiff springs of Table 5.1;
#: 6.1.3 has 3 and 2.5 in, which these springs would not reach.
DOWNFORCE = (700.0 * _POUND, 550.0 * _POUND)

#: Maximum static force of an aeroloader [N], if all push down and if some pull up, where 1000 lbf would lift the wheels
#: (6.1.3 has "near maximum suspension travel").
STATIC_PUSH, STATIC_PULL = 1000.0 * _POUND, 500.0 * _POUND


def random_drive(
    car: AnyCar, seed: int, *, duration: float = 800.0, active: Sequence[str] = (), road_peak: float = ROAD_PEAK
) -> Drivefile:
    """Return the random test: Gaussian noise with the spectra of Table 6.3 on all actuators, or on `active` ones only.

    The noise is shaped by a linear-phase filter of 8 s (6.1.3 has a Yule-Walker fit) and scaled to the peaks of 6.1.3.
    Inactive wheelloaders are at 0, inactive aeroloaders at their mean force.

    Args:
        car: Car whose inputs are commanded.
        seed: Seed of the noise generator.
        duration: Duration [s]; 800, and 100 for single inputs (6.1.3).
        active: Names of the inputs that move; empty for all inputs.
        road_peak: Peak amplitude of the roads [m].

    Raises:
        ParameterError: The car does not have an input, or the duration is not positive.
    """
    unknown = [name for name in active if name not in car.inputs]
    if unknown:
        raise ParameterError(f"there is no input {', '.join(unknown)}; the {car.name} has {', '.join(car.inputs)}")
    _check_duration(duration)
    generator, count, commands = np.random.default_rng(seed), round(duration * RATE) + 1, {}
    for name in car.inputs:
        is_road = name in car.named("road")
        noise = _shaped_noise(generator, count, WHEELLOADER if is_road else AEROLOADER)
        peak = road_peak if is_road else AERO_PEAK
        if car.geometry is not None and name.endswith("_moment"):  # with half the wheelbase as lever arm
            peak *= 0.5 * (car.geometry.front_axle + car.geometry.rear_axle)
        if not active or name in active:
            commands[name] = peak * noise
    return _drivefile(car, count, commands)


def quarter_random(seed: int, *, duration: float) -> Drivefile:
    """Return the random test of 4.5.1: a multisine with the spectrum of Table 4.3 in steps of 0.1 Hz on `road` [m].

    The peak amplitude is that of the 8-post rig, because 4.5.1 does not state it.

    Args:
        seed: Seed of the phases.
        duration: Duration [s]; the signal repeats every 10 s.
    """
    _check_duration(duration)
    frequencies = np.arange(1, 201) / 10.0
    amplitudes = np.interp(frequencies, *np.array(TABLE_4_3).T)
    phases = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, frequencies.size)
    period = round(10.0 * RATE)
    lines = np.zeros(period // 2 + 1, dtype=np.complex128)
    lines[1:201] = amplitudes * np.exp(1j * phases)
    wave = np.fft.irfft(lines, period)
    count = round(duration * RATE) + 1
    values = np.resize(wave * (ROAD_PEAK / np.abs(wave).max()), count)
    channels = {"road": ("m", values), "aero_force": ("N", np.zeros(count))}
    return Drivefile(TimeSeries.from_channels(np.arange(count) / RATE, channels))


def sine_drive(
    car: AnyCar, frequency: float, amplitude: float, *, mode: str = "heave", duration: float = 20.0
) -> Drivefile:
    """Return a sine of the wheelloaders in a mode; the amplitude grows during the first second.

    Args:
        car: Car whose inputs are commanded.
        frequency: Sine frequency [Hz].
        amplitude: Amplitude of each wheelloader [m].
        mode: Mode: heave, pitch, roll or warp.
        duration: Duration [s].
    """
    _check_duration(duration)
    time = np.arange(round(duration * RATE) + 1) / RATE
    wave = amplitude * np.minimum(time, 1.0) * np.sin(2.0 * np.pi * frequency * time)
    return _drivefile(car, time.size, _in_mode(car, mode, wave))


def bump_drive(car: AnyCar, *, height: float = 0.4 * _INCH, period: float = 10.0, duration: float = 50.0) -> Drivefile:
    """Return a square wave of all wheelloaders, `height` [m] from peak to peak (6.1.3: 0.4 in, 10 s period, 50 s long).

    The edges take 20 ms (two moving averages of 10 ms), because actuators cannot jump. Section 4.5.1 has 1 in, a period
    of 20 s and a duration of 60 s.
    """
    _check_duration(duration)
    time = np.arange(round(duration * RATE) + 1) / RATE
    wave = np.where((time / period) % 1.0 < 0.5, 0.0, height) - 0.5 * height
    for _ in range(2):
        wave = uniform_filter1d(wave, 13, mode="nearest")
    return _drivefile(car, time.size, _in_mode(car, "heave", wave))


def static_drive(
    car: AnyCar, kind: str = "heave", *, most: float | None = None, levels: int = 5, hold: float = 5.0
) -> Drivefile:
    """Return the spring-rating test of 6.1.3: the aeroloader forces increase in levels from zero to `most`, and back.

    Args:
        car: Car with four aeroloaders.
        kind: Type of loading: heave, pitch, roll, warp, or the name of one aeroloader, such as `lf.aero`.
        most: Maximum force of each active aeroloader [N]; in pitch, roll and warp, two of them pull. Default
            `STATIC_PUSH` if all push and `STATIC_PULL` if some pull.
        levels: Number of force levels above zero; default 5.
        hold: Duration of each level [s], after a ramp of 1 s; default 5 (6.4.4).

    Raises:
        ParameterError: The car has no aeroloaders, or the type of loading does not exist.
    """
    names = car.named("aero")
    if car.loads != names:
        raise ParameterError(
            f"static loading needs four aeroloaders, which the {car.name} does not have; use eight_post"
        )
    if kind not in (*SIGNS, *names):
        raise ParameterError(f"there is no static test {kind!r}; there are {', '.join((*SIGNS, *names))}")
    if most is None:
        most = STATIC_PULL if kind in ("pitch", "roll", "warp") else STATIC_PUSH
    steps = [*range(levels + 1), *range(levels - 1, -1, -1)]
    corners = [(k * (hold + 1.0) + rest, level) for k, level in enumerate(steps) for rest in (0.0, hold)]
    times, shares = np.array(corners).T
    time = np.arange(round(times[-1] * RATE) + 1) / RATE
    force = most / levels * np.interp(time, times, shares)
    # The modes are positive up, the aeroloader forces down.
    signs = {n: -s if kind != "heave" else s for n, s in zip(names, SIGNS.get(kind, (0,) * 4), strict=True)}
    if kind in names:
        signs[kind] = 1
    return _drivefile(car, time.size, {name: sign * force for name, sign in signs.items()}, rest=False)


def _check_duration(duration: float) -> None:
    """Refuse a duration [s] that is not above 0."""
    if not (np.isfinite(duration) and duration > 0.0):
        raise ParameterError(f"the duration must be above 0, not {duration:g} s")


def _in_mode(car: AnyCar, mode: str, wave: Array) -> dict[str, Array]:
    if mode not in SIGNS:
        raise ParameterError(f"there is no mode {mode!r}; there are {', '.join(SIGNS)}")
    signs = SIGNS[mode] if len(car.corners) == 4 else (1,)
    return {name: sign * wave for name, sign in zip(car.named("road"), signs, strict=True)}


def _drivefile(car: AnyCar, count: int, commands: Mapping[str, Array], *, rest: bool = True) -> Drivefile:
    """Return the drive file of the inputs that move; with `rest`, the mean forces of the aeroloaders are added."""
    zero, channels = np.zeros(count), {}
    units = (*("m",) * len(car.corners), *car.load_units)
    for name, unit in zip(car.inputs, units, strict=True):
        mean = _mean_load(car, name) if rest else 0.0
        channels[name] = (unit, mean + commands.get(name, zero))
    return Drivefile(TimeSeries.from_channels(np.arange(count) / RATE, channels))


def _mean_load(car: AnyCar, name: str) -> float:
    """Return the mean of an input, which is the downforce for aeroloaders and 0 otherwise."""
    if car.loads != car.named("aero") or name not in car.loads:
        return 0.0
    return DOWNFORCE[0] if car.loads.index(name) < 2 else DOWNFORCE[1]


def _shaped_noise(generator: np.random.Generator, count: int, table: Sequence[tuple[float, float]]) -> Array:
    """Return zero-mean Gaussian noise (count,) with the amplitude spectrum of a table and a peak of 1."""
    frequencies, amplitudes = np.array(table).T
    taps = round(8.0 * RATE) | 1
    edges = np.array([*frequencies, frequencies[-1] + 0.5, 0.5 * RATE])
    gains = np.array([0.0, *amplitudes[1:], 0.0, 0.0])
    white = generator.standard_normal(count + taps - 1)
    noise = fftconvolve(white, firwin2(taps, edges, gains, fs=RATE, nfreqs=32769), mode="valid")
    noise -= noise.mean()
    return np.asarray(noise / np.abs(noise).max(), dtype=np.float64)


# ---- Synthetic lap of a track on the virtual rig (6.1.3), because the Richmond drive file is not public -------------

#: Root mean square of the four roads of a lap [m]: 0.64 of the 0.11 in of the identification drive. Laps are smoother
#: than identification tests: Table 7.4 has 0.2 to 0.28 g at the front hubs and 0.32 to 0.47 g at the rear hubs, which
#: this car has at 0.03 in; at 0.07 in it has 0.5 to 0.76 g and 0.69 to 1.1 g. The smoother the lap, the larger is the
#: influence of friction (figures in docs/explanation/rig.md); at 0.07 in a linear model has the error found with our
#: prototypes.
LAP_ROAD = convert(0.07, "in", "m")

#: Ratio of the loads of a lap to those of `Track`, which are those of the identification drive. With half the loads,
#: the total tire force is 260 to 300 lbf RMS; Table 7.4 has 149 to 204 lbf.
LAP_LOADS = 0.5

_TRACK = Track()
_LAP = replace(
    _TRACK,
    downforce=2.0 * sum(DOWNFORCE),
    heave_rms=LAP_LOADS * _TRACK.heave_rms,
    roll_rms=LAP_LOADS * _TRACK.roll_rms,
    pitch_rms=LAP_LOADS * _TRACK.pitch_rms,
)


def track_drive(car: AnyCar, seed: int, *, duration: float = 33.0) -> Drivefile:
    """Return a synthetic lap for a four-wheeled car; the aeroloaders apply the loads if the car has any.

    The spectra are those of `track_drivefile`. The aeroloaders have the mean forces of the identification tests.

    Args:
        car: Car whose inputs are commanded.
        seed: Seed of the noise generator.
        duration: Duration [s]; all channels grow from their means during the first second.

    Raises:
        ParameterError: The car does not have four wheels, or the duration is not positive.
    """
    if car.geometry is None:
        raise ParameterError("a track lap needs a car with four wheels")
    _check_duration(duration)
    lap = track_drivefile(seed, duration=duration, rate=RATE, track=_LAP).series
    roads = np.stack([lap[name] for name in car.named("road")])
    roads *= LAP_ROAD / np.sqrt(np.mean(roads**2))
    channels = {name: ("m", row) for name, row in zip(car.named("road"), roads, strict=True)}
    if car.loads == car.named("aero"):
        # The forces for the variations of the body loads about their means.
        modes = [lap["heave_force"] + _LAP.downforce, lap["pitch_moment"], lap["roll_moment"], np.zeros(len(lap))]
        for name, force in zip(car.loads, aeroloader_forces(np.stack(modes), car.geometry), strict=True):
            channels[name] = ("N", _mean_load(car, name) + force)
    else:
        channels |= {name: (lap.unit(name), lap[name]) for name in car.loads}
    return Drivefile(TimeSeries.from_channels(lap.time, channels))
