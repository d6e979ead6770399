"""Figures of a validation."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from eightpost.array_types import Array
from eightpost.ident.validation.bump import BumpValidation
from eightpost.ident.validation.evaluation import RandomValidation
from eightpost.ident.validation.static import StaticValidation
from eightpost.ident.validation.study import names_of
from eightpost.ident.validation.tables import sine
from eightpost.units import convert

if TYPE_CHECKING:
    from eightpost.ident.validation.bump import BumpEvent
    from eightpost.ident.validation.record import Record
    from eightpost.ident.validation.sine import Loop
    from eightpost.ident.validation.static import Hold
    from eightpost.ident.validation.study import Case
    from eightpost.signals import TimeSeries


# ---- A figure as plotly's JSON, with numbers in SI and the unit of each axis, so that the page can ------------------

#: First and last value of a range [1].
Span = tuple[float, float]

#: Width of every figure [px]: that of a landscape A4 page within its margins, so that print and screen look the same.
WIDTH = 1000

#: Colours that remain distinct with colour-blindness (Okabe and Ito 2008), one for each shock of a record.
COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56a4d8", "#7a5c00")
MEASURED = "#9aa4b1"

#: Space for axis labels next to a panel and above it [px].
_LEFT, _RIGHT, _TOP, _BOTTOM = 62, 12, 58, 44

_AXIS = {"gridcolor": "#e6e9ee", "zerolinecolor": "#c3cad3", "linecolor": "#b9c1cb", "ticks": "outside", "ticklen": 3,
         "tickcolor": "#b9c1cb", "tickfont": {"size": 10}, "automargin": False}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Axis:
    """An axis of a panel.

    Attributes:
        title: Name of the quantity on the axis.
        unit: SI unit; empty for a plain number. The page appends the unit to the title.
        kind: `linear` or `log`.
        span: Fixed range in plotly's terms, for axes without unit; None: the range follows the data.
    """

    title: str
    unit: str = ""
    kind: str = "linear"
    span: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True)
class Panel:
    """A panel of a figure.

    Attributes:
        x: Horizontal axis.
        y: Vertical axis.
        column: Start and end as shares of the figure's width [1].
        row: Start and end as shares of the figure's height [1], from below.
        title: Heading above the panel.
    """

    x: Axis
    y: Axis
    column: tuple[float, float]
    row: tuple[float, float]
    title: str = ""


@dataclass
class Figure:
    """A figure under construction.

    Args:
        caption: Text below the figure.
        height: Height [px].
        panels: Panels with their axes and positions.
    """

    caption: str
    height: int
    panels: Sequence[Panel]
    _traces: list[dict[str, Any]] = field(default_factory=list)
    _shapes: list[dict[str, Any]] = field(default_factory=list)
    _named: set[str] = field(default_factory=set)

    def line(self, panel: int, x: Array, y: Array, *, name: str, color: str, dash: str = "solid") -> None:
        """Draw a line in a panel, counted from 0; a name is in the legend once. Measured lines are wider."""
        width = 4.0 if color == MEASURED else 1.4
        self._add(panel, x, y, name, mode="lines", line={"color": color, "width": width, "dash": dash})

    def dots(self, panel: int, x: Array, y: Array, *, name: str, color: str = MEASURED, size: float = 2.5) -> None:
        """Draw dots in a panel."""
        self._add(panel, x, y, name, mode="markers", marker={"color": color, "size": size})

    def marks(
        self, panel: int, x: Array, y: Array, *, name: str, color: str, symbol: str = "circle", dash: str = "solid"
    ) -> None:
        """Draw marks joined by a line."""
        marker, line = {"color": color, "size": 8, "symbol": symbol}, {"color": color, "width": 1.5, "dash": dash}
        self._add(panel, x, y, name, mode="lines+markers", marker=marker, line=line)

    def bubbles(self, panel: int, x: Array, y: Array, values: Array, *, unit: str, greatest: float) -> None:
        """Draw a disc for each value, with area and colour by the value, and the value written above it."""
        sizes = 10.0 + 26.0 * np.sqrt(np.abs(values) / greatest)
        marker = {"color": _numbers(values), "size": _numbers(sizes), "colorscale": "YlOrRd", "reversescale": True,
                  "cmin": 0.0, "cmax": greatest, "opacity": 0.9,
                  "line": {"color": "#5b6675", "width": 0.8}}  # fmt: skip
        self._add(panel, x, y, "", mode="markers+text", marker=marker, textposition="top center", textfont={"size": 10})
        self._traces[-1] |= {
            "meta": {"unit": unit, "values": _numbers(values)},
            "showlegend": False,
            "cliponaxis": False,
        }

    def band(self, panel: int, start: float, stop: float) -> None:
        """Shade a span of a panel's horizontal axis, whose unit must be the same in both unit systems."""
        x, y = _axes(panel)
        self._shapes.append({"type": "rect", "xref": x, "yref": f"{y} domain", "x0": start, "x1": stop, "y0": 0,
                             "y1": 1, "fillcolor": "#eceff3", "line": {"width": 0}, "layer": "below"})  # fmt: skip

    def level(self, panel: int, value: float) -> None:
        """Draw a dotted horizontal line at a value of an axis without unit."""
        x, y = _axes(panel)
        self._shapes.append({"type": "line", "xref": f"{x} domain", "yref": y, "x0": 0, "x1": 1, "y0": value,
                             "y1": value, "line": {"color": "#5b6675", "width": 1, "dash": "dot"}})  # fmt: skip

    def content(self) -> dict[str, Any]:
        """Return the content that the page's script draws."""
        layout: dict[str, Any] = {
            "width": WIDTH,
            "height": self.height,
            "margin": {"l": _LEFT, "r": _RIGHT, "t": _TOP, "b": _BOTTOM},
            "legend": {"orientation": "h", "x": 0, "y": 1, "yref": "container", "yanchor": "top", "font": {"size": 12}},
            "shapes": self._shapes,
            "annotations": [],
        }
        units: dict[str, str] = {}
        for k, panel in enumerate(self.panels):
            x, y = _axes(k)
            layout[_layout_name(x)] = _axis(panel.x, panel.column, y)
            layout[_layout_name(y)] = _axis(panel.y, panel.row, x)
            units |= {x: panel.x.unit, y: panel.y.unit}
            if panel.title:
                layout["annotations"].append(_heading(panel))
        return {"data": self._traces, "layout": layout, "units": units}

    def _add(self, panel: int, x: Array, y: Array, name: str, **style: Any) -> None:
        x_axis, y_axis = _axes(panel)
        first = bool(name) and name not in self._named
        trace = {"type": "scatter", "x": _numbers(x), "y": _numbers(y), "xaxis": x_axis, "yaxis": y_axis,
                 "name": name, "legendgroup": name, "showlegend": first, "hoverinfo": "x+y+name"}  # fmt: skip
        self._named.add(name)
        self._traces.append(trace | style)


def grid(
    count: int, columns: int, *, gap: tuple[float, float]
) -> list[tuple[tuple[float, float], tuple[float, float]]]:
    """Return column and row [1] of each panel of a grid, row by row from above.

    Args:
        count: Number of panels.
        columns: Number of panels in a row.
        gap: Gaps between columns and between rows [1].
    """
    rows = -(-count // columns)
    width, height = (1.0 - gap[0] * (columns - 1)) / columns, (1.0 - gap[1] * (rows - 1)) / rows
    places = []
    for k in range(count):
        left, below = (k % columns) * (width + gap[0]), (rows - 1 - k // columns) * (height + gap[1])
        places.append(((left, left + width), (below, below + height)))
    return places


def _axes(panel: int) -> tuple[str, str]:
    number = "" if panel == 0 else str(panel + 1)
    return f"x{number}", f"y{number}"


def _layout_name(axis: str) -> str:
    return f"{axis[0]}axis{axis[1:]}"


def _axis(axis: Axis, domain: tuple[float, float], anchor: str) -> dict[str, Any]:
    entry: dict[str, Any] = dict(_AXIS) | {"domain": list(domain), "anchor": anchor, "type": axis.kind}
    entry["title"] = {"text": axis.title, "font": {"size": 11}, "standoff": 4}
    if axis.span:
        entry["range"] = list(axis.span)
    return entry


def _heading(panel: Panel) -> dict[str, Any]:
    return {"text": panel.title, "xref": "paper", "yref": "paper", "x": sum(panel.column) / 2.0, "y": panel.row[1],
            "xanchor": "center", "yanchor": "bottom", "showarrow": False,
            "font": {"size": 11, "color": "#1c2430"}}  # fmt: skip


def _numbers(values: Array) -> list[float]:
    """Return values rounded to six digits of the largest, finer than a screen's resolution."""
    array = np.asarray(values, dtype=np.float64)
    top = float(np.abs(array).max(initial=0.0))
    digits = 5 - int(np.floor(np.log10(top))) if top > 0.0 else 0
    rounded: list[float] = np.round(array, digits).tolist()
    return rounded


# ---- Bump records ---------------------------------------------------------------------------------------------------

_POINTS = 500


def bump_figure(record: Record, cases: tuple[Case, ...]) -> Figure:
    """Return the figure of a bump record: the fastest event of each direction in time, and all events over velocity."""
    first = _bump(cases[0])
    events = _drawn(first.events)
    width = 0.62 / len(events)
    force = Axis("force", "N")
    panels = [
        Panel(Axis("time [s]"), force, (k * width, (k + 1) * width - 0.06), (0.0, 1.0), _way(event))
        for k, event in enumerate(events)
    ]
    panels.append(Panel(Axis("velocity", "m/s"), force, (0.64, 1.0), (0.0, 1.0), "force over velocity"))
    low_pass = f"low-pass {first.prediction.cutoff:g} Hz"
    caption = f"{record.name}: force over time and over velocity, as in Fig 3.24 and 3.25; {low_pass}."
    figure = Figure(caption, 400, panels)
    _draw(figure, events, first.prediction.measured, first.prediction.measured, ("measured", MEASURED))
    for case, name, color in zip(cases, names_of(cases), COLORS * len(cases), strict=False):
        _draw(figure, events, first.prediction.measured, _bump(case).prediction.predicted, (name, color))
    return figure


def _draw(
    figure: Figure, events: list[BumpEvent], motion: TimeSeries, forces: TimeSeries, style: tuple[str, str]
) -> None:
    name, color = style
    for k, event in enumerate(events):
        inside = np.flatnonzero((motion.time >= event.start) & (motion.time <= event.stop))
        kept = inside[:: max(1, inside.size // _POINTS)]
        figure.line(k, motion.time[kept], forces["force"][kept], name=name, color=color)
        figure.line(len(events), motion["velocity"][kept], forces["force"][kept], name=name, color=color)


def _drawn(events: tuple[BumpEvent, ...]) -> list[BumpEvent]:
    """Return the fastest event in compression and the fastest in rebound, in the order of time."""
    ends = {max(events, key=lambda e: e.speed).start, min(events, key=lambda e: e.speed).start}
    return [event for event in events if event.start in ends]


def _way(event: BumpEvent) -> str:
    return "compression" if event.speed > 0.0 else "rebound"


def _bump(case: Case) -> BumpValidation:
    assert isinstance(case.outcome, BumpValidation)
    return case.outcome


# ---- Figures of random records --------------------------------------------------------------------------------------

#: Number of dots of a record and of points of a line; more would only fill the page.
_DOTS, _RANDOM_FIGURES_POINTS = 3000, 500

#: Duration of the traces over time, around the highest speed [s].
_SPAN = 1.0

#: Duration of the loop [s]; a longer one would hide the measured dots.
_LOOP = 0.25

_FORCE, _TIME, _FREQUENCY = Axis("force", "N"), Axis("time [s]"), Axis("frequency [Hz]")
_PANELS = (
    Panel(Axis("velocity", "m/s"), _FORCE, (0.0, 0.3), (0.0, 1.0), "force over velocity"),
    Panel(_TIME, _FORCE, (0.37, 0.67), (0.6, 1.0), "force"),
    Panel(_TIME, Axis("error", "N"), (0.37, 0.67), (0.0, 0.39), "error, measured minus predicted"),
    Panel(_FREQUENCY, Axis("", span=(0.0, 1.03)), (0.74, 1.0), (0.6, 1.0), "coherence of error and velocity"),
    Panel(_FREQUENCY, Axis("density", "N2/Hz", "log"), (0.74, 1.0), (0.0, 0.39), "spectrum of the error"),
)


def random_figure(record: Record, cases: tuple[Case, ...]) -> Figure:
    """Return the figure of a random record with all its shocks."""
    caption = (
        f"{record.name}: force over velocity, the record as dots and a quarter of a second of each prediction as a "
        "loop; one second of force and error; coherence of the error with the velocity, significant (5 %) above the "
        "dotted line; spectrum of the error below that of the measured force."
    )
    figure = Figure(caption, 470, _PANELS)
    first = _random(cases[0])
    measured = first.prediction.measured
    every = max(1, len(measured) // _DOTS)
    figure.dots(0, measured["velocity"][::every], measured["force"][::every], name="measured")
    here = _liveliest(measured.time, measured["velocity"], _SPAN)
    loop = _liveliest(measured.time, measured["velocity"], _LOOP)
    time = measured.time[here]
    figure.line(1, time, measured["force"][here], name="measured", color=MEASURED)
    for case, name, color in zip(cases, names_of(cases), COLORS * len(cases), strict=False):
        found = _random(case)
        figure.line(0, measured["velocity"][loop], found.prediction.predicted["force"][loop], name=name, color=color)
        figure.line(1, time, found.prediction.predicted["force"][here], name=name, color=color)
        figure.line(2, time, found.prediction.error[here], name=name, color=color)
        if found.residual:
            figure.line(3, found.residual.frequency, found.residual.coherence, name=name, color=color)
            figure.line(4, found.residual.frequency, found.residual.density, name=name, color=color)
    if first.residual:
        figure.level(3, first.residual.threshold)
        figure.line(4, first.residual.frequency, first.residual.force_density, name="measured", color=MEASURED)
    return figure


def _random(case: Case) -> RandomValidation:
    assert isinstance(case.outcome, RandomValidation)
    return case.outcome


def _liveliest(time: Array, velocity: Array, span: float) -> NDArray[np.intp]:
    """Return the samples of a span [s] around the highest speed, at most about 500."""
    middle = float(time[np.argmax(np.abs(velocity))])
    start = min(max(middle - 0.5 * span, float(time[0])), max(float(time[-1]) - span, float(time[0])))
    inside = np.flatnonzero((time >= start) & (time <= start + span))
    return inside[:: max(1, inside.size // _RANDOM_FIGURES_POINTS)]


# ---- Figures of sine records ----------------------------------------------------------------------------------------

#: Number of loops in a figure and in a row, and number of points of a loop.
_LOOPS, _COLUMNS, _SINE_FIGURES_POINTS = 15, 5, 160

#: Amplitudes within this share of each other are one group, because the actuator does not follow its command exactly.
_ALIKE = 0.1


def sine_figures(rows: list[tuple[Case, ...]]) -> Iterator[Figure]:
    """Return the figures of the sine records of one damper.

    Args:
        rows: Cases of each record, with the same shocks in the same order.
    """
    if len(rows) > 1:
        yield _map(rows)
        yield _over_frequency(rows)
    for start in range(0, len(rows), _LOOPS):
        some = rows[start : start + _LOOPS]
        yield _loops(some, "velocity")
        yield _loops(some, "displacement")


def _map(rows: list[tuple[Case, ...]]) -> Figure:
    """Return the error as a disc at each amplitude and peak speed, with a panel for each shock."""
    names = names_of(rows[0])
    amplitude = np.array([sine(cases[0]).amplitude for cases in rows])
    speed = np.array([sine(cases[0]).speed for cases in rows])
    errors = np.array([[sine(case).rms for case in cases] for cases in rows])
    columns = min(len(names), 4)
    places = grid(len(names), columns, gap=(0.07, 0.2))
    x, y = Axis("peak speed", "m/s", "log"), Axis("amplitude", "m", "log")
    panels = [Panel(x, y, *place, title=name) for place, name in zip(places, names, strict=True)]
    caption = "RMS error [{N}] of each sine at its amplitude and peak speed (Table 3.3); larger and darker is worse."
    figure = Figure(caption, 330 if len(names) <= columns else 620, panels)
    for k in range(len(names)):
        figure.bubbles(k, speed, amplitude, errors[:, k], unit="N", greatest=float(errors.max()))
    return figure


def _over_frequency(rows: list[tuple[Case, ...]]) -> Figure:
    """Return the error over frequency, with a panel for each amplitude (Fig 3.20)."""
    groups = _amplitudes(rows)
    names = names_of(rows[0])
    places = grid(len(groups), min(len(groups), 5), gap=(0.06, 0.22))
    x, y = Axis("frequency [Hz]", kind="log"), Axis("RMS error", "N")
    panels = [Panel(x, y, *place, title=title) for place, title in zip(places, groups, strict=True)]
    figure = Figure(
        "RMS error over frequency at each amplitude, as Fig 3.20.", 320 if len(groups) <= 5 else 600, panels
    )
    for k, group in enumerate(groups.values()):
        frequency = np.array([sine(cases[0]).frequency for cases in group])
        order = np.argsort(frequency)
        for i, (name, color) in enumerate(zip(names, COLORS * len(names), strict=False)):
            errors = np.array([sine(cases[i]).rms for cases in group])
            figure.marks(k, frequency[order], errors[order], name=name, color=color)
    return figure


def _amplitudes(rows: list[tuple[Case, ...]]) -> dict[str, list[tuple[Case, ...]]]:
    """Return the records by amplitude, the largest first."""
    groups: list[list[tuple[Case, ...]]] = []
    for cases in sorted(rows, key=lambda cases: -sine(cases[0]).amplitude):
        if groups and sine(cases[0]).amplitude > (1.0 - _ALIKE) * sine(groups[-1][0][0]).amplitude:
            groups[-1].append(cases)
        else:
            groups.append([cases])
    return {_length(sine(group[0][0]).amplitude): group for group in groups}


def _length(amplitude: float) -> str:
    return f"{convert(amplitude, 'm', 'in'):.2g} in ({1e3 * amplitude:.2g} mm)"


def _loops(rows: list[tuple[Case, ...]], over: str) -> Figure:
    """Return the last period of each record as force over velocity or displacement, measured and predicted."""
    columns = min(len(rows), _COLUMNS)
    places = grid(len(rows), columns, gap=(0.055, 0.13))
    unit = "m/s" if over == "velocity" else "m"
    panels = []
    for k, (place, cases) in enumerate(zip(places, rows, strict=True)):
        found = sine(cases[0])
        x, y = over if k >= len(rows) - columns else "", "force" if k % columns == 0 else ""
        title = f"{_length(found.amplitude).partition(' (')[0]}, {found.frequency:.3g} Hz"
        panels.append(Panel(Axis(x, unit), Axis(y, "N"), *place, title=title))
    height = {1: 300, 2: 460}.get(-(-len(rows) // columns), 640)
    figure = Figure(f"Hysteresis loops, force over {over}: the last period of each sine.", height, panels)
    for k, cases in enumerate(rows):
        _sine_figures_draw(figure, k, sine(cases[0]).measured, over, ("measured", MEASURED))
        for case, name, color in zip(cases, names_of(cases), COLORS * len(cases), strict=False):
            _sine_figures_draw(figure, k, sine(case).predicted, over, (name, color))
    return figure


def _sine_figures_draw(figure: Figure, panel: int, loop: Loop, over: str, style: tuple[str, str]) -> None:
    kept = np.linspace(0, loop.force.size - 1, min(_SINE_FIGURES_POINTS, loop.force.size)).astype(int)
    name, color = style
    figure.line(panel, getattr(loop, over)[kept], loop.force[kept], name=name, color=color)


# ---- Figures of static records --------------------------------------------------------------------------------------

#: Number of points of a trace over time.
_STATIC_FIGURES_POINTS = 1500

_HOLD = "#4b5563"

_STATIC_FIGURES_FORCE = Axis("force", "N")


def static_figure(record: Record, cases: tuple[Case, ...]) -> Figure:
    """Return the figure of a static record: its traces, and its holds with each law's gas force."""
    panels = (
        Panel(Axis("time [s]"), _STATIC_FIGURES_FORCE, (0.0, 0.52), (0.36, 1.0), "force"),
        Panel(Axis("time [s]"), Axis("displacement", "m"), (0.0, 0.52), (0.0, 0.2)),
        Panel(Axis("displacement", "m"), _STATIC_FIGURES_FORCE, (0.6, 1.0), (0.0, 1.0), "force at the holds"),
    )
    caption = (
        f"{record.name}: the averaged times are shaded. The distance between the directions is twice the seal drag; "
        "a law's drag is a function of velocity, so at rest it predicts the gas force alone."
    )
    figure = Figure(caption, 430, panels)
    first = _static(cases[0])
    kept = np.linspace(0, len(first.series) - 1, min(_STATIC_FIGURES_POINTS, len(first.series))).astype(int)
    time = first.series.time[kept]
    figure.line(0, time, first.series["force"][kept], name="measured", color=MEASURED)
    figure.line(1, time, first.series["displacement"][kept], name="measured", color=MEASURED)
    for hold in first.holds:
        figure.band(0, hold.start, hold.stop)
    _branches(figure, 2, first.holds)
    for case, name, color in zip(cases, names_of(cases), COLORS * len(cases), strict=False):
        holds = sorted(_static(case).holds, key=lambda hold: hold.displacement)
        forces = np.array([hold.predicted for hold in holds])
        figure.line(2, np.array([hold.displacement for hold in holds]), forces, name=name, color=color)
    return figure


def overlay(found: tuple[tuple[Record, tuple[Case, ...]], ...]) -> Figure:
    """Return the measured holds of several static records in one figure, relative to the first hold (Fig 3.23)."""
    panels = (
        Panel(Axis("displacement from the first hold", "m"), Axis("force from the first hold", "N"), (0, 1), (0, 1)),
    )
    figure = Figure(
        "Force over displacement of all static records, relative to the first hold of each, as Fig 3.23.", 420, panels
    )
    for (record, cases), color in zip(found, COLORS * len(found), strict=False):
        holds = _static(cases[0]).holds
        x = np.array([hold.displacement - holds[0].displacement for hold in holds])
        y = np.array([hold.force - holds[0].force for hold in holds])
        figure.marks(0, x, y, name=record.name, color=color)
    return figure


def _branches(figure: Figure, panel: int, holds: tuple[Hold, ...]) -> None:
    styles = {"start": ("circle", "solid"), "compression": ("triangle-up", "dot"), "rebound": ("triangle-down", "dash")}
    for direction, (symbol, dash) in styles.items():
        found = [hold for hold in holds if hold.direction == direction]
        if found:
            x, y = np.array([hold.displacement for hold in found]), np.array([hold.force for hold in found])
            name = "first hold" if direction == "start" else f"reached in {direction}"
            figure.marks(panel, x, y, name=name, color=_HOLD, symbol=symbol, dash=dash)


def _static(case: Case) -> StaticValidation:
    assert isinstance(case.outcome, StaticValidation)
    return case.outcome
