"""Option --channel: columns, units and signs of the channels of records."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from eightpost.app.options import MAPS, UNITS, option

if TYPE_CHECKING:
    from eightpost.signals import ChannelMap


@dataclass(frozen=True, slots=True)
class Channels:
    """Columns, units and signs of the channels of a record, as the command line states them."""

    channel_map: ChannelMap | None = None
    units: Mapping[str, str] = field(default_factory=dict)
    flip: tuple[str, ...] = ()  #: Channels to reverse in all files; `none` confirms the signs as recorded.
    of_files: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  #: Channels to reverse, by name of a file.

    @property
    def options(self) -> dict[str, Any]:
        """Return the arguments of the functions that read records; the signs of single files are in `flips`."""
        return {"channel_map": self.channel_map, "units": dict(self.units), "flip": self.flip}

    @property
    def flips(self) -> dict[str, tuple[str, ...]]:
        """Return the channels to reverse by name of a file; those of all other files have an empty name."""
        return {**self.of_files, **({"": self.flip} if self.flip else {})}

    @property
    def record_options(self) -> dict[str, Any]:
        """Return the arguments of the functions that read several records, each with its own signs."""
        return {**self.options, "flip": self.flips}

    def of(self, file: Path) -> dict[str, Any]:
        """Return the arguments of the functions that read a file."""
        from eightpost.rig.columns import flips_of

        return {**self.options, "flip": flips_of(file, self.flips)}

    @property
    def is_stated(self) -> bool:
        """Return whether the command line states anything."""
        return self != Channels()


class _ChannelText(click.ParamType):  # type: ignore[type-arg]
    """`[FILE:]CHANNEL=[-]COLUMN [UNIT]`, or a TOML file with a channel map."""

    name = "channel"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return a channel map, or file, channel, sign, column and unit."""
        if not isinstance(value, str):
            return value
        from eightpost.units import is_unit

        name, equals, column = value.partition("=")
        if not equals and value.lower().endswith(".toml"):
            from eightpost.signals import ChannelMap

            if ctx:
                ctx.meta.setdefault(MAPS, []).append(Path(value))
            return ChannelMap.read(Path(value))
        if not (name and column):
            self.fail(
                f"{value!r}: write CHANNEL=COLUMN, CHANNEL='-COLUMN [UNIT]' or the name of a .toml file", param, ctx
            )
        file, _, channel = name.rpartition(":")
        sign = column[0] if column in ("+", "-") or column[0] == "-" else ""
        source, unit = column.removeprefix(sign).strip(), None
        bracket = re.fullmatch(r"(.*?)\s*\[([^\]]+)\]", source)
        if bracket and (not bracket[1] or is_unit(bracket[2])):
            source, unit = bracket.groups()
        return file, channel, sign, source, unit

    @staticmethod
    def merged(ctx: click.Context | None, _param: click.Parameter | None, values: Sequence[Any]) -> Channels:
        """Return all values of the option as one object."""
        maps = [value for value in values if not isinstance(value, tuple)]
        stated = [value for value in values if isinstance(value, tuple)]
        channel_map, columns = (
            (maps[-1] if maps else None),
            {name: source for _, name, _, source, _ in stated if source},
        )
        if columns:
            from eightpost.rig.columns import with_channels

            channel_map = with_channels(channel_map, columns)
        of_files: dict[str, tuple[str, ...]] = {}
        for file, name, sign, _, _ in stated:
            if sign == "-":
                of_files[file] = (*of_files.get(file, ()), name)
        is_confirmed = any(sign == "+" for _, _, sign, _, _ in stated)
        flip = of_files.pop("", ("none",) if is_confirmed else ())
        units = {name: unit for _, name, _, _, unit in stated if unit}
        if ctx:
            ctx.meta.setdefault(UNITS, []).extend(units.values())
        return Channels(channel_map, units, flip, of_files)


#: Option --channel of the verbs that read records.
CHANNELS: Any = option(
    "Column, sign and unit of a channel whose header lacks them: force='Load 2', force=3 (in a file without a header), "
    "force=- (the opposite sign; force=+ confirms that of the file), 'force=[lbf]', or all: 'force=-Load 2 [lbf]'; "
    "for one file run7.csv:force=-. bridge=20: up to 20 samples in a row that are NaN or empty become a straight line. "
    "A .toml file is a channel map (docs/reference/signs_and_units.md). May be repeated.",
    "--channel", kind=_ChannelText(), metavar="CHANNEL=COLUMN|MAP.TOML",
)  # fmt: skip
