"""Written CSV tables contain no formulas, numbers stay numbers, and names read back unchanged."""

import csv

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eightpost.files import plain_cell, quoted_cell, safe_cell, safe_line
from eightpost.ident import linearity_plots
from eightpost.signals import TimeSeries, read_series, write_csv, write_series

FORMULA = "=cmd|' /C calc'!A0"
NAMES = (FORMULA, "+1+1", "-x", "@SUM(A1)", "'=quoted", "plain;=1+1")


@given(st.text())
def test_a_cell_is_not_a_formula_and_reads_back_unchanged(text):
    cell = safe_cell(text)
    assert plain_cell(cell) == text
    assert cell == text or not cell.startswith(("=", "+", "-", "@", "\t", "\r"))


@pytest.mark.parametrize("number", ["-1.5", "+2", "-.5e-3", "1.", "-0"])
def test_numbers_stay_numbers(number):
    assert safe_cell(number) == number


@pytest.mark.parametrize("text", ["=1", "-a", "+-1", "-1-1", "@x", "\t=1", "-1e", "＝1"])
def test_a_text_that_a_spreadsheet_would_execute_gets_an_apostrophe(text):
    assert safe_cell(text) == f"'{text}"


def test_free_text_is_safe_in_every_cell_into_which_a_spreadsheet_splits_it():
    assert safe_line("Note,=1+1;@x,-2.5, -y") == "Note,'=1+1;'@x,-2.5, -y"


def cells(path):
    with path.open(encoding="utf-8", newline="") as stream:
        return [cell for row in csv.reader(stream) for cell in row]


def is_safe(cell):
    return safe_cell(cell) == cell or cell.startswith("'")


def test_a_series_with_names_like_formulas_is_safe_and_reads_back(tmp_path):
    time = np.arange(10) / 10.0
    series = TimeSeries.from_channels(time, dict.fromkeys(NAMES, ("m", -1.5 - time)))
    write_series(series, tmp_path / "run.csv")
    assert all(map(is_safe, cells(tmp_path / "run.csv")))
    read = read_series(tmp_path / "run.csv")
    assert read.names == series.names
    np.testing.assert_array_equal(read.values, series.values)


def test_a_preamble_is_safe(tmp_path):
    series = TimeSeries.from_channels(np.arange(10) / 10.0, {"x": ("m", np.ones(10))})
    write_csv(series, tmp_path / "run.csv", preamble=(f"{FORMULA},{FORMULA}",))
    assert all(map(is_safe, cells(tmp_path / "run.csv")))


def test_the_judgement_of_linearity_is_safe(tmp_path):
    linearity_plots._write(
        tmp_path / "paths.csv", ["# note"], ("input", "output"), [(FORMULA, "-1.5"), ("a,b", 'say "x"')]
    )
    assert cells(tmp_path / "paths.csv")[3:] == [f"'{FORMULA}", "-1.5", "a,b", 'say "x"']


def test_cells_with_a_delimiter_of_any_locale_are_quoted():
    assert quoted_cell("a;=1") == '"a;=1"' and quoted_cell("plain") == "plain"
