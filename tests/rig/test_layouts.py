"""The same record in the layouts of dynamometer rooms is read to the same values, or refused with a helpful message."""

import datetime

import numpy as np
import pytest

from eightpost.errors import InputError
from eightpost.rig import read_dyno_test
from eightpost.rig.columns import with_channels
from eightpost.signals import ChannelMap, MappedChannel

from .layouts import (
    COUNT,
    RATE,
    SI,
    US,
    F,
    T,
    V,
    X,
    clock,
    column,
    excel,
    grouped,
    lvm,
    matlab,
    matlab73,
    tdms,
    text,
    values,
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
    "semicolons, decimal comma": text(H.replace(",", ";"), sep=";", decimal=","),
    "tabs": text(H.replace(",", "\t"), sep="\t", suffix=".txt"),
    "tabs, decimal comma": text(H.replace(",", "\t"), sep="\t", decimal=",", suffix=".tsv"),
    "spaces": text("t[s] x[mm] v[mm/s] F[N]", sep="  ", suffix=".txt"),
    "spaces, header with spaces": text("Time [s]  Disp [mm]  Vel [mm/s]  Force [N]", sep="   ", suffix=".txt"),
    "one space, units in brackets": text("Time [s] Disp [mm] Vel [mm/s] Force [N]", sep=" ", suffix=".dat"),
    "spaces, decimal comma": text("t[s] x[mm] v[mm/s] F[N]", sep="  ", decimal=",", suffix=".txt"),
    "units in a second row": text(["Time,Disp,Vel,Force", "s,mm,mm/s,N"]),
    "units in a row of brackets": text(["Time,Disp,Vel,Force", "[s],[mm],[mm/s],[N]"]),
    "units as suffixes": text("t_s,x_mm,v_mm_s,F_N"),
    "UTF-8 with a byte order mark": text(H, encoding="utf-8-sig"),
    "UTF-16": text(H, encoding="utf-16"),
    "UTF-16 without a byte order mark": text(H, encoding="utf-16-le"),
    "Latin-1": text(H + ",T [°C]", [*SI, ("T", "degC")], encoding="latin-1"),
    "US units, spelled out": text(UH, US),
    "US units in capitals": text("TIME [SEC],DISP [IN],VEL [IN/SEC],FORCE [LBF]", US[:4]),
    "inch per second, pounds": text("time [seconds],disp [inch],vel [inch/second],load [pounds]", US[:4]),
    "kilogram-force": text("t [s],x [mm],v [mm/s],F [Kgf]", [*SI[:3], ("F", "kgf")]),
    "kilonewtons": text("t [s],x [mm],v [mm/s],F [KN]", [*SI[:3], ("F", "kN")]),
    "MM in capitals": text("t [s],x [MM],v [MM/S],F [N]"),
    "time in milliseconds": text("t [msec],x [mm],v [mm/s],F [N]", [("t", "ms"), *SI[1:]]),
    "temperature in deg C": text(H + ",Temp [deg C]", [*SI, ("T", "degC")]),
    "preamble": text(H, above="Shock ID: A7\nTest Date: 3 May\nClicks: 6\n\n"),
    "preamble with cells": text(H, above="Operator,JD,,\nGas Pressure,150,psi,\n"),
    "footer": text(H, below="\nEnd of test\n"),
    "footer of statistics": text(H, below="Max,1.0,2.0,3.0\nMin,0.0,0.0,0.0\n"),
    "trailing delimiter": text(H + ",", [*SI, column("")]),
    "ISO times": text("timestamp,x [mm],v [mm/s],F [N]", [clock(pattern="%Y-%m-%dT%H:%M:%S.%f"), *SI[1:]]),
    "ISO times with a space": text("time,x [mm],v [mm/s],F [N]", [clock(pattern="%Y-%m-%d %H:%M:%S.%f"), *SI[1:]]),
    "times of day": text("Time,x [mm],v [mm/s],F [N]", [clock(), *SI[1:]]),
    "times past midnight": text(
        "Time,x [mm],v [mm/s],F [N]", [clock(datetime.datetime(2024, 5, 3, 23, 59, 59, 600000)), *SI[1:]]
    ),
    "date and time": text("Date,Time,x [mm],v [mm/s],F [N]", [column("2024-05-03"), clock(), *SI[1:]]),
    "thousands in quotes": text("t [s],x [mm],v [mm/s],F [N]", [*SI[:3], grouped("F", "N")]),
    "thousands with points": text(
        "t [s];x [mm];v [mm/s];F [N]",
        [[f"{t:.9f}".replace(".", ",") for t in T],
         *([f"{x:.12f}".replace(".", ",") for x in values(*c)] for c in SI[1:3]),
         grouped("F", "N", group=".", mark=",", quote="")],
        sep=";",
    ),
    "thousands beside decimal points": text(
        "t [s]\tx [mm]\tv [mm/s]\tF [N]", [*SI[:3], grouped("F", "N", quote="")], sep="\t", suffix=".txt"
    ),
    "raw force in volts beside newtons": text(
        "t [s],x [mm],v [mm/s],Force raw [V],Force [N]", [*SI[:3], column("0.5"), SI[3]]
    ),
    "filtered and raw force": text(
        "t [s],x [mm],v [mm/s],Force filtered [N],Force raw [N]", [*SI[:3], column("1.5"), SI[3]]
    ),
    "commanded and measured displacement": text(
        "t [s],Disp command [mm],Disp [mm],v [mm/s],F [N]", [SI[0], column("3.5"), *SI[1:]]
    ),
    "displacement named D": text("t [s],D [mm],v [mm/s],F [N]"),
    "a text column": text(H + ",comment", [*SI, column("ok")]),
    "a column with an unknown unit": text(H + ",aux [flurb]", [*SI, column("7")]),
    "an empty column": text(H + ",spare", [*SI, column("")]),
    "a column with missing samples": text(H + ",aux", [*SI, [""] + ["3"] * (COUNT - 1)]),
    "a column without a name": text("t [s],x [mm],,v [mm/s],F [N]", [*SI[:2], column("9"), *SI[2:]]),
    "two spare columns of one name": text(H + ",aux,aux", [*SI, column("1"), column("2")]),
    "elapsed time": text("Elapsed Time [s],x [mm],v [mm/s],F [N]"),
    "sample numbers first": text("Sample," + H, [[str(i) for i in range(COUNT)], *SI]),
    "spreadsheet": excel(NAMES),
    "spreadsheet with a preamble and a row of units": excel(
        ["s", "mm", "mm/s", "N"], above=(["Shock ID:", "A7"], ["Time", "Disp", "Vel", "Force"])
    ),
    "spreadsheet with a sheet of facts": excel(NAMES, before=["Operator: JD", "Date: today"]),
    "spreadsheet with a footer": excel(NAMES, below=(["End of test"],)),
    "mat": matlab(MM | {"units": UNIT_STRUCT}),
    "mat with a struct": matlab({"run": MM | {"units": UNIT_STRUCT}}),
    "mat with a vector of another length": matlab(MM | {"units": UNIT_STRUCT, "spectrum": T[:77]}),
    "mat 7.3": matlab73(MM | {"units": UNIT_STRUCT}),
    "mat 7.3 with a struct": matlab73({"run": MM | {"units": UNIT_STRUCT}}),
    "tdms": tdms([("Time", "s", T), ("Disp", "mm", 1e3 * X), ("Vel", "mm/s", 1e3 * V), ("Load", "N", F)]),
    "tdms waveform": tdms([("Disp", "mm", 1e3 * X), ("Vel", "mm/s", 1e3 * V), ("Load", "N", F)], step=1.0 / RATE),
    "lvm": lvm(["Disp", "Vel", "Force"], ["mm", "mm/s", "N"], SI),
}  # fmt: skip

#: Layouts that need a map of a matrix, and their files.
MAPPED = {"mat with a matrix": matlab(MATRIX), "mat 7.3 with a matrix": matlab73(MATRIX)}

REFUSED = {
    "no header": (text("", SI), "no header line"),
    "no units": (text("t,x,v,F"), "have no unit"),
    "unknown unit of force": (text("t [s],x [mm],v [mm/s],F [flurb]"), "unknown unit 'flurb'"),
    "force in volts only": (text("t [s],x [mm],v [mm/s],F [V]"), "cannot be converted to 'N'"),
    "no force": (text("t [s],x [mm],v [mm/s]", SI[:3]), "channel 'force'"),
    "force negative in compression": (
        text(H, [*SI[:3], [f"{-f:.9g}" for f in F]]), "--flip force"
    ),
    "words in the force column": (text(H, [*SI[:3], ["bad", *(f"{f:.9g}" for f in F[1:])]]), "'bad' is not a number"),
    "times of day in whole seconds": (
        text("Time,x [mm],v [mm/s],F [N]", [clock(pattern="%H:%M:%S"), *SI[1:]]), "is repeated"
    ),
    "unquoted thousands": (text(H, [*SI[:3], grouped("F", "N", quote="")]), "columns"),
    "a picture as a spreadsheet": (lambda folder: _file(folder / "run.xlsx", b"\x89PNG\r\n" * 9), "a spreadsheet"),
    "a damaged TDMS file": (lambda folder: _file(folder / "run.tdms", b"TDSm" + bytes(99)), "TDMS"),
    "another suffix": (lambda folder: _file(folder / "run.docx", b"words"), "cannot be read as records; .*xlsx"),
}  # fmt: skip


def _file(path, content):
    path.write_bytes(content)
    return path


def check(series):
    for name, expected in (("displacement", X), ("force", F)):
        if name in series:
            assert series[name] == pytest.approx(expected, rel=1e-6, abs=1e-6 * abs(expected).max()), name
    assert series.time - series.time[0] == pytest.approx(T, abs=1e-6)
    assert series["velocity"][50:-50] == pytest.approx(V[50:-50], rel=1e-6, abs=0.02 * V.max())


@pytest.mark.repeated(30)
@pytest.mark.parametrize("layout", READ)
def test_a_layout_is_read_to_the_same_values(layout, tmp_path):
    test = read_dyno_test(READ[layout](tmp_path))
    check(test.series)
    if not test.derived:
        assert test.series["velocity"] == pytest.approx(V, rel=1e-6, abs=1e-6)
    if "temperature" in test.series:
        assert test.series["temperature"][0] == pytest.approx(300.0, abs=1e-6)


@pytest.mark.parametrize("layout", MAPPED)
def test_columns_of_a_matrix_are_addressed_by_a_channel_map(layout, tmp_path):
    names = {"displacement": ("data(:,2)", "mm"), "velocity": ("data(:,3)", "mm/s"), "force": ("data(:,4)", "N")}
    channels = {name: MappedChannel(source, unit) for name, (source, unit) in names.items()}
    mapping = ChannelMap(channels, MappedChannel("data(:,1)", "s"))
    path = MAPPED[layout](tmp_path)
    check(read_dyno_test(path, channel_map=mapping).series)
    with pytest.raises(InputError, match=r"--channel time=COLUMN.*data\(:,1\), data\(:,2\)"):
        read_dyno_test(path)


@pytest.mark.parametrize("layout", REFUSED)
def test_a_layout_that_cannot_be_read_is_refused_with_advice(layout, tmp_path):
    write, message = REFUSED[layout]
    with pytest.raises(InputError, match=f"(?s)run.*{message}"):
        read_dyno_test(write(tmp_path))


def test_the_column_that_was_chosen_is_named_and_another_can_be_given(tmp_path):
    path = READ["filtered and raw force"](tmp_path)
    notes = read_dyno_test(path).remarks
    assert any("'Force raw' was read, and not 'Force filtered'" in note for note in notes)
    mapping = with_channels(None, {"force": "Force raw"})
    assert not any("was read" in note for note in read_dyno_test(path, channel_map=mapping).remarks)


def test_there_are_sixty_layouts():
    assert len(READ) + len(MAPPED) + len(REFUSED) >= 60
