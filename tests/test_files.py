"""Files with settings are checked and written whole; cells of tables are safe in spreadsheets."""

import csv
import json
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eightpost.errors import FileFormatError, InputError, OutputError
from eightpost.files import (
    atomic_path,
    json_content,
    plain_cell,
    quoted_cell,
    read_text,
    safe_cell,
    safe_line,
)
from eightpost.ident import linearity_plots
from eightpost.signals import TimeSeries, read_series, write_csv, write_series

# ---- Files ----------------------------------------------------------------------------------------------------------


def test_settings_keep_their_values(tmp_path):
    document = {"a": [1, -(2**63), 2**63 - 1, 1.5], "b": {"c": "é"}, "d": None}
    (tmp_path / "a.json").write_bytes(b"\xef\xbb\xbf" + json.dumps(document).encode())
    assert json_content(tmp_path / "a.json") == document
    (tmp_path / "b.json").write_text('{"a": Infinity}')
    assert json_content(tmp_path / "b.json", finite=False) == {"a": float("inf")}


def test_a_path_without_a_text_file_is_refused_by_name(tmp_path):
    (tmp_path / "folder.toml").mkdir()
    (tmp_path / "loop.toml").symlink_to("loop.toml")
    (tmp_path / "latin.toml").write_bytes(b"a = 1\nb = '\xe9'\n")
    for name, said in {
        "gone.toml": "there is no such file",
        "folder.toml": "is a folder, not a file",
        "loop.toml": "symbolic links",
        "latin.toml": "line 2: the byte 0xe9 is not UTF-8",
        "a\0b.toml": "there is no such file",
    }.items():
        with pytest.raises(FileFormatError) as caught:
            read_text(tmp_path / name)
        assert name in str(caught.value) and said in str(caught.value)


FULL = """
import resource, sys
from pathlib import Path
import numpy as np
from eightpost.signals import TimeSeries, write_series
from eightpost.vehicle import read_vehicle, shipped, write_vehicle
from eightpost.archive import write_archive
from eightpost.errors import OutputError
import scipy.io, arro3.io

folder = Path(sys.argv[1])
series = TimeSeries.from_channels(np.arange(5000) / 100.0, {"x": ("m", np.random.default_rng(1).normal(size=5000))})
writers = {
    "run.csv": lambda path: write_series(series, path),
    "run.parquet": lambda path: write_series(series, path),
    "run.mat": lambda path: write_series(series, path),
    "a.fmu": lambda path: write_archive(path, {"a": np.random.default_rng(1).bytes(50_000)}),
}
resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, 10_000))  # writing beyond it fails as on a full disk
for name, write in writers.items():
    (folder / name).write_bytes(b"old")
    try:
        write(folder / name)
    except OutputError as error:
        assert str(folder / name) in str(error) and "free space there" in str(error), error
    else:
        raise SystemExit(f"{name} was written")
    assert (folder / name).read_bytes() == b"old"
assert sorted(path.name for path in folder.iterdir()) == sorted(writers)
"""


@pytest.mark.nightly
@pytest.mark.skipif(sys.platform == "win32", reason="limits of files are POSIX's")
def test_a_full_disk_is_reported_with_the_file_name_and_keeps_the_old_file(tmp_path):
    ran = subprocess.run([sys.executable, "-c", FULL, str(tmp_path)], capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr


def test_a_folder_that_cannot_be_created_is_named(tmp_path):
    with pytest.raises(InputError, match=r"plain is a file, not a folder"):
        (tmp_path / "plain").write_text("")
        with atomic_path(tmp_path / "plain" / "out.csv"):
            pass
    with pytest.raises(OutputError, match=r"File name too long"), atomic_path(tmp_path / ("x" * 300)) as temporary:
        temporary.write_text("")


# ---- Cells of written CSV tables contain no formulas, and names read back unchanged ---------------------------------

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
