"""Recorded channels for display: in display units, sorted into panels by quantity and unit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf, isfinite

from cosim.study.measures import DISPLAY
from eightpost import units
from eightpost.signals import TimeSeries

#: Okabe and Ito's colours, which colour-blind readers can distinguish, without the yellow, which is too light on white.
COLORS = ("#0072b2", "#d55e00", "#009e73", "#8e5a9b", "#56b4e9", "#e69f00", "#4d4d4d", "#a6374f")

#: Dash styles, which distinguish lines of the same colour.
DASHES = ("solid", "dash", "dot", "dashdot")

#: Number of panels that are open at first, and of lines that each of them draws at first: one per colour.
_OPEN, _DRAWN = 5, len(COLORS)


@dataclass(frozen=True, slots=True)
class Scale:
    """Conversion from SI to the unit on the axis: `shown = factor * value + offset`."""

    si: str
    unit: str
    factor: float
    offset: float

    @property
    def squared(self) -> tuple[str, str]:
        """Square of the unit on the axis, and of the SI unit, for power spectral densities."""
        return _squared(self.unit), _squared(self.si)

    @classmethod
    def of(cls, si: str) -> Scale:
        """Return the scale of an SI unit."""
        unit = DISPLAY.get(si, si)
        return cls(si, unit, *units.conversion(si, unit))

    def __call__(self, value: float) -> float:
        """Return the value in the unit on the axis."""
        return self.factor * value + self.offset


@dataclass(frozen=True, slots=True)
class Statistics:
    """Statistics of a channel after settling, in its SI unit.

    Args:
        name: Name of the channel.
        scale: Conversion to the display unit.
        mean: Mean.
        rms: Root mean square about the mean.
        least: Minimum.
        greatest: Maximum.
        error: Stated coupling error in percent of `rms`; None if it is not known.
    """

    name: str
    scale: Scale
    mean: float
    rms: float
    least: float
    greatest: float
    error: float | None

    @property
    def deviation(self) -> float:
        """Stated error in the SI unit, root mean square; 0 if it is not known."""
        return 0.01 * (self.error or 0.0) * self.rms


@dataclass(frozen=True, slots=True)
class Line:
    """One channel: its row in the series, its colour and dashes, and whether it is drawn at first."""

    row: int
    name: str
    color: str
    dash: str
    drawn: bool


@dataclass(frozen=True, slots=True)
class Panel:
    """Channels of one quantity and unit on common axes."""

    quantity: str
    scale: Scale
    lines: tuple[Line, ...]
    opened: bool


def panels(series: TimeSeries) -> tuple[Panel, ...]:
    """Sort channels into panels by the last part of their name and their unit, in the order of the series."""
    members: dict[tuple[str, str], list[int]] = {}
    for row, (name, unit) in enumerate(zip(series.names, series.units, strict=True)):
        members.setdefault((name.rpartition(".")[2], unit), []).append(row)
    return tuple(
        Panel(quantity, Scale.of(unit), _lines(series, rows), opened=k < _OPEN)
        for k, ((quantity, unit), rows) in enumerate(members.items())
    )


def statistics(series: TimeSeries, stated: Mapping[str, float]) -> tuple[Statistics, ...]:
    """Return the statistics of each channel, with the error that the run states for it [%]."""
    return tuple(
        Statistics(
            name,
            Scale.of(unit),
            *(float(row.mean()), float(row.std()), float(row.min()), float(row.max())),
            error=stated[name] if isfinite(stated.get(name, inf)) else None,
        )
        for name, unit, row in zip(series.names, series.units, series.values, strict=True)
    )


def _lines(series: TimeSeries, rows: Sequence[int]) -> tuple[Line, ...]:
    return tuple(
        Line(row, series.names[row], COLORS[k % len(COLORS)], DASHES[k // len(COLORS) % len(DASHES)], drawn=k < _DRAWN)
        for k, row in enumerate(rows)
    )


def _squared(unit: str) -> str:
    """Return `m²` of `m`, `(m/s)²` of `m/s`."""
    return "1" if unit == "1" else f"{unit}²" if unit.isalpha() else f"({unit})²"
