"""The same record in usual and unusual layouts is read to the same values, or refused with a helpful message."""

import datetime

import numpy as np
import pytest

from eightpost.errors import InputError
from eightpost.rig import read_dyno_test
from eightpost.rig.columns import with_channels
from eightpost.signals import ChannelMap, MappedChannel

from .layouts import (
    COUNT,
    SI,
    US,
    F,
    T,
    V,
    X,
    cells,
    clock,
    column,
    file_with,
    grid,
    grouped,
    groups,
    matlab,
    matlab73,
    rows,
    sheets,
    text,
)

H = "t [s],x [mm],v [mm/s],F [N]"
UH = "Time (Sec),Disp (Inches),Velocity (Inches/Sec),Load (Lbf),Temp (Deg F)"
NAMES = ["t [s]", "x [mm]", "v [mm/s]", "F [N]"]
MM = {"t": T, "x": 1e3 * X, "v": 1e3 * V, "F": F}
UNIT_STRUCT = {"t": "s", "x": "mm", "v": "mm/s", "F": "N"}
MATRIX = {"data": np.column_stack([T, 1e3 * X, 1e3 * V, F])}

READ = {
    "plain": text(H),
    "no velocity": text("t [s],x [mm],F [N]", [SI[0], SI[1], SI[3]]),
    "no displacement": text("t [s],v [mm/s],F [N]", [SI[0], SI[2], SI[3]]),
    "UTF-16 without a byte order mark": text(H, encoding="utf-16-le"),
    "US units, spelled out": text(UH, US),
    "footer of statistics": text(H, below="Max,1.0,2.0,3.0\nMin,0.0,0.0,0.0\n"),
    "trailing delimiter": text(H + ",", [*SI, column("")]),
    "ISO times": text("timestamp,x [mm],v [mm/s],F [N]", [clock(pattern="%Y-%m-%dT%H:%M:%S.%f"), *SI[1:]]),
    "times past midnight": text(
        "Time,x [mm],v [mm/s],F [N]", [clock(datetime.datetime(2024, 5, 3, 23, 59, 59, 600000)), *SI[1:]]
    ),
    "date and time": text("Date,Time,x [mm],v [mm/s],F [N]", [column("2024-05-03"), clock(), *SI[1:]]),
    "thousands in quotes": text("t [s],x [mm],v [mm/s],F [N]", [*SI[:3], grouped("F", "N")]),
    "thousands beside decimal points": text(
        "t [s]\tx [mm]\tv [mm/s]\tF [N]", [*SI[:3], grouped("F", "N", quote="")], sep="\t", suffix=".txt"
    ),
    "raw force in volts beside newtons": text(
        "t [s],x [mm],v [mm/s],Force raw [V],Force [N]", [*SI[:3], column("0.5"), SI[3]]
    ),
    "filtered and raw force": text(
        "t [s],x [mm],v [mm/s],Force filtered [N],Force raw [N]", [*SI[:3], column("1.5"), SI[3]]
    ),
    "a text column": text(H + ",comment", [*SI, column("ok")]),
    "a column with an unknown unit": text(H + ",aux [flurb]", [*SI, column("7")]),
    "a column with missing samples": text(H + ",aux", [*SI, [""] + ["3"] * (COUNT - 1)]),
    "a column without a name": text("t [s],x [mm],,v [mm/s],F [N]", [*SI[:2], column("9"), *SI[2:]]),
    "sample numbers first": text("Sample," + H, [[str(i) for i in range(COUNT)], *SI]),
    "spreadsheet with a sheet of facts": sheets(
        {"Info": [["Operator: JD"], ["Date: today"]], "Data": [NAMES, *grid()]}),
    "mat": matlab(MM | {"units": UNIT_STRUCT}),
    "mat 7.3 with a struct": matlab73({"run": MM | {"units": UNIT_STRUCT}}),
}  # fmt: skip

#: Layouts that need a map of a matrix, and their files.
MAPPED = {"mat with a matrix": matlab(MATRIX), "mat 7.3 with a matrix": matlab73(MATRIX)}

REFUSED = {
    "force in volts only": text("t [s],x [mm],v [mm/s],F [V]"),
    "times of day in whole seconds": text("Time,x [mm],v [mm/s],F [N]", [clock(pattern="%H:%M:%S"), *SI[1:]]),
    "unquoted thousands": text(H, [*SI[:3], grouped("F", "N", quote="")]),
    "a damaged TDMS file": lambda folder: file_with(folder, "run.tdms", "TDSm" + "\0" * 99),
}  # fmt: skip


def check(series):
    for name, expected in (("displacement", X), ("force", F)):
        if name in series:
            assert series[name] == pytest.approx(expected, rel=1e-6, abs=1e-6 * abs(expected).max()), name
    assert series.time - series.time[0] == pytest.approx(T, abs=1e-6)
    assert series["velocity"][50:-50] == pytest.approx(V[50:-50], rel=1e-6, abs=0.02 * V.max())


@pytest.mark.parametrize("layout", MAPPED)
def test_columns_of_a_matrix_are_addressed_by_a_channel_map(layout, tmp_path):
    names = {"displacement": ("data(:,2)", "mm"), "velocity": ("data(:,3)", "mm/s"), "force": ("data(:,4)", "N")}
    channels = {name: MappedChannel(source, unit) for name, (source, unit) in names.items()}
    mapping = ChannelMap(channels, MappedChannel("data(:,1)", "s"))
    path = MAPPED[layout](tmp_path)
    check(read_dyno_test(path, channel_map=mapping).series)
    with pytest.raises(InputError, match=r"--channel time=COLUMN.*data\(:,1\), data\(:,2\)"):
        read_dyno_test(path)


def test_the_column_that_was_chosen_is_named_and_another_can_be_given(tmp_path):
    path = READ["filtered and raw force"](tmp_path)
    notes = read_dyno_test(path).remarks
    assert any("'Force raw' was read, and not 'Force filtered'" in note for note in notes)
    mapping = with_channels(None, {"force": "Force raw"})
    assert not any("was read" in note for note in read_dyno_test(path, channel_map=mapping).remarks)


SEMICOLONS = H.replace(",", ";")
OTHER = {"t": T, "x": 2e3 * X, "v": 2e3 * V, "F": 1.7 * F}
TDMS = [("Time", "s", T), ("Disp", "mm", 1e3 * X), ("Vel", "mm/s", 1e3 * V), ("Load", "N", F)]


COMMAS = [cells(*one, comma=True) for one in SI]


def force(change):
    """Return the columns with the force as other texts, one per value."""
    return [*SI[:3], [change(value) for value in F]]


def interrupted(line, *, by=100):
    """Return a writer with a line between the samples."""

    def write(folder):
        lines = [",".join(row) for row in rows(SI)]
        for place in range(COUNT - COUNT % by, 0, -by):
            lines.insert(place, line)
        return file_with(folder, "run.csv", "\n".join([H, *lines]) + "\n")

    return write


def ended(end, encoding="utf-8"):
    """Return a writer with another line end."""
    return lambda folder: file_with(folder, "run.csv", end.join([H, *map(",".join, rows(SI))]) + end, encoding)


def dated(step):
    """Return rows whose time is a date, every `step` seconds."""
    start = datetime.datetime(2024, 5, 3, 10)
    return [[start + datetime.timedelta(seconds=step * k), *row[1:]] for k, row in enumerate(grid())]


def struct_array():
    found = np.zeros(4, dtype=[("name", "O"), ("unit", "O"), ("data", "O")])
    for place, one in enumerate(TDMS):
        found[place] = one
    return found


READ |= {
    "thousands dots and decimal comma in quotes": text(
        SEMICOLONS, [*COMMAS[:3], grouped("F", "N", group=".", mark=",")], sep=";"),
    "thousands spaces that do not break": text(
        SEMICOLONS, force(lambda f: f"{f:,.6f}".replace(",", "\u00a0")), sep=";"),
    "thousands apostrophes": text(SEMICOLONS, force(lambda f: f"{f:,.6f}".replace(",", "'")), sep=";"),
    "thousands dots in whole numbers": text(
        "t [s];x [mm];v [mm/s];F [mN]",
        [*COMMAS[:3], [f"{round(1e3 * f):,}".replace(",", ".") for f in F]], sep=";"),
    "UTF-16 with the high byte first": text(H, above="\ufeff", encoding="utf-16-be"),
    "a byte order mark before a preamble": text(H, above="Dyno v3\n", encoding="utf-8-sig"),
    "carriage returns": ended("\r"),
    "the name of the force twice": text(H + ",F [N]", [*SI, cells("x", "mm")]),
    "the name of the displacement twice": text(
        "t [s],Disp [mm],Disp [mm],v [mm/s],F [N]", [*SI[:2], column("0.0"), *SI[2:]]),
    "times with a decimal comma": text(
        "Time;x [mm];v [mm/s];F [N]", [[t.replace(".", ",") for t in clock()], *COMMAS[1:]], sep=";"),
    "ISO times in UTC": text(
        "time,x [mm],v [mm/s],F [N]", [[f"{t}Z" for t in clock(pattern="%Y-%m-%dT%H:%M:%S.%f")], *SI[1:]]),
    "an empty column first": text("," + H, [column(""), *SI]),
    "a header behind #": text("# " + H),
    "a footer with the number of samples": text(H, below="480 samples\n"),
    "force in two units": text("t [s],x [mm],v [mm/s],F [kN],F [N]", [*SI[:3], ("F", "kN"), SI[3]]),
    "magnitude of the velocity beside it": text(
        "Time [s],Position [mm],Abs Velocity [mm/s],Velocity [mm/s],Force [N]",
        [*SI[:2], [f"{abs(1e3 * v):.9g}" for v in V], *SI[2:]]),
    "spreadsheet with merged headings and a row of units": sheets(
        {"Data": [[], ["Time", "Displacement", "Velocity", "Force"], ["s", "mm", "mm/s", "N"], *grid()]},
        merged=[(0, 1, 0, 2, "Motion")]),
    "spreadsheet that begins in cell C3": sheets(
        {"Data": [[], [], [None, None, *NAMES], *([None, None, *row] for row in grid())]}),
    "spreadsheet with statistics beside the samples": sheets(
        {"Data": [[*NAMES, None, "Stat"], *([*row, None, "Min" if i else "Max"] for i, row in enumerate(grid()[:2])),
                  *grid()[2:]]}),
    "spreadsheet with statistics below the samples": sheets(
        {"Data": [NAMES, *grid(), [], ["Mean", 0.0, 0.0, 120.0]]}),
    "spreadsheet with numbers as text, decimal comma": sheets(
        {"Data": [NAMES, *zip(*(cells(*one, ".12f", comma=True) for one in SI), strict=True)]}),
    "tdms with a channel of another length": groups({"Data": [*TDMS, ("Temp", "degC", np.full(12, 30.0))]}),
    "a constant stroke before the position": text(
        "Time [s],Stroke [mm],Position [mm],Velocity [mm/s],Load [N]", [SI[0], column("40.0"), *SI[1:]]),
    "capitals with underscores": text("TIME_SEC,SHOCK_DISP_MM,SHOCK_VEL_MM_PER_SEC,SHOCK_FORCE_N"),
    "mat with structs in structs": matlab({"test": {"data": MM, "units": UNIT_STRUCT}}),
    "mat with a struct per channel": matlab({name: {"data": samples, "unit": unit} for name, unit, samples in TDMS}),
    "mat with an array of structs": matlab({"channels": struct_array()}),
}  # fmt: skip

REFUSED |= {
    "pipes": text(H.replace(",", "|"), sep="|"),
    "names, then sources": text(["Time,Disp,Vel,Force", "LVDT,LVDT,calc,Cell", "s,mm,mm/s,N"]),
    "units above the names": text(["s,mm,mm/s,N", "Time,Disp,Vel,Force"]),
    "Fortran exponents": text(H, [[f"{c}D0" for c in cells(*one, ".9f")] for one in SI]),
    "UTF-32": text(H, encoding="utf-32"),
    "a colon before the milliseconds": text(
        "Time,x [mm],v [mm/s],F [N]", [[f"00:00:{int(t):02d}:{round(1e4 * (t % 1)):04d}" for t in T], *SI[1:]]),
    "a header among the samples": interrupted(H, by=160),
    "statistics without words": text(H, below="0.6,0.0,0.0,120.0\n0.0,14.0,220.0,1200.0\n"),
    "a second table of other columns": text(H, below="\nSpeed [mm/s],Compression [N]\n50,400\n100,700\n"),
    "another delimiter in the header": text(H, sep=";"),
    "a force for each stroke": text("t [s],x [mm],v [mm/s],Bump Force [N],Rebound Force [N]",
             [*SI[:3], [f"{max(f, 0.0):.9g}" for f in F], [f"{min(f, 0.0):.9g}" for f in F]]),
    "spreadsheet with dates every 2.5 ms": sheets({"Data": [["Time", *NAMES[1:]], *dated(2.5e-3)]}),
    "spreadsheet with two runs": sheets({"Run 1": [NAMES, *grid()], "Run 2": [NAMES, *grid((1, 2, 2, 1.7))]}),
    "a page as a spreadsheet": lambda folder: file_with(folder, "run.xls", "<table><tr><td>t [s]</td></tr></table>"),
    "mat with two runs": matlab({"run1": MM | {"units": UNIT_STRUCT}, "run2": OTHER | {"units": UNIT_STRUCT}}),
    "tdms with a group per channel": groups({name: [(name, unit, v)] for name, unit, v in TDMS}),
}  # fmt: skip


@pytest.mark.repeated(30)
@pytest.mark.parametrize("layout", READ)
def test_a_layout_is_read_to_the_same_values(layout, tmp_path):
    test = read_dyno_test(READ[layout](tmp_path))
    check(test.series)
    assert len(test.series) == COUNT
    if not test.derived:
        assert test.series["velocity"] == pytest.approx(V, rel=1e-6, abs=1e-6)
    if "temperature" in test.series:
        assert test.series["temperature"][0] == pytest.approx(300.0, abs=1e-6)


@pytest.mark.parametrize("layout", REFUSED)
def test_a_layout_that_is_not_understood_is_refused_with_advice(layout, tmp_path, unchanged):
    with pytest.raises(InputError) as caught:
        read_dyno_test(REFUSED[layout](tmp_path))
    unchanged(str(caught.value))


def test_dates_of_a_spreadsheet_that_are_exact_to_a_millisecond_are_times(tmp_path):
    series = read_dyno_test(sheets({"Data": [["Time", *NAMES[1:]], *dated(0.01)]})(tmp_path)).series
    assert series.time - series.time[0] == pytest.approx(0.01 * np.arange(COUNT), abs=1e-6)
