"""Text files of loggers are read, and faults are refused with their line."""

from pathlib import Path

import numpy as np
import pytest

from eightpost import errors
from eightpost.signals import TimeSeries, read_record, read_records, read_series, write_csv
from eightpost.signals.csv_file import _first_row_of_channels
from eightpost.signals.table_text import seconds_of, split_header, units_row, with_whole_headers


def written(folder: Path, text: str, encoding: str = "utf-8") -> Path:
    path = folder / "run.csv"
    path.write_bytes(text.encode(encoding))
    return path


LAYOUTS = {
    "brackets": "t [ms],x (mm),F [kN]\n0,1,2\n100,2,3\n",
    "suffixes": "t_ms,x_mm,F_kN\n0,1,2\n100,2,3\n",
    "units row": "t,x,F\nms,mm,kN\n0,1,2\n100,2,3\n",
    "units row in brackets": "t;x;F\n[ms];[mm];[kN]\n0;1;2\n100;2;3\n",
    "decimal comma": "t [ms];x [mm];F [kN]\n0,0;1,0;2,0\n1e2;2,0;3,0\n",
    "tabs": "t [ms]\tx [mm]\tF [kN]\n0\t1\t2\n100\t2\t3\n",
    "tabs and decimal comma": "t [ms]\tx [mm]\tF [kN]\n0\t1,0\t2\n100\t2,0\t3\n",
    "preamble": "Dyno 7, run 3\nRate,10,Hz\n\nt [ms],x [mm],F [kN]\n0,1,2\n100,2,3\n",
    "preamble and units row": "Dyno;7\nRate;10;Hz\nt;x;F\nms;mm;kN\n0;1,0;2\n100;2;3\n",
    "delimiter at the end of lines": "t [ms],x [mm],F [kN],\n0,1,2,\n100,2,3,\n",
    "windows line ends and blank lines": "t [ms],x [mm],F [kN]\r\n0,1,2\r\n\r\n100,2,3\r\n\r\n",
    "byte order mark": "\ufefft [ms],x [mm],F [kN]\n0,1,2\n100,2,3\n",
    "quoted": '"t [ms]","x [mm]","F [kN]"\n"0","1","2"\n"100","2","3"\n',
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_record_is_the_same_in_every_layout(tmp_path, layout):
    series = read_series(written(tmp_path, LAYOUTS[layout]))
    assert series.names == ("x", "F")
    assert series.units == ("m", "N")
    np.testing.assert_allclose(series.time, [0.0, 0.1])
    np.testing.assert_allclose(series.values, [[0.001, 0.002], [2000.0, 3000.0]])


def test_latin_1_is_read(tmp_path):
    series = read_series(written(tmp_path, "t [s],T [°C]\n0,20\n1,21\n", "latin-1"))
    np.testing.assert_allclose(series["T"], [293.15, 294.15])


# ---- Headers and cells ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "name", "unit"),
    [
        ("velocity [in/s]", "velocity", "in/s"), ("Force(lbf)", "Force", "lbf"), ("T [°C]", "T", "°C"),
        ("x_mm [m]", "x_mm", "m"), ("a [b] [m]", "a [b]", "m"), ("alpha []", "alpha", ""), ("x_mm", "x", "mm"),
        ("t_s", "t", "s"), ("v_mm_s", "v", "mm/s"), ("T_degC", "T", "degC"), ("T_C", "T", "degC"),
        ("lf_disp_in", "lf_disp", "in"), ("lf_force", "lf_force", None), ("max_s", "max_s", None),
        ("MAX_S", "MAX_S", None), ("sensor_in", "sensor_in", None), ("case_C", "case_C", None), ("Time", "Time", None),
        ("Disp N", "Disp N", None), ("Load 2", "Load 2", None), ("F/v", "F/v", None), ("comp/reb", "comp/reb", None),
        ("run 3: 4", "run 3: 4", None),
    ],
)  # fmt: skip
def test_a_header_splits_into_name_and_unit_and_words_that_look_like_units_remain_names(text, name, unit):
    assert split_header(text) == (name, unit)


@pytest.mark.parametrize("run", ["v" * 200_000, "." * 200_000, "v." * 100_000, "v = " + " " * 200_000])
def test_a_script_with_a_long_run_of_letters_is_refused_at_once(tmp_path, run):
    (tmp_path / "x.m").write_text(run, encoding="utf-8")
    with pytest.raises(errors.FileFormatError, match="no two vectors of numbers"):
        read_record(tmp_path / "x.m")


def test_a_header_longer_than_any_name_has_no_unit():
    assert split_header("_" * 200_000) == ("_" * 200_000, None)
    assert split_header(f"{'a' * 900} [N]") == ("a" * 900, "N")


def test_a_row_of_units_is_distinguished_from_data_and_from_names():
    assert units_row(["s", "mm", "N"]) == ["s", "mm", "N"]
    assert units_row(["[s]", "(mm)", ""]) == ["s", "mm", ""]
    assert units_row(["0", "1.5", "2"]) is None
    assert units_row(["velocity", "force"]) is None


def test_a_header_with_line_breaks_in_its_cells_is_its_last_line():
    lines = ['"Time', '[s]","Force', '[N]"', "0,1", '"a note that is never closed']
    assert with_whole_headers(lines) == ["", "", '"Time [s]","Force [N]"', "0,1", '"a note that is never closed']


TIMES = {
    "10:59:59.5": 39599.5, "00:07.25": 7.25, "10:59": 659.0, "1:02:03,5": 3723.5, "11:00:01.5 PM": 82801.5,
    "12:00:00 am": 0.0,
    **dict.fromkeys((
        "12-Nov-2026 10:59:59.5", "12 November 2026 10:59:59.5", "Nov 12, 2026 10:59:59.5", "12.11.26 10:59:59.5",
        "Thursday, 12 November 2026 10:59:59.5", "12. M\u00e4rz 2026 10:59:59.5", "12 ao\u00fbt 2026 10:59:59.5",
        "12 dic 2026 10:59:59.5", "11/12/26 10:59:59.5", "2026/11/12 10:59:59.5", "12-Nov-26T10:59:59.5",
    ), 39599.5),
    "2000-01-02 00:00:01.5": 86401.5, "2000-01-01T00:00:00.250Z": 0.25,
    **dict.fromkeys(("12-Foo-2026 10:59:59.5", "12-Nov-2026", "12-Mon-26 10:59:59.5", "word", "7.5")),
}  # fmt: skip


@pytest.mark.parametrize("cell", TIMES)
def test_a_cell_is_a_time_of_day_a_date_with_a_time_or_neither(cell):
    assert seconds_of(cell) == TIMES[cell]


BROKEN = {
    "text cell": ("t [s],F [N]\n0,1\n1,abc\n2,3\n", errors.NotANumberError, "line 3, channel 'F': 'abc'"),
    "text in the first line": ("t [s],F [N]\n0,x\n1,2\n2,3\n", errors.NotANumberError, "line 2, channel 'F': 'x'"),
    "empty cell": ("t [s],F [N]\n0,1\n1,\n2,3\n", errors.NotANumberError, "line 3, channel 'F'.*empty"),
    "NaN after blanks": ("t [s],F [N]\n0,1\n\n\n1,nan\n", errors.NotANumberError, "line 5, channel 'F'.*NaN"),
    "bad time": ("t [s],F [N]\n0,1\nx,2\n", errors.NotANumberError, "line 3, channel 'time'"),
    "short line": ("t [s],F [N]\n0,1\n1,2\n2\n", errors.FileFormatError, "line 4: .*1 columns instead of 2"),
    "long line": ("t [s],F [N]\n0,1\n1,2\n2,3,4\n", errors.FileFormatError, "line 4: .*3 columns instead of 2"),
    "backward": ("t [s],F [N]\n0,1\n1,2\n0.5,3\n", errors.BackwardTimeError, "line 4, channel 'time'.*1 s to 0.5"),
    "duplicate": ("a\nt [s],F [N]\n0,1\n1,2\n1,3\n", errors.DuplicateTimeError, "line 5, channel 'time'"),
    "no unit": ("t [s],F\n0,1\n1,2\n", errors.MissingUnitError, r"line 1, channel 'F'.*--channel 'F=\[unit\]'"),
    "unknown unit": ("a\nt [s],F [furlong/x]\n0,1\n1,2\n", errors.UnknownUnitError, "line 2, channel 'F'.*furlong/x"),
    "unknown in a row": ("t,F\ns,blub\n0,1\n1,2\n", errors.UnknownUnitError, "line 2, channel 'F'.*blub"),
    "time in metres": ("t [m],F [N]\n0,1\n1,2\n", errors.UnknownUnitError, "channel 'time'.*'m' cannot"),
    "no time": ("a [s],F [N]\n0,1\n1,2\n", errors.MissingChannelError, "line 1, channel 'time'.*has: a, F"),
    "no header": ("0,1\n1,2\n", errors.MissingChannelError, "channel 'time'.*no header line.*--channel 'force=3"),
    "unnamed column": ("t [s],F [N]\n0,1,5\n1,2,6\n", errors.FileFormatError, "line 1: .*2 columns.*have 3"),
    "a name twice": ("t [s],F [N],F [N]\n0,1,5\n1,2,6\n", errors.FileFormatError, "line 1: .*'F' is not unique"),
    "no numbers": ("hello\nworld\n", errors.FileFormatError, "no table"),
    "empty": ("", errors.FileFormatError, "is empty: it has 0 bytes"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_file_is_refused_with_its_place(tmp_path, case):
    text, error, message = BROKEN[case]
    with pytest.raises(error, match=r"run\.csv.*" + message) as caught:
        read_series(written(tmp_path, text))
    assert type(caught.value) is error


def test_units_may_be_given_for_a_header_without_units(tmp_path):
    path = written(tmp_path, "t,F\n0,1\n1,2\n")
    series = read_series(path, units={"time": "ms", "F": "lbf"})
    np.testing.assert_allclose(series["F"], [4.4482216152605, 8.896443230521])
    with pytest.raises(errors.MissingChannelError, match=r"'Force'.*time, F"):
        read_series(path, units={"time": "ms", "F": "lbf", "Force": "N"})


def test_a_file_is_written_with_the_requested_units_and_digits(tmp_path):
    series = TimeSeries.from_channels([0.0, 0.1], {"x": ("m", [0.0254, -1e-9]), "y": ("m", [1.0, 2.0])})
    path = tmp_path / "out.csv"
    write_csv(series, path, units={"x": "in"}, decimals={"x": 3}, titles={"x": "Position, raw"}, preamble=["made up"])
    assert path.read_text() == 'made up\ntime [s],"Position, raw [in]",y [m]\n0.0,1.0,1.0\n0.1,0.0,2.0\n'


def test_files_of_unknown_kind_and_missing_files_are_refused(tmp_path):
    with pytest.raises(errors.FileFormatError, match=r"a\.doc: .*'\.doc' cannot be read as records; supported: \.csv"):
        read_series(tmp_path / "a.doc")
    with pytest.raises(errors.FileFormatError, match=r"a\.csv: there is no such file"):
        read_series(tmp_path / "a.csv")


@pytest.mark.parametrize(("row", "message"), [("," * 300_000, "has 300000 characters"), ("1,\0", "has a zero byte")])
def test_a_line_that_cannot_belong_to_a_table_is_refused_by_number(tmp_path, row, message):
    path = tmp_path / "run.csv"
    path.write_text(f"time [s],force [N]\n0,1\n{row}\n2,3\n")
    with pytest.raises(errors.FileFormatError, match=rf"run\.csv, line 3: .*{message}"):
        read_series(path)


@pytest.mark.parametrize(("rows", "remark", "expected"), [(60, [], 0), (61, [], None), (2, ["remark"] * 300, 0)])
def test_channels_in_rows_are_at_most_60_and_lines_without_numbers_may_follow(rows, remark, expected):
    lines = [f"channel {k} (N),{k},2.5,3.5" for k in range(rows)]
    assert _first_row_of_channels(lines + remark) == expected


def test_quoted_numbers_that_all_have_three_digits_behind_a_comma_have_decimals_and_a_note(tmp_path):
    (record,) = read_records(written(tmp_path, 't [s],x [mm],n\n0,"12,573","1,250"\n1,"-13,210",950\n2,"0,500",1\n'))
    np.testing.assert_array_equal(record.columns[1], [12.573, -13.21, 0.5])
    assert record.steps == ()  # the leading zero shows it
    (record,) = read_records(written(tmp_path, 't [s],x [mm],n\n0,"12,573","1,250"\n1,"-13,210",950\n'))
    np.testing.assert_array_equal(record.columns[1], [12.573, -13.21])
    np.testing.assert_array_equal(record.columns[2], [1250.0, 950.0])
    assert record.steps == ("the commas in the column 'x' are decimal: every number has three digits behind one",)


# ---- Several tables, one below the other -----------------------------------------------------------------------------

TABLE = "Time (s),Load (N)\n0,1\n0.1,2\n0.2,3\n"
UNITS_ROW = "Time;Load\ns;N\n0,0;1,5\n0,1;2,5\n"


@pytest.mark.parametrize(
    "content",
    [
        TABLE + TABLE,
        "Test,1\n" + TABLE + "\nTest,2\nGas,50,psi\n" + TABLE,
        "Test: 1\n" + TABLE + ",\n,,\nTest: 2\n\n" + TABLE,
        UNITS_ROW + "Test;2\n" + UNITS_ROW,
        "Test\t1\n" + TABLE.replace(",", "\t") + "Test\t2\n" + TABLE.replace(",", "\t"),
    ],
)
def test_a_second_header_begins_another_table(tmp_path, content):
    first, second = read_records(written(tmp_path, content))
    assert first.names == second.names == ("Time", "Load")
    assert first.units == second.units == ("s", "N")
    np.testing.assert_array_equal(first.columns[1], second.columns[1])


def test_each_table_has_the_preamble_above_it(tmp_path):
    records = read_records(written(tmp_path, "Dyno 7\nGas,50,psi\n" + TABLE + "Gas,150,psi\n" + TABLE))
    assert [record.preamble for record in records] == [(("Dyno 7",), ("Gas", "50", "psi")), (("Gas", "150", "psi"),)]


def test_the_message_on_a_fault_in_a_later_table_has_its_line_in_the_file(tmp_path):
    path = written(tmp_path, TABLE + "Test,2\n" + TABLE.replace("0.1,2", "0.1,x"))
    second = read_records(path)[1]
    assert second.origin.lines is not None and second.origin.lines[:3].tolist() == [7, 8, 9]
    with pytest.raises(errors.NotANumberError, match=r"line 8, channel 'F'.*'x'"):
        second.numbers(1, channel="F")


def test_the_message_on_a_truncated_line_in_a_later_table_has_its_line_in_the_file(tmp_path):
    path = written(tmp_path, TABLE + TABLE.replace("0.1,2", "0.1"))
    with pytest.raises(errors.FileFormatError, match="line 7: the line has 1 columns instead of 2"):
        read_records(path)


def test_text_among_the_numbers_does_not_begin_a_table(tmp_path):
    assert len(read_records(written(tmp_path, TABLE + "bad,cell\n0.4,5\n"))) == 1


def test_several_tables_are_refused_if_one_is_expected(tmp_path):
    with pytest.raises(errors.FileFormatError, match=r"line 5: the file has 2 tables, but one is needed"):
        read_record(written(tmp_path, TABLE + TABLE))
