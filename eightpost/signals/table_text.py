"""Texts of tables: unusual notations of numbers and times, and the names and units in headers."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from datetime import datetime
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eightpost.units import compatible, is_unit

# ==== Unusual notations: encodings, columns of spaces, thousands separators, times of day, footers ===================

#: Full-width letters, digits and marks of East Asian texts, and units in one letter; the others are rarely in tables.
_WIDE = {code: code - 0xFEE0 for code in range(0xFF01, 0xFF5F)} | {
    0x3000: " ", 0x339C: "mm", 0x339D: "cm", 0x338F: "kg", 0x33A7: "m/s",
}  # fmt: skip
_ANY_WIDE = re.compile(f"[{''.join(map(chr, _WIDE))}]")


def decoded(content: bytes) -> str:
    """Return the text of a file in UTF-8, UTF-16 (with or without byte order mark), Shift-JIS or Latin-1.

    Full-width letters and digits are replaced by the usual ones.
    """
    text = _decoded(content)
    return text.translate(_WIDE) if _ANY_WIDE.search(text) else text


def _decoded(content: bytes) -> str:
    if content[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return content.decode("utf-16", errors="replace")
    head = content[:2000]
    for encoding, zeros in (("utf-16-le", head[1::2]), ("utf-16-be", head[::2])):
        if len(head) > 20 and zeros.count(0) > 0.9 * len(zeros):
            return content.decode(encoding, errors="replace")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return _in_shift_jis(content) or content.decode("latin-1")


def _in_shift_jis(content: bytes) -> str:
    """Return a Japanese text; empty if the content has no byte that Latin-1 leaves unused, or is not Shift-JIS."""
    if not re.search(rb"[\x81-\x9f]", content):
        return ""
    try:
        text = content.decode("cp932")
    except UnicodeDecodeError:
        return ""
    return text if re.search(r"[\u3040-\u30ff\u4e00-\u9fff]{2}", text) else ""


#: A dash of a typesetter in place of the minus of a number.
_DASH = re.compile(r"(?:(?<![\w.])|(?<=[eE]))[\u2010-\u2015\u2212\ufe63](?=[\d.,])")
#: A number in parentheses, as accountants write a negative one, in a cell of its own or in a line without words.
_NEGATIVE = r"\(\s*(\d[\d.,]*(?:[eE][+-]?\d+)?)\s*\)"
_NEGATIVE_CELL = re.compile(rf"((?:^|[,;\t])\s*\"?\s*){_NEGATIVE}(?=\s*\"?\s*(?:[,;\t]|$))")
_NEGATIVE_IN_LINE = re.compile(rf"(){_NEGATIVE}")
_WORD = re.compile(r"[^\W\d_eE]")


def with_minus_signs(lines: list[str]) -> tuple[list[str], tuple[str, ...]]:
    """Return lines in which negative numbers have a minus, and a note if some were in parentheses.

    >>> with_minus_signs(["Force (2),x", "(1.5),\u22122"])[0]
    ['Force (2),x', '-1.5,-2']
    """
    lines = [line if line.isascii() else _DASH.sub("-", line) for line in lines]
    kept = [
        (_NEGATIVE_CELL if _WORD.search(line) else _NEGATIVE_IN_LINE).sub(r"\1-\2", line) if "(" in line else line
        for line in lines
    ]
    first = next((i for i, (old, new) in enumerate(zip(lines, kept, strict=True)) if old != new), None)
    return kept, () if first is None else (f"numbers in parentheses are negative, the first in line {first + 1}",)


# ---- Headers over several lines -------------------------------------------------------------------------------------

_OPEN = re.compile(r'(?:^|[;,\t])\s*"[^"]*$')
#: Lines in which a header may be, and maximum number of lines of one.
_HEADER_LINES, _MOST_LINES = 200, 12
_SPACE_AND_QUOTE = re.compile(r'(^|(?<=")[,;\t]) +(?=")')


def without_spaces_before_quotes(lines: list[str]) -> list[str]:
    """Return the lines of `"a", "b"` without the spaces before the quotes, which would become part of the cells."""
    if not any(_SPACE_AND_QUOTE.search(line) for line in lines[:_HEADER_LINES]):
        return lines
    return [_SPACE_AND_QUOTE.sub(r"\1", line) for line in lines]


def with_whole_headers(lines: list[str]) -> list[str]:
    """Return lines in which a header with line breaks in quoted cells is its last line; its other lines are empty."""
    found = list(lines)
    for i in range(min(_HEADER_LINES, len(lines))):
        if found[i].count('"') % 2 == 0 or not _OPEN.search(found[i]):
            continue
        for stop in range(i + 1, min(i + _MOST_LINES, len(lines))):
            whole = " ".join(found[i : stop + 1])
            if whole.count('"') % 2 == 0:
                # The last of its lines, so that a row of units or of numbers follows.
                found[i : stop + 1] = [*[""] * (stop - i), whole]
                break
    return found


# ---- Columns separated by spaces ------------------------------------------------------------------------------------

_PLAIN = re.compile(r"[+-]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eE][+-]?\d+)?")
_NAME_WITH_UNIT = re.compile(r"[^\s\[(]+(?:\s*[\[(][^\])]*[\])])?")


def with_tabs(lines: list[str]) -> list[str]:
    """Return the lines of a table whose columns are separated by spaces with tabs instead; other lines unchanged."""
    counts = Counter(cells for line in lines[:200] if (cells := _spaced_numbers(line)))
    if not counts:
        return lines
    kinds, often = counts.most_common(1)[0]
    if often < 0.5 * sum(bool(line.strip()) for line in lines[:200]) - 30 * all(kinds):
        return lines
    width = len(kinds)

    def tabbed(line: str) -> str:
        ways = (re.split(r"\s{2,}", line.strip()), line.split(), _NAME_WITH_UNIT.findall(line), _pairs(line))
        return next(("\t".join(cells) for cells in ways if len(cells) == width), line)

    return [tabbed(line) for line in lines]


def _spaced_numbers(line: str) -> tuple[bool, ...]:
    """Return whether each cell of a line is a number or a time; empty for a line with fewer than two, or delimiters."""
    if "\t" in line or ";" in line:
        return ()
    cells = line.split()
    found = tuple(bool(_PLAIN.fullmatch(cell)) or seconds_of(cell) is not None for cell in cells)
    has_commas = any("," in cell and (not plain or cell[-1] == ",") for cell, plain in zip(cells, found, strict=True))
    return found if sum(found) > 1 and not has_commas else ()


def _pairs(line: str) -> list[str]:
    """Return the names with units of `Time s Force N`: every second word is a unit."""
    words = line.split()
    names, units = words[::2], words[1::2]
    is_paired = len(names) == len(units) and all(is_unit(unit) and not unit.isnumeric() for unit in units)
    return [f"{name} [{unit}]" for name, unit in zip(names, units, strict=False)] if is_paired else []


# ---- Footers --------------------------------------------------------------------------------------------------------


_STATISTICS = re.compile(r"(?:max|min|mean|average|avg|total|sum|end|std|rms|peak)\b.*", re.IGNORECASE)


def without_footer(rows: Sequence[list[str]]) -> int:
    """Return the number of rows, of one or more cells each, up to the last of a table: words below it are a footer.

    A line with a word in place of its first number and numbers in all other cells is a damaged row, not a footer,
    unless the word names a statistic (`Max`, `Average`).
    """
    kinds = Counter(_kind(cells[0]) for cells in rows if any(cells))
    usual = kinds.most_common(1)[0][0] if kinds else "word"
    if usual == "word":
        return len(rows)
    last = len(rows)
    while last > 0 and (not any(rows[last - 1]) or _is_footer(rows[last - 1], usual)):
        last -= 1
    return last


def _is_footer(cells: list[str], usual: str) -> bool:
    if _kind(cells[0]) in {"number", usual}:
        return False
    has_numbers = len(cells) > 1 and all(cell and _kind(cell) != "word" for cell in cells[1:])
    return bool(_STATISTICS.fullmatch(cells[0])) or not has_numbers


_NUMBER_LIKE = re.compile(r"[+-]?[\d.,'\s]+(?:[eE][+-]?\d+)?|[+-]?(?:nan|inf)", re.IGNORECASE)


def _kind(cell: str) -> str:
    if not cell or _NUMBER_LIKE.fullmatch(cell):  # first, because most cells are numbers
        return "number"
    return "word" if seconds_of(cell) is None else "time"


# ---- Thousands ------------------------------------------------------------------------------------------------------

_GROUPED = re.compile(r"[+-]?[1-9]\d{0,2}(?:[,.'’\s]\d{3})+(?:[.,]\d+)?")
_DECIMAL_POINT = re.compile(
    r"(?:^|[;\t\"])\s*[+-]?(?:0\.\d*|\d*\.(?:\d{1,2}|\d{4,}))(?:[eE][+-]?\d+)?\s*(?=$|[;\t\"])", re.M
)


#: A quoted number whose comma is not a thousands separator: `"0,125"`, `"1250,5"`, `"12,50"`.
_QUOTED_COMMA = re.compile(r'"\s*[+-]?(?:0\d*,\d+|\d{4,},\d+|\d+,(?:\d{1,2}|\d{4,}))(?:[eE][+-]?\d+)?\s*"')


def decimal_mark(body: str, delimiter: str) -> str:
    """Return the decimal mark of a table: a comma, unless commas delimit or group and points are decimals.

    Where commas delimit, numbers in quotes have a decimal comma if one of their commas cannot separate thousands.
    """
    if delimiter == ",":
        return "," if _QUOTED_COMMA.search(body) and "." not in body else "."
    if "," not in body:
        return "."
    return "." if _DECIMAL_POINT.search(body) else ","


_THREE_DECIMALS = re.compile(r"[+-]?\d{1,3},\d{3}")


def has_three_decimals(cells: NDArray[Any]) -> bool:
    """Return whether every text (N,) is a number such as `12,573`: of thousands, small ones would have no comma."""
    return cells.size > 1 and all(_THREE_DECIMALS.fullmatch(str(cell).strip()) for cell in cells)


def numbers_with_groups(cells: NDArray[Any], decimal: str) -> NDArray[np.float64] | None:
    """Return a column of texts (N,) as numbers if some of them have thousands separators; None otherwise.

    If a cell has a comma and a point, the last of them is the decimal mark of the column.
    """
    texts = [str(cell).strip() for cell in cells]
    if not any(_GROUPED.fullmatch(text) for text in texts):
        return None
    both = next((text for text in texts if "," in text and "." in text), None)
    if both is not None:
        decimal = max(",.", key=both.rfind)
    group = r"[,'’\s]" if decimal == "." else r"[.'’\s]"
    if any(re.fullmatch(rf"[+-]?(?:0\d*|\d{{4,}}){group}\d+", text) for text in texts):
        return None  # a mark after a leading zero or after four digits is a decimal mark
    grouped = re.compile(rf"[+-]?\d{{1,3}}(?:{group}\d{{3}})+(?:\{decimal}\d*)?")
    plain = [re.sub(group, "", text) if grouped.fullmatch(text) else text for text in texts]
    if any(text and not _PLAIN.fullmatch(text) for text in plain):
        return None
    if decimal == "." and any("," in text for text in plain):
        return None
    return np.array([float(text.replace(",", ".")) if text else np.nan for text in plain])


# ---- Times of day and dates -----------------------------------------------------------------------------------------

#: Months as words: English, German, French, Italian, Spanish, Portuguese and Dutch, abbreviated or not.
_MONTH = (
    r"(?:jan|feb|f[ée]v|fev|m[aä]r|maa|mrt|apr|avr|abr|ma[iyg]|mei|jui?n|giu|jui?l|lug|aug|ao[uû]|ago|se[pt]t?|oct|okt|"
    r"ott|out|nov|de[czs]|d[ée]c|dic|gen|ene)[^\W\d_]*\.?"
)
#: A day before a time of day. It only matters past midnight, which the times show, so its order need not be known.
_DAY_BEFORE = (
    r"(?:\d{1,2}[./-]\d{1,2}[./-](?:\d{4}|\d{2})|\d{4}[./]\d{1,2}[./]\d{1,2}|"
    rf"(?:[^\W\d_]{{2,10}}\.?,? +)?(?:\d{{1,2}}[ .-]+{_MONTH}[ .,-]+\d{{2,4}}|{_MONTH}[ -]+\d{{1,2}}[ ,-]+\d{{4}}))"
    r"[ T,]+(?=\d{1,2}:\d{2}:)"
)
_CLOCK = re.compile(
    rf"(?:{_DAY_BEFORE})?"
    r"(?:(\d{1,2}):)?(\d{1,2}):(\d{1,2}(?:[.,]\d+)?)\s*([AaPp][Mm])?",
    re.IGNORECASE,
)
_DATE = re.compile(r"\d{4}-\d{2}-\d{2}[T ]\d{1,2}:\d{2}")
_DAY = 86400.0


def seconds_of(text: str) -> float | None:
    """Return the seconds of `hh:mm:ss.s`, `mm:ss.s`, or of these behind a date; else None.

    The day counts in ISO dates (`2026-11-12 10:00:00`) only; in others (`12.11.2026`, `11/12/26`, `12-Nov-2026`) its
    order may be unknown, and `times_of` refuses a record over days.
    """
    text = text.strip()
    if match := _CLOCK.fullmatch(text):
        hours, minutes, seconds, half = match.groups()
        hour = int(hours or 0) % 12 + 12 * (half.lower() == "pm") if half else int(hours or 0)
        return 3600.0 * hour + 60.0 * int(minutes) + float(seconds.replace(",", "."))
    if not _DATE.match(text):
        return None
    try:
        whole, _, fraction = text.replace(",", ".").partition(".")
        digits = re.match(r"\d*", fraction)[0]  # type: ignore[index]
        moment = datetime.fromisoformat(whole + fraction[len(digits) :])
        return (moment.replace(tzinfo=None) - datetime(2000, 1, 1)).total_seconds() + float(f"0.{digits or 0}")
    except ValueError:
        return None


def times_of(cells: NDArray[Any]) -> NDArray[np.float64] | None:
    """Return a column of times of day or dates (N,) as seconds from the first; None for other texts.

    A time of day that jumps back by more than half a day has passed midnight.
    """
    if cells.size == 0 or seconds_of(str(cells[0])) is None:
        return None
    found = [seconds_of(str(cell)) for cell in cells]
    if any(one is None for one in found):
        return None
    seconds = np.array(found, dtype=np.float64)
    days = np.concatenate([[0.0], np.cumsum(np.diff(seconds) < -0.5 * _DAY)])
    texts = [re.split(r"[ T,]*\d{1,2}:", str(cell).strip(), maxsplit=1)[0] for cell in cells]
    changes = sum(before != after for before, after in pairwise(texts))
    if texts[0] and not _DATE.match(str(cells[0]).strip()) and changes != days[-1]:
        return None  # over days, which only ISO dates count: otherwise the date changes at midnight only
    return np.asarray(np.round(seconds + _DAY * days - seconds[0], 9))


# ==== Column headers: names, units, numbers ==========================================================================

_BRACKETED = re.compile(r"^(?P<name>.*\S)\s*[\[({](?P<unit>[^\[\](){}]*)[\])}]$")
#: A name and a unit behind a slash, a comma or a colon: `Force / N`, `v/(mm/s)`, `Time, s`.
_SEPARATED = re.compile(r"^(?P<name>[^/,:]*[^/,:\s])\s*[/,:]\s*(?P<unit>\([^()]+\)|[^()]+)$")
#: A column of a matrix in MATLAB's notation, `data(:,2)`, which is a name.
_MATRIX_COLUMN = re.compile(r":,\d+|\d+,:")
_BARE_BRACKETS = re.compile(r"^\s*[\[(](?P<unit>[^\[\]()]*)[\])]\s*$")
#: Header suffixes that are units after any name: `v_mm_s`, `F_lbf`.
_SUFFIXES = {
    "mm_per_s": "mm/s", "in_per_s": "in/s", "m_per_s": "m/s", "mm_s": "mm/s", "cm_s": "cm/s", "in_s": "in/s",
    "m_s": "m/s", "m_s2": "m/s2", "ips": "in/s", "mm": "mm", "cm": "cm", "inch": "in", "N": "N", "kN": "kN",
    "lbf": "lbf", "lbs": "lbf", "lb": "lbf", "kgf": "kgf", "Kgf": "kgf", "daN": "daN", "Nm": "N.m",
    "psi": "psi", "bar": "bar", "kPa": "kPa", "MPa": "MPa", "Pa": "Pa", "degC": "degC", "degF": "degF", "Hz": "Hz",
    "rpm": "rpm", "sec": "s",
    "rad": "rad", "deg": "deg", "mm_per_sec": "mm/s", "in_per_sec": "in/s", "m_per_sec": "m/s", "mm_sec": "mm/s",
    "in_sec": "in/s", "msec": "ms",
}  # fmt: skip

_TIME = {"t", "time", "timestamp"}
_LENGTH = {"x", "z", "disp", "displacement", "pos", "position", "travel", "stroke", "height", "road"}
_TEMPERATURE = {"t", "temp", "temperature"}
#: Suffixes that may also be words or abbreviations (`max_s`, `sensor_in`): units only after a matching quantity.
_CAUTIOUS = {
    "s": ("s", _TIME), "ms": ("ms", _TIME), "us": ("us", _TIME), "m": ("m", _LENGTH), "in": ("in", _LENGTH),
    "C": ("degC", _TEMPERATURE), "F": ("degF", _TEMPERATURE), "K": ("K", _TEMPERATURE),
}  # fmt: skip
#: Words of a name whose quantity confirms a unit behind a blank (`Force N`), by the SI unit of the quantity.
_QUANTITIES = {
    "s": _TIME | {"zeit", "tiempo", "tempo", "temps"},
    "m": _LENGTH | {"weg", "hub"},
    "m/s": {"v", "vel", "velocity", "speed", "geschwindigkeit", "vitesse", "velocidad"},
    "N": {"f", "force", "load", "kraft", "fuerza", "forza", "comp", "compression", "reb", "rebound", "bump", "droop"},
    "K": _TEMPERATURE,
    "Pa": {"p", "pressure", "druck"},
}
#: Names of a time that are its unit, as loggers write them.
_TIMES = {"millis": "ms", "milliseconds": "ms", "msec": "ms", "micros": "us", "microseconds": "us", "seconds": "s"}
#: The same suffixes in headers of capitals: `TIME_SEC`, `VEL_MM_S`.
_CAPITALS = {suffix.upper(): unit for suffix, unit in _SUFFIXES.items()}
_CAUTIOUS_CAPITALS = {suffix.upper(): (unit, words) for suffix, (unit, words) in _CAUTIOUS.items()}


#: Characters of the longest name that is searched for a unit: of a damaged file the search would take minutes.
_LONGEST_NAME = 1000


def split_header(text: str) -> tuple[str, str | None]:
    """Split a column header into its name and its unit, which is None for a header without a unit.

    Brackets (`velocity [in/s]`, `Force (N)`) contain any unit, known or not. A text behind a slash, a comma or a colon
    (`Force / N`, `Time, s`) is a unit only if it is known, and behind a blank (`Force N`) only if the name states the
    same quantity. A suffix (`x_mm`, `v_mm_s`, `T_degC`, `TIME_SEC`) is a unit
    only if it is in a list of such suffixes: `lf_force` and `max_s` have no unit.

    >>> split_header("Force (N)"), split_header("v_mm_s"), split_header("max_s")
    (('Force', 'N'), ('v', 'mm/s'), ('max_s', None))
    """
    text = text.strip()
    if len(text) > _LONGEST_NAME:
        return text, None
    if separated := _separated(text) or _behind_blank(text):
        return separated
    match = _BRACKETED.match(text)
    if match and not _MATRIX_COLUMN.fullmatch(match["unit"]):
        return match["name"], match["unit"].strip()
    for cut in [i for i, letter in enumerate(text) if letter == "_" and i > 0]:
        unit = _suffix_unit(text[:cut], text[cut + 1 :])
        if unit:
            return text[:cut], unit
    return text, _TIMES.get(text.lower())


def named_with_unit(text: str, units: Mapping[str, str]) -> tuple[str, str | None]:
    """Return a name and its unit, from units by name or from the name itself."""
    return (text, units[text]) if text in units else split_header(text)


def _separated(text: str) -> tuple[str, str] | None:
    """Return the name and the unit of `Force / N`; None if no unit follows the mark, or the name ends in one.

    `Vel mm/s` is not divided: its name would end in a unit.
    """
    match = _SEPARATED.match(text)
    *first, last = re.split(r"[ _]+", match["name"]) if match else [""]
    if match is None or (first and is_unit(last) and not is_number(last)):
        return None
    unit = match["unit"].strip().removeprefix("(").removesuffix(")").strip()
    return (match["name"], unit) if unit and not is_number(unit) and is_unit(unit) else None


def _behind_blank(text: str) -> tuple[str, str] | None:
    """Return the name and the unit of `Force N`; None if the last words are no unit of the quantity that is named.

    A number before the unit is a count (`Load 2 N`) if it has one digit, else it may be a factor (`Force 10 N`).
    """
    words = text.split()
    for count in (2, 1):
        stem, last = " ".join(words[:-count]), " ".join(words[-count:])
        if stem and is_number(stem.split()[-1]) and not re.fullmatch(r"\d", stem.split()[-1]):
            continue
        named = set(re.findall(r"[^\W\d_]+", stem.lower()))
        unit = _SUFFIXES.get(last) or _CAUTIOUS.get(last, (last, set()))[0]
        for si, quantities in _QUANTITIES.items():
            if named & quantities and last[:1].isalpha() and is_unit(unit) and compatible(unit, si):
                return stem, unit
    return None


def _suffix_unit(stem: str, suffix: str) -> str | None:
    if suffix in _SUFFIXES or ("/" in suffix and is_unit(suffix)):
        return _SUFFIXES.get(suffix, suffix)
    if stem.isupper() and suffix in _CAPITALS:
        return _CAPITALS[suffix]
    cautious = _CAUTIOUS | (_CAUTIOUS_CAPITALS if stem.isupper() else {})
    unit, words = cautious.get(suffix, (None, set()))
    return unit if re.split(r"[\s_.]", stem)[-1].lower() in words else None


def units_row(cells: list[str]) -> list[str] | None:
    """Return the units of a row under the header (`s;mm;N`, brackets allowed), or None if it is not a row of units.

    A row of units contains no number and at least one cell that can be read as a unit.
    """
    bare = [_BARE_BRACKETS.sub(lambda match: match["unit"], cell).strip() for cell in cells]
    if any(is_number(cell) for cell in bare if cell != "1"):
        return None
    return bare if any(cell and is_unit(cell) for cell in bare) else None


def is_number(cell: str) -> bool:
    """Return whether a cell is a number, with a decimal point or comma and thousands separators, or a time of day."""
    try:
        if numbers_with_groups(np.array([cell], dtype=object), ".") is not None or seconds_of(cell) is not None:
            return True
        float(cell.strip().replace(",", "."))
    except ValueError:
        return False
    return True


def letters_of(name: str) -> str:
    """Return a name in lower case and reduced to its letters, for the comparison with usual names.

    >>> letters_of("Shock Vel. 1")
    'shockvel'
    """
    return re.sub(r"[^a-z]", "", name.lower())
