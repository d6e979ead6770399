"""Figures of sine records: the map of the error, the error over frequency (Fig 3.20), and the loops (Fig 3.21)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eightpost.ident.validation.report.figure import COLORS, MEASURED, Axis, Figure, Panel, grid
from eightpost.ident.validation.study import names_of
from eightpost.ident.validation.tables import sine
from eightpost.units import convert

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from eightpost.ident.validation.sine import Loop
    from eightpost.ident.validation.study import Case

    Array = NDArray[np.float64]

#: Number of loops in a figure and in a row, and number of points of a loop.
_LOOPS, _COLUMNS, _POINTS = 15, 5, 160

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
        _draw(figure, k, sine(cases[0]).measured, over, ("measured", MEASURED))
        for case, name, color in zip(cases, names_of(cases), COLORS * len(cases), strict=False):
            _draw(figure, k, sine(case).predicted, over, (name, color))
    return figure


def _draw(figure: Figure, panel: int, loop: Loop, over: str, style: tuple[str, str]) -> None:
    kept = np.linspace(0, loop.force.size - 1, min(_POINTS, loop.force.size)).astype(int)
    name, color = style
    figure.line(panel, getattr(loop, over)[kept], loop.force[kept], name=name, color=color)
