"""Laws of mechanics that relate the channels of a rig record, whatever the car, drive and setup."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm, t

from eightpost.array_types import Array
from eightpost.corners import CORNERS, channel
from eightpost.signals.timeseries import TimeSeries

# ==== Short-time spectra of a record, and linear laws with real coefficients estimated from them =====================

SEGMENT = 4.0  # length of a segment [s]; segments overlap by half
FEWEST, MOST = 6, 60  # segments: shorter records are not checked; in longer ones they are spread over the record
BAND = (0.7, 15.0)  # of all laws [Hz], ...
HIGHEST = 0.08  # ... at most this share of the sample rate: above, central differences are 4 % low
LEAK = 0.1  # share of what a law leaves unexplained that may depend on the inputs
BLOCKS = 16  # largest number of blocks that the jackknife leaves out in turn; a short record has one per segment
#: Directions of a shock's velocity, and of the difference of those left and right (with the left corner as prefix), on
#: which friction along the shock and in an anti-roll bar depend; velocity of the transition between them [RMS].
DIRECTION, TWIST, SLOW = "direction", "twist_direction", 0.1

AXLES = (CORNERS[:2], CORNERS[2:])  # left and right corner

Spectrum = NDArray[np.complex128]
Term = tuple[str, int]  # a channel and the order of its derivative


class Regression(NamedTuple):
    """Coefficients of a linear law."""

    values: Array  #: (P,)
    samples: Array  #: (B, P), without each of B blocks of the record
    biased: Array  #: (P, P), moved along each of P independent directions by what the law leaves unexplained
    explained: float  #: share of the weighted variance [1]

    def figure(self, of: Callable[[Array], Array]) -> tuple[float, float, float]:
        """Return a figure computed from coefficients (..., P), its jackknife standard deviation, and its bias.

        The bias is the standard deviation if what the law does not explain (friction, flexibility) is not noise but
        depends on the inputs, as if the record had only 1 / `LEAK`^2 independent samples.
        """
        value, numbers = float(of(np.atleast_2d(self.values))[0]), of(self.samples)
        share = (len(numbers) - 1) / len(numbers)
        deviation = float(np.sqrt(share * np.sum((numbers - numbers.mean()) ** 2)))
        return value, deviation, float(np.linalg.norm(of(self.biased) - value))


@dataclass(frozen=True, slots=True, eq=False)
class Spectra:
    """Spectra of the channels of a record; a search for faults corrects, exchanges and leaves out some of them."""

    frequencies: NDArray[np.float64]  #: (F,) [Hz]
    rows: Mapping[str, Spectrum]  #: (S, F) of S segments, by channel
    left_out: frozenset[str] = frozenset()

    def __contains__(self, name: str) -> bool:
        """Return whether a channel is known."""
        return name in self.rows

    def has(self, names: Iterable[str]) -> bool:
        """Return whether all channels are known."""
        return all(name in self.rows for name in names)

    def size(self, name: str) -> float:
        """Return the norm of a channel; 0 if it is not known."""
        return float(np.linalg.norm(self.rows[name])) if name in self.rows else 0.0

    def derivative(self, name: str, order: int = 0) -> Spectrum:
        """Return the spectra (S, F) of a channel's derivative of a given order."""
        return self.rows[name] if order == 0 else self.rows[name] * (2j * np.pi * self.frequencies) ** order

    def corrected(self, names: Iterable[str], *, gain: float = 1.0, delay: float = 0.0) -> Spectra:
        """Return the spectra with channels (and directions) divided by a gain and advanced by a delay [s]."""
        names = [one for name in names for one in (name, _direction(name)) if one in self.rows]
        turn = np.exp(2j * np.pi * self.frequencies * delay)
        factors = {name: turn * np.sign(gain) if name.endswith(DIRECTION) else turn / gain for name in names}
        return replace(self, rows={**self.rows, **{name: self.rows[name] * f for name, f in factors.items()}})

    def exchanged(self, one: str, two: str) -> Spectra:
        """Return the spectra with two channels exchanged; directions with velocities."""
        rows = {**self.rows, one: self.rows[two], two: self.rows[one]}
        if (first := _direction(one)) != one:
            rows |= {first: self.rows[_direction(two)], _direction(two): self.rows[first]}
        return replace(self, rows=rows)

    def without(self, names: Iterable[str]) -> Spectra:
        """Return the spectra without some channels."""
        left_out = {one for name in names for one in (name, _direction(name))} | self.left_out
        return replace(
            self, rows={n: row for n, row in self.rows.items() if n not in left_out}, left_out=frozenset(left_out)
        )

    def fit(self, output: Term, inputs: Sequence[Term], high: float | None = None) -> Regression | None:
        """Return the coefficients of a derivative of one channel on those of others up to a frequency [Hz].

        None if a channel is missing, the output is zero, or the inputs do not determine the coefficients.
        """
        if not self.has(name for name, _ in (output, *inputs)):
            return None
        return self.regress(self.derivative(*output), [self.derivative(*term) for term in inputs], high)

    def regress(self, output: Spectrum, inputs: Sequence[Spectrum], high: float | None = None) -> Regression | None:
        """Return the real c that minimise |w (y - sum_p c_p x_p)|^2, with 1 / w(f)^2 = S_y(f) + mean S_y.

        Frequencies at which y is weak get little weight, because noise dominates there.
        """
        used = slice(None) if high is None else self.frequencies <= high
        y = output[:, used]
        power = np.mean(np.abs(y) ** 2, axis=0)
        if not power.any():
            return None
        level = np.sqrt(power + power.mean())
        rows = np.stack([x[:, used] / level for x in inputs])
        scales = np.sqrt(np.mean(np.abs(rows) ** 2, axis=(1, 2)))
        if not scales.all():
            return None
        starts = np.linspace(0, len(y), min(BLOCKS, len(y)), endpoint=False).astype(int)
        x = (rows / scales[:, None, None]).transpose(1, 0, 2)
        target = (y / level)[:, :, None]
        grams = np.add.reduceat((x.conj() @ x.transpose(0, 2, 1)).real, starts)
        rights = np.add.reduceat((x.conj() @ target).real, starts)
        gram, right, energy = grams.sum(axis=0), rights.sum(axis=0), float(np.vdot(target, target).real)
        if np.linalg.cond(gram) > 1e10:
            return None
        values = np.linalg.solve(gram, right)[:, 0]
        try:
            samples = np.linalg.solve(gram - grams, right - rights)[:, :, 0]
        except np.linalg.LinAlgError:
            return None
        left = max(0.0, energy - float(values @ right[:, 0]))
        biased = values + LEAK * np.sqrt(left) * np.linalg.inv(np.linalg.cholesky(gram))
        return Regression(values / scales, samples / scales, biased / scales, 1.0 - left / energy)


def spectra_of(series: TimeSeries) -> Spectra | None:
    """Return the spectra of a record; None if it is too short."""
    rate = series.sample_rate
    size = round(SEGMENT * rate)
    starts = np.arange(0, len(series) - size + 1, max(1, size // 2))
    if starts.size < FEWEST:
        return None
    if starts.size > MOST:
        starts = starts[np.linspace(0, starts.size - 1, MOST).astype(int)]
    lines = np.fft.rfftfreq(size, 1.0 / rate)
    used = (lines >= BAND[0]) & (lines <= min(BAND[1], HIGHEST * rate))
    window = np.hanning(size)

    def segments(values: Array) -> Array:
        return np.stack([values[start : start + size] for start in starts])

    def transformed(cut: Array) -> Spectrum:
        return np.asarray(np.fft.rfft(window * cut, axis=1)[:, used])

    rows = {}
    for name in series.names:
        cut = segments(series[name])
        rows[name] = transformed(cut - cut.mean(axis=1, keepdims=True))
    velocities = [name for name in series.names if name.rpartition(".")[2] == "velocity"]
    own = {name.removesuffix("velocity"): series[name] for name in velocities}
    slopes = {f"{place}{DIRECTION}": velocity for place, velocity in own.items()}
    for left, right in AXLES:
        if f"{left}." in own and f"{right}." in own:
            slopes[channel(left, TWIST)] = own[f"{left}."] - own[f"{right}."]
    rows |= {name: transformed(np.tanh(segments(v) / (SLOW * v.std() or 1.0))) for name, v in slopes.items()}
    return Spectra(np.asarray(lines[used], dtype=np.float64), rows)


def _direction(name: str) -> str:
    return f"{name.removesuffix('velocity')}{DIRECTION}" if name.endswith("velocity") else name


# ==== The laws =======================================================================================================
# Each law yields comparisons: figures that are zero in a sound record of a usual car. A figure is the logarithm of a
# ratio or a time [s], computed from the coefficients c (..., P) of a regression.

SIGNIFICANT = 4.0  # standard deviations above which a comparison is violated
SMALLEST = 0.01  # ratio that is distinguished from zero or a wrong sign
TIME = 1.5e-3  # tolerance of the delay between a potentiometer and accelerometers [s]
HIGH = 8.0  # upper end of the band [Hz] in which the engine and chassis bending follow the corners of the chassis

TIRE, TRAVEL, SLOPE = "the law of the tire", "the kinematics of the shock", "the slope of the displacement"
HUB, CAR = "the balance of forces at the hub", "Newton's law of the car"
ROLL = "the roll of the chassis by left and right aeroloaders"
BODY, ACTUATOR = "the motion of the chassis", "the response of the actuator"

# ---- Comparisons ----------------------------------------------------------------------------------------------------


class Kind(StrEnum):
    """Kind of a comparison and of the fault that it shows: a ratio (its logarithm), or a time [s]."""

    GAIN = "gain"
    DELAY = "delay"


class Comparison(NamedTuple):
    """A figure that should be zero."""

    law: str
    kind: Kind
    value: float  #: figure minus its expectation
    tolerance: float  #: absolute value that a sound record and a usual car may reach
    deviation: float  #: standard deviation from the record's noise, with `few_blocks_factor`
    effect: Mapping[str, float]  #: change of the figure per logarithm of the gain, or per delay, of each channel
    alone: bool = False  #: whether it is relative to other corners, so that a fault of all corners does not show

    @property
    def scale(self) -> float:
        """Standard deviation to be expected, from usual cars and from noise."""
        return float(np.hypot(self.tolerance / SIGNIFICANT, self.deviation))

    @property
    def score(self) -> float:
        """Figure in standard deviations."""
        return self.value / self.scale

    @property
    def is_violated(self) -> bool:
        """Whether the figure contradicts the law."""
        return abs(self.score) > SIGNIFICANT

    def minus(self, others: Sequence[Comparison], tolerance: float) -> Comparison:
        """Return the comparison with the median of other corners, or with the first of them if that is closer."""
        effect, law = dict(self.effect), f"{self.law} at the other corners"
        if len(others) == 1:
            effect |= {name: -size for name, size in others[0].effect.items()}
            law = f"the symmetry of left and right in {self.law}"
        deviation = float(np.linalg.norm([one.deviation for one in (self, *others)]) / len(others) ** 0.5)
        references = others[0].value, float(np.median([one.value for one in others]))
        value = min((self.value - reference for reference in references), key=abs)
        return self._replace(law=law, value=value, tolerance=tolerance, deviation=deviation, effect=effect, alone=True)


@cache
def few_blocks_factor(blocks: int) -> float:
    """Return the factor by which a deviation from a few blocks must be larger to be exceeded as rarely as a known one.

    A figure over its jackknife deviation from B blocks has Student's distribution with B - 1 degrees of freedom:
    chance exceeds four standard deviations of 8 blocks 80 times as often as four known ones.
    """
    return float(t.isf(norm.sf(SIGNIFICANT), blocks - 1)) / SIGNIFICANT


def figure(fit: Regression, of: Callable[[Array], Array]) -> tuple[float, float]:
    """Return a figure of coefficients (..., P), and its standard deviation from noise and from what is unexplained."""
    value, deviation, bias = fit.figure(of)
    return value, float(np.hypot(few_blocks_factor(len(fit.samples)) * deviation, bias))


def _ratio(
    law: str, fit: Regression, effect: Mapping[str, float], tolerance: float,
    of: Callable[[Array], Array], expected: float = 1.0,
) -> Comparison:  # fmt: skip
    value, deviation = figure(fit, lambda c: of(c) / expected)
    gain = float(np.log(max(value, SMALLEST)))
    # The ratio, not its logarithm, has a known deviation from 1.
    slope = gain / (value - 1.0) if value != 1.0 else 1.0
    return Comparison(law, Kind.GAIN, gain, tolerance, slope * deviation, effect)


def _delay(
    law: str, fit: Regression, effect: Mapping[str, float], tolerance: float,
    of: Callable[[Array], Array], over: Sequence[int] = (), expected: float = 0.0,
) -> Comparison:  # fmt: skip
    """Return the comparison of a time; its deviation is infinite if a column by which `of` divides is insignificant."""
    value, deviation = figure(fit, lambda c: of(c) - expected)
    known = all(abs(fit.values[k]) > SIGNIFICANT * figure(fit, lambda c, k=k: c[:, k])[1] for k in over)  # type: ignore[misc]
    return Comparison(law, Kind.DELAY, value, tolerance, deviation if known else np.inf, effect)


def comparisons(spectra: Spectra, corners: Sequence[str], mass: float | None = None) -> Iterator[Comparison]:
    """Yield the comparisons of all laws whose channels are known; the mass of the car [kg] may be unknown."""
    yield from _tires(spectra, corners)
    yield from _travels(spectra, corners)
    yield from _slopes(spectra, corners)
    yield from _hubs(spectra, corners)
    yield from _whole_car(spectra, corners, mass)
    yield from _loads(spectra, corners)
    yield from _points_of_chassis(spectra, corners)
    yield from _actuators(spectra, corners)


def across(corner: str) -> str | None:
    """Return the other corner of the same axle; None for a quarter car."""
    return next((pair[1 - pair.index(corner)] for pair in AXLES if corner in pair), None)


def _at(corner: str, *quantities: str) -> list[str]:
    return [channel(corner, quantity) for quantity in quantities]


def _sides(found: Mapping[str, Comparison], tolerance: float) -> Iterator[Comparison]:
    """Yield the comparisons of left with right corners."""
    for left, right in AXLES:
        if {left, right} <= set(found):
            yield found[left].minus([found[right]], tolerance)


def _siblings(
    found: Sequence[Comparison], tolerance: float, sizes: Sequence[float] = (1.0,) * 4
) -> Iterator[Comparison]:
    """Yield the comparisons of each of four corners with the others; the axles may differ, so first across the axle.

    A negative figure has the tolerance of a corner with the median of the forces `sizes`: friction that sticks is a
    force, and so looks like a longer lead of a smaller one.
    """
    for k, one in enumerate(found if len(found) == 4 else ()):
        others = [found[k ^ 1], *(found[j] for j in range(4) if j not in (k, k ^ 1))]
        apart = one.minus(others, tolerance)
        lead = max(1.0, float(np.median(sizes)) / sizes[k]) if apart.value < 0.0 else 1.0
        yield apart._replace(tolerance=lead * tolerance)


# ---- One corner -----------------------------------------------------------------------------------------------------


def tire_fit(spectra: Spectra, corner: str) -> Regression | None:
    """Return the coefficients (k, c, m, -k, -c) of T'' = k r'' + c r''' + m r'''' - k w'' - c w'''.

    T is the tire force, r the road, w'' the hub's acceleration, k the stiffness, c the damping, and m the mass of the
    wheelloader's pan above its load cell.
    """
    force, road, hub = _at(corner, "tire_force", "road", "hub_acceleration")
    return spectra.fit((force, 2), [(road, 2), (road, 3), (road, 4), (hub, 0), (hub, 1)])


def _tires(spectra: Spectra, corners: Sequence[str]) -> Iterator[Comparison]:
    stiffness, times, ratios, delays = {}, {}, [], []
    for corner in corners:
        if (fit := tire_fit(spectra, corner)) is None:
            continue
        force, road, hub = _at(corner, "tire_force", "road", "hub_acceleration")
        ratios.append(_ratio(TIRE, fit, {road: -1.0, hub: 1.0}, 0.08, lambda c: -c[:, 0] / c[:, 3]))
        # Usual tires have 120 to 1000 N/mm, and 1.25 ms of damping over stiffness from hysteresis and damping together.
        stiffness[corner] = _ratio(TIRE, fit, {force: 1.0, hub: -1.0}, float(np.log(3.0)), lambda c: -c[:, 3], 350e3)
        delays.append(
            _delay(
                TIRE, fit, {road: 1.0, hub: -1.0}, 1.5e-3, lambda c: c[:, 1] / c[:, 0] - c[:, 4] / c[:, 3], over=(0, 3)
            )
        )
        times[corner] = _delay(
            TIRE, fit, {force: -1.0, hub: 1.0}, 2.5e-3, lambda c: c[:, 4] / c[:, 3], over=(3,), expected=1.25e-3
        )
    yield from (*ratios, *delays, *stiffness.values(), *times.values())
    yield from (*_sides(stiffness, 0.08), *_sides(times, 1e-3), *_siblings(delays, 1e-3), *_siblings(ratios, 0.06))


def _travel_fit(spectra: Spectra, corner: str) -> Regression | None:
    """Return the coefficients of x'' = n (w'' + t w''') - n (z'' + t z''') + the same across the axle.

    x is the travel of the shock, w'' and z'' the accelerations of hub and chassis, n the motion ratio, and t a delay.
    The coefficients are (n, n t, -n, -n t), then those of the other side, to which a solid axle connects the shock.
    """
    pot, *names = _at(corner, "displacement", "hub_acceleration", "chassis_acceleration")
    if (other := across(corner)) is not None:
        far = _at(other, "hub_acceleration", "chassis_acceleration")
        names += far if spectra.has(far) else []
    return spectra.fit((pot, 2), [(name, order) for name in names for order in (0, 1)])


def _travels(spectra: Spectra, corners: Sequence[str]) -> Iterator[Comparison]:
    """Yield the comparisons of potentiometers with accelerometers.

    Accelerometers of the chassis that are inboard of the wheels move less in roll, and so at all corners count for
    less; rubber at the ends of a shock lets its potentiometer lead or lag by milliseconds.
    """
    motions, ratios = {}, []
    hubs, bodies = list[Comparison](), list[Comparison]()
    for corner in corners:
        if (fit := _travel_fit(spectra, corner)) is None:
            continue
        pot, hub, chassis = _at(corner, "displacement", "hub_acceleration", "chassis_acceleration")
        ratios.append(_ratio(TRAVEL, fit, {hub: -1.0, chassis: 1.0}, 0.25, lambda c: -c[:, 0] / c[:, 2]))
        # Usual motion ratios (travel of the shock over that of the wheel) are 0.28 to 1.6.
        motions[corner] = _ratio(TRAVEL, fit, {pot: 1.0, hub: -1.0}, float(np.log(2.4)), lambda c: c[:, 0], 0.67)
        for found, k, name in ((hubs, 0, hub), (bodies, 2, chassis)):
            effect = {pot: -1.0, name: 1.0}
            found.append(_delay(TRAVEL, fit, effect, 8e-3, lambda c, k=k: c[:, k + 1] / c[:, k], over=(k,)))  # type: ignore[misc]
    yield from (*motions.values(), *ratios, *hubs, *bodies, *_sides(motions, 0.05), *_siblings(ratios, 0.06))
    yield from (*_siblings(hubs, 2.3e-3), *_siblings(bodies, 2.3e-3))


def _slopes(spectra: Spectra, corners: Sequence[str]) -> Iterator[Comparison]:
    """Yield the comparisons of each velocity with the slope of the displacement: v = g (x' + t x'')."""
    for corner in corners:
        velocity, pot = _at(corner, "velocity", "displacement")
        if (fit := spectra.fit((velocity, 0), [(pot, 1), (pot, 2)])) is not None:
            yield _ratio(SLOPE, fit, {velocity: 1.0, pot: -1.0}, 0.06, lambda c: c[:, 0])
            yield _delay(SLOPE, fit, {velocity: -1.0, pot: 1.0}, 1.5e-3, lambda c: c[:, 1] / c[:, 0], over=(0,))


def _hub_fit(spectra: Spectra, corner: str) -> Regression | None:
    """Return the coefficients of the tire force.

        T = n (F + t F') + n_o (F_o + t F_o') + m w'' + m_o w_o'' + k x + k_o x_o + f sign(v) + f_b sign(v_l - v_r)

    T is the tire force, F the shock force, w'' the hub's acceleration, x the travel and v the velocity of the shock;
    `o` is the other side of the axle. By virtual work, n is the motion ratio. f is friction along the shock, f_b
    that in the anti-roll bar; without f_b, a soft shock's n would be up to 0.3 too large.
    """
    tire, force, *rest = _at(corner, "tire_force", "force", "hub_acceleration", "displacement", DIRECTION)
    inputs = [(force, 0), (force, 1), *((name, 0) for name in rest)]
    if (other := across(corner)) is not None:
        force, *rest = _at(other, "force", "hub_acceleration", "displacement")
        rest += [channel(axle[0], TWIST) for axle in AXLES if corner in axle]
        inputs += [term for term in [(force, 0), (force, 1), *((name, 0) for name in rest)] if term[0] in spectra]
    return spectra.fit((tire, 0), inputs)


def _hubs(spectra: Spectra, corners: Sequence[str]) -> Iterator[Comparison]:
    """Yield the comparisons of each shock's force with the tire force, and of motion ratios from forces and motions.

    Friction elsewhere than along the shock adds up to 0.11 of a motion ratio; friction that sticks looks like a lead
    of a shock force of up to 1 ms, of 2 ms if the shock is half as stiff as the others.
    """
    works, delays, sizes = {}, [], []
    for corner in corners:
        if (balance := _hub_fit(spectra, corner)) is None:
            continue
        force, tire, pot, hub = _at(corner, "force", "tire_force", "displacement", "hub_acceleration")
        if (travel := _travel_fit(spectra, corner)) is not None:
            effect = {force: -1.0, tire: 1.0, pot: -1.0, hub: 1.0}
            of_forces, of_motions = (_ratio(HUB, fit, effect, 0.25, lambda c: c[:, 0]) for fit in (balance, travel))
            works[corner] = of_forces._replace(
                value=of_forces.value - of_motions.value,
                deviation=float(np.hypot(of_forces.deviation, of_motions.deviation)),
            )
        effect = {force: 1.0, tire: -1.0}
        sizes.append(max(abs(balance.values[0]), SMALLEST) * spectra.size(force))
        delays.append(_delay(HUB, balance, effect, 3.5e-3, lambda c: c[:, 1] / c[:, 0], over=(0,), expected=-0.5e-3))
    yield from (*works.values(), *delays, *_siblings(list(works.values()), 0.08), *_siblings(delays, 1.2e-3, sizes))


# ---- The whole car --------------------------------------------------------------------------------------------------


def _car_law(spectra: Spectra, corners: Sequence[str]) -> tuple[Regression, dict[str, int], list[int]] | None:
    """Return the coefficients of the sum of the tire forces, the first of two columns of each load, and of the masses.

        sum T + sum_axles d (T_l - T_r) = sum_j a_j (A_j + t_j A_j') + sum_axles m(s) (z_l'' + z_r'') + ...

    T are the tire forces, A_j the aeroloader forces, d is 0 and a_j is 1. The masses are unknown. The inertia of the
    chassis at an axle is m + c s + e s^2, because the engine on its mounts and a chassis that bends do not follow the
    corners exactly.
    """
    tires, hubs, bodies = (_of_all(corners, n) for n in ("tire_force", "hub_acceleration", "chassis_acceleration"))
    known = [*_of_all(corners, "aero"), "aero_force", "heave_force"]
    unknown = any(n in spectra.left_out or (f"{n}_command" in spectra and n not in spectra) for n in known)
    if not spectra.has((*tires, *hubs, *bodies)) or unknown:
        return None
    d, axles, rows = spectra.derivative, AXLES if len(corners) > 1 else (), []

    def sum_of(places: Sequence[str], quantity: str, order: int = 0) -> Spectrum:
        return np.asarray(np.sum([d(name, order) for name in _of_all(places, quantity)], axis=0))

    for left, right in axles:
        rows += [d(channel(left, "tire_force"), order) - d(channel(right, "tire_force"), order) for order in (0, 1)]
    loads = {name: len(rows) + 2 * k for k, name in enumerate(name for name in known if name in spectra)}
    rows += [d(load, order) for load in loads for order in (0, 1)]
    first = len(rows)
    for place in axles or (tuple(corners),):
        rows += [sum_of(place, "hub_acceleration"), *(sum_of(place, "chassis_acceleration", k) for k in range(3))]
    fit = spectra.regress(sum_of(corners, "tire_force"), rows, HIGH)
    if fit is None:
        return None
    return fit, loads, [k for start in range(first, len(rows), 4) for k in (start, start + 1)]


def _whole_car(spectra: Spectra, corners: Sequence[str], mass: float | None) -> Iterator[Comparison]:
    """Yield the comparisons of forces with each other and with accelerations."""
    if (law := _car_law(spectra, corners)) is None:
        return
    (fit, loads, masses), tires = law, _of_all(corners, "tire_force")
    for k, (left, right) in enumerate(AXLES if len(corners) > 1 else ()):
        # The total is sum T = -d (T_l - T_r) + ..., so the left force counts 1 + d and the right one 1 - d.
        effect = {channel(left, "tire_force"): 1.0, channel(right, "tire_force"): -1.0}
        yield _ratio(CAR, fit, effect, 0.05,
                     lambda c, k=2 * k: (1.0 + c[:, k]) / np.maximum(1.0 - c[:, k], 1e-3))  # type: ignore[misc]  # fmt: skip
        yield _delay(CAR, fit, effect, 1e-3, lambda c, k=2 * k + 1: -2.0 * c[:, k])  # type: ignore[misc]
    share = {name: 1.0 / len(tires) for name in tires}
    for load, k in loads.items():
        sign = -1.0 if load == "heave_force" else 1.0
        yield _ratio(CAR, fit, {load: -1.0, **share}, 0.06, lambda c, k=k, s=sign: s * c[:, k])  # type: ignore[misc]
        yield _delay(CAR, fit, {load: 1.0, **_negative(share)}, 3e-3, lambda c, k=k: c[:, k + 1] / c[:, k], over=(k,))  # type: ignore[misc]
    sides = 2.0 if len(tires) > 1 else 1.0
    felt = [*_of_all(corners, "hub_acceleration"), *_of_all(corners, "chassis_acceleration")]
    # Usual cars have 300 to 3600 kg.
    name = f"{CAR} of {mass:.4g} kg" if mass else "the usual mass of a car"
    yield _ratio(name, fit, share | {n: -1.0 / len(felt) for n in felt}, 0.1 if mass else float(np.log(3.5)),
                 lambda c: sides * c[:, masses].sum(axis=1), mass or 1040.0)  # fmt: skip


def _of_all(corners: Sequence[str], quantity: str) -> list[str]:
    return [channel(corner, quantity) for corner in corners]


def _negative(effect: Mapping[str, float]) -> dict[str, float]:
    return {name: -size for name, size in effect.items()}


LEFT, FRONT = np.array([1.0, -1.0, 1.0, -1.0]), np.array([1.0, 1.0, -1.0, -1.0])  # signs of the corners


def load_fit(spectra: Spectra, corners: Sequence[str], signs: Array) -> Regression | None:
    """Return the coefficients of the roll or pitch acceleration of the chassis on the four aeroloader forces, ...

    their derivatives, tire forces and hub accelerations: it is a sum over forces, with unknown factors.
    """
    names = [(q, order) for q, order in (("aero", 0), ("aero", 1), ("tire_force", 0), ("hub_acceleration", 0))]
    terms = [(channel(corner, quantity), order) for quantity, order in names for corner in corners]
    bodies = _of_all(corners, "chassis_acceleration")
    if len(corners) != len(signs) or not spectra.has((*bodies, *(name for name, _ in terms))):
        return None
    motion = np.asarray(sum(sign * spectra.derivative(name) for sign, name in zip(signs, bodies, strict=True)))
    return spectra.regress(motion, [spectra.derivative(*term) for term in terms], HIGH)


def _loads(spectra: Spectra, corners: Sequence[str]) -> Iterator[Comparison]:
    """Yield the comparisons of the moments by which left and right aeroloaders roll the chassis."""
    if (fit := load_fit(spectra, corners, LEFT)) is None:
        return
    for k in (0, 2):
        effect = {channel(corners[k], "aero"): -1.0, channel(corners[k + 1], "aero"): 1.0}
        yield _ratio(ROLL, fit, effect, 0.1, lambda c, k=k: -c[:, k] / c[:, k + 1])  # type: ignore[misc]
        yield _delay(ROLL, fit, _negative(effect), 2e-3,
                     lambda c, k=k: c[:, k + 4] / c[:, k] - c[:, k + 5] / c[:, k + 1], over=(k, k + 1))  # type: ignore[misc]  # fmt: skip


def _points_of_chassis(spectra: Spectra, corners: Sequence[str]) -> Iterator[Comparison]:
    """Yield the comparisons of points on the chassis with its corners.

        y = sum_i a_i z_i'' - sum_i b_i r_i'' - t y'

    y is the acceleration of the point, or of its height above the roads r_i. If the whole chassis moves up by 1, so
    does the point: sum a_i = 1, and for a height above the road sum b_i = 1. t is the delay of y.
    """
    bodies, roads = _of_all(corners, "chassis_acceleration"), _of_all(corners, "road")
    heights = ["ride_height", "front.ride_height", "rear.ride_height"]
    points = dict.fromkeys([*_of_all(corners, "aero_position"), "aero.heave", *heights], 2)
    points |= {"cg.vertical_acceleration": 0, "driver.acceleration": 0}
    less = {body: -1.0 / len(bodies) for body in bodies}
    for name, order in points.items():
        inputs = [(body, 0) for body in bodies] + [(road, 2) for road in roads if name in heights]
        fit = spectra.fit((name, order), [*inputs, (name, order + 1)], HIGH)
        if fit is not None:
            yield _ratio(BODY, fit, {name: 1.0, **less}, 0.08, lambda c: c[:, : len(bodies)].sum(axis=1))
            yield _delay(BODY, fit, {name: 1.0, **less}, 1.5e-3, lambda c: -c[:, -1])


def _actuators(spectra: Spectra, corners: Sequence[str]) -> Iterator[Comparison]:
    """Yield the comparisons of actuators with their commands: y = g (u + a u' + b u''); a is minus the delay.

    Every actuator has a lag of its own, but actuators of one kind have the same: with three or more, the delay of each
    is compared with the median of the others.
    """
    for quantity in ("road", "aero"):
        delays = []
        for name in _of_all(corners, quantity):
            fit = spectra.fit((name, 0), [(f"{name}_command", order) for order in range(3)], HIGH)
            if fit is not None:
                effect = {name: 1.0, f"{name}_command": -1.0}
                yield _ratio(ACTUATOR, fit, effect, 0.15, lambda c: c[:, 0])
                delays.append(_delay(ACTUATOR, fit, effect, 2e-3, lambda c: -c[:, 1] / c[:, 0], over=(0,)))
        yield from _siblings(delays, 2e-3)
