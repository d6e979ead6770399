"""Text files with several tables: each table is found with its preamble, its line numbers and its faults."""

import numpy as np
import pytest

from eightpost import errors
from eightpost.signals import read_record, read_records

TABLE = "Time (s),Load (N)\n0,1\n0.1,2\n0.2,3\n"
UNITS_ROW = "Time;Load\ns;N\n0,0;1,5\n0,1;2,5\n"


def written(folder, content):
    path = folder / "run.csv"
    path.write_text(content)
    return path


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
    assert [second.origin.line(i) for i in range(3)] == [7, 8, 9]
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
