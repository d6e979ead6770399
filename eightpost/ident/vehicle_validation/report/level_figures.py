"""Plots of levels: trends and correlation (Figs 6.27, 6.28), sines (Fig 6.30), static levels (Fig 6.32)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eightpost.ident.validation.report.figure import COLORS, MEASURED, Axis, Figure, Panel, grid
from eightpost.ident.vehicle_validation.comparison import quantity

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eightpost.ident.vehicle_validation.findings import Limits
    from eightpost.ident.vehicle_validation.sine import SineOutput
    from eightpost.ident.vehicle_validation.study import Case, VehicleValidation
    from eightpost.ident.vehicle_validation.trends import Trend

_COLUMNS = 3

#: Number of outputs of a static record that are plotted, counted from the last: tire forces and ride heights.
_STATIC = 6


def trend_figure(trends: Sequence[Trend]) -> Figure:
    """Return a plot of the measured and predicted RMS of each record, with a panel for each output (Fig 6.27)."""
    number = np.arange(1.0, len(trends[0].measured) + 1.0)
    panels = [
        Panel(Axis("record"), Axis("RMS", one.unit), *place, title=f"{one.name}: rank {_rank(one)}")
        for one, place in zip(trends, grid(len(trends), _COLUMNS, gap=(0.08, _gap(len(trends)))), strict=True)
    ]
    caption = "RMS of each random record, in the order of the table of records, as in Fig 6.27."
    figure = Figure(caption, _height(len(trends)), panels)
    for k, one in enumerate(trends):
        figure.line(k, number, one.measured, name="measured", color=MEASURED)
        figure.marks(k, number, one.predicted, name="predicted", color=COLORS[0])
    return figure


def correlation_figure(trends: Sequence[Trend]) -> Figure:
    """Return a plot of predicted over measured RMS with the line of equality, a panel for each output (Fig 6.28)."""
    panels = [
        Panel(Axis("measured RMS", one.unit), Axis("predicted", one.unit), *place, title=_titled(one))
        for one, place in zip(trends, grid(len(trends), _COLUMNS, gap=(0.08, _gap(len(trends)))), strict=True)
    ]
    caption = "Predicted over measured RMS of the random records, as in Fig 6.28; the line is equality."
    figure = Figure(caption, _height(len(trends)), panels)
    for k, one in enumerate(trends):
        both = np.concatenate((one.measured, one.predicted))
        ends = np.array([both.min(), both.max()])
        figure.line(k, ends, ends, name="equality", color=MEASURED, dash="dot")
        figure.dots(k, one.measured, one.predicted, name="records", color=COLORS[0], size=8)
    return figure


def sine_figure(cases: Sequence[Case]) -> Figure:
    """Return a plot of gain and phase of the predicted fundamental, a line for each quantity's worst output."""
    rows = [(case.record.frequency or 0.0, case.sines) for case in cases if case.sines]
    rows.sort(key=lambda row: row[0])
    x = Axis("frequency [Hz]", kind="log")
    places = grid(3, 3, gap=(0.07, 0.0))
    titles = ("predicted / measured amplitude", "phase lead of predicted [degrees]", "measured: not sinusoidal [%]")
    panels = [Panel(x, Axis(""), *place, title=title) for place, title in zip(places, titles, strict=True)]
    figure = Figure("Sine records: for each quantity the output with the worst gain at each frequency.", 330, panels)
    figure.level(0, 1.0)
    figure.level(1, 0.0)
    names = sorted({quantity(one.name) for _, sines in rows for one in sines})
    for name, color in zip(names, COLORS * len(names), strict=False):
        found = [(frequency, _worst(sines, name)) for frequency, sines in rows]
        points = [(frequency, one) for frequency, one in found if one is not None]
        frequency = np.array([f for f, _ in points])
        figure.marks(0, frequency, np.array([one.gain for _, one in points]), name=name, color=color)
        figure.marks(1, frequency, np.degrees([one.phase for _, one in points]), name=name, color=color)
        figure.marks(2, frequency, np.array([100.0 * one.harmonics for _, one in points]), name=name, color=color)
    return figure


def static_figure(case: Case) -> Figure:
    """Return a plot of tire forces and ride heights during the holds of a static record."""
    shown = case.holds[-_STATIC:]
    panels = [
        Panel(Axis("load", "N"), Axis("change", one.unit), *place, title=one.name)
        for one, place in zip(shown, grid(len(shown), _COLUMNS, gap=(0.08, _gap(len(shown)))), strict=True)
    ]
    caption = (
        f"{case.record.name}: levels minus their means, as in Fig 6.32. Friction causes loops in the measured ones."
    )
    figure = Figure(caption, _height(len(shown)), panels)
    for k, one in enumerate(shown):
        figure.marks(k, one.load, one.measured, name="measured", color=MEASURED)
        figure.marks(k, one.load, one.predicted, name="predicted", color=COLORS[0])
    return figure


def level_figure(study: VehicleValidation, limits: Limits) -> Figure:
    """Return an overview plot of RMS errors and errors, with a point for each output of each record."""
    places = grid(2, 2, gap=(0.08, 0.0))
    titles = ("RMS predicted minus measured [%]", "error [% of measured RMS]")
    cases = [case for case in study.cases if case.outputs and not case.is_gentle]
    panels = [Panel(Axis("record"), Axis(""), *place, title=title) for place, title in zip(places, titles, strict=True)]
    figure = Figure(
        "All judged outputs, records numbered as in the table. Dotted: limits; that of RMS is for random records.",
        330,
        panels,
    )
    for panel, value in ((0, limits.level), (0, -limits.level), (1, limits.error)):
        figure.level(panel, 100.0 * value)
    names = sorted({quantity(one.name) for case in cases for one in case.judged})
    for name, color in zip(names, COLORS * len(names), strict=False):
        found = [
            (study.cases.index(c) + 1.0, 100.0 * o.level, 100.0 * o.error)
            for c in cases
            for o in c.judged
            if quantity(o.name) == name
        ]
        number, level, error = np.array(found).T
        figure.dots(0, number, level, name=name, color=color, size=7)
        figure.dots(1, number, error, name=name, color=color, size=7)
    return figure


def _worst(sines: Sequence[SineOutput], name: str) -> SineOutput | None:
    found = [one for one in sines if quantity(one.name) == name]
    return max(found, key=lambda one: abs(one.gain - 1.0), default=None)


def _rank(trend: Trend) -> str:
    return "–, flat" if trend.is_flat else f"{trend.rank:.2f}"


def _titled(trend: Trend) -> str:
    return f"{trend.name}: level {100 * trend.bias:+.2g} %"


def _height(count: int) -> int:
    return 110 + 205 * (-(-count // _COLUMNS))


def _gap(count: int) -> float:
    """Return the gap between rows [1] that corresponds to 60 px, for a title and a label."""
    return 60.0 / (205.0 * (-(-count // _COLUMNS)))
