"""Layouts of the exports of dynamometers, loggers and spreadsheets: read to the same values, or refused with advice."""

import csv
import re

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from eightpost.errors import InputError
from eightpost.rig import read_dyno_test, read_dyno_tests
from eightpost.signals.csv_file import _is_cut_off, _split_cells
from eightpost.signals.formats import read_records
from eightpost.signals.table_text import split_header

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
    groups,
    rows,
    sheets,
    text,
    values,
)
from .test_layouts import check

H = "t [s],x [mm],v [mm/s],F [N]"
NAMES = H.split(",")
COMMAS = [cells(*one, comma=True) for one in SI]
CHANNELS = [("Disp", "mm", 1e3 * X), ("Vel", "mm/s", 1e3 * V), ("Load", "N", F)]


def lines(columns, sep=","):
    return "\n".join(sep.join(row) for row in rows(columns)) + "\n"


def raw(content, name="run.csv", encoding="utf-8"):
    return lambda folder: file_with(folder, name, content, encoding)


def quoted(heads, columns, above="", sep=","):
    """Return a writer of a text file with every cell in quotes."""
    head = [sep.join(f'"{cell}"' for cell in row) for row in heads]
    return text(head, [[f'"{cell}"' for cell in cells(*one)] for one in columns], sep=sep, above=above)


def three_decimals(mark, quote="", group=""):
    """Return the columns with three decimals, time in milliseconds."""
    swap = {",": group, ".": mark}
    return [
        ["".join([quote, *(swap.get(letter, letter) for letter in f"{value:,.3f}"), quote]) for value in values(*one)]
        for one in [("t", "ms"), *SI[1:]]
    ]


def waveforms(steps, starts):
    """Return a writer of a .tdms file of waveforms with their own increments and starts."""
    times = [{"wf_increment": step, "wf_start_offset": start} for step, start in zip(steps, starts, strict=True)]
    return groups({"Data": [(*one, own) for one, own in zip(CHANNELS, times, strict=True)]})


def speeds(count):
    head = "Time (sec),Position (in),Velocity (in/sec),Force (lbs)\n"
    return "".join(f"Speed {k}: {5 * k} in/sec\n{head}{lines(US[:4])}" for k in range(1, count + 1))


MOTEC = '"Format","MoTeC CSV File",,,"Workbook",""\n"Sample Rate","400.000","Hz",,"Segment","",\n\n\n'
READ = {
    "channels in rows": raw("\n".join(",".join([n, *cells(*one)]) for n, one in zip(NAMES, SI, strict=True)) + "\n"),
    "everything in quotes, words above": quoted(
        [["Time (sec)", "Position (in)", "Velocity (in/sec)", "Force (lbs)", "Temp (F)"]], US,
        above='"Shock 6.3"\n"Shock: LF-22"\n"Test: PVP 10 ips"\n\n'),
    "title of the run above the names, row of units": raw(
        ",Run 1,,\nTime,Disp,Vel,Force\nsec,mm,mm/sec,N\n" + lines(SI)),
    "line of marks, tabs, time last": raw(
        "MTS793|MPT|ENU|1|2|.|/|:|1|0|0|A\n\nData Acquisition\t\t\tTime: 10.0\tSec\n"
        "Axial Displacement\tAxial Force\tTime\nmm\tkN\tSec\n" + lines([("x", "mm"), ("F", "kN"), ("t", "s")], "\t"),
        "run.txt"),
    "a column of labels": raw(
        "Name,Time,Disp,Vel,Force\nUnits,s,mm,mm/s,kN\n"
        + lines([[str(i) for i in range(COUNT)], *SI[:3], ("F", "kN")])),
    "semicolons, decanewtons, German": raw(
        "Pruefling: A7\nDatum: 03.05.2024\nZeit [s];Weg [mm];Kraft [daN];Temp. [°C]\n"
        + lines([*COMMAS[:2], [f"{0.1 * f:.9g}".replace(".", ",") for f in F], cells("T", "degC", comma=True)], ";"),
        encoding="latin-1"),
    "quoted names and units": quoted([["Time", "Damper Pos", "Damper Vel", "Damper Force"],
                                      ["s", "mm", "mm/s", "N"]], SI, MOTEC),
    "column numbers under the units": quoted(
        [["Time", "Shock Disp", "Shock Speed", "Load"], ["s", "mm", "mm/s", "N"], ["1", "2", "3", "4"]], SI,
        '"Format","AiM CSV File"\n"Session","7"\n'),
    "blocks in braces": raw(
        "PiToolboxVersionedASCIIDataSet\nVersion\t2\n\n{OutingInformation}\nCarName\tX\n\n{ChannelBlock}\n"
        "Time[s]\tDamper_Pos[mm]\tDamper_Vel[mm/s]\tDamper_Force[N]\n" + lines(SI, "\t"), "run.txt"),
    "two tables side by side": text(
        ",".join([*NAMES, "", *NAMES]), [*SI, column(""), *([f"{k * float(c):.9g}" for c in cells(*one)]
                                                            for k, one in zip((2, 1.5, 0.75, 1.7), SI, strict=True))]),
    "two tables side by side, the second shorter": text(
        ",".join([*NAMES, *NAMES]), [*SI, *(cells(*one)[:300] + [""] * (COUNT - 300) for one in SI)]),
    "a time for each channel": text("t [s],F [N],t [s],x [mm],t [s],v [mm/s]", [SI[0], SI[3], *SI[:2], SI[0], SI[2]]),
    "Japanese in Shift-JIS": text("時間[s],変位[mm],速度[mm/s],荷重[N]", encoding="cp932"),
    "dashes in a spare column": text(H + ",aux", [*SI, ["---"] * 10 + ["1"] * (COUNT - 10)]),
    "a named delimiter in UTF-16": text(H.replace(",", ";"), COMMAS, sep=";", above="sep=;\n", encoding="utf-16"),
    "decimal commas in quotes beside commas": text("t [ms],x [mm],v [mm/s],F [N]", three_decimals(",", '"')),
    "decimal commas, thousands points": text("t [ms]\tx [mm]\tv [mm/s]\tF [N]", three_decimals(",", group="."),
                                             sep="\t", suffix=".txt"),
    "decimal commas beside decimal points": text(
        "t [s];x [mm];v [mm/s];F [N]", [COMMAS[0], *three_decimals(".")[1:]], sep=";"),
    "days with points": text("Zeit;x [mm];v [mm/s];F [N]", [clock(pattern="%d.%m.%Y %H:%M:%S.%f"), *COMMAS[1:]],
                             sep=";"),
    "names over two rows": raw(
        "Shock,Shock,Damper,Axial\nTime (s),Position (mm),Velocity (mm/s),Force (N)\n" + lines(SI)),
    "temperatures in every tenth row": text(H + ",Temp [degC]", [*SI, ["" if i % 10 else "27" for i in range(COUNT)]]),
    "no temperature in its column": text(H + ",Temp [degC]", [*SI, column("n/a")]),
    "line breaks in the header": raw('"Time\n[s]","Disp\n[mm]","Vel\n[mm/s]","Force\n[N]"\n' + lines(SI)),
    "spreadsheet with groups, names, units and an empty row": sheets(
        {"Data": [["Test 7"], [None, "Motion", None, "Load"], ["Time", "Disp", "Vel", "Force"],
                  ["(s)", "(mm)", "(mm/s)", "(N)"], [], *grid()]}),
    "spreadsheet with statistics above the samples": sheets(
        {"Data": [["", "t", "x", "v", "F"], ["Max", 1.2, 20, 314, 1700], ["Min", 0, -20, -314, -1400], [],
                  [None, *NAMES], *([None, *row] for row in grid())]}),
    "comments of other programs": raw(
        H + "\n" + "".join(line + ("" if i % 100 else "% cycle, 7\n")
                           for i, line in enumerate(lines(SI).splitlines(keepends=True), 1))),
    "a peak beside the force": text("t [s],x [mm],v [mm/s],Peak Force [N],Force [N]",
                                    [*SI[:3], [f"{f:.9g}" for f in np.maximum.accumulate(F)], SI[3]]),
    "units behind a slash, decimal comma": text("t/s;s/mm;v/(mm/s);F/N", COMMAS, sep=";"),
    "tdms with settings and a spectrum": groups({
        "Settings": [("Clicks", "", [6.0])], "Data": [("Time", "s", T), *CHANNELS],
        "Spectrum": [("Frequency", "Hz", T[:99]), ("Size", "N", F[:99])]}),
}  # fmt: skip

REFUSED = {
    "three speeds, one below the other": raw(speeds(3)),
    "scale factors under the units": raw("Time,Disp,Vel,Force\ns,mm,mm/s,N\n1,0.5,1,2\n" + lines(SI)),
    "descriptions between names and units": raw(
        "Time\tDisp\tForce\nClock\tLVDT 3\tCell 2\ns\tmm\tN\n" + lines([*SI[:2], SI[3]], "\t"), "run.txt"),
    "waveforms without names": raw(
        "waveform\t[0]\t[1]\nt0\t03.05.2024 10:00:00\t03.05.2024 10:00:00\ndelta t\t0.0025\t0.0025\n\n"
            "time\tY[0]\tY[1]\n" + lines([*SI[:2], SI[3]], "\t"), "run.txt"),
    "the time of the other table": text("t [s],F [N],t [s],x [mm]", [SI[0], SI[3], [f"{2 * t:.9g}" for t in T], SI[1]]),
    "units in the cells": text("Time,Disp,Vel,Force", [[f"{c} {u}" for c in cells(*one)]
                                     for one, u in zip(SI, ("s", "mm", "mm/s", "N"), strict=True)]),
    "a minus behind the number": text(
        H, [SI[0], *([re.sub(r"^-(.*)", r"\1-", c) for c in cells(*one)] for one in SI[1:])]),
    "least and largest values under the units": raw(
        "Time,Disp,Vel,Force\ns,mm,mm/s,N\nMin,-20,-314,-1400\nMax,20,314,1700\n" + lines(SI)),
    "days as a number": sheets({"Data": [["Time", *NAMES[1:]], *([row[0] / 86400.0, *row[1:]] for row in grid())]}),
    "tdms with a force that starts later": waveforms([2.5e-3] * 3, [0.0, 0.0, 5e-3]),
    "tdms with a force at half the rate": waveforms([2.5e-3, 2.5e-3, 5e-3], [0.0] * 3),
}  # fmt: skip


@pytest.mark.repeated(20)
@pytest.mark.parametrize("layout", READ)
def test_an_export_is_read_to_the_same_values(layout, tmp_path):
    test = read_dyno_test(READ[layout](tmp_path))
    rounded = "decimal" in layout and ("three" in layout or "thousands" in layout or "quotes" in layout)
    if not (rounded or "points" in layout):
        check(test.series)
    assert len(test.series) == COUNT
    for name, expected in (("displacement", X), ("velocity", V), ("force", F)):
        if name in test.series and name not in ("velocity" if test.derived else ""):
            assert test.series[name] == pytest.approx(expected, abs=1e-4 * abs(expected).max()), name
    assert test.series.time - test.series.time[0] == pytest.approx(T, abs=1e-6)


@pytest.mark.slow
def test_what_is_noted_about_each_layout_is_kept(tmp_path, unchanged):
    """Columns, units, notes and origin of each table, and the words with which a layout is refused."""
    kept = {}
    for layout, write in (READ | REFUSED).items():
        folder = tmp_path / re.sub(r"\W", "_", layout)
        folder.mkdir()
        try:
            records = read_records(write(folder))
        except InputError as error:
            kept[layout] = str(error).replace(str(folder), "")
            continue
        for k, one in enumerate(records):
            columns = "; ".join(f"{name} [{unit}]" for name, unit in zip(one.names, one.units, strict=True))
            lines, numbers = one.origin.lines, [column for column in one.columns if column.dtype != object]
            first = "" if lines is None else f"from line {lines[0]}, units in {one.origin.header_line}"
            said = [*one.notes, *one.steps, *(" ".join(row) for row in one.preamble)]
            kept[f"{layout}, table {k}"] = f"{columns}: {len(one.columns[0])} samples {first}. {'; '.join(said)}"
            kept[f"{layout}, last numbers {k}"] = np.array([column[-1] for column in numbers], dtype=np.float64)
    unchanged(kept)


@pytest.mark.parametrize("layout", REFUSED)
def test_an_export_that_is_not_understood_is_refused_with_advice(layout, tmp_path, unchanged):
    with pytest.raises(InputError) as caught:
        read_dyno_test(REFUSED[layout](tmp_path))
    unchanged(str(caught.value))


def test_settings_of_a_tdms_file_are_conditions(tmp_path):
    (test,) = read_dyno_tests(READ["tdms with settings and a spectrum"](tmp_path))
    assert test.conditions.clicks == "Clicks 6"


def test_comments_among_the_samples_are_a_note_because_they_may_state_a_change(tmp_path):
    notes = read_dyno_test(READ["comments of other programs"](tmp_path)).notes
    assert any(
        "4 comment lines among the samples were left out, the first is line 102: '% cycle, 7'" in n for n in notes
    )


def test_tables_side_by_side_are_reported(tmp_path):
    notes = read_dyno_test(READ["two tables side by side"](tmp_path)).remarks
    assert any("'F' was read, and not 'F (2)'" in note for note in notes)


def test_slow_temperatures_are_interpolated_and_missing_ones_left_out(tmp_path):
    slow = read_dyno_test(READ["temperatures in every tenth row"](tmp_path))
    assert slow.series["temperature"] == pytest.approx(np.full(COUNT, 300.15))
    none = read_dyno_test(READ["no temperature in its column"](tmp_path))
    assert "temperature" not in none.series
    assert any("'Temp' was not read" in note for note in none.remarks)


# ---- Files that were cut off ----------------------------------------------------------------------------------------

#: A force without repeated samples, so that few numbers end in zeros.
NOISE = 1e-2 * np.random.default_rng(4).standard_normal(COUNT)


def table(form):
    columns = [T, 1e3 * X, 1e3 * V, F + NOISE]
    return H + "\n" + "\n".join(",".join(form.format(value) for value in row) for row in zip(*columns, strict=True))


FORMS = ("{:.4f}", "{:.6E}", "{:.15g}")


@pytest.mark.nightly
@settings(max_examples=60, deadline=None)
@given(form=st.sampled_from(FORMS), data=st.data())
def test_a_file_that_ends_within_its_last_number_loses_this_sample_and_no_other(form, data, tmp_path_factory):
    whole = table(form)
    last = len(whole) - whole.rfind(",") - 1
    removed = data.draw(st.integers(0, last - 2))
    path = tmp_path_factory.mktemp("cut") / "run.csv"
    path.write_text(whole[: len(whole) - removed], encoding="utf-8")
    try:
        test = read_dyno_test(path)
    except InputError as error:
        assert "481" in str(error)  # a mantissa without its exponent is not a number
        return
    assert test.series["force"] == pytest.approx((F + NOISE)[: len(test.series)], abs=1e-3)
    assert len(test.series) == COUNT or any("last sample (line 481) was left out" in note for note in test.notes)


@settings(max_examples=60, deadline=None)
@given(
    form=st.sampled_from(["{:.6g}", "{:.4g}", "{:.15g}", "{:.0f}"]),
    comma=st.booleans(),
    count=st.integers(100, COUNT),
    kept=st.integers(1, 12),
)
def test_a_number_without_its_last_digits_is_left_out_or_close_to_its_neighbours(form, comma, count, kept):
    forces = (F + NOISE)[:count]
    cells = [form.format(value).replace(".", "," if comma else ".") for value in forces]
    cut = cells[-1][:kept]
    assume(any(letter.isdigit() for letter in cut))
    assume(not _is_cut_off([*cells[:-1], cut], has_end=False))
    bends = np.abs(np.diff(forces, 2))
    assert float(cut.replace(",", ".")) == pytest.approx(forces[-1], abs=4.0 * bends.max())


@pytest.mark.parametrize(("above", "is_cut"), [("0.123", True), ("0.1", False)])
def test_a_number_of_an_ended_line_is_cut_off_only_if_all_above_it_have_more_decimals(above, is_cut):
    """A program that leaves out zeros at the end writes short numbers anywhere."""
    cells = ["0.123"] * 60
    cells[30] = above
    assert _is_cut_off([*cells, "0.12"], has_end=True) == is_cut


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("end", ["", "\n"])
def test_no_sample_of_a_whole_file_is_left_out(form, end, tmp_path):
    path = file_with(tmp_path, "run.csv", table(form) + end)
    test = read_dyno_test(path)
    assert len(test.series) == COUNT
    assert not any("left out" in note for note in test.notes)


# ---- Headers --------------------------------------------------------------------------------------------------------

UNITS = {"mm": "m", "in": "m", "mm/s": "m/s", "in/s": "m/s", "N": "N", "kN": "N", "lbf": "N", "s": "s", "ms": "s"}


@given(name=st.sampled_from(["Time", "Shock Disp", "F", "Load 2"]), unit=st.sampled_from(sorted(UNITS)),
       mark=st.sampled_from([" [{}]", "({})", " / {}", "/({})", ", {}", ": {}", " {{{}}}"]))  # fmt: skip
def test_a_unit_is_found_in_every_notation(name, unit, mark):
    assert split_header(name + mark.format(unit)) == (name, unit)


@given(st.text('01., ;"\r\na\x0b', max_size=9), st.sampled_from(",;\t"))
def test_a_line_has_the_cells_that_the_csv_module_finds(line, delimiter):
    try:
        expected = next(csv.reader([line], delimiter=delimiter), [])
    except csv.Error:
        expected = [line]
    assert _split_cells(line, delimiter) == [cell.strip() for cell in expected]


@pytest.mark.parametrize(("length", "count"), [(100_000, 2), (140_000, 1)])
def test_a_line_with_a_cell_beyond_the_limit_of_the_csv_module_is_one_cell(length, count):
    assert len(_split_cells("a" * length + ",b", ",")) == count
