"""Columns of records by the names that files give them: what each is, which are read, and what the others tell.

Names are recognised in eleven languages. A column that cannot be read and is not needed never prevents the reading of a
file; a column that is not read is still searched for a setting that changes during the run.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from eightpost.array_types import Array
from eightpost.corners import CORNERS
from eightpost.errors import DataError, FileFormatError, UnknownUnitError
from eightpost.rig.faults import Fault, fault
from eightpost.signals.raw_record import TIME_NAMES, ChannelMap, MappedChannel, bridge_of
from eightpost.signals.table_text import is_number, letters_of
from eightpost.units import compatible, convert, is_unit

if TYPE_CHECKING:
    from pathlib import Path

    from eightpost.signals.raw_record import RawRecord
    from eightpost.signals.timeseries import TimeSeries


# ---- Channels of a dynamometer file, and the choice among several columns -------------------------------------------

#: SI unit of each channel of a dynamometer test.
DYNO_UNITS = {"velocity": "m/s", "force": "N", "displacement": "m", "temperature": "K"}
_SI = {**DYNO_UNITS, "time": "s", "length": "m"}
#: Column names by channel, in lower case and reduced to letters: English, German, French, Italian, Spanish,
#: Portuguese, Dutch, Swedish, Japanese, Chinese and Korean.
#: Files use `F` and `T` in upper and lower case.
_NAMES = """
time: elapsedtime elapsed timeelapsed runtime testtime xvalue sec runningtime millis milliseconds msec micros
  microseconds seconds datetime temps tempo tiempo tijd tid \u6642\u9593 \u65f6\u95f4 \uc2dc\uac04
velocity: velocity vel v shockvelocity shaftvelocity dampervelocity pistonvelocity speed shaftspeed geschwindigkeit
  geschw vitesse velocita velocidad velocidade snelheid hastighet \u901f\u5ea6 \uc18d\ub3c4
force: force f load loadcell shockforce damperforce axialforce shaftforce kraft effort forza fuerza carga carico forca
  kracht \u8377\u91cd \u529b \u8f7d\u8377 \ud558\uc911
displacement: displacement disp displ x d position pos travel stroke linearpot stringpot shocktravel dampertravel
  shockposition damperposition pot lvdt weg deplacement course spostamento corsa desplazamiento deslocamento curso
  verplaatsing slag forskjutning \u4f4d\u79fb \ubcc0\uc704 \u5909\u4f4d \u30b9\u30c8\u30ed\u30fc\u30af
temperature: temperature temp t thermocouple shocktemperature bodytemperature dampertemperature tempc tempf temperatur
  temperatura temperatuur \u6e29\u5ea6 \uc628\ub3c4
length: length totallength eyetoeye eyetoeyelength lange longueur
"""
_ALIASES = {name: {*words.split()} for name, words in re.findall(r"(\w+): ([^:]+)(?=\n\w+:|\n$)", _NAMES)}
_ALIASES["time"] |= {*TIME_NAMES}

#: Words that qualify a column, and how much less than one without such a word it is preferred.
_QUALIFIERS = {
    "measured": 0, "meas": 0, "actual": 0, "act": 0, "fbk": 0, "feedback": 0, "shock": 0, "damper": 0, "axial": 0,
    "ch": 0, "channel": 0,
    "ai": 0, "raw": 1, "filtered": 2, "filt": 2, "fil": 2, "smoothed": 2, "smooth": 2, "avg": 2, "calc": 3,
    "calculated": 3, "derived": 3, "command": 9, "cmd": 9, "setpoint": 9, "target": 9, "demand": 9, "desired": 9,
    "reference": 9, "ref": 9, "volts": 8, "voltage": 8, "v": 8,
}  # fmt: skip


_COMMAND = 9  #: Qualifiers of this value are those of a command.
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
    number = re.search(r"\d+$", force.source) if force else None
    of_number = re.compile(rf"(?<!\d){number[0]}$" if number else "")
    found = {name: _first(list(filter(of_number.search, names)) or names) for name, names in ranked.items()}
    channels = {name: pick for name, pick in found.items() if pick} | dict(given.channels)
    if "displacement" not in channels and (length := _first(_candidates(record, "length", taken))):
        values = record.column(record.names.index(length.source))  # the displacement is 0 in the middle of the stroke
        middle = 0.0 if values.dtype == object or not values.size else 0.5 * float(values.min() + values.max())
        channels["displacement"] = replace(length, gain=-1.0, offset=middle)
    return ChannelMap(channels, time, given.path)


def length_note(mapping: ChannelMap) -> tuple[str, ...]:
    """Return how the displacement was found if the length was measured; nothing otherwise."""
    pick = mapping.channels.get("displacement")
    if pick is None or not is_named(pick.source, "length"):
        return ()
    return (f"displacement from {pick.source!r}: the shock is compressed where it is short, and 0 is the mid-stroke",)


def with_channels(channel_map: ChannelMap | None, columns: Mapping[str, str]) -> ChannelMap | None:
    """Return a channel map in which some channels are read from given columns, by channel name.

    The entries `time` and `bridge` stand for the column of the time and for `ChannelMap.bridge`.
    """
    if not columns:
        return channel_map
    given = channel_map or ChannelMap()
    picks = {name: MappedChannel(source) for name, source in columns.items() if name != "bridge"}
    time, bridge = picks.pop("time", given.time), bridge_of(columns.get("bridge", given.bridge))
    return ChannelMap({**given.channels, **picks}, time, given.path, bridge)


def flips_of(path: Path, flips: Mapping[str, Iterable[str]]) -> tuple[str, ...]:
    """Return the channels to reverse in a file, by the name of a file; those of an empty name are of all files."""
    named = (name for key in ("", str(path), path.name, path.stem) for name in flips.get(key, ()))
    return tuple(dict.fromkeys(named))


def choice_faults(record: RawRecord, mapping: ChannelMap, given: ChannelMap | None) -> Iterator[Fault]:
    """Yield a fault for each channel for which one of several possible columns, or only a command, was found."""
    for name in ("displacement", "velocity", "force"):
        if name not in mapping.channels or (given is not None and name in given.channels):
            continue
        used = mapping.channels[name].source
        if is_command(used, name):
            figure = f"{used!r} was read, because there is no measured one"
            remedy = f"export the measured {name}, or confirm with --channel {name}='{used}'"
            yield fault("a command instead of a measurement", f"the {name} is not a measurement", figure, remedy)
        taken = {pick.source for other, pick in mapping.channels.items() if other != name}
        others = [column for column in _candidates(record, name, taken) if column != used]
        if others:
            figure = f"{used!r} was read, and not {', '.join(map(repr, others))}"
            remedy = f"read another column with --channel {name}='{others[0]}', or confirm with '{used}'"
            yield fault("one of several columns", f"several columns could be the {name}", figure, remedy)


def _first(names: list[str]) -> MappedChannel | None:
    return MappedChannel(names[0]) if names else None


def _is_unit_of(unit: str | None, *quantities: str) -> bool:
    """Return whether a column has a unit of one of the quantities, which are named by their SI units."""
    return bool(unit) and is_unit(unit or "") and any(compatible(unit or "", si) for si in quantities)


def _candidates(record: RawRecord, channel: str, taken: set[str]) -> list[str]:
    """Return the columns that can be a channel, best first."""
    si = _SI[channel]
    ranked = []
    for i, (name, unit) in enumerate(zip(record.names, record.units, strict=True)):
        rank = _rank(name, channel)
        if name in taken or rank is None:
            continue
        if unit is not None and not _is_unit_of(unit, si):
            if channel == "temperature" and is_unit(unit):
                continue
            rank += 100  # for a message about its unit if there is no other column
        ranked.append((rank, i, name))
    ranked.sort()
    if channel == "time":
        is_time = len(ranked) == 1 and not _is_unit_of(record.units[ranked[0][1]], "K")
        ranked = [entry for entry in ranked if entry[2] != "T" or is_time]
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


# ---- Columns that must not prevent reading, and further columns of time ---------------------------------------------

FEWEST = 10  #: Minimum number of temperatures in a column with empty cells.
SAME_TIME = 0.01  #: Largest difference of two columns of time that are the same, in median steps.

_IS_COMMAND = "it is a command, not a measurement"
_EMPTY, _CONSTANT = _DEAD = ("it is empty", "it is constant")


def with_readable_columns(
    record: RawRecord, given: ChannelMap | None, units: Mapping[str, str]
) -> tuple[RawRecord, ChannelMap, tuple[Fault, ...]]:
    """Return a record and a channel map without columns that cannot be read and are not needed, and their faults.

    A displacement is not needed beside a velocity, nor the reverse, nor one of several columns that could be a channel.
    Columns that the caller named are kept, and so is what is needed, for a message about its fault. Empty cells between
    temperatures are interpolated: it is often logged more slowly than the force.
    """
    named = set(given.channels) if given is not None else set()
    faults: list[Fault] = []
    while True:
        mapping = dyno_map(record, given)
        for name, pick in mapping.channels.items():
            if name in named or pick.source not in record.names:
                continue
            why = _unreadable(record, name, pick, units)
            smaller = _without(record, pick.source)
            if why and _is_complete(smaller, given, units, mapping):
                is_dead = why in _DEAD and name != "temperature" and name not in dyno_map(smaller, given).channels
                rule = "a dead channel" if is_dead else "a column that was not read"
                faults.append(fault(rule, f"the column {pick.source!r} was not read", why))
                record = smaller
                break
        else:
            return _with_filled_temperature(record, mapping), mapping, tuple(faults)


def _is_complete(smaller: RawRecord, given: ChannelMap | None, units: Mapping[str, str], whole: ChannelMap) -> bool:
    """Return whether a record without a column has all that is needed, and still a measured motion if there was one."""
    mapping = dyno_map(smaller, given)
    named = set(given.channels) if given is not None else set()
    readable = {
        name: pick
        for name, pick in mapping.channels.items()
        if name in named or _unreadable(smaller, name, pick, units) in ("", _IS_COMMAND)
    }
    usable = replace(mapping, channels=readable)
    return has_channels(_measured(usable)) or (has_channels(usable) and not has_channels(_measured(whole)))


def _measured(mapping: ChannelMap) -> ChannelMap:
    """Return a channel map without commands."""
    channels = {name: pick for name, pick in mapping.channels.items() if not is_command(pick.source, name)}
    return replace(mapping, channels=channels)


def _unreadable(record: RawRecord, channel: str, pick: MappedChannel, units: Mapping[str, str]) -> str:
    """Return why a column cannot be read as a channel; empty if it can, or if its samples may be repaired."""
    if pick.source not in record.names:
        return ""  # an error names it
    place = record.names.index(pick.source)
    unit = pick.unit or units.get(channel) or units.get(pick.source) or record.units[place]
    if unit is None and channel == "force":  # the file may have the unit elsewhere: an error asks for it
        return ""
    if unit is None:
        return f"it has no unit; give it in the header or with --channel '{channel}=[unit]'"
    if not _is_unit_of(unit, DYNO_UNITS[channel]):
        return f"its unit {unit!r} is not one of a {channel}"
    if is_command(pick.source, channel):
        return _IS_COMMAND
    return _fault_of_samples(record.column(place), channel)


def _fault_of_samples(column: NDArray[Any], channel: str) -> str:
    if column.dtype == object:
        is_damaged = channel == "temperature" or not any(is_number(str(cell)) for cell in column)
        return "it contains words" if is_damaged else ""
    known = column[np.isfinite(column)]
    if channel == "temperature":
        return f"{known.size} numbers" if known.size < min(FEWEST, column.size) else ""
    if not known.size:
        return _EMPTY
    if known.size == column.size and np.ptp(column) == 0.0:
        return _CONSTANT
    return "it is a magnitude, without a sign" if channel == "velocity" and known.min() >= 0.0 else ""


def _without(record: RawRecord, source: str) -> RawRecord:
    """Return a record without a column."""
    kept = [i for i, name in enumerate(record.names) if name != source]
    names, units = tuple(record.names[i] for i in kept), tuple(record.units[i] for i in kept)
    return replace(record, names=names, units=units, columns=tuple(record.columns[i] for i in kept))


def _with_filled_temperature(record: RawRecord, mapping: ChannelMap) -> RawRecord:
    """Return a record without empty cells between its temperatures."""
    pick = mapping.channels.get("temperature")
    if pick is None or pick.source not in record.names:
        return record
    place = record.names.index(pick.source)
    values = record.column(place)
    if values.dtype == object or not (known := np.isfinite(values)).any():
        return record
    rows = np.arange(values.size)
    return record.with_column(place, np.interp(rows, rows[known], values[known]))


def check_one_time(record: RawRecord, mapping: ChannelMap, given: ChannelMap | None) -> None:
    """Raise a FileFormatError if a channel stands behind a column of time that differs from the one that is read.

    Tables side by side, and channels with a time of their own, repeat the column of time. It applies to the columns
    behind it, up to the next one. A column of time that the caller named is not questioned.
    """
    is_named = given is not None and given.time is not None
    if is_named or mapping.time is None or mapping.time.source not in record.names:
        return
    used = record.names.index(mapping.time.source)
    name = _bare(mapping.time.source)
    units = enumerate(zip(record.names, record.units, strict=True))
    times = [i for i, (one, unit) in units if _bare(one) == name and (unit is None or _is_unit_of(unit, "s"))]
    for channel, pick in mapping.channels.items():
        place = record.names.index(pick.source) if pick.source in record.names else -1
        own = max((i for i in times if i < place), default=used)
        if own != used and not _is_same(record, used, own):
            what = (
                f"the column {pick.source!r} stands behind the time {record.names[own]!r}, which differs from "
                f"{record.names[used]!r}; export the channels with one time, or delete the other table"
            )
            raise record.origin.header_fault(FileFormatError, what, channel=channel)


def _bare(name: str) -> str:
    """Return a name without case, number and marks: `t (2)` and `T` are `t`."""
    return letters_of(name) or name


def _is_same(record: RawRecord, first: int, second: int) -> bool:
    try:
        values = [_seconds(record, place) for place in (first, second)]
    except DataError:
        return False
    step = float(np.median(np.abs(np.diff(values[0])))) if values[0].size > 1 else 0.0
    return bool(np.abs(values[0] - values[1]).max(initial=0.0) <= SAME_TIME * step)  # False if there is a NaN


def _seconds(record: RawRecord, place: int) -> Array:
    unit = record.units[place]
    values = record.numbers(place, channel="time")
    return convert(values, unit, "s") if unit is not None else values


# ---- Columns that are not read, such as a setting that changes during the run ---------------------------------------

#: Columns that count or describe samples and not the shock, in lower case and reduced to letters.
_COUNTERS = (
    "index", "sample", "count", "cycle", "point", "row", "number", "date", "clock", "time", "step", "stroke", "scan",
    "direction", "id", "phase", "event", "events",
)  # fmt: skip
#: Units of measured motion, force and temperature: such a column is another sensor, not a setting.
_MEASURED = ("m", "m/s", "m/s2", "N", "K", "s", "rad", "Hz", "Pa", "N.m", "W", "J")
_CONTROL = ("V", "A")  #: Units of a control, which may vary all the time.
#: Number of parts of a record, minimum relative change, and minimum share of the variance between the parts.
PARTS, CHANGE, BETWEEN = 24, 0.02, 0.8
#: Largest share of the variance within two levels, and share of the variance that slow changes of a control have.
WITHIN, SLOW = 0.1, 0.9
#: Correlation with a channel that is read, from which a column is the same sensor; with time, that of a counter.
SAME, COUNTER = 0.9, 0.9999
NAMED, TEXTS = 4, 8  #: Number of times that are named, and of values of a column of texts.


def column_faults(record: RawRecord, mapping: ChannelMap, series: TimeSeries) -> Iterator[Fault]:
    """Yield a fault for each column that is not read and changes during the record."""
    used = {pick.source for pick in mapping.channels.values()} | ({mapping.time.source} if mapping.time else set())
    for place, (name, unit) in enumerate(zip(record.names, record.units, strict=True)):
        if name in used or _is_sensor(name, unit) or record.columns[place].size != series.time.size:
            continue
        column = record.column(place)
        is_control, is_text = _is_unit_of(unit, *_CONTROL), column.dtype == object
        figure = _text_change(column, series.time) if is_text else _change(column, series, is_control=is_control)
        if figure:
            figure += f" [{unit}]" if unit else ""
            yield fault("another column changes", f"the column {name!r} changes during the run", figure)


def _is_sensor(name: str, unit: str | None) -> bool:
    letters = letters_of(name)
    is_counter = any(letters.startswith(word) or letters.endswith(word) for word in _COUNTERS)
    return is_counter or "temp" in letters or _is_unit_of(unit, *_MEASURED)


def _change(column: Array, series: TimeSeries, *, is_control: bool) -> str:
    """Return a figure if a column (N,) changes its level, drifts, or (a control) varies; empty otherwise."""
    values, time = np.asarray(column, dtype=np.float64), series.time
    if not float(np.ptp(values)) > CHANGE * float(np.abs(values).max()) or _is_known(values, series):  # or NaN
        return ""
    low, high = np.quantile(values, [0.02, 0.98])
    upper = values > 0.5 * (low + high)
    changes = np.flatnonzero(np.diff(upper)) + 1
    turns = int(np.count_nonzero(np.diff(np.sign(series["velocity"]))))
    within = sum(float(values[side].var()) * np.count_nonzero(side) for side in (upper, ~upper) if side.any())
    if changes.size and within < WITHIN * values.var() * values.size and 2 * changes.size < max(turns, 4):
        return f"between {values[~upper].mean():.4g} and {values[upper].mean():.4g} at {_times(time[changes])}"
    parts = np.array_split(values, PARTS)
    means = np.array([part.mean() for part in parts])
    if np.mean([part.var() for part in parts]) <= (1.0 - BETWEEN) * values.var():
        at = int(np.argmax(np.abs(np.diff(means)))) + 1
        where = time[min(at * values.size // PARTS, values.size - 1)]
        return f"from {means[0]:.4g} to {means[-1]:.4g}, largest change near {where:.4g} s"
    if is_control and np.diff(values).var() < 2.0 * (1.0 - SLOW) * values.var():
        return f"all the time between {low:.4g} and {high:.4g}"
    return ""


def _is_known(values: Array, series: TimeSeries) -> bool:
    """Return whether values (N,) count the samples, or are those of a channel that is read in another unit."""
    if np.corrcoef(values, series.time)[0, 1] > COUNTER:
        return True
    known = [series[name] for name in ("velocity", "displacement", "force") if name in series]
    return any(abs(np.corrcoef(values, row)[0, 1]) > SAME for row in known)


def _times(times: Array) -> str:
    more = f" and {times.size - NAMED} more times" if times.size > NAMED else ""
    return ", ".join(f"{time:.4g} s" for time in times[:NAMED]) + more


def _text_change(column: NDArray[Any], time: Array) -> str:
    """Return a figure if a column of texts (N,) has two to eight values, each for a long part of the record."""
    texts = [str(cell).strip() for cell in column]
    changes = [i for i in range(1, len(texts)) if texts[i] != texts[i - 1]]
    if not 1 <= len(changes) <= TEXTS or len(set(texts)) > TEXTS:
        return ""
    return f"from {texts[0]!r} to {texts[changes[0]]!r} at {_times(time[changes])}"


# ---- Columns of a rig record with a team's own names, and a proposed channel map ------------------------------------

#: Words for a corner and for an axle, in lower case.
_CORNER = {"lf": "lf", "fl": "lf", "vl": "lf", "rf": "rf", "fr": "rf", "vr": "rf",
           "lr": "lr", "rl": "lr", "hl": "lr", "rr": "rr", "hr": "rr"}  # fmt: skip
_AXLE = {"front": "front", "frt": "front", "rear": "rear"}
_SIDES = {("front", "left"): "lf", ("front", "right"): "rf", ("rear", "left"): "lr", ("rear", "right"): "rr"}
#: Words for the part that a sensor belongs to, and the channel of each SI unit there; the first part that fits applies.
_PARTS: tuple[tuple[Collection[str], Mapping[str, str]], ...] = (
    ({"al", "aero", "aeroloader", "downforce"}, {"m": "aero_position", "N": "aero"}),
    ({"rh", "ride", "rideheight"}, {"m": "ride_height"}),
    ({"damper", "shock", "dmp", "pot"}, {"m": "displacement", "N": "force", "m/s": "velocity"}),
    ({"body", "chassis", "frame", "sprung", "tower"}, {"m/s2": "chassis_acceleration"}),
    ({"hub", "upright", "unsprung", "axle", "wheel"}, {"m/s2": "hub_acceleration", "N": "tire_force"}),
    ({"wl", "loader", "wheelloader", "wheelpan", "pan", "road", "platen", "post", "shaker", "actuator", "tire", "tyre"},
     {"m": "road", "N": "tire_force"}),
)  # fmt: skip

#: Words for the SI unit of a column without a unit.
_QUANTITIES = {
    "m": {"pos", "position", "disp", "displacement", "travel", "stroke", "height", "pot"},
    "N": {"load", "force", "fz"},
    "m/s": {"vel", "velocity", "speed"},
    "m/s2": {"acc", "accel", "acceleration"},
}
_COMMAND_WORDS = {"cmd", "command", "demand", "target"}
_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")
_FEWEST = 2  #: Number of columns at each corner from which a file looks like a rig record.


@dataclass(frozen=True, slots=True)
class ProposedMap:
    """Columns of a file that look like channels of a rig."""

    columns: Mapping[str, tuple[str, ...]]  #: Columns that each channel could be, by channel.
    time: str  #: Column of the time; empty if none has a usual name.
    per_corner: int  #: Minimum number of columns at a corner.

    @property
    def finding(self) -> str:
        """What the file looks like, as a clause."""
        return f"looks like a rig record: it has {self.per_corner} or more columns at each corner"

    def toml(self) -> str:
        """Return the proposal as a channel map; if several columns could be a channel, they are comments."""
        lines = ["[time]", f'source = "{self.time}"', "", "[channels]"]
        for name, columns in self.columns.items():
            lines += [f'{"# " * (len(columns) > 1)}"{name}" = {{ source = "{column}" }}' for column in columns]
        return "\n".join(lines)


def propose_map(record: RawRecord) -> ProposedMap | None:
    """Return what the columns of a rig record look like, by the words in their names and their units.

    None if the file does not look like a rig record: it needs two columns at each of the four corners.
    """
    found: dict[str, tuple[str, ...]] = {}
    counts = dict.fromkeys(CORNERS, 0)
    for column, unit in zip(record.names, record.units, strict=True):
        words = [word.lower() for word in _WORD.findall(column)]
        axle = next((_AXLE[word] for word in words if word in _AXLE), "")
        side = next((word for word in words if word in ("left", "right")), "")
        corner = _SIDES.get((axle, side)) or next((_CORNER[word] for word in words if word in _CORNER), "")
        if corner:
            counts[corner] += 1
        kind = _kind({*words}, unit)
        if place := axle if kind == "ride_height" else corner:
            name = f"{place}.{kind}{'_command' * bool(_COMMAND_WORDS & {*words} and kind in ('road', 'aero'))}"
            found |= {name: (*found.get(name, ()), column)} if kind else {}
    if min(counts.values()) < _FEWEST:
        return None
    return ProposedMap(found, next((n for n in record.names if n.lower() in TIME_NAMES), ""), min(counts.values()))


def _kind(words: Collection[str], unit: str | None) -> str:
    """Return the quantity of a channel that words and unit of a column stand for; empty if none."""
    try:
        by_unit = [si for si in _QUANTITIES if unit and compatible(unit, si)]
    except UnknownUnitError:
        by_unit = []
    si = next(iter(by_unit or [si for si, names in _QUANTITIES.items() if names & {*words}]), "")
    return next((kinds[si] for part, kinds in _PARTS if {*part} & {*words} and si in kinds), "")
