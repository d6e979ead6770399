"""Headers contain units in many notations, and words that look like units remain names."""

import pytest

from eightpost.signals.table_text import split_header, units_row, with_whole_headers


@pytest.mark.parametrize(
    ("text", "name", "unit"),
    [
        ("velocity [in/s]", "velocity", "in/s"),
        ("Force (N)", "Force", "N"),
        ("Force(lbf)", "Force", "lbf"),
        ("T [°C]", "T", "°C"),
        ("x_mm [m]", "x_mm", "m"),
        ("a [b] [m]", "a [b]", "m"),
        ("alpha []", "alpha", ""),
        ("x_mm", "x", "mm"),
        ("F_N", "F", "N"),
        ("t_s", "t", "s"),
        ("v_mm_s", "v", "mm/s"),
        ("v_in_s", "v", "in/s"),
        ("T_degC", "T", "degC"),
        ("T_C", "T", "degC"),
        ("lf_disp_in", "lf_disp", "in"),
        ("lf_force", "lf_force", None),
        ("max_s", "max_s", None),
        ("sensor_in", "sensor_in", None),
        ("case_C", "case_C", None),
        ("Time", "Time", None),
    ],
)
def test_a_header_splits_into_name_and_unit(text, name, unit):
    assert split_header(text) == (name, unit)


def test_a_row_of_units_is_distinguished_from_data_and_from_names():
    assert units_row(["s", "mm", "N"]) == ["s", "mm", "N"]
    assert units_row(["[s]", "(mm)", ""]) == ["s", "mm", ""]
    assert units_row(["0", "1.5", "2"]) is None
    assert units_row(["velocity", "force"]) is None


def test_a_header_with_line_breaks_in_its_cells_is_its_last_line():
    lines = ['"Time', '[s]","Force', '[N]"', "0,1", '"a note that is never closed']
    assert with_whole_headers(lines) == ["", "", '"Time [s]","Force [N]"', "0,1", '"a note that is never closed']
