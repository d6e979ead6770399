"""Table of common units, computed with pint and stored in a file that loads faster than pint.

`python -m eightpost.unit_table` writes the file; a test compares it with the installed version of pint.
"""

from __future__ import annotations

import json
import re
from itertools import product
from pathlib import Path
from typing import NamedTuple

from eightpost.unit_symbols import expression

PATH = Path(__file__).with_suffix(".json")

#: Units in the table, in the notation of file headers.
COMMON = (
    "1", "%",
    "m", "mm", "cm", "um", "km", "in", "ft",
    "m/s", "mm/s", "cm/s", "in/s", "ft/s", "km/h", "mph",
    "m/s2", "mm/s2", "in/s2", "ft/s2", "g",
    "N", "kN", "mN", "lbf", "kgf",
    "N.m", "kN.m", "N.mm", "lbf.in", "lbf.ft",
    "N/m", "N/mm", "kN/m", "lbf/in", "lbf/ft",
    "N.s/m", "N.s/mm", "kN.s/m", "lbf.s/in", "lbf.s/ft", "lbf/(in/s)", "lbf/(ft/s)", "N/(m/s)", "N/(mm/s)",
    "kg", "lbm", "kg.m2", "lbm.in2", "lbm.ft2",
    "rad", "deg", "mrad", "rad/s", "deg/s", "rad/s2", "rpm",
    "s", "ms", "us", "min", "h", "Hz", "kHz", "1/s",
    "Pa", "kPa", "MPa", "bar", "psi", "W", "kW", "J", "kJ",
    "K", "degC", "degF", "V", "mV", "A",
    "m3", "cm3", "m2", "cm2", "mm2", "in2",
    "kg/m3", "Pa.s", "m2/s", "N/rad", "N.m/rad", "N.m.s/rad",
)  # fmt: skip


class Table(NamedTuple):
    """Properties of units, which are keys in pint's notation.

    Args:
        exponents: Exponents of the SI base units; base units outside SI have pint's name.
        factors: Value of one unit in SI base units.
        conversions: Pair (factor, offset) for each pair of units with the same dimension.
    """

    exponents: dict[str, dict[str, int]]
    factors: dict[str, float]
    conversions: dict[tuple[str, str], tuple[float, float]]


def read_table() -> Table:
    """Read the table from its file."""
    document = json.loads(PATH.read_text(encoding="utf-8"))
    pairs = {
        (source, target): (f, o) for source, row in document["conversions"].items() for target, (f, o) in row.items()
    }
    return Table(document["exponents"], document["factors"], pairs)


def make_table() -> Table:
    """Compute the table with pint."""
    from eightpost import pint_units  # noqa: PLC0415 -- it takes long to load

    texts = tuple(dict.fromkeys(map(expression, COMMON)))
    found = {pair: pint_units.conversion(*pair) for pair in product(texts, texts)}
    return Table(
        {text: pint_units.exponents(text) for text in texts},
        {text: pint_units.factor(text) for text in texts},
        {pair: conversion for pair, conversion in found.items() if conversion is not None},
    )


def main() -> None:
    """Write the table to its file, one line per unit."""
    table = make_table()
    rows: dict[str, dict[str, tuple[float, float]]] = {text: {} for text in table.exponents}
    for (source, target), conversion in table.conversions.items():
        rows[source][target] = conversion
    sections = {"exponents": table.exponents, "factors": table.factors, "conversions": rows}
    text = json.dumps(sections, separators=(",", ":"))
    PATH.write_text(re.sub(r"(?<=\},)(?=\")|(?<=:\{)(?=\"[^\"]*\":\{)", "\n", text) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
