"""Figures of a report: every build, all builds together, and every run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eightpost.array_types import Array
from eightpost.ident.dyno_report.builds import DynoReport, Variant
from eightpost.ident.dyno_report.cycles import crossings_of
from eightpost.ident.dyno_report.entry import Entry
from eightpost.ident.dyno_report.found import Unknown
from eightpost.ident.dyno_report.tables import kind_of
from eightpost.ident.dyno_report.velocity_curve import STROKES
from eightpost.report.charts import COLORS, MEASURED, Axis, Figure, Panel, grid_figure
from eightpost.signals import TimeSeries

_VELOCITY, _FORCE, _DISPLACEMENT = Axis("velocity", "m/s"), Axis("force", "N"), Axis("displacement", "m")
_TIME = Axis("time [s]")
_WHOLE = (0.0, 1.0)
#: Line styles of the runs of one build, and of laws.
_DASHES, _LAW_DASH = ("solid", "dot", "dashdot", "longdash"), "dash"
#: Numbers of dots and of points of a line; more would only fill the page.
_DOTS, _POINTS = 2500, 600
#: Number of cycles shown over time and as a loop, and duration shown of a record without cycles [s].
_CYCLES, _SPAN = 2, 1.0
#: Longest time of the runs shown together, over the shortest.
_LONGEST = 2.0
#: Number of runs that a caption names.
_NAMED = 4
#: Number of panels in a row of the overview.
_COLUMNS = 4


@dataclass(frozen=True, slots=True)
class Style:
    """Colour and dash of an entry's line."""

    color: str
    dash: str


def styles(report: DynoReport) -> Mapping[str, Style]:
    """Return the style of every entry by name: a colour for each build, a dash for each of its runs."""
    found = {}
    any_measured = any(variant.measured for variant in report.variants)
    for number, variant in enumerate(report.variants):
        color = COLORS[number % len(COLORS)]
        for k, entry in enumerate(variant.measured):
            found[entry.name] = Style(color, _DASHES[k % len(_DASHES)])
        for entry in variant.of_kind("law"):
            found[entry.name] = Style(color, _LAW_DASH if any_measured else "solid")
    return found


# ---- Builds ---------------------------------------------------------------------------------------------------------


def overview_figure(report: DynoReport) -> Figure:
    """Return a panel for each build on common axes: measured curves and laws."""
    variants, columns = report.variants, min(_COLUMNS, len(report.variants))
    span = _common_ranges(report)
    panels = [
        (Axis("velocity" if k >= len(variants) - columns else "", "m/s"),
         Axis("force" if k % columns == 0 else "", "N"), _heading(report, variant))
        for k, variant in enumerate(variants)
    ]  # fmt: skip
    rows = -(-len(variants) // columns)
    caption = (
        f"Every build on the same axes: mean force over velocity {without_text(report.entries)}, measured (grey) and "
        "of laws (coloured, with their 95 % bands); dots are points of peak-velocity tables."
    )
    figure = grid_figure(caption, {1: 330, 2: 520}.get(rows, 210 * rows + 60), panels, columns, gap=(0.05, 0.14))
    for k, variant in enumerate(variants):
        figure.dots(k, *span, name="", color="rgba(0,0,0,0)")
        for entry in variant.entries:
            color = MEASURED if entry.kind != "law" else COLORS[k % len(COLORS)]
            _curve(figure, k, entry, "", Style(color, "solid"))
    return figure


def _heading(report: DynoReport, variant: Variant) -> str:
    at = [corner for corner, build in report.fitted_to.items() if build in (variant.label, variant.build)]
    return f"{', '.join(at)}: {variant.label}" if at else variant.label


def _common_ranges(report: DynoReport) -> tuple[Array, Array]:
    """Return two invisible points (2,), (2,) that give all panels the same axes."""
    curves = [entry.curve for entry in report.entries if not isinstance(entry.curve, Unknown)]
    if not curves:
        return np.zeros(0), np.zeros(0)
    velocity = [float(end(curve.velocity)) for curve in curves for end in (np.min, np.max)]
    force = [float(end(curve.force)) for curve in curves for end in (np.min, np.max)]
    return np.array([min(velocity), max(velocity)]), np.array([min(force), max(force)])


def curves_figure(report: DynoReport) -> Figure:
    """Return force over velocity of all entries together, and magnified at low speed."""
    panels = (
        Panel(_VELOCITY, without_axis(report.entries), (0.0, 0.62), _WHOLE, "all builds"),
        Panel(_VELOCITY, Axis("force", "N"), (0.70, 1.0), _WHOLE, "low speed"),
    )
    caption = (
        f"Mean force over velocity {without_text(report.entries)}: runs (solid, then dotted and dash-dotted for "
        "further runs of a build), laws (dashed) with 95 % bands, peak-velocity tables (marks). A colour is a build. "
        "Right: the lowest quarter of the speeds."
    )
    figure, styled = Figure(caption, 480, panels), styles(report)
    low = 0.25 * max((entry.highest for entry in report.entries), default=0.0)
    for variant in report.variants:
        for entry in variant.entries:
            name = f"{variant.label}: {kind_of(entry)}" if len(variant.entries) > 1 else variant.label
            _curve(figure, 0, entry, name, styled[entry.name])
            _curve(figure, 1, entry, name, styled[entry.name], limit=low)
    return figure


def _curve(figure: Figure, panel: int, entry: Entry, name: str, style: Style, *, limit: float = np.inf) -> None:
    """Draw the curve of an entry up to a speed [m/s]."""
    if isinstance(entry.curve, Unknown):
        return
    velocity, force = entry.curve.velocity, entry.curve.force
    near = np.abs(velocity) <= limit
    if entry.band is not None:
        inside = np.abs(entry.band.velocity) <= limit
        if np.count_nonzero(inside) > 1:
            band = (row[inside] for row in (entry.band.velocity, entry.band.low, entry.band.high))
            figure.ribbon(panel, *band, name=name, color=style.color)
    if not near.any():
        return
    if entry.kind == "table":
        figure.marks(panel, velocity[near], force[near], name=name, color=style.color, dash=style.dash, size=5)
    else:
        figure.line(panel, velocity[near], force[near], name=name, color=style.color, dash=style.dash)


# ---- Runs -----------------------------------------------------------------------------------------------------------


def without_axis(entries: Sequence[Entry]) -> Axis:
    """Return the axis of forces without a constant part: that at zero velocity, the gas force of slow runs, or both."""
    shared = [entry.shared_gas is not None for entry in entries if entry.kind == "run"]
    if not any(shared):
        return Axis("force without that at v = 0", "N")
    return Axis("force without gas (slow run)" if all(shared) else "force without gas or that at v = 0", "N")


def without_text(entries: Sequence[Entry]) -> str:
    """Return what is subtracted from the forces of runs over velocity, as part of a caption."""
    names = [entry.name for entry in entries if entry.shared_gas is not None]
    if not names:
        return "without the force at zero velocity"
    listed = f"{', '.join(names[:_NAMED])} and {len(names) - _NAMED} more" if len(names) > _NAMED else ", ".join(names)
    return f"without the force at zero velocity ({listed}: without the gas force of a slow run instead)"


def _panels_of_runs(entries: Sequence[Entry]) -> tuple[Panel, ...]:
    return (
        Panel(_VELOCITY, without_axis(entries), (0.0, 0.29), _WHOLE, "force over velocity"),
        Panel(_DISPLACEMENT, _FORCE, (0.36, 0.63), _WHOLE, "force over displacement"),
        Panel(Axis(""), _FORCE, (0.70, 1.0), (0.57, 1.0), "force over time"),
        Panel(_TIME, _VELOCITY, (0.70, 1.0), (0.0, 0.40), "velocity over time"),
    )


def runs_figure(report: DynoReport) -> Figure:
    """Return the loops of all runs together: force over displacement, and force and velocity over time."""
    caption = (
        f"All runs: one loop of force over velocity, {without_text(report.runs)}, and over displacement from the "
        "middle of the stroke; force and velocity over time from the same change of direction."
    )
    figure, styled = Figure(caption, 430, _panels_of_runs(report.runs)), styles(report)
    lengths = [float(np.ptp(_even(entry).time[_cycles_in(_even(entry), _CYCLES)])) for entry in report.runs]
    for variant in report.variants:
        for entry in variant.of_kind("run"):
            _loops(figure, entry, entry.name, styled[entry.name], longest=_LONGEST * min(lengths))
    return figure


def _loops(figure: Figure, entry: Entry, name: str, style: Style, *, longest: float = np.inf) -> None:
    """Draw one loop, and force and velocity over two cycles or a longest time [s]."""
    series, offset = _even(entry), _offset(entry)
    loop, part = _cycles_in(series, 1), _cycles_in(series, _CYCLES)
    figure.line(0, series["velocity"][loop], series["force"][loop] - offset, name=name, color=style.color,
                dash=style.dash)  # fmt: skip
    if "displacement" in series:
        path = series["displacement"]
        middle = 0.5 * float(path.max() + path.min())
        figure.line(1, path[loop] - middle, series["force"][loop], name=name, color=style.color, dash=style.dash)
    part = part[series.time[part] - series.time[part[0]] <= longest]
    time = series.time[part] - series.time[part[0]]
    figure.line(2, time, series["force"][part], name=name, color=style.color, dash=style.dash)
    figure.line(3, time, series["velocity"][part], name=name, color=style.color, dash=style.dash)


def run_figures(report: DynoReport) -> Iterator[Figure]:
    """Yield the figure of each run: its samples, one loop, mean curve, peaks, and the laws of its build."""
    for variant in report.variants:
        for entry in variant.of_kind("run"):
            yield _run_figure(entry, variant)


def _single_text(entry: Entry) -> str:
    return "without the force at zero velocity" if entry.shared_gas is None else "without the gas force of a slow run"


def _run_figure(entry: Entry, variant: Variant) -> Figure:
    caption = (
        f"{entry.name}: samples (grey), one loop (blue), over velocity {_single_text(entry)}, mean of both branches "
        "(orange), peaks of the half cycles (green), knees (crosses), and the laws of the build (dashed, without lag)."
    )
    figure, series, offset = Figure(caption, 400, _panels_of_runs((entry,))), _even(entry), _offset(entry)
    every = slice(None, None, max(1, len(series) // _DOTS))
    figure.dots(0, series["velocity"][every], series["force"][every] - offset, name="samples", size=2.0)
    if "displacement" in series:
        path = series["displacement"] - 0.5 * float(series["displacement"].max() + series["displacement"].min())
        figure.dots(1, path[every], series["force"][every], name="samples", size=2.0)
    _loops(figure, entry, "one loop, two cycles", Style(COLORS[0], "solid"))
    if not isinstance(entry.curve, Unknown):
        figure.line(0, entry.curve.velocity, entry.curve.force, name="mean of both branches", color=COLORS[1])
    if not isinstance(entry.cycles, Unknown) and entry.cycles.peak_velocity.size:
        shown = slice(None, None, max(1, entry.cycles.peak_velocity.size // 400))
        figure.dots(0, entry.cycles.peak_velocity[shown], entry.cycles.peak_force[shown] - offset, name="peaks",
                    color=COLORS[2], size=4.0)  # fmt: skip
    _knees(figure, entry)
    for k, law in enumerate(variant.of_kind("law")):
        style = Style(COLORS[(3 + k) % len(COLORS)], _LAW_DASH)
        _curve(figure, 0, law, f"{law.name}: {kind_of(law)}", style, limit=1.05 * entry.highest)
    return figure


def _knees(figure: Figure, entry: Entry) -> None:
    for stroke, sign in zip(STROKES, (1.0, -1.0), strict=True):
        one = entry.strokes[stroke]
        if not (isinstance(one.knee, Unknown) or isinstance(one.knee_force, Unknown)):
            at = (np.array([sign * one.knee]), np.array([sign * one.knee_force]))
            figure.marks(0, *at, name="knee", color="#1c2430", symbol="x", size=7)


def temperature_figure(report: DynoReport) -> Figure | None:
    """Return the temperature over time of the runs with a temperature channel; None without one."""
    heated = [entry for entry in report.runs if "temperature" in _even(entry)]
    if not heated:
        return None
    figure = Figure("Temperature of the runs that measured it.", 260,
                    (Panel(_TIME, Axis("temperature [°C]"), _WHOLE, _WHOLE),))  # fmt: skip
    styled = styles(report)
    for entry in heated:
        series = _even(entry)
        kept = _some(np.arange(len(series)))
        smooth = _averaged(series["temperature"] - 273.15, max(1, len(series) // _POINTS))
        style = styled[entry.name]
        figure.line(0, series.time[kept] - series.time[0], smooth[kept], name=entry.name, color=style.color,
                    dash=style.dash)  # fmt: skip
    return figure


def _averaged(values: Array, width: int) -> Array:
    """Return running means (N,) over a width of samples."""
    total = np.cumsum(np.concatenate([[0.0], values]))
    low = np.maximum(np.arange(values.size) - width, 0)
    high = np.minimum(np.arange(values.size) + width + 1, values.size)
    return np.asarray((total[high] - total[low]) / (high - low))


def _even(entry: Entry) -> TimeSeries:
    assert entry.test is not None
    series = entry.test.series
    return series if series.is_uniform else series.resample(series.sample_rate)


def _offset(entry: Entry) -> float:
    return 0.0 if isinstance(entry.level, Unknown) else entry.level


def _cycles_in(series: TimeSeries, count: int) -> NDArray[np.intp]:
    """Return the samples of whole cycles in the middle of a record, or of a second around the highest speed."""
    starts = [crossing.time for crossing in crossings_of(series) if crossing.upward]
    if len(starts) > count:
        first = (len(starts) - 1 - count) // 2
        span = (starts[first], starts[first + count])
    else:
        middle = float(series.time[np.argmax(np.abs(series["velocity"]))])
        span = (middle - 0.5 * _SPAN, middle + 0.5 * _SPAN)
    return _some(np.flatnonzero((series.time >= span[0]) & (series.time <= span[1])))


def _some(inside: NDArray[np.intp]) -> NDArray[np.intp]:
    return inside[:: max(1, inside.size // _POINTS)]
