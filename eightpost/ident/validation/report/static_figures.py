"""Figures of static records: force over time with the averaged parts (Fig 3.22), force over displacement (Fig 3.23)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eightpost.ident.validation.report.figure import COLORS, MEASURED, Axis, Figure, Panel
from eightpost.ident.validation.static import StaticValidation
from eightpost.ident.validation.study import names_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.ident.validation.record import Record
    from eightpost.ident.validation.static import Hold
    from eightpost.ident.validation.study import Case

    Array = NDArray[np.float64]

#: Number of points of a trace over time.
_POINTS = 1500

_HOLD = "#4b5563"

_FORCE = Axis("force", "N")


def static_figure(record: Record, cases: tuple[Case, ...]) -> Figure:
    """Return the figure of a static record: its traces, and its holds with each law's gas force."""
    panels = (
        Panel(Axis("time [s]"), _FORCE, (0.0, 0.52), (0.36, 1.0), "force"),
        Panel(Axis("time [s]"), Axis("displacement", "m"), (0.0, 0.52), (0.0, 0.2)),
        Panel(Axis("displacement", "m"), _FORCE, (0.6, 1.0), (0.0, 1.0), "force at the holds"),
    )
    caption = (
        f"{record.name}: the averaged times are shaded. The distance between the directions is twice the seal drag; "
        "a law's drag is a function of velocity, so at rest it predicts the gas force alone."
    )
    figure = Figure(caption, 430, panels)
    first = _static(cases[0])
    kept = np.linspace(0, len(first.series) - 1, min(_POINTS, len(first.series))).astype(int)
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
