"""Unusual layouts of one record are read to the same values, or refused with a helpful message: none is misread."""

import datetime
import re

import numpy as np
import pytest

from eightpost.errors import InputError
from eightpost.rig import read_dyno_test

from .layouts import (
    COUNT,
    SI,
    F,
    T,
    V,
    X,
    cells,
    clock,
    column,
    every,
    excel,
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
from .test_layouts import check

H = "t [s],x [mm],v [mm/s],F [N]"
SEMICOLONS, NAMES = H.replace(",", ";"), H.split(",")
UNITS = {"t": "s", "x": "mm", "v": "mm/s", "F": "N"}
MM = {"t": T, "x": 1e3 * X, "v": 1e3 * V, "F": F}
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


READ = {
    "minus signs of typesetting": text(H, [[c.replace("-", "\u2212") for c in one] for one in every(".9g")]),
    "a space after each comma": text("t [s], x [mm], v [mm/s], F [N]", sep=", "),
    "semicolons with decimal points": text(SEMICOLONS, sep=";"),
    "German names, a row of units, decimal comma": text(
        ["Zeit;Weg;Geschwindigkeit;Kraft", "s;mm;mm/s;N"], COMMAS, sep=";"),
    "German names in Latin-1": text("Zeit [s];Weg [mm];Geschw. [mm/s];Kraft [N]", COMMAS, sep=";", encoding="latin-1"),
    "thousands dots and decimal comma in quotes": text(
        SEMICOLONS, [*COMMAS[:3], grouped("F", "N", group=".", mark=",")], sep=";"),
    "thousands spaces": text(SEMICOLONS, force(lambda f: f"{f:,.6f}".replace(",", " ")), sep=";"),
    "thousands spaces that do not break": text(
        SEMICOLONS, force(lambda f: f"{f:,.6f}".replace(",", "\u00a0")), sep=";"),
    "thousands apostrophes": text(SEMICOLONS, force(lambda f: f"{f:,.6f}".replace(",", "'")), sep=";"),
    "thousands dots in whole numbers": text(
        "t [s];x [mm];v [mm/s];F [mN]",
        [*COMMAS[:3], [f"{round(1e3 * f):,}".replace(",", ".") for f in F]], sep=";"),
    "exponents": text(H, every(".10E")),
    "plus signs": text(H, every("+.12f")),
    "UTF-16 with the high byte first": text(H, above="\ufeff", encoding="utf-16-be"),
    "a byte order mark before a preamble": text(H, above="Dyno v3\n", encoding="utf-8-sig"),
    "carriage returns": ended("\r"),
    "empty lines between the lines": ended("\r\n\r\n"),
    "product of units": text("Time [s],Displacement [mm],Velocity [mm·s⁻¹],Force [N]"),
    "the same force twice": text(H + ",F [N]", [*SI, SI[3]]),
    "the name of the force twice": text(H + ",F [N]", [*SI, cells("x", "mm")]),
    "the name of the displacement twice": text(
        "t [s],Disp [mm],Disp [mm],v [mm/s],F [N]", [*SI[:2], column("0.0"), *SI[2:]]),
    "hours, minutes, seconds from zero": text(
        "Time,x [mm],v [mm/s],F [N]", [[f"00:00:{t:010.7f}" for t in T], *SI[1:]]),
    "minutes and seconds": text("Time,x [mm],v [mm/s],F [N]", [[f"0:{t:07.4f}" for t in T], *SI[1:]]),
    "times with a decimal comma": text(
        "Time;x [mm];v [mm/s];F [N]", [[t.replace(".", ",") for t in clock()], *COMMAS[1:]], sep=";"),
    "a clock of twelve hours over noon": text(
        "Time,x [mm],v [mm/s],F [N]",
        [clock(datetime.datetime(2024, 5, 3, 11, 59, 59, 600000), "%I:%M:%S.%f %p"), *SI[1:]]),
    "ISO times in UTC": text(
        "time,x [mm],v [mm/s],F [N]", [[f"{t}Z" for t in clock(pattern="%Y-%m-%dT%H:%M:%S.%f")], *SI[1:]]),
    "seconds since 1970": text("time [s],x [mm],v [mm/s],F [N]", [[f"{1714730400 + t:.4f}" for t in T], *SI[1:]]),
    "milliseconds since 1970": text(
        "timestamp [ms],x [mm],v [mm/s],F [N]", [[f"{1714730400000 + 1e3 * t:.1f}" for t in T], *SI[1:]]),
    "microseconds": text("time [us],x [mm],v [mm/s],F [N]", [[f"{1e6 * t:.0f}" for t in T], *SI[1:]]),
    "minutes": text("time [min],x [mm],v [mm/s],F [N]", [[f"{t / 60.0:.12f}" for t in T], *SI[1:]]),
    "an empty column first": text("," + H, [column(""), *SI]),
    "empty columns between": text(
        "t [s],,x [mm],,v [mm/s],,F [N]", [SI[0], column(""), SI[1], column(""), SI[2], column(""), SI[3]]),
    "a header behind #": text("# " + H),
    "a header behind %": text("% " + H),
    "a footer of statistics with words": text(H, below="Mean,0.0,0.0,120.0\nStd Dev,14.0,220.0,1200.0\n"),
    "a footer with the number of samples": text(H, below="480 samples\n"),
    "everything in quotes": text(
        ",".join(f'"{name}"' for name in NAMES), [[f'"{cell}"' for cell in one] for one in every(".12g")]),
    "a line that names the delimiter": text(SEMICOLONS, sep=";", above="sep=;\n"),
    "NaN in a spare column": text(H + ",aux [mm]", [*SI, column("NaN")]),
    "#N/A in a spare column": text(H + ",aux [mm]", [*SI, column("#N/A")]),
    "decanewtons": text("t [s],x [mm],v [mm/s],F [daN]", force(lambda f: f"{0.1 * f:.12g}")),
    "pounds as #": text("t [s],x [mm],v [mm/s],F [#]", [*SI[:3], ("F", "lbf")]),
    "inches, ips and lbs": text(
        "Time (s),Disp (in),Vel (ips),Force (lbs)", [SI[0], ("x", "in"), ("v", "in/s"), ("F", "lbf")]),
    "kilometres per hour": text(
        "t [s],x [m],v [km/h],F [N]", [SI[0], ("x", "m"), [f"{3.6 * v:.12g}" for v in V], SI[3]]),
    "force in two units": text("t [s],x [mm],v [mm/s],F [kN],F [N]", [*SI[:3], ("F", "kN"), SI[3]]),
    "displacement in two units": text("t [s],Disp [in],Disp [mm],v [mm/s],F [N]", [SI[0], ("x", "in"), *SI[1:]]),
    "time in the last column": text("x [mm],v [mm/s],F [N],t [s]", [*SI[1:], SI[0]]),
    "target and actual force": text(
        "Time [s],Position [mm],Velocity [mm/s],Force target [N],Force actual [N]", [*SI[:3], column("1000.0"), SI[3]]),
    "magnitude of the velocity beside it": text(
        "Time [s],Position [mm],Abs Velocity [mm/s],Velocity [mm/s],Force [N]",
        [*SI[:2], [f"{abs(1e3 * v):.9g}" for v in V], *SI[2:]]),
    "a preamble of a drive file": text(H, above="FORMAT=BINARY_IEEE_LITTLE_END\nNUM_PARAMS=3\n"),
    "sections": text(H, above="[Header]\nRate=400\n[Data]\n"),
    "spreadsheet with a merged title": sheets(
        {"Data": [["Shock test"], ["Left front"], NAMES, *grid()]}, merged=[(0, 0, 0, 3, "Shock test")]),
    "spreadsheet with merged headings and a row of units": sheets(
        {"Data": [[], ["Time", "Displacement", "Velocity", "Force"], ["s", "mm", "mm/s", "N"], *grid()]},
        merged=[(0, 1, 0, 2, "Motion")]),
    "spreadsheet that begins in cell C3": sheets(
        {"Data": [[], [], [None, None, *NAMES], *([None, None, *row] for row in grid())]}),
    "spreadsheet with statistics beside the samples": excel(
        [*NAMES, "", "Stat"], [*SI, column(""), ["Max", "Min", *[""] * (COUNT - 2)]]),
    "spreadsheet with statistics below the samples": excel(NAMES, below=([], ["Mean", 0.0, 0.0, 120.0])),
    "spreadsheet with numbers as text": excel(NAMES, every(".12g")),
    "spreadsheet with numbers as text, decimal comma": excel(NAMES, [cells(*one, ".12f", comma=True) for one in SI]),
    "mat with units as suffixes": matlab({"t_s": T, "x_mm": 1e3 * X, "v_mm_s": 1e3 * V, "F_N": F}),
    "tdms with a channel of another length": groups({"Data": [*TDMS, ("Temp", "degC", np.full(12, 30.0))]}),
    "French names": text("Temps (s),Déplacement (mm),Vitesse (mm/s),Force (N)"),
    "units after a slash": text("Time / s,Displacement / mm,Velocity / mm/s,Force / N"),
    "units after a comma": text('"Time, s","Disp, mm","Vel, mm/s","Force, N"'),
    "units after a colon": text("Time: s,Disp: mm,Vel: mm/s,Force: N"),
    "units in braces": text("Time {s},Disp {mm},Vel {mm/s},Force {N}"),
    "powers as text": text("Time [s],Disp [mm],Vel [mm s^-1],Force [N]"),
    "a constant stroke before the position": text(
        "Time [s],Stroke [mm],Position [mm],Velocity [mm/s],Load [N]", [SI[0], column("40.0"), *SI[1:]]),
    "capitals with underscores": text("TIME_SEC,SHOCK_DISP_MM,SHOCK_VEL_MM_PER_SEC,SHOCK_FORCE_N"),
    "a comment among the samples": interrupted("# marker"),
    "two tests side by side": text(f"{H},{H}", [*SI, *every(".9g")]),
    "mat with structs in structs": matlab({"test": {"data": MM, "units": UNITS}}),
    "mat with a struct per channel": matlab({name: {"data": samples, "unit": unit} for name, unit, samples in TDMS}),
    "mat with an array of structs": matlab({"channels": struct_array()}),
    "mat 7.3 with structs in structs": matlab73({"test": {"data": MM | {"units": UNITS}}}),
    "tdms with a group of settings": groups({"Settings": [("Clicks", "", [6.0])], "Data": TDMS}),
}  # fmt: skip

REFUSED = {
    "pipes": (text(H.replace(",", "|"), sep="|"), "supported delimiters"),
    "names, then sources": (text(["Time,Disp,Vel,Force", "LVDT,LVDT,calc,Cell", "s,mm,mm/s,N"]), "--channel time="),
    "units above the names": (text(["s,mm,mm/s,N", "Time,Disp,Vel,Force"]), "'Time', .* have no unit"),
    "names, numbers, units": (text(["Time,Disp,Vel,Force", "1,2,3,4", "s,mm,mm/s,N"]), "--channel time="),
    "names, units, types": (
        text(["Time,Disp,Vel,Force", "(s),(mm),(mm/s),(N)", "float,float,float,float"]), "--channel time="),
    "camel case": (text("TimeS,DispMm,VelMmS,ForceN"), "--channel time="),
    "Fortran exponents": (text(H, [[c.replace("e", "D") for c in one] for one in every(".9e")]), "columns of numbers"),
    "UTF-32": (text(H, encoding="utf-32"), "zero byte"),
    "a colon before the milliseconds": (
        text("Time,x [mm],v [mm/s],F [N]", [[f"00:00:{int(t):02d}:{round(1e4 * (t % 1)):04d}" for t in T], *SI[1:]]),
        "neither a number nor a time"),
    "a header among the samples": (interrupted(H, by=160), "line 162: the file has 3 tables"),
    "statistics without words": (text(H, below="0.6,0.0,0.0,120.0\n0.0,14.0,220.0,1200.0\n"), "time decreases"),
    "a second table of other columns": (text(H, below="\nSpeed [mm/s],Compression [N]\n50,400\n100,700\n"), "line 48"),
    "one column more in the lines": (text(H, [*SI, column("7")]), "4 columns.*5"),
    "one column less in the lines": (text(H + ",T [degC]"), "5 columns.*4"),
    "another delimiter in the header": (text(H, sep=";"), "1 columns"),
    "falling time": (text(H, [one[::-1] for one in every(".12g")]), "time decreases"),
    "a force for each stroke": (
        text("t [s],x [mm],v [mm/s],Bump Force [N],Rebound Force [N]",
             [*SI[:3], [f"{max(f, 0.0):.9g}" for f in F], [f"{min(f, 0.0):.9g}" for f in F]]),
        "Bump Force, Rebound Force"),
    "no time": (text("x [mm],v [mm/s],F [N]", SI[1:], above="Sample Rate: 400 Hz\n"), "'time'"),
    "spreadsheet with dates every 2.5 ms": (sheets({"Data": [["Time", *NAMES[1:]], *dated(2.5e-3)]}), "read to 1 ms"),
    "spreadsheet with two runs": (
        sheets({"Run 1": [NAMES, *grid()], "Run 2": [NAMES, *grid((1, 2, 2, 1.7))]}), "2 tables"),
    "a page as a spreadsheet": (
        lambda folder: file_with(folder, "run.xls", "<table><tr><td>t [s]</td></tr></table>"), "not a spreadsheet"),
    "mat with two runs": (
        matlab({"run1": MM | {"units": UNITS}, "run2": OTHER | {"units": UNITS}}), r"run1\.t.*run2\.t"),
    "tdms with two runs": (groups({"Run 1": TDMS, "Run 2": TDMS}), "2 tables"),
    "tdms with a group per channel": (groups({name: [(name, unit, v)] for name, unit, v in TDMS}), "4 tables"),
    "tdms without units": (groups({"Data": [(name, "", v) for name, _, v in TDMS]}), "'Time', .* have no unit"),
    "json": (lambda folder: file_with(folder, "run.json", '{"t": [0, 1]}'), "--channel force=COLUMN"),
}  # fmt: skip


@pytest.mark.repeated(30)
@pytest.mark.parametrize("layout", READ)
def test_an_unusual_layout_is_read_to_the_same_values(layout, tmp_path):
    test = read_dyno_test(READ[layout](tmp_path))
    check(test.series)
    assert len(test.series) == COUNT
    if not test.derived:
        assert test.series["velocity"] == pytest.approx(V, rel=1e-6, abs=1e-6)


@pytest.mark.parametrize("layout", REFUSED)
def test_an_unusual_layout_that_is_not_understood_is_refused_with_advice(layout, tmp_path):
    write, message = REFUSED[layout]
    with pytest.raises(InputError) as caught:
        read_dyno_test(write(tmp_path))
    # The name of the test's folder may contain the words that are looked for.
    assert re.search(f"(?s)run.*{message}", str(caught.value).replace(str(tmp_path), ""))


def test_dates_of_a_spreadsheet_that_are_exact_to_a_millisecond_are_times(tmp_path):
    series = read_dyno_test(sheets({"Data": [["Time", *NAMES[1:]], *dated(0.01)]})(tmp_path)).series
    assert series.time - series.time[0] == pytest.approx(0.01 * np.arange(COUNT), abs=1e-6)
