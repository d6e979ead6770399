"""Naming of a record's columns by choosing from lists; the choice is a channel map that the terminal reads, too."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from nicegui import ui

from eightpost.corners import CORNERS
from eightpost.files import write_text
from eightpost.window.folder import quoted
from eightpost.window.parts import Window

if TYPE_CHECKING:
    from eightpost.signals.raw_record import RawRecord

#: Quantities of a corner, with what people call them.
_CORNER = {
    "road": "wheelloader position", "tire_force": "wheelloader load", "force": "shock force",
    "displacement": "shock displacement", "velocity": "shock velocity", "aero": "aeroloader load",
    "hub_acceleration": "hub acceleration", "chassis_acceleration": "chassis acceleration",
}  # fmt: skip

#: Channels of a rig record in the order of the lists, and of a dynamometer record.
RIG = (*(f"{corner}.{name}" for name in _CORNER for corner in CORNERS), "front.ride_height", "rear.ride_height")
DYNO = ("force", "displacement", "velocity")


Columns = tuple["RawRecord", Mapping[str, str]]


def columns_of(record: Path) -> Columns:
    """Return a record as it is in its file, and the column of each rig channel that only one could be.

    Raises:
        FileFormatError: The file cannot be read.
    """
    from eightpost.rig.columns import propose_map
    from eightpost.signals import read_records

    raw = read_records(record)[0]
    proposal = propose_map(raw)
    return raw, {name: found[0] for name, found in proposal.columns.items() if len(found) == 1} if proposal else {}


def name_channels(
    window: Window, columns: Columns, channels: Sequence[str], path: Path, done: Callable[[], Awaitable[None]]
) -> None:
    """Show a list for each channel, from which its column is chosen, and its sign."""
    raw, guess = columns
    record = Path(raw.origin.path or "")
    labels = {name: f"{name} [{unit}]" if unit else name for name, unit in zip(raw.names, raw.units, strict=True)}
    lists, signs = {}, {}
    with ui.card().classes("w-full channels"):
        ui.label(f"Which column of {record.name} is which channel?").classes("text-base")
        with ui.grid(columns=max(1, min(4, len(channels)))).classes("w-full"):
            for channel in channels:
                with ui.row().classes("items-center no-wrap"):
                    choice = ui.select({"": "-", **labels}, label=_title(channel), value=guess.get(channel, ""))
                    lists[channel] = choice.classes("channel").props(f'dense options-dense data-channel="{channel}"')
                    signs[channel] = ui.checkbox("-").tooltip("reverse the sign: compression, up and load are positive")
                    signs[channel].props(f'dense aria-label="reverse {channel}"')

        async def keep() -> None:
            columns = {name: choice.value for name, choice in lists.items() if choice.value}
            write_map(path, columns, {name for name, sign in signs.items() if sign.value})
            window.folder.read_as(record, map=window.folder.name(path))
            await done()

        ui.button("Use these channels", on_click=keep).props("no-caps")


def write_map(path: Path, columns: Mapping[str, str], reversed_channels: set[str]) -> None:
    """Write a channel map."""
    lines = []
    for channel, column in columns.items():
        lines += [f"[channels.{quoted(channel)}]", f"source = {quoted(column)}"]
        lines += ["gain = -1.0", ""] if channel in reversed_channels else [""]
    write_text(path, "\n".join(lines))


def _title(channel: str) -> str:
    place, _, quantity = channel.rpartition(".")
    return f"{place} {_CORNER.get(quantity, quantity.replace('_', ' '))}".strip()
