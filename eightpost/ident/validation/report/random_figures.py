"""Figures of random records: force over velocity, force and error over time, the residual's coherence and spectrum."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eightpost.ident.validation.random import RandomValidation
from eightpost.ident.validation.report.figure import COLORS, MEASURED, Axis, Figure, Panel
from eightpost.ident.validation.study import names_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.ident.validation.record import Record
    from eightpost.ident.validation.study import Case

    Array = NDArray[np.float64]

#: Number of dots of a record and of points of a line; more would only fill the page.
_DOTS, _POINTS = 3000, 500

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
    return inside[:: max(1, inside.size // _POINTS)]
