"""Synthetic sources of the demonstration data: a track, and a damper whose model differs from the fitted laws."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

from eightpost.array_types import Array
from eightpost.corners import CORNERS
from eightpost.signals.drivefile import Drivefile
from eightpost.signals.timeseries import TimeSeries
from eightpost.units import convert

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray


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


# ---- Damper ---------------------------------------------------------------------------------------------------------
# The valve gives velocity as a function of force (the laws give force as a function of velocity). It is digressive and
# different on its two sides. The fluid stiffens with pressure, so that the lag changes with the force. No law of
# `eightpost.shock` contains this model. It is integrated with scipy.

_POUND_PER_INCH_PER_SECOND = convert(1.0, "lbf.s/in", "N.s/m")
_POUND = convert(1.0, "lbf", "N")


@dataclass(frozen=True, slots=True)
class ValveSide:
    """One side of the piston: a bleed orifice in parallel with a blow-off stack.

        bleed:     |F| = R u + Q u^2
        blow-off:  u = (w / c) [ln(1 + exp((|F| - F_open) / w)) - ln(1 + exp(-F_open / w))]

    The two flows are added; u is the flow velocity at the piston.
    """

    bleed_linear: float  #: Laminar resistance R of the bleed [N.s/m].
    bleed_square: float  #: Turbulent resistance Q of the bleed [N.s2/m2].
    opening_force: float  #: Force F_open at which the stack opens [N].
    opening_width: float  #: Force range w over which the stack opens [N].
    open_damping: float  #: Slope c of the open stack [N.s/m].

    def flow(self, force: float) -> float:
        """Return the flow velocity [m/s] at a valve force of magnitude `force` [N]."""
        root = math.sqrt(self.bleed_linear**2 + 4.0 * self.bleed_square * force)
        bleed = 2.0 * force / (root + self.bleed_linear)
        rise = _softplus((force - self.opening_force) / self.opening_width)
        rest = _softplus(-self.opening_force / self.opening_width)
        return bleed + self.opening_width / self.open_damping * (rise - rest)


def _softplus(x: float) -> float:
    """Return ln(1 + exp(x)) without overflow."""
    return max(x, 0.0) + math.log1p(math.exp(-abs(x)))


@dataclass(frozen=True, slots=True)
class TruthDamper:
    """A gas-charged damper with a digressive valve behind a stiffening fluid spring (3.1.5).

        dF/dt = k0 (1 + |F| / F1) (v - g(F)),  port force = F + K x + F0 + F_seal tanh(v / v_seal)

    Here v is the velocity, x the displacement and g the flow velocity of the valve, which differs between the sides.
    """

    compression: ValveSide  #: Valve side for positive force.
    rebound: ValveSide  #: Valve side for negative force.
    fluid_stiffness: float  #: Fluid stiffness k0 at zero force [N/m].
    stiffening_force: float  #: Force F1 at which the fluid is twice as stiff [N].
    gas_stiffness: float = convert(4.0, "lbf/in", "N/m")  #: Gas stiffness K [N/m]; about 4 lbf/in at 150 psi (Eq 3.14).
    gas_preload: float = 46.0 * _POUND  #: Gas force F0 at zero displacement [N] (Eq 3.18); that of 150 psi.
    seal_drag: float = 4.0 * _POUND  #: Seal friction F_seal [N]; 3 to 5 lbf (3.4.3).
    seal_velocity: float = convert(0.2, "in/s", "m/s")  #: Transition velocity v_seal of the seal friction [m/s].

    def valve_velocity(self, force: float) -> float:
        """Return the flow velocity g [m/s] at a valve force [N], both signed."""
        if force >= 0.0:
            return self.compression.flow(force)
        return -self.rebound.flow(-force)

    def static_force(self, velocity: float) -> float:
        """Return the valve force [N] at a constant velocity [m/s], which is the inverse of g."""
        reach = 1000.0
        while (self.valve_velocity(math.copysign(reach, velocity)) - velocity) * velocity < 0.0:
            reach *= 2.0
        return float(brentq(lambda force: self.valve_velocity(force) - velocity, -reach, reach))

    def respond(self, motion: TimeSeries, *, rate: float) -> TimeSeries:
        """Integrate the damper for a displacement command.

        The command is interpolated by a cubic spline; the valve starts with its static force.

        Args:
            motion: Evenly sampled series with the channel `displacement` [m].
            rate: Sample rate of the result [Hz].

        Returns:
            Series with displacement [m], velocity [m/s] and the force of the port [N].

        Raises:
            ValueError: The command is not evenly sampled.
        """
        steps = np.diff(motion.time)
        if np.ptp(steps) > 1e-6 * steps[0]:
            raise ValueError("the displacement must be evenly sampled; resample it first")
        spline = CubicSpline(motion.time, motion["displacement"])
        speed = spline.derivative()
        start = float(motion.time[0])
        time = start + np.arange(int(motion.duration * rate * (1.0 + 1e-12)) + 1) / rate
        valve = self._integrate(_fast_quadratic(speed.c, start, float(steps.mean())), time)
        displacement, velocity = spline(time), speed(time)
        gas = self.gas_stiffness * displacement + self.gas_preload
        seal = self.seal_drag * np.tanh(velocity / self.seal_velocity)
        return TimeSeries.from_channels(
            time,
            {
                "displacement": ("m", displacement),
                "velocity": ("m/s", velocity),
                "force": ("N", valve + gas + seal),
            },
        )

    def _integrate(self, velocity: Callable[[float], float], time: Array) -> Array:
        """Return the valve force (N,) [N] at `time` (N,) [s] for a velocity [m/s] as a function of time."""

        def rate_of_force(t: float, state: Array) -> list[float]:
            force = float(state[0])
            stiffness = self.fluid_stiffness * (1.0 + abs(force) / self.stiffening_force)
            return [stiffness * (velocity(t) - self.valve_velocity(force))]

        solution = solve_ivp(
            rate_of_force,
            (float(time[0]), float(time[-1])),
            [self.static_force(velocity(float(time[0])))],
            method="LSODA",
            t_eval=time,
            rtol=1e-6,
            atol=1e-2,
            max_step=5e-3,
        )
        if not solution.success:
            raise RuntimeError(f"the integration of the demonstration damper failed: {solution.message}")
        return np.asarray(solution.y[0], dtype=np.float64)


def _fast_quadratic(coefficients: Array, start: float, step: float) -> Callable[[float], float]:
    """Return a piecewise quadratic (3, K) on an even grid as a function of one time, faster than scipy's."""
    pieces = [tuple(piece) for piece in coefficients.T.tolist()]
    last = len(pieces) - 1

    def value(t: float) -> float:
        place = min(max(int((t - start) / step), 0), last)
        a, b, c = pieces[place]
        s = t - start - place * step
        return float((a * s + b) * s + c)

    return value


def _side(bleed: float, square: float, opening: float, damping: float) -> ValveSide:
    """Return a valve side for values in lbf/(in/s), lbf/(in/s)^2, lbf and lbf/(in/s)."""
    c = _POUND_PER_INCH_PER_SECOND
    width = 0.15 * opening * _POUND
    return ValveSide(bleed * c, square * c / 0.0254, opening * _POUND, width, damping * c)


def demo_damper(build: str) -> TruthDamper:
    """Return the damper of a demonstration build.

    Args:
        build: Name of the build: `A` (baseline, about 20 lbf/(in/s) on average), `B` (stiffer, about 28, more damping
            in rebound) or `C` (softer, about 10, more damping in compression and nearly linear).

    Raises:
        ValueError: The build does not exist.
    """
    if build not in _BUILDS:
        raise ValueError(f"no demonstration build {build!r}; there are {', '.join(_BUILDS)}")
    compression, rebound, stiffness, stiffening = _BUILDS[build]
    return TruthDamper(
        compression=_side(*compression),
        rebound=_side(*rebound),
        fluid_stiffness=convert(stiffness, "lbf/in", "N/m"),
        stiffening_force=stiffening * _POUND,
    )


#: Compression and rebound (bleed lbf/(in/s) and lbf/(in/s)^2, opening lbf, open lbf/(in/s)), fluid stiffness
#: [lbf/in], stiffening force [lbf].
_BUILDS = {
    "A": ((26.0, 3.0, 110.0, 13.0), (33.0, 4.0, 160.0, 16.0), 22000.0, 1500.0),
    "B": ((32.0, 5.0, 130.0, 15.0), (44.0, 7.0, 260.0, 24.0), 30000.0, 2000.0),
    "C": ((14.0, 1.0, 90.0, 9.0), (9.0, 0.3, 70.0, 6.5), 11000.0, 1200.0),
}
