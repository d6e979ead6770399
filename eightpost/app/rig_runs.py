"""Records of rig runs for a study: they need no other channels than its measures."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.markup import escape

from eightpost.display import some

if TYPE_CHECKING:
    from eightpost.app.options import Channels
    from eightpost.signals import TimeSeries


def record_reader(console: Console, channels: Channels) -> Callable[[Path], TimeSeries]:
    """Return a function that reads and checks the channels of a rig record, whichever it has.

    It prints which channels the checks of sign and corner do not cover.
    """
    from eightpost.rig.post import read_rig_test

    def read(file: Path) -> TimeSeries:
        test = read_rig_test(file, **channels.options, needs=())
        if test.unchecked:
            console.print(
                f"[yellow]note[/] {escape(str(file))}: sign and corner of {some(test.unchecked)} were not checked, "
                "because the record lacks the channels that show them",
                highlight=False,
                soft_wrap=True,
            )
        return test.series

    return read
