"""How texts of tables are understood is what tests/results keeps, one notation after the other."""

from collections.abc import Callable

import numpy as np
import pytest

from eightpost.errors import InputError
from eightpost.signals.csv_file import read_delimited
from eightpost.signals.drivefile import Drivefile
from eightpost.signals.faults import check_gaps, check_length, check_sign, clipped_samples
from eightpost.signals.raw_record import RawRecord, spread_evenly
from eightpost.signals.table_text import (
    decimal_mark,
    decoded,
    has_three_decimals,
    is_number,
    numbers_with_groups,
    seconds_of,
    split_header,
    times_of,
    units_row,
    with_minus_signs,
    with_tabs,
    without_footer,
)
from eightpost.signals.timeseries import TimeSeries

HEADERS = (
    "Force / N", "v/(mm/s)", "Time, s", "Vel mm/s", "Force 10 N", "Load 2 N", "Force N", "TIME_SEC", "VEL_MM_S",
    "POS_IN", "x (1)", "data(:,2)", "millis", "Damper force kN", "rebound lbs", "T_F", "temp_K", "lf.disp_in", "a_kPa",
    "speed m / s", "_mm", "x_mm_s", "Weg mm", "F", "p bar", "Force (N) [raw]", "x:mm", "run_3", "u_us", "t_us",
)  # fmt: skip
CELLS = (
    "1", "-1.5", "1,5", "1,234", "1,234.5", "1.234,5", "12,34", "0,125", "1e5", "nan", "inf", "", "1'234.5", "1 234",
    "10:00:00", "1.2.3", "--5", "+7", "12,573", "1,234,567", "01,234", "1234,567",
)  # fmt: skip


def texts(values: list[str]) -> np.ndarray:
    return np.array(values, dtype=object)


def test_headers_and_cells(unchanged: Callable[..., None]) -> None:
    groups = {cell: [numbers_with_groups(texts([cell]), mark) for mark in ".,"] for cell in CELLS}
    unchanged({
        "headers": " | ".join(f"{text} -> {split_header(text)}" for text in HEADERS),
        "numbers": " | ".join(f"{cell!r} {is_number(cell)}" for cell in CELLS),
        "groups": " | ".join(f"{cell!r} {[None if one is None else one.tolist() for one in both]}"
                             for cell, both in groups.items()),
        "columns": [str(numbers_with_groups(texts(cells), ".")) for cells in (
            ["1,234", "5"], ["1,234", ""], ["1,234.5", "12"], ["1.234,5", "2,5"], ["1,234", "0,5"], ["1,234", "word"])],
        "marks": " ".join(decimal_mark(body, mark) for mark in ",;" for body in (
            "1,5", "1.5", "1,234.5", '"0,125"', '"1,234"', "0.5;1,2")),
        "three": [has_three_decimals(texts(cells)) for cells in (["1,234", "12,345"], ["1,234"], ["1,23", "1,234"])],
        "rows of units": [units_row(cells) for cells in (["s", "1", "N"], ["1", "2"], ["[mm]", "x"], ["a", "b"])],
        "minus": with_minus_signs(["(1.5),(2)", "Force (2),x", "\u22123,4e\u22125", "a,(1)"]),
    })  # fmt: skip


def test_times_of_day_and_dates(unchanged: Callable[..., None]) -> None:
    columns = {
        "midnight": ["23:59:59.5", "23:59:59.9", "00:00:00.3"],
        "back by less than half a day": ["14:00:00", "13:00:00"],
        "date at midnight": ["12.11.26 23:59:59.5", "13.11.26 00:00:00.5"],
        "date at another time": ["12.11.26 10:00:00", "13.11.26 10:00:01"],
        "ISO": ["2026-11-12 10:00:00.25", "2026-11-13T10:00:00.5"],
        "not all": ["10:00:00", "x"],
    }
    kept = {name: str(times_of(texts(cells))) for name, cells in columns.items()}
    cells = ("1:00 PM", "12:30:00 PM", "12:30:00 AM", "2000-13-01 00:00:00", "1:2", "99:59.5", "2000-01-01 00:00:00,5")
    unchanged(kept | {"seconds": " | ".join(f"{cell} {seconds_of(cell)}" for cell in cells)})


def test_lines_of_a_table(unchanged: Callable[..., None]) -> None:
    spaced = ["Time s Force N", *(f"{0.1 * k:.1f}   {k}" for k in range(6)), "end of test"]
    rows = [["1", "2"], ["3", "4"], ["Max", "9"], [""], ["note"]]
    damaged = [["1", "2"], ["3", "4"], ["x", "9"]]
    text = "時間,Zeit ä １２"
    encoded = {name: decoded(text.encode(name, errors="replace")) for name in ("utf-8", "utf-16", "cp932", "latin-1")}
    unchanged({
        "tabs": with_tabs(spaced), "footers": [without_footer(one) for one in (rows, damaged, [["a", "b"]], [])],
        "encodings": encoded, "UTF-16 without a mark": [decoded(("0123456789,ab" * 3).encode(name))
                                                       for name in ("utf-16-le", "utf-16-be")],
    })  # fmt: skip


@pytest.mark.parametrize("rows", [49, 50])
@pytest.mark.parametrize("last", ["0.5", "0.52", "0.522", "0.5225"])
def test_a_last_number_with_fewer_digits_is_cut_off_in_a_table_of_fifty_rows(rows: int, last: str, tmp_path) -> None:
    lines = [f"{0.01 * k:.2f},{0.4 + 0.0025 * k:.4f}" for k in range(rows - 1)]
    path = tmp_path / "run.csv"
    path.write_text("\n".join(["t [s],x [mm]", *lines, f"{0.01 * rows:.2f},{last}"]), encoding="utf-8")
    (record,) = read_delimited(path)
    assert len(record.columns[0]) == rows - (rows == 50 and last != "0.5225")


TIME = np.arange(2000) / 1000.0
SINE = np.sin(2 * np.pi * 2.0 * TIME)


def said(check: Callable[..., None], *values: object, **options: object) -> str:
    try:
        check(*values, **options)
    except InputError as error:
        return str(error)
    return "nothing"


def test_faults_at_their_limits(unchanged: Callable[..., None]) -> None:
    steps = np.ones(50)
    gaps = {factor: np.cumsum(np.where(np.arange(50) == 20, factor, steps)) for factor in (1.49, 1.51)}
    kept: dict[str, object] = {f"gap of {factor}": said(check_gaps, time) for factor, time in gaps.items()}
    for height in (0.9, 0.999, 0.99995):
        kept[f"clipped samples at {height}"] = clipped_samples(np.minimum(SINE, height), np.ones(2000, dtype=bool)).size
    for delay in (0.2, 0.31, 0.45):
        other = np.sin(2 * np.pi * (2.0 * TIME - delay))
        kept[f"sign after {delay}"] = said(check_sign, other, SINE, channel="force", against="velocity")
    kept["short"] = [said(check_length, TIME[:count], shortest=0.1, fewest=150) for count in (101, 149, 150)]
    unchanged(kept)


def test_bridges_and_rounded_times(unchanged: Callable[..., None]) -> None:
    column = np.where(np.isin(np.arange(20), (0, 5, 6, 11, 12, 13)), np.nan, np.arange(20.0))
    record = RawRecord.in_memory({"t [s]": np.arange(20.0), "x [mm]": column})
    found = {f"bridged {longest}": record.bridged(longest) for longest in (0, 2, 3)}
    even = np.arange(30) * 2.6
    lost = np.delete(even, 12)
    rounded = {"even": spread_evenly(np.round(even)), "lost": spread_evenly(np.round(lost)),
               "slow": spread_evenly(np.round(0.4 * even)), "fine": spread_evenly(np.round(even, 1))}  # fmt: skip
    bridged = {name: {"x": one.columns[1], "steps": one.steps} for name, one in found.items()}
    squares = {"road": ("m", np.arange(28.0) ** 2)}
    drive = Drivefile(TimeSeries.from_channels(np.delete(np.arange(30.0), [7, 8]), squares))
    at = np.array([-1.0, 0.5, 6.7, 7.5, 40.0])
    parts = {"at": drive.sample(at), "means": drive.means(at)}
    unchanged({**bridged, **rounded, **parts})
