"""Bump records: force in time (Fig 3.24) and over velocity (Fig 3.25)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eightpost.ident.validation.bump import BumpValidation
from eightpost.ident.validation.report.figure import COLORS, MEASURED, Axis, Figure, Panel
from eightpost.ident.validation.study import names_of

if TYPE_CHECKING:
    from eightpost.ident.validation.bump import BumpEvent
    from eightpost.ident.validation.record import Record
    from eightpost.ident.validation.study import Case
    from eightpost.signals import TimeSeries

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
