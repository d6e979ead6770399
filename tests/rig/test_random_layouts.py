"""Property of random layouts: the numbers that are read are the numbers written, or the file is refused."""

import string
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eightpost.errors import InputError
from eightpost.rig import read_peak_velocity
from eightpost.signals import read_records

from .layouts import BUMP, DROOP, SPEED

CHANNELS = {"Time": "s", "Displacement": "mm", "Velocity": "mm/s", "Force": "N", "Temperature": "degC", "Sample": ""}
UNITS = {
    "brackets": "{} [{}]", "parentheses": "{} ({})", "slash": "{} / {}", "suffix": "{}_{}", "row": "{}", "none": "{}",
}  # fmt: skip
MINUS = {"plain": "-{}", "parentheses": "({})", "typesetter": "\u2212{}"}
PREAMBLE = st.lists(st.text(string.ascii_letters + " :,;0123456789.", max_size=30), max_size=4)
#: Least number of rows of a table that is not turned.
ROWS = 12


@st.composite
def layouts(draw):
    """Draw a table: text, values by column and their units."""
    names = draw(st.permutations(list(CHANNELS)))[: draw(st.integers(2, len(CHANNELS)))]
    rows = draw(st.integers(ROWS, 40))
    seed = draw(st.integers(0, 2**32 - 1))
    digits, scale = draw(st.integers(0, 6)), 10.0 ** draw(st.integers(-2, 4))
    random = np.random.default_rng(seed)
    values = {name: np.round(scale * random.normal(size=rows), digits) for name in names}
    values |= {name: np.arange(rows) * 0.01 for name in names if name == "Time"}
    mark = draw(st.sampled_from([".", ","]))
    sep = draw(st.sampled_from([",", ";", "\t", "  "]))
    minus = MINUS[draw(st.sampled_from(list(MINUS)))]
    style = draw(st.sampled_from(list(UNITS)))

    def cell(value):
        digits_of = f"{abs(value):.{max(digits, 2)}f}".replace(".", mark)
        text = minus.format(digits_of) if value < 0 else digits_of
        return f'"{text}"' if mark == sep else text

    header = [UNITS[style].format(name, CHANNELS[name]) if CHANNELS[name] else name for name in names]
    lines = [*draw(PREAMBLE), sep.join(header)]
    lines += [sep.join(CHANNELS[name] or "-" for name in names)] * (style == "row")
    lines += [sep.join(map(cell, row)) for row in zip(*values.values(), strict=True)]
    end = draw(st.sampled_from(["\n", "\r\n"]))
    text = end.join(lines) + draw(st.sampled_from(["", end, end * 2]))
    encoding = draw(st.sampled_from(["utf-8", "utf-8-sig", "utf-16"]))
    units = {name: None if style == "none" else CHANNELS[name] or None for name in names}
    return text.encode(encoding), values, units


def _read(content, read):
    """Return what is read from a file with this content; None if it is refused."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.csv"
        path.write_bytes(content)
        try:
            return read(path)
        except InputError:
            return None


@pytest.mark.slow
@given(layouts())
def test_the_numbers_of_a_table_are_those_written_or_it_is_refused(layout):
    content, values, units = layout
    records = _read(content, read_records)
    if records is None or all(name.isdigit() for record in records for name in record.names):
        return
    (record,) = records
    assert set(record.names) <= {*values, "column 1"}
    for name, unit, column in zip(record.names, record.units, record.columns, strict=True):
        assert unit in (units[name], "1", "-")
        if column.dtype != object:  # texts are refused where a number is needed
            np.testing.assert_allclose(column, values[name], rtol=1e-9, atol=1e-9)


def test_a_usual_table_is_read_in_every_delimiter_decimal_mark_and_notation_of_units():
    for sep in (",", ";", "\t", "  "):
        for mark in ".,":
            for style, notation in list(UNITS.items())[:5]:
                if mark == sep:
                    continue
                names = [notation.format(name, unit) for name, unit in list(CHANNELS.items())[:4]]
                lines = [sep.join(names), *([sep.join(list(CHANNELS.values())[:4])] * (style == "row"))]
                values = 0.25 * np.arange(4 * ROWS).reshape(ROWS, 4) - 3.0
                lines += [sep.join(f"{x:.3f}".replace(".", mark) for x in row) for row in values]
                (record,) = _read("\n".join(lines).encode(), read_records)
                assert record.names == tuple(CHANNELS)[:4], (sep, mark, style)
                assert record.units == tuple(CHANNELS.values())[:4], (sep, mark, style)
                np.testing.assert_array_equal(np.transpose(record.columns), values)


@st.composite
def tables(draw):
    """Draw a peak-velocity table of one setting in one of the layouts, with magnitudes or one of both signs."""
    c, r = draw(st.sampled_from([(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0)]))
    bump, droop = c * BUMP, -r * DROOP
    order = draw(st.permutations(range(len(SPEED))))
    speed, bump, droop = (column[list(order)] for column in (SPEED, bump, droop))
    kind = draw(st.sampled_from(["columns", "rows", "wide", "by line", "signed", "coefficients"]))
    sep, minus = draw(st.sampled_from([",", ";", "\t"])), MINUS[draw(st.sampled_from(list(MINUS)))]

    def line(*values):
        return sep.join(v if isinstance(v, str) else (minus.format(f"{-v:g}") if v < 0 else f"{v:g}") for v in values)

    v, comp, reb = "Velocity (mm/s)", "Compression (N)", "Rebound (N)"
    if kind == "columns":
        lines = [line(v, comp, reb), *(line(*row) for row in zip(speed, bump, droop, strict=True))]
    elif kind == "rows":
        lines = [line(v, *speed), line(comp, *bump), line(reb, *droop)]
    elif kind == "wide":
        lines = [line("Force (N)", *(f"{x:g} mm/s" for x in speed)), line("comp", *bump), line("reb", *droop)]
    elif kind == "by line":
        sides = [("comp", x, f) for x, f in zip(speed, bump, strict=True)]
        sides += [("reb", x, f) for x, f in zip(speed, droop, strict=True)]
        lines = [line("side", v, "Force (N)"), *(line(*sides[i]) for i in draw(st.permutations(range(len(sides)))))]
    elif kind == "signed":
        pairs = [*zip(-speed, droop, strict=True), *zip(speed, bump, strict=True)]
        lines = [line(v, "Force (N)"), *(line(*pair) for pair in pairs)]
    else:
        lines = [line(v, "Comp (N.s/m)", "Reb (N.s/m)")]
        lines += [line(x, 1e3 * b / x, 1e3 * d / x) for x, b, d in zip(speed, bump, droop, strict=True)]
    return "\n".join(lines).encode()


@pytest.mark.slow
@given(tables())
def test_the_numbers_of_a_peak_velocity_table_are_those_written_or_it_is_refused(content):
    found = _read(content, lambda path: read_peak_velocity(path, units={"force": "N"}))
    if found is None:
        return
    (table,) = found
    np.testing.assert_allclose(table.speed, SPEED / 1e3)
    np.testing.assert_allclose(table.compression, BUMP, rtol=1e-4)
    np.testing.assert_allclose(table.rebound, DROOP, rtol=1e-4)
