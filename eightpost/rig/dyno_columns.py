"""Columns of dynamometer files: recognition of channels by usual names, and the choice among several columns."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator
from typing import TYPE_CHECKING

from eightpost.rig.plausibility_rules import CHOSEN_COLUMN, COMMANDED
from eightpost.signals.channel_map import TIME_NAMES, ChannelMap, MappedChannel
from eightpost.units import compatible, is_unit

if TYPE_CHECKING:
    from collections.abc import Mapping

    from eightpost.signals.raw_record import RawRecord
    from eightpost.verdict import Reason

#: SI unit of each channel of a dynamometer test.
DYNO_UNITS = {"velocity": "m/s", "force": "N", "displacement": "m", "temperature": "K"}
_SI = {**DYNO_UNITS, "time": "s", "length": "m"}

#: Column names by channel, in lower case and reduced to letters: English, German, French, Italian, Spanish,
#: Portuguese, Dutch, Swedish, Japanese, Chinese and Korean.
#: Files use `F` and `T` in upper and lower case.
_ALIASES = {
    "time": {*TIME_NAMES, "elapsedtime", "elapsed", "timeelapsed", "runtime", "testtime", "xvalue", "sec",
             "runningtime", "millis", "milliseconds", "msec", "micros", "microseconds", "seconds", "datetime",
             "temps", "tempo", "tiempo", "tijd", "tid", "\u6642\u9593", "\u65f6\u95f4", "\uc2dc\uac04"},
    "velocity": {
        "velocity", "vel", "v", "shockvelocity", "shaftvelocity", "dampervelocity", "pistonvelocity", "speed",
        "shaftspeed", "geschwindigkeit", "geschw", "vitesse", "velocita", "velocidad", "velocidade",
        "snelheid", "hastighet", "\u901f\u5ea6", "\uc18d\ub3c4",
    },
    "force": {"force", "f", "load", "loadcell", "shockforce", "damperforce", "axialforce", "shaftforce", "kraft",
              "effort", "forza", "fuerza", "carga", "carico", "forca", "kracht",
              "\u8377\u91cd", "\u529b", "\u8f7d\u8377", "\ud558\uc911"},
    "displacement": {
        "displacement", "disp", "displ", "x", "d", "position", "pos", "travel", "stroke", "linearpot",
        "stringpot", "shocktravel", "dampertravel",
        "shockposition", "damperposition", "pot", "lvdt", "weg", "deplacement", "course", "spostamento", "corsa",
        "desplazamiento", "deslocamento", "curso", "verplaatsing", "slag", "forskjutning", "\u4f4d\u79fb",
        "\ubcc0\uc704", "\u5909\u4f4d", "\u30b9\u30c8\u30ed\u30fc\u30af",
    },
    "temperature": {
        "temperature", "temp", "t", "thermocouple",
        "shocktemperature", "bodytemperature", "dampertemperature", "tempc", "tempf",
        "temperatur", "temperatura", "temperatuur", "\u6e29\u5ea6", "\uc628\ub3c4",
    },
    "length": {"length", "totallength", "eyetoeye", "eyetoeyelength", "lange", "longueur"},
}  # fmt: skip

#: Words that qualify a column, and how much less than one without such a word it is preferred.
_QUALIFIERS = {
    "measured": 0, "meas": 0, "actual": 0, "act": 0, "fbk": 0, "feedback": 0, "shock": 0, "damper": 0, "axial": 0,
    "ch": 0, "channel": 0,
    "ai": 0, "raw": 1, "filtered": 2, "filt": 2, "fil": 2, "smoothed": 2, "smooth": 2, "avg": 2, "calc": 3,
    "calculated": 3, "derived": 3, "command": 9, "cmd": 9, "setpoint": 9, "target": 9, "demand": 9, "desired": 9,
    "reference": 9, "ref": 9, "volts": 8, "voltage": 8, "v": 8,
}  # fmt: skip


#: Qualifiers of this value are those of a command.
_COMMAND = 9

#: A factor in a name, as in `Force/10`: the column is not the quantity itself.
_ARITHMETIC = re.compile(r"[*/^\u00d7]\s*\(?\s*[-+]?\d")


def dyno_map(record: RawRecord, channel_map: ChannelMap | None = None) -> ChannelMap:
    """Return the channel map of a dynamometer record: the given map, completed by columns with usual names.

    If several columns could be a channel, one without a qualifying word is preferred to a raw, a filtered and a
    commanded one, and the first of equals is used. A motion has the number of the force if there is one (`Disp 2` and
    `Force 2`). A column in volts is used only if there is no other. A column named `T` is the temperature, unless it is
    the only column that can be the time. A name with a factor (`Force/10`) is not a usual name.

    Args:
        record: Columns of the file.
        channel_map: Columns that the caller named; they take precedence.

    Raises:
        FileFormatError: A column that the caller named is not unique.
    """
    given = channel_map or ChannelMap()
    for name, pick in given.channels.items():
        record.check_unique(pick.source, channel=name)
    taken = {pick.source for pick in given.channels.values()} | ({given.time.source} if given.time else set())
    time = given.time or _first(_candidates(record, "time", taken))
    taken |= {time.source} if time else set()
    ranked = {name: _candidates(record, name, taken) for name in DYNO_UNITS if name not in given.channels}
    force = given.channels.get("force") or _first(ranked["force"])
    found = {name: _first(_of_one_number(names, force)) for name, names in ranked.items()}
    channels = {name: pick for name, pick in found.items() if pick} | dict(given.channels)
    if "displacement" not in channels and (lengths := _candidates(record, "length", taken)):
        channels["displacement"] = _of_length(record, lengths[0])
    return ChannelMap(channels, time, given.path)


def _of_length(record: RawRecord, name: str) -> MappedChannel:
    """Return the displacement of a shock whose length was measured: 0 in the middle of the stroke."""
    lengths = record.columns[record.names.index(name)]
    middle = 0.0 if lengths.dtype == object or not lengths.size else 0.5 * float(lengths.min() + lengths.max())
    return MappedChannel(name, gain=-1.0, offset=middle)


def length_note(mapping: ChannelMap) -> tuple[str, ...]:
    """Return how the displacement was found if the length was measured; nothing otherwise."""
    pick = mapping.channels.get("displacement")
    if pick is None or not is_named(pick.source, "length"):
        return ()
    return (f"displacement from {pick.source!r}: the shock is compressed where it is short, and 0 is the mid-stroke",)


def with_channels(channel_map: ChannelMap | None, columns: Mapping[str, str]) -> ChannelMap | None:
    """Return a channel map in which some channels are read from given columns, by channel name."""
    if not columns:
        return channel_map
    given = channel_map or ChannelMap()
    picks = {name: MappedChannel(source) for name, source in columns.items()}
    time = picks.pop("time", given.time)
    return ChannelMap({**given.channels, **picks}, time, given.path)


def choice_reasons(record: RawRecord, mapping: ChannelMap, given: ChannelMap | None, origin: str) -> Iterator[Reason]:
    """Yield a reason for each channel for which one of several possible columns, or only a command, was found."""
    for name in ("displacement", "velocity", "force"):
        if name not in mapping.channels or (given is not None and name in given.channels):
            continue
        used = mapping.channels[name].source
        if is_command(used, name):
            figure = f"{used!r} was read, because there is no measured one"
            remedy = f"export the measured {name}, or confirm with --channel {name}='{used}'"
            yield COMMANDED.reason(f"the {name} is not a measurement", figure=figure, origin=origin, remedy=remedy)
        taken = {pick.source for other, pick in mapping.channels.items() if other != name}
        others = [column for column in _candidates(record, name, taken) if column != used]
        if others:
            figure = f"{used!r} was read, and not {', '.join(map(repr, others))}"
            remedy = f"read another column with --channel {name}='{others[0]}', or confirm with '{used}'"
            yield CHOSEN_COLUMN.reason(f"several columns could be the {name}", figure=figure, origin=origin,
                                       remedy=remedy)  # fmt: skip


def _of_one_number(names: list[str], force: MappedChannel | None) -> list[str]:
    """Return the columns that have the number of the force in their names, or all if no name has it."""
    number = re.search(r"\d+$", force.source) if force else None
    return [name for name in names if number and re.search(rf"(?<!\d){number[0]}$", name)] or names


def _first(names: list[str]) -> MappedChannel | None:
    return MappedChannel(names[0]) if names else None


def _candidates(record: RawRecord, channel: str, taken: set[str]) -> list[str]:
    """Return the columns that can be a channel, best first."""
    si = _SI[channel]
    ranked = []
    for i, (name, unit) in enumerate(zip(record.names, record.units, strict=True)):
        rank = _rank(name, channel)
        if name in taken or rank is None:
            continue
        if unit is not None and not (is_unit(unit) and compatible(unit, si)):
            if channel == "temperature" and is_unit(unit):
                continue
            rank += 100  # for a message about its unit if there is no other column
        ranked.append((rank, i, name))
    ranked.sort()
    if channel == "time":
        ranked = [entry for entry in ranked if entry[2] != "T" or (len(ranked) == 1 and not _is_heat(record, "T"))]
    usable = [entry for entry in ranked if entry[0] < 100] or ranked[:1]
    return [name for _, _, name in usable]


def _rank(name: str, channel: str) -> int | None:
    """Return how far a column's name is from a usual name of a channel; None if it is not a name of it."""
    aliases = _ALIASES[channel]
    if _ARITHMETIC.search(name):
        return None
    plain_name = _without_accents(name)
    if "".join(re.findall(r"[^\W\d_]", plain_name)) in aliases:
        return 0
    words = re.findall(r"[^\W\d_]+", plain_name)
    plain = [word for word in words if word not in _QUALIFIERS]
    if plain and len(plain) < len(words) and "".join(plain) in aliases:
        return 1 + max(_QUALIFIERS[word] for word in words if word in _QUALIFIERS)
    return None


def is_named(name: str, channel: str) -> bool:
    """Return whether a name is a usual one of a channel."""
    return _rank(name, channel) is not None


def is_command(name: str, channel: str) -> bool:
    """Return whether a column's name calls it a command, a target or a reference of a channel."""
    return (_rank(name, channel) or 0) > _COMMAND


def has_channels(mapping: ChannelMap) -> bool:
    """Return whether a channel map has the time, the force and a motion."""
    found = set(mapping.channels)
    return mapping.time is not None and "force" in found and bool(found & {"velocity", "displacement"})


def _without_accents(name: str) -> str:
    """Return a name in lower case without accents: `D\u00e9placement` -> `deplacement`."""
    letters = unicodedata.normalize("NFKD", name.lower())
    return unicodedata.normalize("NFKC", "".join(one for one in letters if one not in _ACCENTS))


#: Combining grave, acute, circumflex, tilde, diaeresis, ring and cedilla.
_ACCENTS = "\u0300\u0301\u0302\u0303\u0308\u030a\u0327"


def _is_heat(record: RawRecord, name: str) -> bool:
    """Return whether a column has a temperature unit."""
    unit = record.units[record.names.index(name)]
    return unit is not None and is_unit(unit) and compatible(unit, "K")
