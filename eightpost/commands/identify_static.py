"""The static part of `eightpost identify`: records with held loads give the car's static state (6.4.4)."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from rich.table import Table

from eightpost.ident.preparation import Decimation, Preparation, prepare
from eightpost.ident.vehicle.static_rating import rate_statically
from eightpost.rig.post.modes import MODES
from eightpost.units import convert

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console

    from eightpost.ident.vehicle.experiment import Experiment
    from eightpost.ident.vehicle.static_rating import StaticRating
    from eightpost.rig.post import RigTest
    from eightpost.signals import TimeSeries

#: Sampling rate to which static records are decimated [Hz].
_RATE = 125.0


def with_static_state(console: Console, experiment: Experiment, tests: Sequence[RigTest]) -> Experiment:
    """Return the experiment with the tire forces and ride heights of static tests at zero load, and print them.

    Raises:
        InputError: The tests have no held load levels.
    """
    loads = [name for name in experiment.rig if name.rpartition(".")[2] != "road"]
    rating = rate_statically([_with_means(test) for test in tests], loads)
    static = {name: value for name, value in rating.zero.items() if name in experiment.outputs}
    _show(console, rating, static)
    return replace(experiment, static=static)


def _with_means(test: RigTest) -> TimeSeries:
    prepared = prepare([test], Preparation(Decimation(_RATE)))
    series = prepared.records[0]
    for name, mean in prepared.means[0].items():
        series = series.with_channel(name, series.unit(name), series[name] + mean)
    return series


def _show(console: Console, rating: StaticRating, static: dict[str, float]) -> None:
    tires = [f"{n.rpartition('.')[0]} {convert(v, 'N', 'lbf'):.0f}" for n, v in static.items() if "tire" in n]
    heights = [f"{n.rpartition('.')[0]} {convert(v, 'm', 'in'):.3f}" for n, v in static.items() if "height" in n]
    lifted = f" ({rating.lifted} more left out, at which a tire carries no load)" if rating.lifted else ""
    text = f"static state at zero load, from {rating.levels} levels{lifted}: tires {', '.join(tires)} lbf"
    console.print(f"{text}; ride heights {', '.join(heights)} in" if heights else text, highlight=False, soft_wrap=True)
    if rating.modal is not None and rating.unexplained is not None:
        console.print(_spring_table(rating))
        left = ", ".join(f"{100.0 * part:.1f}" for part in rating.unexplained)
        console.print(f"unexplained part of each aeroloader's force: {left} %", highlight=False, soft_wrap=True)


def _spring_table(rating: StaticRating) -> Table:
    """Return the table of Eq 6.11: a row for each mode's force, in the units of the dissertation."""
    assert rating.modal is not None
    force = [convert(1.0, "N", "lbf"), *[convert(1.0, "N.m", "lbf.ft")] * 3]
    moved = [convert(1.0, "m", "in"), *[convert(1.0, "rad", "deg")] * 3]
    table = Table("", title="spring matrix, 1e3 lbf and lbf.ft per in and deg (Eq 6.11)")
    for mode in MODES:
        table.add_column(mode, justify="right")
    for mode, row, unit in zip(MODES, rating.modal, force, strict=True):
        table.add_row(mode, *(f"{1e-3 * value * unit / step:.2f}" for value, step in zip(row, moved, strict=True)))
    return table
