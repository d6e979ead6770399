"""Figures of a report: curves of the builds, loops and branches of the runs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eightpost.array_types import Array
from eightpost.ident.dyno_report.builds import DynoReport
from eightpost.ident.dyno_report.cycles import STROKES, Cycles, Unknown, crossings_of
from eightpost.ident.dyno_report.entry import Entry, ForceBand
from eightpost.ident.dyno_report.loop import VelocityCurve
from eightpost.report.charts import COLORS, Axis, Figure, Panel, row_figure
from eightpost.signals import TimeSeries

_VELOCITY, _FORCE, _DISPLACEMENT = Axis("velocity", "m/s"), Axis("force", "N"), Axis("displacement", "m")
_TIME = Axis("time [s]")
_WHOLE = (0.0, 1.0)
_LIMITS = "limits"
#: Colours of limits and of shaft speeds, and of what only sets the range of an axis.
_GREY, _DARK, _INVISIBLE = "#5b6675", "#4d4d4d", "rgba(0,0,0,0)"
_DOTS, _POINTS = 700, 600  #: Numbers of dots of a run and of points of a line; more would only fill the page.
_CYCLES, _SPAN = 2, 1.0  #: Number of cycles shown over time, and duration shown of a record without cycles [s].
_LONGEST = 2.0  #: Longest time of the runs shown together, over the shortest.
_COLUMNS, _MOST = 4, 12  #: Panels of runs in a row, and largest number of them.
_BARS = 60  #: Classes of shaft speed on a track.


def colors(report: DynoReport) -> dict[str, str]:
    """Return the colour of every build by its label."""
    return {variant.label: COLORS[k % len(COLORS)] for k, variant in enumerate(report.variants)}


# ---- Builds ---------------------------------------------------------------------------------------------------------


def curves_figure(report: DynoReport) -> Figure:
    """Return force over velocity of all entries, and both strokes upward over speed, with limits and shaft speeds."""
    left, right = (0.0, 0.47), (0.55, 1.0)
    panels = [
        Panel(
            Axis("", "m/s") if report.track else _VELOCITY,
            _FORCE,
            left,
            (0.36, 1.0) if report.track else _WHOLE,
            "force over velocity",
        ),
        Panel(Axis("speed", "m/s"), _FORCE, right, _WHOLE, "over speed: compression solid, rebound dotted"),
    ]
    if report.track:
        panels.append(Panel(_VELOCITY, Axis("time [%]"), left, (0.0, 0.2), "shaft velocity on the track"))
    has_both = {v.label: bool(v.of_basis("measured") and v.of_basis("law")) for v in report.variants}
    caption = (
        "Mean force over velocity, without the force at zero velocity or the gas force of a slow run. A colour is a "
        "build."
    )
    if any(has_both.values()):
        caption += " Dashed: laws, with their 95 % bands."
    if report.track:
        caption += " The outer bars of the shaft velocity have the speeds beyond."
    figure, color = Figure(caption, 410 if report.track else 390, panels), colors(report)
    if report.limits is not None:
        _limits(figure, report.limits.band)
    for variant in report.variants:
        for entry in variant.entries:
            dash = "dash" if entry.kind == "law" and has_both[variant.label] else "solid"
            _curve(figure, entry, variant.label, color[variant.label], dash)
        for entry in variant.of_basis("measured") or variant.entries:
            for stroke, dash in zip(STROKES, ("solid", "dot"), strict=True):
                if not isinstance(entry.curve, Unknown):
                    figure.line(
                        1, *entry.curve.stroke(stroke), name=variant.label, color=color[variant.label], dash=dash
                    )
    if report.track:
        _shaft_speeds(figure, report)
    return figure


def _curve(figure: Figure, entry: Entry, name: str, color: str, dash: str) -> None:
    if entry.band is not None:
        figure.ribbon(0, entry.band.velocity, entry.band.low, entry.band.high, name=name, color=color)
    if isinstance(entry.curve, Unknown):
        return
    points = (entry.curve.velocity, entry.curve.force)
    if entry.kind == "table":
        figure.marks(0, *points, name=name, color=color, size=5)
    else:
        figure.line(0, *points, name=name, color=color, dash=dash)


def _limits(figure: Figure, band: ForceBand) -> None:
    """Shade the limits over velocity, and over the speed of each stroke."""
    figure.ribbon(0, band.velocity, band.low, band.high, name=_LIMITS, color=_GREY)
    for edge in (band.low, band.high):
        figure.line(0, band.velocity, edge, name=_LIMITS, color=_GREY, dash="dash")
    low, high = VelocityCurve(band.velocity, band.low), VelocityCurve(band.velocity, band.high)
    for stroke in STROKES:
        speed, edge = low.stroke(stroke)
        figure.ribbon(1, speed, edge, high.stroke(stroke)[1], name=_LIMITS, color=_GREY)


def _shaft_speeds(figure: Figure, report: DynoReport) -> None:
    """Draw the histograms of shaft velocity over the range of the curves; the outer bars have the speeds beyond."""
    top = max(entry.highest for entry in report.entries)
    edges = np.linspace(-top, top, _BARS + 1)
    for panel in (0, 2):
        figure.dots(panel, edges[[0, -1]], np.zeros(2), name="", color=_INVISIBLE)
    for k, (name, velocity) in enumerate(report.track.items()):
        share = 100.0 * np.histogram(np.clip(velocity, -top, top), edges)[0] / velocity.size
        x, y = np.repeat(edges, 2)[1:-1], np.repeat(share, 2)
        color = (_DARK, *COLORS[::-1])[k % (1 + len(COLORS))]
        figure.ribbon(2, x, np.zeros(x.size), y, name=name, color=color)
        figure.line(2, x, y, name=name, color=color)


# ---- Runs -----------------------------------------------------------------------------------------------------------


def branches_figure(report: DynoReport) -> Figure:
    """Return a panel for each run: its samples, both branches of its loop, and its mean curve."""
    runs = report.runs[:_MOST]
    columns = min(_COLUMNS, len(runs))
    panels = [
        (Axis("velocity" if k >= len(runs) - columns else "", "m/s"), Axis("force" if k % columns == 0 else "", "N"),
         entry.name)
        for k, entry in enumerate(runs)
    ]  # fmt: skip
    more = f" The first {_MOST} of {len(report.runs)} runs." if len(report.runs) > _MOST else ""
    caption = (
        "Every run: measured branches of the loop, and their mean without lag and gas spring, the curve of the "
        f"tables.{more}"
    )
    figure = row_figure(caption, 185, panels, columns, gap=0.06)
    for k, entry in enumerate(runs):
        series, level = _series(entry), 0.0 if isinstance(entry.level, Unknown) else entry.level
        every = slice(None, None, max(1, len(series) // _DOTS))
        figure.dots(k, series["velocity"][every], series["force"][every] - level, name="samples", size=2.0)
        if entry.branches is not None:
            at, opening, closing = entry.branches.velocity, entry.branches.opening, entry.branches.closing
            figure.line(k, at, opening, name="open branch (speed rises)", color=COLORS[0])
            figure.line(k, at, closing, name="closed branch (speed falls)", color=COLORS[1])
        if not isinstance(entry.curve, Unknown):
            figure.line(k, entry.curve.velocity, entry.curve.force, name="mean", color="#1c2430")
    return figure


def loops_figure(report: DynoReport) -> Figure:
    """Return the loops of all runs over displacement, force over time, and temperature or velocity over time."""
    heated = [entry for entry in report.runs if "temperature" in _series(entry)]
    third = Axis("temperature [°C]") if heated else _VELOCITY
    panels = (
        Panel(_DISPLACEMENT, _FORCE, (0.0, 0.29), _WHOLE, "force over displacement"),
        Panel(_TIME, _FORCE, (0.36, 0.64), _WHOLE, "force over time"),
        Panel(_TIME, third, (0.71, 1.0), _WHOLE, f"{'temperature' if heated else 'velocity'} over time"),
    )
    caption = (
        "One loop of every run over displacement from the middle of the stroke, and two cycles over time, as measured."
    )
    figure, color = Figure(caption, 300, panels), colors(report)
    shortest = min((float(np.ptp(_series(e).time[_cycles_in(e, _CYCLES)])) for e in report.runs), default=0.0)
    for variant in report.variants:
        name, style = variant.label, color[variant.label]
        for entry in variant.runs:
            series, loop, part = _series(entry), _cycles_in(entry, 1), _cycles_in(entry, _CYCLES)
            if "displacement" in series:
                path = series["displacement"] - 0.5 * float(series["displacement"].max() + series["displacement"].min())
                figure.line(0, path[loop], series["force"][loop], name=name, color=style)
            time = series.time[part] - series.time[part[0]]
            shown = part[time <= _LONGEST * shortest]
            time = series.time[shown] - series.time[shown[0]]
            figure.line(1, time, series["force"][shown], name=name, color=style)
            if not heated:
                figure.line(2, time, series["velocity"][shown], name=name, color=style)
            elif "temperature" in series:
                kept = _some(np.arange(len(series)))
                smooth = _averaged(series["temperature"] - 273.15, max(1, len(series) // _POINTS))
                figure.line(2, series.time[kept] - series.time[0], smooth[kept], name=name, color=style)
    return figure


def _averaged(values: Array, width: int) -> Array:
    """Return running means (N,) over a width of samples."""
    total = np.cumsum(np.concatenate([[0.0], values]))
    low = np.maximum(np.arange(values.size) - width, 0)
    high = np.minimum(np.arange(values.size) + width + 1, values.size)
    return np.asarray((total[high] - total[low]) / (high - low))


def _series(entry: Entry) -> TimeSeries:
    assert entry.test is not None  # it is a run
    return entry.test.series


def _cycles_in(entry: Entry, count: int) -> NDArray[np.intp]:
    """Return the samples of the chosen cycle, of cycles in the middle, or of a second around the highest speed."""
    series = _series(entry)
    starts = [crossing.time for crossing in crossings_of(series) if crossing.upward]
    if isinstance(entry.cycles, Cycles) and entry.cycles.span is not None:
        span = entry.cycles.span
    elif len(starts) > count:
        first = (len(starts) - 1 - count) // 2
        span = (starts[first], starts[first + count])
    else:
        middle = float(series.time[np.argmax(np.abs(series["velocity"]))])
        span = (middle - 0.5 * _SPAN, middle + 0.5 * _SPAN)
    return _some(np.flatnonzero((series.time >= span[0]) & (series.time <= span[1])))


def _some(inside: NDArray[np.intp]) -> NDArray[np.intp]:
    return inside[:: max(1, inside.size // _POINTS)]
