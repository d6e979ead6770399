"""The loop of force over velocity of a record: its branches and lag, curve and knee."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from eightpost.array_types import Array
from eightpost.ident.dyno_report.cycles import STROKES, Cycles, Found, Stroke, Unknown, of_known
from eightpost.rig.motion import SMALLEST, path_of, turning_points
from eightpost.rig.peak_velocity import PeakVelocityTable
from eightpost.shock import ShockLaw
from eightpost.shock.law import valve_force
from eightpost.signals import TimeSeries
from eightpost.signals.filters import derivative, lowpass
from eightpost.units import convert

# ---- Branches and lag -----------------------------------------------------------------------------------------------

CLASSES, GROWTH = 40, 1.5  #: Number of classes of speed in each stroke, and their growth with speed.
#: Smallest and largest minimum number of samples of a branch in a class; in between it grows with the record.
FEWEST_SAMPLES = (3, 12)
NEAR_ZERO = 0.1  #: The force at zero velocity is extrapolated from the speeds below this share of the highest one.
#: Cut-off frequency of the acceleration that distinguishes the branches, over the usual frequency of the motion.
HARMONICS = 6.0
#: Lags of the search [s]: from that of a late velocity to a share of a period, which is within these limits.
EARLIEST, LONGEST, SHARE = -0.01, (0.03, 0.05), 0.2
STEP = 0.002  #: Step of the search [s].
#: Forms of a lag, and how much less open the loop must be in squares to prefer another form than the first.
FORMS, CLEARLY = ("delay", "first order", "series"), 0.6
FORCE_CUTOFF = 200.0  #: Cut-off frequency of the rate of force in the equation of a first-order lag [Hz].
LAW_POINTS = 120  #: Number of speeds of a law's curve in each stroke.
#: Minimum number of points of a stroke for two lines, and minimum number of points on either side of the knee.
FEWEST_POINTS, BESIDE_KNEE = 6, 3
LAST = 0.85  #: A knee is below this share of the highest speed, because the branches of a loop meet at its end.
BEND = 0.2  #: Minimum change of slope at a knee, as a share of the steeper slope.
BETTER = 0.5  #: Maximum sum of squares about two lines, as a share of that about one line.
_ROUNDING = 1e-9  #: Largest force at which a sum of squares is rounding, as a share of the force's range.


@dataclass(frozen=True, slots=True, eq=False)
class LoopClasses:
    """Classes of velocity of a record that have samples on both branches."""

    #: Number of the class and branch of each sample (N,): class times 2, plus 1 while the velocity rises.
    cell: NDArray[np.intp]
    counts: NDArray[np.intp]  #: Number of samples of each class and branch (4 CLASSES,).
    kept: NDArray[np.bool_]  #: Whether each class (2 CLASSES,) has enough samples on both branches.

    @classmethod
    def of(cls, velocity: Array, rises: NDArray[np.bool_]) -> LoopClasses:
        """Return the classes of velocities (N,) [m/s], and whether they rise (N,).

        No class contains zero velocity, and those near it are narrow, as far as both branches have samples there.
        """
        low, high = min(float(velocity.min()), 0.0), max(float(velocity.max()), 0.0)
        share = np.linspace(0.0, 1.0, CLASSES + 1) ** GROWTH
        edges = np.concatenate([low * share[::-1], high * share[1:]])
        number = np.clip(np.searchsorted(edges, velocity, "left") - 1, 0, 2 * CLASSES - 1)
        counts = np.bincount(2 * number + rises, minlength=4 * CLASSES).reshape(-1, 2)
        fewest = int(np.clip(velocity.size // (6 * CLASSES), *FEWEST_SAMPLES))
        below, above = _merged(counts[CLASSES - 1 :: -1], fewest)[::-1], _merged(counts[CLASSES:], fewest)
        merged = np.concatenate([CLASSES - 1 - below, CLASSES + above])
        cell = 2 * merged[number] + rises
        counts = np.bincount(cell, minlength=4 * CLASSES)
        return cls(cell, counts, np.asarray((counts.reshape(-1, 2) >= fewest).all(axis=1)))

    def means(self, row: Array) -> Array:
        """Return the means (2, K) of a channel (N,) on the falling and the rising branch of the kept classes."""
        sums = np.bincount(self.cell, weights=row, minlength=self.counts.size)
        return np.asarray((sums / np.maximum(self.counts, 1)).reshape(-1, 2)[self.kept].T)

    def about_means(self, row: Array) -> Array:
        """Return a channel (M,) in the kept classes without its mean in each class."""
        number = self.cell // 2
        sums = np.bincount(number, weights=row, minlength=self.kept.size)
        means = sums / np.maximum(self.counts.reshape(-1, 2).sum(axis=1), 1)
        return np.asarray((row - means[number])[self.kept[number]])


def _merged(counts: NDArray[np.intp], fewest: int) -> NDArray[np.intp]:
    """Return the number of the merged class of each class (C,), so that its counts (C, 2) are not too small."""
    numbers, number, found = [], 0, np.zeros(2, dtype=np.intp)
    for own in counts:
        numbers.append(number)
        found = found + own
        if found.min() >= fewest:
            number, found = number + 1, np.zeros(2, dtype=np.intp)
    return np.minimum(numbers, max(number - 1, 0))


def _usual_frequency(series: TimeSeries) -> float:
    path = path_of(series)
    turns = turning_points(path, threshold=SMALLEST * float(np.ptp(path)))
    return series.sample_rate / (2.0 * float(np.median(np.diff(turns)))) if len(turns) > 1 else series.sample_rate


def _acceleration(series: TimeSeries) -> Array:
    """Return the acceleration (N,) [m/s2], low-passed so that noise does not change its sign."""
    rate = series.sample_rate
    cutoff = min(HARMONICS * _usual_frequency(series), 50.0, 0.2 * rate)
    return derivative(lowpass(series["velocity"], rate, cutoff, order=4), rate)


def _classes_of(series: TimeSeries) -> LoopClasses:
    return LoopClasses.of(series["velocity"], _acceleration(series) > 0.0)


def closed_loop(series: TimeSeries) -> TimeSeries:
    """Return a record without the lag and the gas spring with which the branches of its loop agree best.

    With a spring in series, velocity and displacement are those of the valves behind it.

    Three forms of the lag d are tried, with the static force f and a gas spring k about the middle of the stroke:

        a delay:              F(t + d) = f(v) + k (x - middle)
        first order:          F + d dF/dt = f(v) + k (x - middle)
        a spring in series:   F = f(v - dF/dt / K) + k (x - middle),  with K such that the mean lag is d

    The stiffness k, 0 or more, is that of force over displacement within the classes of velocity.
    """
    time, rate, velocity, force = series.time, series.sample_rate, series["velocity"], series["force"]
    path = path_of(series)
    path = path - 0.5 * float(path.max() + path.min())
    acceleration = _acceleration(series)
    rises = acceleration > 0.0
    classes = LoopClasses.of(velocity, rises)
    if not classes.kept.any():
        return series
    smooth = lowpass(force, rate, min(FORCE_CUTOFF, 0.2 * rate), order=2)
    change = derivative(smooth, rate)
    # Velocity of a series spring per force and lag, such that it delays the force by the lag on average
    compliance = float(np.sum(acceleration**2)) / max(float(np.sum(change * acceleration)), 1e-12)

    def shifted(form: str, lag: float) -> tuple[Array, Array, Array]:
        """Return velocity, force and displacement (N,) without a lag."""
        if form == "delay":
            return velocity, np.interp(time + lag, time, force), np.interp(time + lag, time, path)
        if form == "first order":
            return velocity, force + lag * change, path + lag * derivative(path, rate)
        return velocity - lag * compliance * change, force, path

    def opened(form: str, lag: float) -> tuple[float, float]:
        """Return how far the loop is open, and the stiffness."""
        speeds, forces, places = shifted(form, lag)
        inside = LoopClasses.of(speeds, rises) if form == "series" else classes
        if not inside.kept.any():
            return np.inf, 0.0
        about = inside.about_means(places)
        stiffness = max(float(np.sum(about * inside.about_means(forces)) / np.sum(about**2)), 0.0)
        difference = np.diff(inside.means(forces - stiffness * places), axis=0)[0]
        weights = 1.0 / np.sum(1.0 / inside.counts.reshape(-1, 2)[inside.kept], axis=1)
        return float(np.sum(weights * difference**2) / np.sum(weights)), stiffness

    longest = float(np.clip(SHARE / _usual_frequency(series), *LONGEST))
    grids = {form: np.arange(EARLIEST if form == "delay" else 0.0, longest, STEP) for form in FORMS}
    tried = {form: _least(lambda lag, form=form: opened(form, lag)[0], grid, 1e-6) for form, grid in grids.items()}  # type: ignore[misc]
    form = min(tried, key=lambda name: tried[name][1])
    if tried[form][1] > CLEARLY * tried["delay"][1]:
        form = "delay"
    lag = tried[form][0]
    stiffness = opened(form, lag)[1]
    speeds, forces, places = shifted(form, lag)
    inside = (time + lag >= time[0]) & (time + lag <= time[-1]) if form == "delay" else np.ones(time.size, dtype=bool)
    closed = series.select([name for name in series.names if name not in ("force", "velocity")])
    closed = closed.with_channel("velocity", "m/s", speeds).with_channel("force", "N", forces - stiffness * places)
    if form == "series" and "displacement" in series:
        closed = closed.with_channel("displacement", "m", series["displacement"] - lag * compliance * smooth)
    return closed.at(inside)


def _least(function: Callable[[float], float], grid: Array, resolution: float) -> tuple[float, float]:
    """Return where a function is least, from the best point of a grid (G,), and its value there."""
    values = np.array([function(float(at)) for at in grid])
    best = int(np.argmin(values))
    ends = (float(grid[max(best - 1, 0)]), float(grid[min(best + 1, grid.size - 1)]))
    found = minimize_scalar(function, bounds=ends, method="bounded", options={"xatol": resolution})
    return (float(found.x), float(found.fun)) if found.fun < values[best] else (float(grid[best]), float(values[best]))


@dataclass(frozen=True, slots=True, eq=False)
class Branches:
    """Both branches of a measured loop (CVP), with its lag and spring."""

    #: Velocities (K,) [m/s], and forces (K,) [N] while the speed rises (open) and falls (closed).
    velocity: Array
    opening: Array
    closing: Array

    def force_at(self, speed: float, stroke: Stroke, branch: str) -> Found:
        """Return the force magnitude [N] of the branch `open` or `closed` at a speed [m/s]."""
        return VelocityCurve(self.velocity, self.opening if branch == "open" else self.closing).force_at(speed, stroke)


def branches_of(series: TimeSeries, level: float) -> Branches | None:
    """Return the branches of a record, without a constant force [N]; None if it has too few samples."""
    classes = _classes_of(series)
    if not classes.kept.any():
        return None
    velocity = classes.means(series["velocity"]).mean(axis=0)
    falling, rising = classes.means(series["force"] - level)
    return Branches(velocity, np.where(velocity > 0.0, rising, falling), np.where(velocity > 0.0, falling, rising))


# ---- Curves ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class VelocityCurve:
    """Mean force over velocity, without the force at zero velocity."""

    #: Velocities (K,) [m/s], increasing, positive in compression, and forces (K,) [N] at these velocities.
    velocity: Array
    force: Array

    def stroke(self, stroke: Stroke) -> tuple[Array, Array]:
        """Return increasing speeds (J,) [m/s] and force magnitudes (J,) [N] of a stroke."""
        if stroke == "compression":
            return self.velocity[self.velocity > 0.0], self.force[self.velocity > 0.0]
        below = self.velocity < 0.0
        return -self.velocity[below][::-1], -self.force[below][::-1]

    def highest(self, stroke: Stroke) -> float:
        """Return the highest speed of a stroke [m/s]; 0 for an empty one."""
        speed, _ = self.stroke(stroke)
        return float(speed[-1]) if speed.size else 0.0

    def force_at(self, speed: float, stroke: Stroke) -> Found:
        """Return the force magnitude [N] at a speed [m/s], linear between points and not extrapolated."""
        speeds, forces = self.stroke(stroke)
        if not speeds.size:
            return Unknown(f"there are no points in {stroke}")
        if not speeds[0] <= speed <= speeds[-1]:
            ends = [f"{convert(end, 'm/s', 'in/s'):.3g} in/s ({end:.3g} m/s)" for end in (speeds[0], speeds[-1])]
            return Unknown(f"the points in {stroke} are from {ends[0]} to {ends[1]}")
        return float(np.interp(speed, speeds, forces))


def force_at_zero(curve: VelocityCurve | Unknown) -> Found:
    """Return the force at zero velocity [N] of a curve: the mean of both strokes, in which friction cancels."""
    if isinstance(curve, Unknown):
        return curve
    found = []
    for stroke, sign in zip(STROKES, (1.0, -1.0), strict=True):
        speeds, forces = curve.stroke(stroke)
        count = max(int(np.searchsorted(speeds, NEAR_ZERO * speeds[-1])), FEWEST_POINTS // 2) if speeds.size else 0
        if speeds.size < FEWEST_POINTS // 2:
            return Unknown(f"there are too few points in {stroke}")
        bent = np.polynomial.Polynomial.fit(speeds[:count], forces[:count], 2 if count >= FEWEST_POINTS else 1)
        found.append(sign * float(bent(0.0)))
    return 0.5 * sum(found)


def ratio_at(curve: VelocityCurve | Unknown, speed: float) -> Found:
    """Return the force in rebound over the force in compression [1] at a speed [m/s]."""

    def ratio(compression: float, rebound: float) -> Found:
        if compression <= 0.0 or rebound <= 0.0:
            return Unknown("a force at this speed acts in the direction of the motion")
        return rebound / compression

    return of_known(ratio, *(forces_at(curve, speed, stroke) for stroke in STROKES))


def forces_at(curve: VelocityCurve | Unknown, speed: float, stroke: Stroke) -> Found:
    """Return the force magnitude [N] at a speed [m/s] of a curve that may be unknown."""
    return curve if isinstance(curve, Unknown) else curve.force_at(speed, stroke)


def curve_of_series(series: TimeSeries, cycles: Cycles, level: float = 0.0) -> VelocityCurve | Unknown:
    """Return the mean curve of a record: in classes of velocity, both branches of the loop count equally.

    The ends of the curve of a steady run are the means of its peaks.

    Args:
        series: Record of a closed loop.
        cycles: Cycles of the record.
        level: Force [N] that is subtracted.
    """
    classes = _classes_of(series)
    speeds, forces = (classes.means(row).mean(axis=0) for row in (series["velocity"], series["force"] - level))
    points = list(zip(speeds.tolist(), forces.tolist(), strict=True))
    for sign in (-1.0, 1.0) if cycles.is_steady else ():
        for peak in cycles.peaks(sign)[:1]:
            points = [point for point in points if sign * point[0] < peak.speed]
            points.append((sign * peak.speed, sign * peak.force - level))
    if len(points) < FEWEST_POINTS:
        return Unknown("too few samples are on both branches of a loop of force over velocity")
    found = np.array(sorted(points))
    return VelocityCurve(found[:, 0], found[:, 1])


def curve_of_table(table: PeakVelocityTable) -> VelocityCurve:
    """Return the points of a peak-velocity table; its gas force is already subtracted."""
    return VelocityCurve(
        np.concatenate([-table.speed[::-1], table.speed]), np.concatenate([table.rebound[::-1], table.compression])
    )


def curve_of_law(law: ShockLaw) -> VelocityCurve:
    """Return a law's static force with its seal friction over the fitted velocities, at the damper, without gas."""
    share = np.arange(1, LAW_POINTS + 1) / LAW_POINTS
    velocity = np.concatenate([-law.curve.rebound_speed * share[::-1], law.curve.compression_speed * share])
    force = [valve_force(law.valve, v) + law.port.seal_force(v) for v in velocity.tolist()]
    return VelocityCurve(velocity, np.array(force))


# ---- The knee -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class StrokeFigures:
    """Knee and slopes of a stroke: two lines that meet at the knee, by least squares over the points of the curve."""

    #: Speed [m/s] at which the lines meet, and force [N] there.
    knee: Found
    knee_force: Found
    #: Slopes below and above the knee [N.s/m]; equal if the stroke is one line.
    low: Found
    high: Found
    highest: float  #: Highest speed of the curve [m/s].


def stroke_figures(curve: VelocityCurve | Unknown, stroke: Stroke) -> StrokeFigures:
    """Return knee and slopes of a stroke; there is no knee if the slopes differ by less than 20 %."""
    if isinstance(curve, Unknown):
        return StrokeFigures(curve, curve, curve, curve, 0.0)
    speed, force = curve.stroke(stroke)
    highest = curve.highest(stroke)
    if speed.size < FEWEST_POINTS:
        few = Unknown(f"{stroke} has {speed.size} points; two lines need {FEWEST_POINTS}")
        return StrokeFigures(few, few, few, few, highest)
    one = np.polyfit(speed, force, 1)
    single = float(np.sum((np.polyval(one, speed) - force) ** 2))
    knee, (level, low, bend), squares = _two_lines(speed, force)
    high = low + bend
    change = abs(bend) / max(abs(low), abs(high), 1e-300)
    straight = single <= (_ROUNDING * float(np.ptp(force))) ** 2 * speed.size
    if straight or change < BEND or squares > BETTER * single:
        none = Unknown(
            f"no knee: {stroke} is one line within its scatter" if squares > BETTER * single or straight
            else f"no knee: the slope of {stroke} changes by {100.0 * change:.0f} %, less than {100.0 * BEND:.0f} %"
        )  # fmt: skip
        return StrokeFigures(none, none, float(one[0]), float(one[0]), highest)
    return StrokeFigures(knee, level + low * knee, low, high, highest)


def _two_lines(speed: Array, force: Array) -> tuple[float, tuple[float, float, float], float]:
    """Return the knee [m/s], (force at 0, slope below, change of slope), and the sum of squares of the best lines."""
    first = float(speed[BESIDE_KNEE - 1])
    last = max(first, float(min(speed[-BESIDE_KNEE], LAST * speed[-1])))
    grid = np.linspace(first, last, 8 * speed.size)
    knee, _ = _least(lambda knee: _hinge(speed, force, knee)[1], grid, 1e-9 * last)
    return knee, *_hinge(speed, force, knee)


def _hinge(speed: Array, force: Array, knee: float) -> tuple[tuple[float, float, float], float]:
    columns = np.stack([np.ones_like(speed), speed, np.maximum(speed - knee, 0.0)], axis=1)
    found = np.linalg.lstsq(columns, force, rcond=None)[0]
    level, low, bend = (float(value) for value in found)
    return (level, low, bend), float(np.sum((columns @ found - force) ** 2))
