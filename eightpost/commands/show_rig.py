"""Output of `eightpost inspect` for a rig file."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.markup import escape
from rich.table import Table

from eightpost.ident.preparation import check_lost_channels, drifts, record_lags

if TYPE_CHECKING:
    from rich.console import Console

    from eightpost.rig.post import RigTest
    from eightpost.signals import ChannelMap
    from eightpost.signals.raw_record import RawRecord


def is_rig(record: RawRecord, channel_map: ChannelMap | None) -> bool:
    """Return whether a file is a rig file: it has wheelloaders, by its own names or by a map."""
    names = {*record.names, *(channel_map.channels if channel_map else ())}
    return bool(names & {"road", "lf.road", "rf.road", "lr.road", "rr.road"})


def show_rig_test(console: Console, test: RigTest) -> bool:
    """Print channels, conditions and lags of a rig test; return whether something is suspicious.

    Raises:
        ConstantChannelError: A channel becomes constant during the record.
    """
    series = test.series
    check_lost_channels(series, test.corners, path=test.source)
    console.print(f"{series.duration:.4g} s at {series.sample_rate:.6g} Hz, corners {' '.join(test.corners) or 'one'}")
    console.print(_channel_table(test))
    known = test.conditions
    for line in (known.synthetic, known.truth, known.drivefile, ", ".join(known.shocks)):
        if line:
            console.print(escape(line))
    for note in test.derived:
        console.print(f"[yellow]note[/] {escape(note)}")
    return _show_lags(console, test)


def _channel_table(test: RigTest) -> Table:
    series = test.series
    table = Table("channel", "unit", "minimum", "maximum", "mean", "std")
    for name, unit, values in zip(series.names, series.units, series.values, strict=True):
        numbers = (values.min(), values.max(), values.mean(), values.std())
        table.add_row(name, unit, *(f"{number:.5g}" for number in numbers))
    return table


def _show_lags(console: Console, test: RigTest) -> bool:
    lags, changes = record_lags(test.series, test.corners), drifts(test.series, test.corners)
    late = [lag for lag in lags if lag.is_notable]
    for lag in lags:
        word = "[red]warning[/] " if lag.is_notable else ""
        console.print(f"{word}{escape(str(lag))}")
    if late:
        console.print("shift the channels of a late logger with delays (docs/rig_data.md)")
    for drift in changes:
        console.print(
            f"[red]warning[/] from start to end {escape(drift.channel)} falls behind {escape(drift.against)} by "
            f"{1e3 * drift.seconds:.2f} ms: a logger lost samples, or two clocks differ"
        )
    return bool(late or changes)
