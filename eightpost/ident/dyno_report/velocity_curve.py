"""Mean force over velocity of a run, a table or a law: forces at stated speeds, the knee, and the slopes beside it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.optimize import minimize_scalar

from eightpost.array_types import Array
from eightpost.ident.dyno_report.branches import LoopClasses
from eightpost.ident.dyno_report.cycles import Cycles
from eightpost.ident.dyno_report.found import Found, Unknown
from eightpost.rig.peak_velocity_table import PeakVelocityTable
from eightpost.shock import ShockLaw
from eightpost.shock.law import valve_force
from eightpost.signals import TimeSeries
from eightpost.units import convert

Stroke = Literal["compression", "rebound"]
STROKES: tuple[Stroke, Stroke] = ("compression", "rebound")

#: Number of speeds of a law's curve in each stroke.
LAW_POINTS = 120
#: Minimum number of points of a stroke for two lines, and minimum number of points on either side of the knee.
FEWEST_POINTS, BESIDE = 6, 3
#: A knee is below this share of the highest speed, because the branches of a loop meet at its end.
LAST = 0.85
#: Minimum change of slope at a knee, as a share of the steeper slope.
BEND = 0.2
#: Maximum sum of squares about two lines, as a share of that about one line.
BETTER = 0.5
#: Largest force at which a sum of squares is rounding, as a share of the force's range.
_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class VelocityCurve:
    """Mean force over velocity, without the force at zero velocity.

    Attributes:
        velocity: Velocities (K,) [m/s], increasing, positive in compression.
        force: Forces (K,) [N] at these velocities.
    """

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


def ratio_at(curve: VelocityCurve | Unknown, speed: float) -> Found:
    """Return the force in rebound over the force in compression [1] at a speed [m/s]."""
    compression, rebound = (forces_at(curve, speed, stroke) for stroke in STROKES)
    if isinstance(compression, Unknown):
        return compression
    if isinstance(rebound, Unknown):
        return rebound
    if compression <= 0.0 or rebound <= 0.0:
        return Unknown("a force at this speed acts in the direction of the motion")
    return rebound / compression


def forces_at(curve: VelocityCurve | Unknown, speed: float, stroke: Stroke) -> Found:
    """Return the force magnitude [N] at a speed [m/s] of a curve that may be unknown."""
    return curve if isinstance(curve, Unknown) else curve.force_at(speed, stroke)


# ---- Curves ---------------------------------------------------------------------------------------------------------


def curve_of_series(series: TimeSeries, cycles: Cycles, offset: float) -> VelocityCurve | Unknown:
    """Return the mean curve of a record: in classes of velocity, both branches of the loop count equally.

    The difference between the branches, which is caused by lag and gas stiffness, cancels. The ends of the curve of a
    steady run are the means of its peaks.

    Args:
        series: Record with `velocity` [m/s] and `force` [N].
        cycles: Cycles of the record.
        offset: Force at zero velocity [N], which is subtracted.
    """
    classes = LoopClasses.of(series)
    speeds, forces = (classes.means(row).mean(axis=0) for row in (series["velocity"], series["force"] - offset))
    points = list(zip(speeds.tolist(), forces.tolist(), strict=True))
    for sign in (-1.0, 1.0):
        points = _with_peak(points, cycles, sign, offset)
    if len(points) < FEWEST_POINTS:
        return Unknown("too few samples are on both branches of a loop of force over velocity")
    found = np.array(sorted(points))
    return VelocityCurve(found[:, 0], found[:, 1])


def _with_peak(
    points: list[tuple[float, float]], cycles: Cycles, sign: float, offset: float
) -> list[tuple[float, float]]:
    """Return the points of classes with the mean peak of a steady run instead of those at its speed and above."""
    speeds, forces = cycles.peaks(sign)
    if not cycles.is_steady or not speeds.size:
        return points
    # The median leaves out the cycles in which the machine starts and stops.
    peak, force = float(np.median(speeds)), sign * float(np.median(forces)) - offset
    return [*(point for point in points if sign * point[0] < peak), (sign * peak, force)]


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
    """Knee and slopes of a stroke: two lines that meet at the knee, by least squares over the points of the curve.

    Attributes:
        knee: Speed at which the lines meet [m/s].
        knee_force: Force at the knee [N].
        low: Slope below the knee [N.s/m].
        high: Slope above the knee [N.s/m]; equal to `low` if the stroke is one line.
        highest: Highest speed of the curve [m/s].
    """

    knee: Found
    knee_force: Found
    low: Found
    high: Found
    highest: float


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

    def misfit(knee: float) -> float:
        return _hinge(speed, force, knee)[1]

    first, last = float(speed[BESIDE - 1]), float(min(speed[-BESIDE], LAST * speed[-1]))
    last = max(first, last)
    grid = np.linspace(first, last, 8 * speed.size)
    best = int(np.argmin([misfit(float(knee)) for knee in grid]))
    near = float(grid[max(best - 1, 0)]), float(grid[min(best + 1, grid.size - 1)])
    refined = minimize_scalar(misfit, bounds=near, method="bounded", options={"xatol": 1e-9 * last})
    knee = float(refined.x if refined.fun < misfit(float(grid[best])) else grid[best])
    coefficients, squares = _hinge(speed, force, knee)
    return knee, coefficients, squares


def _hinge(speed: Array, force: Array, knee: float) -> tuple[tuple[float, float, float], float]:
    columns = np.stack([np.ones_like(speed), speed, np.maximum(speed - knee, 0.0)], axis=1)
    found = np.linalg.lstsq(columns, force, rcond=None)[0]
    level, low, bend = (float(value) for value in found)
    return (level, low, bend), float(np.sum((columns @ found - force) ** 2))
