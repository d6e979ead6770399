"""Chapter 3.2: configurations, drive files, and force over velocity of the virtual dynamometer."""

from __future__ import annotations

import itertools

import numpy as np

from dissertation.checks import shown
from dissertation.dyno_bench import FITTED, fitted, random_record
from dissertation.effort import Effort
from dissertation.findings import Findings
from dissertation.plots import TIME, TRUTH, Line, Plot, figure_of
from eightpost.array_types import Array
from eightpost.report.charts import Axis, Figure
from eightpost.shock.curve import StaticCurve
from eightpost.signals import derivative, lowpass
from eightpost.units import si_factor
from eightpost.virtual import CONFIGURATIONS, bump, random_multisine, sine_tests, static_steps
from eightpost.virtual.dynamometer import OFFSET, SPACING, crest_factor, multisine_spectrum

_POUND = si_factor("lbf")
VELOCITY, FORCE = Axis("velocity", "m/s"), Axis("force", "N")

#: Speeds between which the loops are compared, as shares of the largest: at the ends the branches meet [1].
_INNER = 0.9


def moving(number: int) -> tuple[Array, Array]:
    """Return velocity and force (N,) of a configuration's random record from 1 to 10 s, after the low-pass of 3.3."""
    series = random_record(number, FITTED).series
    rows = (lowpass(series[name], series.sample_rate, 50.0) for name in ("velocity", "force"))
    velocity, force = (row[2000:20000] for row in rows)
    return velocity, force


def hysteresis(velocity: Array, force: Array, *, side: float = 0.0) -> float:
    """Return the largest width of the cloud of force over velocity [N].

    Args:
        velocity: Velocity (N,) [m/s].
        force: Force (N,) [N].
        side: 1 for compression alone, -1 for rebound alone, 0 for both.
    """
    inside = (side * velocity >= 0.0) & (np.abs(velocity) < _INNER * np.abs(velocity).max())
    low, high = np.quantile(velocity[inside], (0.005, 0.995)).tolist()
    edges = np.linspace(low, high, 41).tolist()
    widths = []
    for low, high in itertools.pairwise(edges):
        v, f = (row[inside][(velocity[inside] >= low) & (velocity[inside] < high)] for row in (velocity, force))
        if v.size > 50:
            slope = np.polyfit(v, f, 1)
            widths.append(np.ptp(np.quantile(f - np.polyval(slope, v), (0.005, 0.995))))
    return float(max(widths))


def cloud(number: int, name: str = TRUTH) -> Line:
    """Return the dots of a configuration's random record."""
    return Line(name, *moving(number), "dots")


def curve_line(curve: StaticCurve, velocity: Array, name: str) -> Line:
    """Return a static curve over the range of velocities."""
    grid = np.linspace(velocity.min(), velocity.max(), 300)
    return Line(name, grid, np.array([curve.force(v) for v in grid.tolist()]))


def figure_3_4(_: Effort) -> Findings:
    """Record of configuration 1 with its curve."""
    velocity, force = moving(1)
    law = fitted(1, "polylinear").shock.law
    width, extent = hysteresis(velocity, force), float(np.ptp(force))
    shifted = Line(TRUTH, velocity, force - law.port.gas_preload, "dots")
    plot = Plot("", VELOCITY, FORCE, [shifted, curve_line(law.curve, velocity, "Polylinear")])
    return Findings(
        {"hysteresis": width, "range": extent, "share": 100.0 * width / extent},
        blocks=[figure_of("Random record without gas preload (dots) and the static curve.", [plot], columns=1)],
    )


def figure_3_5(_: Effort) -> Findings:
    """A single polynomial of order 15 against Polylinear, 5 % beyond the data."""
    velocity, force = moving(1)
    law = fitted(1, "polylinear").shock.law
    top = float(velocity.max())
    polynomial = np.polynomial.Polynomial.fit(velocity, force, 15)
    beyond = 1.05 * top
    straight = float(np.interp(top, *_branch(law.curve, top))) + law.curve.compression_slope * (beyond - top)
    wrong = abs(float(polynomial(beyond)) - law.port.gas_preload - straight)
    ours = abs(law.curve.force(beyond) - straight)
    grid = np.linspace(float(velocity.min()) * 1.05, beyond, 400)
    lines = [
        Line(TRUTH, velocity, force - law.port.gas_preload, "dots"),
        Line("polynomial of order 15", grid, polynomial(grid) - law.port.gas_preload),
        Line("Polylinear", grid, np.array([law.curve.force(v) for v in grid.tolist()])),
    ]
    caption = "A polynomial of order 15 and Polylinear, 5 % beyond the data; Polylinear has straight ends there."
    return Findings(
        {"error": wrong, "transition": law.curve.transition_speed, "width": law.curve.transition_width},
        {
            "straight": (
                ours < 0.1 * max(wrong, _POUND),
                f"{ours / _POUND:.2g} lbf, the polynomial {wrong / _POUND:.3g} lbf",
            )
        },
        [figure_of(caption, [Plot("", VELOCITY, FORCE, lines)], columns=1)],
        "The error of the polynomial depends on the shock and on its few samples near the end; the order in print is "
        "not stated. The error is taken from the straight line that continues Polylinear.",
    )


def _branch(curve: StaticCurve, top: float) -> tuple[Array, Array]:
    grid = np.linspace(0.0, top, 200)
    return grid, np.array([curve.force(v) for v in grid.tolist()])


def _clouds(numbers: dict[str, int], caption: str) -> Figure:
    plots = [Plot(title, VELOCITY, FORCE, [cloud(number)]) for title, number in numbers.items()]
    return figure_of(caption, plots)


def figure_3_10(_: Effort) -> Findings:
    """The three builds at 50 psi and 1 click."""
    builds = {"build 1": 1, "build 2": 5, "build 4": 9}
    speed = 0.4
    peaks = []
    for number in builds.values():
        velocity, force = moving(number)
        peaks.append(float(np.mean(force[np.abs(velocity - speed) < 0.02])) / _POUND)
    return Findings(
        claims={"soft": (peaks[2] == min(peaks), f"mean force at {speed:g} m/s {shown(peaks, 'lbf')}")},
        blocks=[_clouds(builds, "Force over velocity of the random records.")],
    )


def figure_3_19(_: Effort) -> Findings:
    """Build 2, 1 click, at two gas pressures."""
    pressures = {"50 psi": 5, "150 psi": 7}
    widths = [hysteresis(*moving(number), side=-1.0) / _POUND for number in pressures.values()]
    return Findings(
        claims={"pressure": (widths[0] > widths[1], f"width in rebound {shown(widths, 'lbf')}")},
        blocks=[_clouds(pressures, "Force over velocity of build 2 with 1 click.")],
    )


# ---- Drive files ----------------------------------------------------------------------------------------------------


def figure_3_11(_: Effort) -> Findings:
    """Random drive file."""
    drive = random_multisine(FITTED).series
    values = drive["displacement"]
    single = crest_factor(random_multisine(FITTED, draws=1).series["displacement"])
    chosen = crest_factor(values)
    shown_part = drive.window(0.0, 5.0)
    plot = Plot("", TIME, Axis("displacement", "m"), [Line("drive", shown_part.time, shown_part["displacement"])])
    frequencies, _amplitudes = multisine_spectrum()
    return Findings(
        {
            "lines": frequencies.size,
            "spacing": SPACING,
            "duration": drive.duration,
            "peak": float(np.abs(values).max()),
        },
        {"crest": (chosen < single, f"{chosen:.3g}, a single draw {single:.3g}")},
        [figure_of("Five seconds of our draw; the phases of the dissertation are not printed.", [plot], columns=1)],
    )


def figure_3_12(_: Effort) -> Findings:
    """Static drive file."""
    drive = static_steps().series
    x = drive["displacement"] + OFFSET
    speed = np.abs(derivative(x, drive.sample_rate))
    held = np.flatnonzero(np.diff((speed < 1e-6).astype(int)))
    first = float(drive.time[held[0]])
    plot = Plot("", TIME, Axis("displacement", "m"), [Line("drive", drive.time, x)])
    return Findings(
        {
            "start": float(x[0]),
            "step": float(np.ptp(x)) / 3.0,
            "top": round(float(np.ptp(x)) / si_factor("in")),
            "speed": float(speed.max()),
            "hold": first,
        },
        blocks=[figure_of("Static drive file.", [plot], columns=1)],
    )


def figure_3_13(_: Effort) -> Findings:
    """Bump drive file."""
    drive = bump().series
    x = drive["displacement"]
    speed = float(np.abs(derivative(x, drive.sample_rate)).max())
    plot = Plot("", TIME, Axis("displacement", "m"), [Line("drive", drive.time, x)])
    return Findings(
        {"height": float(np.ptp(x)), "speed": speed}, blocks=[figure_of("Bump drive file.", [plot], columns=1)]
    )


# ---- Tables ---------------------------------------------------------------------------------------------------------


def table_3_1(_: Effort) -> Findings:
    """Settings of the virtual dynamometer's configurations."""
    found: dict[str, float] = {}
    order = (1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12)
    for number in order:
        setting = CONFIGURATIONS[number]
        found |= {
            f"configuration {number}/build": setting.build,
            f"configuration {number}/clicks": setting.clicks,
            f"configuration {number}/gas": setting.gas_pressure / si_factor("psi"),
        }
    return Findings(found)


def table_3_2(_: Effort) -> Findings:
    """Interpolated spectrum at the printed frequencies."""
    frequencies, amplitudes = multisine_spectrum()
    printed = (0.1, 1.0, 2.0, 3.0, 4.0, 5.0, 8.0, 10.0, 20.0, 30.0)
    return Findings({f"amplitude/{f:g} Hz": float(np.interp(f, frequencies, amplitudes)) for f in printed})


def table_3_3(_: Effort) -> Findings:
    """Frequency of each sine test: velocity over 2 pi amplitude."""
    return Findings({f"frequency/{test.name}": test.frequency for test in sine_tests()})


COMPUTATIONS = {
    "figure-3.4": figure_3_4,
    "figure-3.5": figure_3_5,
    "figure-3.10": figure_3_10,
    "figure-3.11": figure_3_11,
    "figure-3.12": figure_3_12,
    "figure-3.13": figure_3_13,
    "figure-3.19": figure_3_19,
    "table-3.1": table_3_1,
    "table-3.2": table_3_2,
    "table-3.3": table_3_3,
}
