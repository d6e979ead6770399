"""Self-contained HTML page of a validation of shocks, for the screen and for print: its sections and its figures."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from eightpost.array_types import Array
from eightpost.ident.validation import shocks as tables
from eightpost.ident.validation.records import DynoRecord
from eightpost.ident.validation.shock_tests import (
    BumpEvent,
    BumpValidation,
    Hold,
    Loop,
    RandomValidation,
    StaticValidation,
)
from eightpost.ident.validation.shocks import ShockCase, ShockValidation, names_of, notes_on, shock_verdict
from eightpost.report.charts import COLORS, MEASURED, Axis, Figure, Panel, grid_figure
from eightpost.report.page import Block, Section, digest, document, soft, write_page
from eightpost.report.tables import NONE, ResultTable
from eightpost.signals import TimeSeries
from eightpost.units import convert

# ---- Sections -------------------------------------------------------------------------------------------------------

_LOW_PASS = (
    "Errors are of forces through the record's zero-phase low-pass, the same for measurement and prediction (3.3); 50 "
    "Hz, for bumps 200 Hz, unless another cutoff frequency was given."
)


def write_shock_page(
    path: str | Path, study: ShockValidation, *, limit: float | None = None, title: str = "Shock validation"
) -> Path:
    """Write a validation of shocks as an interactive page; an existing file is replaced only when it is complete.

    Names of shocks, records and files are escaped.

    Returns:
        Path of the written file.
    """
    return write_page(path, document(title, shock_verdict(study, limit), list(_shock_sections(study))))


def _shock_sections(study: ShockValidation) -> Iterator[Section]:
    random, static, bump = (study.of_kind(kind) for kind in ("random", "static", "bump"))
    if random:
        drawn = [_random_figure(*found) for found in random]
        yield Section("random", "Random records", [tables.random_table(study), *drawn])
    if groups := tables.sine_groups(study):
        blocks: list[Block] = [tables.sine_table(rows) for rows in groups]
        yield Section("sine", "Sine records", [*blocks, *(one for rows in groups for one in _sine_figures(rows))])
        details: list[Block] = [table for rows in groups for table in tables.loop_tables(rows)]
        details += [figure for rows in groups for figure in _all_loops(rows, "displacement")]
        yield Section("loops", "Loops: hysteresis, energy, peaks", details, folded=True)
    if static:
        drawn = [_overlay(static)] * (len(static) > 1) + [_static_figure(*found) for found in static]
        yield Section("static", "Static records", [tables.static_table(study), *drawn])
    if bump:
        drawn = [_bump_figure(*found) for found in bump]
        yield Section("bump", "Bump records", [tables.bump_table(study), *drawn])
    yield Section("notes", "Notes", [notes_on(study)] if notes_on(study) else [])
    records = (
        (one.name, one.kind, one.reason, one.test.source.name if one.test.source else NONE, digest(one.digest))
        for one in study.records
    )  # fmt: skip
    shocks = (
        (label, shock.law_name, shock.fit.get("recipe", NONE),
         Markup("<br>").join(entry.get("name", NONE) for entry in shock.inputs) or NONE,
         digest(*(entry.get("sha256", NONE) for entry in shock.inputs)) or NONE)
        for label, shock in study.shocks.items()
    )  # fmt: skip
    blocks = [
        ResultTable.of("", ("record", "kind", "reason", "file", "SHA-256"), records),
        ResultTable.of("", ("shock", "law", "recipe", "fitted to", "SHA-256 of that record"), shocks),
        soft(_LOW_PASS),
    ]
    yield Section("what", "What was validated", blocks, folded=True)


# ---- Parts of figures -----------------------------------------------------------------------------------------------

_FORCE, _TIME, _FREQUENCY = Axis("force", "N"), Axis("time [s]"), Axis("frequency [Hz]")
_WHOLE = (0.0, 1.0)

#: Number of points of a line over time or velocity; more would only fill the page.
_POINTS = 500


def _styled(cases: tuple[ShockCase, ...]) -> Iterator[tuple[ShockCase, str, str]]:
    """Return each case of a record with the name and the colour of its shock."""
    return zip(cases, names_of(cases), COLORS * len(cases), strict=False)


def _some(inside: NDArray[np.intp]) -> NDArray[np.intp]:
    return inside[:: max(1, inside.size // _POINTS)]


# ---- Random records -------------------------------------------------------------------------------------------------

#: Number of dots of a record.
_DOTS = 3000

#: Duration of the traces over time, around the highest speed, and of the loop; a longer one would hide the dots [s].
_SPAN, _LOOP = 1.0, 0.25

_RANDOM = (
    Panel(Axis("velocity", "m/s"), _FORCE, (0.0, 0.3), _WHOLE, "force over velocity"),
    Panel(_TIME, _FORCE, (0.37, 0.67), (0.6, 1.0), "force"),
    Panel(_TIME, Axis("error", "N"), (0.37, 0.67), (0.0, 0.39), "error, measured minus predicted"),
    Panel(_FREQUENCY, Axis("", span=(0.0, 1.03)), (0.74, 1.0), (0.6, 1.0), "coherence of error and velocity"),
    Panel(_FREQUENCY, Axis("density", "N2/Hz", "log"), (0.74, 1.0), (0.0, 0.39), "spectrum of the error"),
)


def _random_figure(record: DynoRecord, cases: tuple[ShockCase, ...]) -> Figure:
    """Return the figure of a random record with all its shocks."""
    caption = (
        f"{record.name}: force over velocity, the record as dots and a quarter of a second of each prediction as a "
        "loop; one second of force and error; coherence of the error with the velocity, significant (5 %) above the "
        "dotted line; spectrum of the error below that of the measured force."
    )
    figure = Figure(caption, 470, _RANDOM)
    first = cases[0].outcome_as(RandomValidation)
    measured = first.prediction.measured
    every = max(1, len(measured) // _DOTS)
    figure.dots(0, measured["velocity"][::every], measured["force"][::every], name="measured")
    here = _liveliest(measured.time, measured["velocity"], _SPAN)
    loop = _liveliest(measured.time, measured["velocity"], _LOOP)
    time = measured.time[here]
    figure.line(1, time, measured["force"][here], name="measured", color=MEASURED)
    for case, name, color in _styled(cases):
        found = case.outcome_as(RandomValidation)
        predicted = found.prediction.predicted["force"]
        figure.line(0, measured["velocity"][loop], predicted[loop], name=name, color=color)
        figure.line(1, time, predicted[here], name=name, color=color)
        figure.line(2, time, found.prediction.error[here], name=name, color=color)
        if found.residual:
            figure.line(3, found.residual.frequency, found.residual.coherence, name=name, color=color)
            figure.line(4, found.residual.frequency, found.residual.error, name=name, color=color)
    if first.residual:
        figure.level(3, first.residual.threshold)
        figure.line(4, first.residual.frequency, first.residual.measured, name="measured", color=MEASURED)
    return figure


def _liveliest(time: Array, velocity: Array, span: float) -> NDArray[np.intp]:
    """Return the samples of a span [s] around the highest speed, at most about 500."""
    middle = float(time[np.argmax(np.abs(velocity))])
    start = min(max(middle - 0.5 * span, float(time[0])), max(float(time[-1]) - span, float(time[0])))
    return _some(np.flatnonzero((time >= start) & (time <= start + span)))


# ---- Sine records ---------------------------------------------------------------------------------------------------

#: Number of loops in a figure and in a row, and number of points of a loop.
_LOOPS, _COLUMNS, _LOOP_POINTS = 15, 5, 160

#: Amplitudes within this share of each other are one group, because the actuator does not follow its command exactly.
_ALIKE = 0.1


def _sine_figures(rows: list[tuple[ShockCase, ...]]) -> Iterator[Figure]:
    """Return the figures of the sine records of one damper.

    Each row has the cases of a record, with the same shocks in the same order.
    """
    if any(len(group) > 1 for group in _amplitudes(rows).values()):
        yield _over_frequency(rows)
    yield from _all_loops(rows, "velocity")


def _all_loops(rows: list[tuple[ShockCase, ...]], over: str) -> Iterator[Figure]:
    """Yield the figures of the loops over velocity or displacement."""
    for start in range(0, len(rows), _LOOPS):
        yield _loops(rows[start : start + _LOOPS], over)


def _over_frequency(rows: list[tuple[ShockCase, ...]]) -> Figure:
    """Return the error over frequency, with a panel for each amplitude (Fig 3.20)."""
    groups = _amplitudes(rows)
    x, y = Axis("frequency [Hz]", kind="log"), Axis("RMS error", "N")
    caption = "RMS error over frequency at each amplitude, as Fig 3.20."
    height = 320 if len(groups) <= 5 else 600
    figure = grid_figure(caption, height, [(x, y, title) for title in groups], min(len(groups), 5), gap=(0.06, 0.22))
    for k, group in enumerate(groups.values()):
        frequency = np.array([cases[0].sine.frequency for cases in group])
        order = np.argsort(frequency)
        for i, (_, name, color) in enumerate(_styled(rows[0])):
            errors = np.array([cases[i].outcome.rms for cases in group])
            figure.marks(k, frequency[order], errors[order], name=name, color=color)
    return figure


def _amplitudes(rows: list[tuple[ShockCase, ...]]) -> dict[str, list[tuple[ShockCase, ...]]]:
    """Return the records by amplitude, the largest first."""
    groups: list[list[tuple[ShockCase, ...]]] = []
    for cases in sorted(rows, key=lambda cases: -cases[0].sine.amplitude):
        if groups and cases[0].sine.amplitude > (1.0 - _ALIKE) * groups[-1][0][0].sine.amplitude:
            groups[-1].append(cases)
        else:
            groups.append([cases])
    return {_length(group[0][0].sine.amplitude): group for group in groups}


def _length(amplitude: float) -> str:
    return f"{convert(amplitude, 'm', 'in'):.2g} in ({1e3 * amplitude:.2g} mm)"


def _loops(rows: list[tuple[ShockCase, ...]], over: str) -> Figure:
    """Return the last period of each record as force over velocity or displacement, measured and predicted."""
    columns = min(len(rows), _COLUMNS)
    unit = "m/s" if over == "velocity" else "m"
    panels = []
    for k, cases in enumerate(rows):
        found = cases[0].sine
        x, y = over if k >= len(rows) - columns else "", "force" if k % columns == 0 else ""
        title = f"{_length(found.amplitude).partition(' (')[0]}, {found.frequency:.3g} Hz"
        panels.append((Axis(x, unit), Axis(y, "N"), title))
    height = {1: 300, 2: 460}.get(-(-len(rows) // columns), 640)
    caption = f"Hysteresis loops, force over {over}: the last period of each sine."
    figure = grid_figure(caption, height, panels, columns, gap=(0.055, 0.13))

    def draw(panel: int, loop: Loop, name: str, color: str) -> None:
        kept = np.linspace(0, loop.force.size - 1, min(_LOOP_POINTS, loop.force.size)).astype(int)
        figure.line(panel, getattr(loop, over)[kept], loop.force[kept], name=name, color=color)

    for k, cases in enumerate(rows):
        draw(k, cases[0].sine.measured, "measured", MEASURED)
        for case, name, color in _styled(cases):
            draw(k, case.sine.predicted, name, color)
    return figure


# ---- Static records -------------------------------------------------------------------------------------------------

#: Number of points of a trace over time.
_TRACE = 1500

#: Colour of the holds, and symbol and line of those reached in each direction.
_HOLD = "#4b5563"
_BRANCHES = {
    "start": ("circle", "solid"),
    "compression": ("triangle-up", "dot"),
    "rebound": ("triangle-down", "dash"),
}

_STATIC = (
    Panel(_TIME, _FORCE, (0.0, 0.52), (0.36, 1.0), "force"),
    Panel(_TIME, Axis("displacement", "m"), (0.0, 0.52), (0.0, 0.2)),
    Panel(Axis("displacement", "m"), _FORCE, (0.6, 1.0), _WHOLE, "force at the holds"),
)


def _static_figure(record: DynoRecord, cases: tuple[ShockCase, ...]) -> Figure:
    """Return the figure of a static record: its traces, and its holds with each law's gas force."""
    caption = (
        f"{record.name}: the averaged times are shaded. The distance between the directions is twice the seal drag; "
        "a law's drag is a function of velocity, so at rest it predicts the gas force alone."
    )
    figure = Figure(caption, 430, _STATIC)
    first = cases[0].outcome_as(StaticValidation)
    series = first.series
    kept = np.linspace(0, len(series) - 1, min(_TRACE, len(series))).astype(int)
    for panel, channel in ((0, "force"), (1, "displacement")):
        figure.line(panel, series.time[kept], series[channel][kept], name="measured", color=MEASURED)
    for hold in first.holds:
        figure.band(0, hold.start, hold.stop)
    for direction, (symbol, dash) in _BRANCHES.items():
        if found := [hold for hold in first.holds if hold.direction == direction]:
            name = "first hold" if direction == "start" else f"reached in {direction}"
            figure.marks(2, *_points(found), name=name, color=_HOLD, symbol=symbol, dash=dash)
    for case, name, color in _styled(cases):
        holds = sorted(case.outcome_as(StaticValidation).holds, key=lambda hold: hold.displacement)
        figure.line(2, _points(holds)[0], np.array([hold.predicted for hold in holds]), name=name, color=color)
    return figure


def _overlay(found: tuple[tuple[DynoRecord, tuple[ShockCase, ...]], ...]) -> Figure:
    """Return the measured holds of several static records in one figure, relative to the first hold (Fig 3.23)."""
    x, y = Axis("displacement from the first hold", "m"), Axis("force from the first hold", "N")
    caption = "Force over displacement of all static records, relative to the first hold of each, as Fig 3.23."
    figure = Figure(caption, 420, (Panel(x, y, _WHOLE, _WHOLE),))
    for (record, cases), color in zip(found, COLORS * len(found), strict=False):
        displacement, force = _points(cases[0].outcome_as(StaticValidation).holds)
        figure.marks(0, displacement - displacement[0], force - force[0], name=record.name, color=color)
    return figure


def _points(holds: list[Hold] | tuple[Hold, ...]) -> tuple[Array, Array]:
    """Return displacements [m] and measured forces [N] of holds."""
    return np.array([hold.displacement for hold in holds]), np.array([hold.force for hold in holds])


# ---- Bump records ---------------------------------------------------------------------------------------------------


def _bump_figure(record: DynoRecord, cases: tuple[ShockCase, ...]) -> Figure:
    """Return the figure of a bump record: the fastest event of each direction in time, and all events over velocity."""
    first = cases[0].outcome_as(BumpValidation)
    motion, events = first.prediction.measured, _fastest(first.events)
    width = 0.62 / len(events)
    panels = [
        Panel(_TIME, _FORCE, (k * width, (k + 1) * width - 0.06), _WHOLE, "compression" if e.speed > 0.0 else "rebound")
        for k, e in enumerate(events)
    ]
    panels.append(Panel(Axis("velocity", "m/s"), _FORCE, (0.64, 1.0), _WHOLE, "force over velocity"))
    low_pass = f"low-pass {first.prediction.cutoff:g} Hz"
    caption = f"{record.name}: force over time and over velocity, as in Fig 3.24 and 3.25; {low_pass}."
    figure = Figure(caption, 400, panels)

    def draw(forces: TimeSeries, name: str, color: str) -> None:
        for k, event in enumerate(events):
            kept = _some(np.flatnonzero((motion.time >= event.start) & (motion.time <= event.stop)))
            figure.line(k, motion.time[kept], forces["force"][kept], name=name, color=color)
            figure.line(len(events), motion["velocity"][kept], forces["force"][kept], name=name, color=color)

    draw(motion, "measured", MEASURED)
    for case, name, color in _styled(cases):
        draw(case.outcome_as(BumpValidation).prediction.predicted, name, color)
    return figure


def _fastest(events: tuple[BumpEvent, ...]) -> list[BumpEvent]:
    """Return the fastest event in compression and the fastest in rebound, in the order of time."""
    ends = {max(events, key=lambda e: e.speed).start, min(events, key=lambda e: e.speed).start}
    return [event for event in events if event.start in ends]
