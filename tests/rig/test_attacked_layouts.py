"""Layouts written as attacks on the reader: read to the same values, read with a reason, or refused with advice."""

import datetime
from pathlib import Path

import h5py
import numpy as np
import pytest

from eightpost.errors import InputError, UnknownUnitError
from eightpost.rig import read_dyno_test, read_dyno_tests, read_peak_velocity
from eightpost.rig.peak_velocity import peak_velocity_tables
from eightpost.rig.rig_test import _check_rig_units
from eightpost.signals import TimeSeries, read_record, read_series
from eightpost.signals.faults import IN_MEMORY
from eightpost.units import convert

from .layouts import (
    BUMP,
    COUNT,
    DROOP,
    RATE,
    SI,
    SPEED,
    US,
    F,
    T,
    V,
    X,
    cells,
    clock,
    column,
    grid,
    groups,
    matlab,
    peak_velocity_file,
    sheets,
    text,
)
from .test_layouts import check

CHANNELS = [cells(*one, ".9g") for one in SI]
TIME, DISP, VEL, FORCE = CHANNELS
WIDE = str.maketrans("0123456789.-", "０１２３４５６７８９．－")
CYCLE = [f"{t % 0.4:.9g}" for t in T]


def shown(values):
    return [f"{value:.9g}" for value in values]


def parquet(columns):
    """Return a writer of a Parquet file."""
    pd = pytest.importorskip("pandas", reason="durations are written with pandas")

    def write(folder: Path) -> Path:
        path = folder / "run.parquet"
        pd.DataFrame(columns).to_parquet(path)
        return path

    return write


def durations(folder):
    pd = pytest.importorskip("pandas", reason="durations are written with pandas")
    frame = {"time": pd.to_timedelta(T, unit="s"), "x [mm]": 1e3 * X, "v [mm/s]": 1e3 * V, "F [N]": F}
    return parquet(frame)(folder)


READ = {
    "a time of the cycle behind the others": text("t [s],x [mm],v [mm/s],F [N],t cycle [s]", [*CHANNELS, CYCLE]),
    "time in nanoseconds since 1970": text(
        "t [ns],x [mm],v [mm/s],F [N]", [[str(1714730400 * 10**9 + round(t * 1e9)) for t in T], *CHANNELS[1:]]
    ),
    "displacement of the wheel beside": text(
        "t [s],Wheel Disp [mm],Shock Disp [mm],v [mm/s],F [N]", [TIME, shown(1600.0 * X), *CHANNELS[1:]]
    ),
    "two shocks by number, in another order": text(
        "t [s],Disp 2 [mm],Vel 2 [mm/s],Force 1 [N],Disp 1 [mm],Vel 1 [mm/s],Force 2 [N]",
        [TIME, shown(700.0 * X), shown(700.0 * V), FORCE, DISP, VEL, shown(0.5 * F)],
    ),
    "gas, spring and side force beside": text(
        "t [s],x [mm],v [mm/s],Gas Force [N],Spring Force [N],Side Force [N],Force [N]",
        [*CHANNELS[:3], column("120"), shown(3e4 * X), shown(0.1 * F), FORCE],
    ),
    "power, energy and change of the force beside": text(
        "t [s],x [mm],v [mm/s],F*v [W],E [J],dF [N],F [N]",
        [*CHANNELS[:3], shown(F * V), column("0"), shown(np.gradient(F)), FORCE],
    ),
    "full-width digits": text("t [s],x [㎜],v [㎜/s],Ｆ [Ｎ]", [*CHANNELS[:3], [c.translate(WIDE) for c in FORCE]]),
    "a calibration table above": text(
        "t [s],x [mm],v [mm/s],F [N]", CHANNELS, above="Calibration\nmV,N,gain,off\n1,2,3,4\n2,4,6,8\n\n"
    ),
    "carriage returns twice": text("t [s],x [mm],v [mm/s],F [N]\r\r", [*CHANNELS[:3], [f"{c}\r\r" for c in FORCE]]),
    "durations": durations,
}  # fmt: skip

REFUSED = {
    "a tenth of the force": text("t [s],x [mm],v [mm/s],Force/10 [N]", [*CHANNELS[:3], shown(F / 10)]),
    "a multiple of the force": text("t [s],x [mm],v [mm/s],F*10 [N]", [*CHANNELS[:3], shown(10 * F)]),
    "time of the cycle": text("t [s],x [mm],v [mm/s],F [N]", [CYCLE, *CHANNELS[1:]]),
    "shocks of two corners": text(
        "t [s],LF Disp [mm],LF Force [N],RF Disp [mm],RF Force [N]", [TIME, DISP, FORCE, DISP, FORCE]),
    "least and largest force": text("t [s],x [mm],v [mm/s],Force max [N],Force min [N]", [*CHANNELS, FORCE]),
    "extension for compression": text("t [s],Extension [mm],Extension velocity [mm/s],Tension [N]", CHANNELS),
}  # fmt: skip


def test_a_motion_of_another_number_than_the_force_is_read_only_if_there_is_no_other(tmp_path):
    header = "t [s],Disp 2 [mm],Vel 2 [mm/s],Force 1 [N]"
    test = read_dyno_test(text(header, CHANNELS)(tmp_path))
    np.testing.assert_allclose(test.series["displacement"], X, atol=1e-6)


def test_full_width_letters_of_text_columns_do_not_matter(tmp_path):
    record = read_record(text("t [s],F [N],ｎｏｔｅ", [TIME, FORCE, column("ａ")])(tmp_path))
    assert record.names == ("t", "F", "note")
    assert len(record.columns[1]) == COUNT


@pytest.mark.parametrize(
    ("spelling", "unit"),
    [("Pounds-Force", "lbf"), ("lb-f", "lbf"), ("S", "s"), ("MS", "ms"), ("M/S", "m/s"), ("in./sec", "in/s"),
     ("sec.", "s"), ("mm.s-1", "mm/s"), ("mm*s^-1", "mm/s"), ("mm s^-1", "mm/s")],
)  # fmt: skip
def test_spellings_of_loggers_are_units(spelling, unit):
    assert convert(1.0, spelling, unit) == pytest.approx(1.0)


NAMES = ["t [s]", "x [mm]", "v [mm/s]", "F [N]"]
H = ",".join(NAMES)
OLDER = [[*row[:3], 1.7 * row[3]] for row in grid()]


WAVES = [("Disp", "mm", 1e3 * X), ("Vel", "mm/s", 1e3 * V), ("Force", "N", F)]
TRIGGER = np.datetime64("2024-05-03T10:00:00", "us")


def waveforms(*, late=0.0, unit_key="unit_string", step=1.0 / RATE, x_unit="s", count=COUNT):
    """Return a writer of a .tdms file of waveforms with a trigger; that of the force is `late` seconds later."""
    return groups({"Data": [
        (name, "", samples[: count if name == "Force" else COUNT], {
            unit_key: unit, "wf_increment": step, "wf_start_offset": 0.0, "wf_xunit_string": x_unit,
            "wf_start_time": TRIGGER + np.timedelta64(round(1e6 * late * (name == "Force")), "us")})
        for name, unit, samples in WAVES
    ]})  # fmt: skip


def array_of_structs(folder: Path) -> Path:
    """Write a MATLAB 7.3 file with an array of structs, which MATLAB stores as references."""
    path = folder / "run.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        store, group = file.create_group("#refs#"), file.create_group("run")
        fields = {"name": 0, "unit": 1, "data": 2}
        columns = {field: group.create_dataset(field, (1, 4), dtype=h5py.ref_dtype) for field in fields}
        for i, one in enumerate([("Time", "s", T), *WAVES]):
            for field, place in fields.items():
                value = one[place]
                data = np.array([[ord(letter)] for letter in value]) if isinstance(value, str) else value[None, :]
                item = store.create_dataset(f"{field}{i}", data=data)
                item.attrs["MATLAB_class"] = np.bytes_("char" if isinstance(value, str) else "double")
                columns[field][0, i] = item.ref
    with path.open("r+b") as stream:
        stream.write((b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM").ljust(512, b"\0"))
    return path


def units_row(units, *, more=()):
    return text([",".join(["Time", "Disp", "Vel", "Force", *(["Spare"] * len(more))]), units], [*SI, *more])


READ |= {
    "a row of units that is shorter than the names": units_row("s,mm,mm/s,N", more=[column("1")]),
    "a hidden sheet with an older run": sheets({"Old": [NAMES, *OLDER], "Data": [NAMES, *grid()]}, hidden=("Old",)),
    "a sheet that is hidden, and no other": sheets({"Data": [NAMES, *grid()], "Page": [["Test 7"]]}, hidden=("Data",)),
    "a remark beside one row": sheets(
        {"Data": [NAMES, *([*row, "bump stop"] if i == 9 else row for i, row in enumerate(grid()))]}),
    "feedback channels": text(
        "Time [s],Position Cmd [mm],Position Fbk [mm],Velocity [mm/s],Load Fbk [N]",
        [SI[0], cells("x", "m"), *SI[1:]]),
    "triggered waveforms": waveforms(),
    "waveforms with the unit of a scale": waveforms(unit_key="NI_UnitDescription"),
    "waveforms with steps in milliseconds": waveforms(step=1e3 / RATE, x_unit="ms"),
    "mat 7.3 with an array of structs": array_of_structs,
    "a force in counts before the force in newtons": text(
        "t [s],x [mm],v [mm/s],Force [counts],Force [N]", [*SI[:3], column("7"), SI[3]]),
}  # fmt: skip

#: Columns that are not needed, and a part of the reason that is reported.
LEFT_OUT = {
    "a position in volts": (text("t [s],Pos [V],v [mm/s],F [N]"), "'Pos' was not read: its unit 'V'"),
    "a position without a unit": (text("t [s],Pos,v [mm/s],F [N]"), "'Pos' was not read: it has no unit"),
    "a position of words": (text("t [s],x [mm],v [mm/s],F [N]", [SI[0], column("off"), *SI[2:]]), "it contains words"),
    "an empty velocity": (text("t [s],x [mm],v [mm/s],F [N]", [*SI[:2], column(""), SI[3]]), "'v' was not read"),
    "a dead velocity": (text("t [s],x [mm],v [mm/s],F [N]", [*SI[:2], column("0.0"), SI[3]]), "it is constant"),
    "a speed without sign": (
        text("t [s],x [mm],Speed [mm/s],F [N]", [*SI[:2], [f"{abs(1e3 * v):.9g}" for v in V], SI[3]]), "a magnitude"),
    "a temperature of another unit": (text(H + ",Temp [Cel.]", [*SI, column("27")]), "'Temp' was not read"),
    "a commanded velocity": (
        text("t [s],x [mm],Velocity target [mm/s],F [N]", [*SI[:2], column("300"), SI[3]]), "it is a command"),
}  # fmt: skip

REFUSED |= {
    "a force that is triggered 10 ms later": waveforms(late=0.01),
    "a waveform that is shorter": waveforms(count=300),
    "elapsed times of a spreadsheet, rounded to 1 ms": sheets(
        {"Data": [["Time", *NAMES[1:]], *([datetime.timedelta(seconds=r[0]), *r[1:]] for r in grid())]}),
}  # fmt: skip


@pytest.mark.parametrize("layout", LEFT_OUT)
def test_column_that_is_not_needed_does_not_prevent_reading_and_is_reported(layout, tmp_path):
    write, message = LEFT_OUT[layout]
    test = read_dyno_test(write(tmp_path))
    check(test.series)
    assert any(message in note for note in (*test.remarks, *test.warnings))


def test_hidden_sheet_is_not_another_run_and_is_reported(tmp_path):
    (test,) = read_dyno_tests(READ["a hidden sheet with an older run"](tmp_path))
    assert any("the sheet 'Old' is hidden and was not read" in note for note in test.notes)


def test_command_in_place_of_a_measurement_is_a_reason(tmp_path):
    path = text("t [s],Position Command [mm],F [N]", [*SI[:2], SI[3]])(tmp_path)
    rules = [reason.rule for reason in read_dyno_test(path).reasons]
    assert "a command instead of a measurement" in rules


@pytest.mark.parametrize("broken", ["Velocity [rpm],F [N]", "Velocity [mm/s],F"])
def test_nothing_measured_is_replaced_by_a_command_or_by_another_force(broken, tmp_path):
    header = f"t [s],Position Command [mm],{broken},Force 2 [N]"
    with pytest.raises(InputError, match=r"rpm|no unit"):
        read_dyno_test(text(header, [*SI, ("F", "kgf")])(tmp_path))


def test_command_is_read_if_what_is_measured_is_in_volts(tmp_path):
    path = text("t [s],Position Command [mm],Pot [V],F [N]", [*SI[:2], column("1.0"), SI[3]])(tmp_path)
    test = read_dyno_test(path)
    check(test.series)
    assert "a command instead of a measurement" in [reason.rule for reason in test.reasons]


def test_column_of_another_number_of_cells_than_the_names_is_refused(tmp_path):
    """A column without a name that is full is a shift of the names, not remarks."""
    with pytest.raises(InputError, match="name every column"):
        read_dyno_test(text(H, [*SI, column("7")])(tmp_path))


# ---- Tables of peak velocities --------------------------------------------------------------------------------------

#: Header and columns of one setting in layouts with more than speed and two forces.
TABLES = {
    "a speed for each stroke": (
        "Comp Vel [mm/s],Comp Force [N],Reb Vel [mm/s],Reb Force [N]", [SPEED, BUMP, SPEED, DROOP]),
    "frequency and stroke": (
        "Freq [Hz],Stroke [mm],Peak Velocity [mm/s],Comp Force [N],Reb Force [N]",
        [SPEED / 50, [50] * 5, SPEED, BUMP, DROOP]),
    "ratio, slope and temperature": (
        "Speed [mm/s],Comp [N],Reb [N],Reb/Comp,Comp Slope [N.s/m],Comp Temp [degC]",
        [SPEED, BUMP, DROOP, -DROOP / BUMP, BUMP / SPEED, SPEED]),
    "standard deviations": (
        "Speed [mm/s],Comp [N],Reb [N],Comp Std [N],Reb Std [N]", [SPEED, BUMP, DROOP, BUMP / 99, DROOP / 99]),
    "smallest, mean and largest": (
        "Speed [mm/s],Comp Min [N],Comp Avg [N],Comp Max [N],Reb Min [N],Reb Avg [N],Reb Max [N]",
        [SPEED, BUMP / 2, BUMP, 2 * BUMP, DROOP / 2, DROOP, 2 * DROOP]),
    "peaks beside means": (
        "Speed [mm/s],Peak Comp Force [N],Peak Reb Force [N],Avg Comp Force [N]", [SPEED, BUMP, DROOP, BUMP / 2]),
    "German": ("Geschwindigkeit [mm/s],Druckstufe [N],Zugstufe [N]", [SPEED, BUMP, -DROOP]),
    "French": ("Vitesse [mm/s],Compression [N],D\u00e9tente [N]", [SPEED, BUMP, DROOP]),
}  # fmt: skip


@pytest.mark.parametrize("layout", TABLES)
def test_peak_velocity_table_with_more_columns_is_one_setting(layout, tmp_path):
    path = peak_velocity_file(tmp_path, *TABLES[layout])
    assert peak_velocity_tables(path)
    (found,) = read_peak_velocity(path)
    np.testing.assert_allclose(found.speed, 1e-3 * SPEED)
    np.testing.assert_allclose(found.compression, BUMP)
    np.testing.assert_allclose(found.rebound, DROOP)


def test_second_column_of_speeds_belongs_to_the_forces_behind_it(tmp_path):
    header = "Speed [mm/s],Comp [N],Speed [mm/s],Reb [N]"
    (found,) = read_peak_velocity(peak_velocity_file(tmp_path, header, [SPEED, BUMP, 2 * SPEED, DROOP]))
    np.testing.assert_allclose(np.interp([0.1, 0.2], found.speed, found.rebound), DROOP[:2])
    np.testing.assert_allclose(np.interp([0.1, 0.2], found.speed, found.compression), BUMP[[1, 3]])


def test_file_with_a_table_and_a_record_is_read_as_the_record(tmp_path):
    peaks = [["Speed [mm/s]", "Comp [N]", "Reb [N]"], *np.column_stack([SPEED, BUMP, DROOP]).tolist()]
    path = sheets({"PVP": peaks, "Data": [NAMES, *grid()]})(tmp_path)
    assert not peak_velocity_tables(path)
    (test,) = read_dyno_tests(path)
    check(test.series)


# ---- Rig files ------------------------------------------------------------------------------------------------------


def test_usual_names_of_time_are_those_of_every_record(tmp_path):
    path = text("Elapsed Time [s],road [mm]", SI[:2])(tmp_path)
    assert read_series(path).time == pytest.approx(T)
    assert read_record(path).names[0] == "Elapsed Time"


def pair(*, time=T, displacement=X):
    return TimeSeries.from_channels(time, {"lf.displacement": ("m", displacement), "lf.velocity": ("m/s", V)})


def test_units_of_a_rig_record_that_contradict_each_other_are_refused():
    _check_rig_units(pair(), ("lf",), origin=IN_MEMORY)
    with pytest.raises(UnknownUnitError, match="displacement is in inches but labelled mm"):
        _check_rig_units(pair(displacement=X / 25.4), ("lf",), origin=IN_MEMORY)
    with pytest.raises(UnknownUnitError, match=r"0\.4 samples per second.*in ms but labelled s"):
        _check_rig_units(pair(time=1e3 * T), ("lf",), origin=IN_MEMORY)


def test_shock_at_rest_does_not_show_the_units_of_its_corner():
    noise = np.random.default_rng(1).standard_normal((2, COUNT)) * 1e-4
    series = TimeSeries.from_channels(T, {"displacement": ("m", noise[0]), "velocity": ("m/s", noise[1])})
    _check_rig_units(series, ("",), origin=IN_MEMORY)


AT = datetime.datetime(2026, 11, 12, 10, 59, 59, 500000)


def blanks(header, columns=SI, **options):
    """Return a writer of a table whose columns are separated by blanks."""
    return text(header, columns, sep=options.pop("sep", " "), suffix=".txt", **options)


def padded(header, columns=SI):
    """Return a writer of a table of a fixed width, aligned on the right."""
    return text(header, [[f"{c:>22}" for c in cells(*one)] if isinstance(one, tuple) else [f"{c:>22}" for c in one]
                         for one in columns], sep="", suffix=".txt")  # fmt: skip


def dated(pattern, *, start=AT, sep=",", header="Time,x [mm],v [mm/s],F [N]", quote="", days=0):
    """Return a writer of a table with dates and times, the second half of it some days later."""
    later = start + datetime.timedelta(days=days)
    stamps = [*clock(start, pattern)[: COUNT // 2], *clock(later, pattern)[COUNT // 2 :]]
    stamps = [f"{quote}{stamp}{quote}" for stamp in stamps]
    return text(header, [stamps, *SI[1:]], sep=sep)


def signal(name, samples, unit="", **more):
    return {"Name": name, "Type": "float64", "Data": samples, "Unit": unit, **more}


SIGNALS = [("Disp", 1e3 * X, "mm"), ("Vel", 1e3 * V, "mm/s"), ("Force", F, "N")]


def controldesk(names=("Disp", "Vel", "Force"), *, unit="s", axes=1, name="rec_001", has_index=True,
                empty_index=False, slow_first=False):  # fmt: skip
    """Return a writer of a recording of ControlDesk."""
    index = {"XIndex": np.zeros((0, 0)) if empty_index else 1.0} if has_index else {}
    signals = [signal(own, s, u, **index) for own, (_, s, u) in zip(names, SIGNALS, strict=True)]
    times = [signal("", T, unit), signal("", 2.0 * T, unit)][:axes]
    if axes > 1:
        slow = [signal("slow", F, "N", XIndex=2.0)]
        signals = [*slow, *signals] if slow_first else [*signals, *slow]
    content = {"X": times[0] if axes == 1 else np.array(times, dtype=object), "Y": np.array(signals, dtype=object),
               "Description": "run", "Capture": {"DateTime": "2026-11-12", "Length": float(COUNT)}}  # fmt: skip
    return matlab({name: content})


READ |= {
    # Units behind a blank
    "names and units, commas": text("Time s,Disp mm,Vel mm/s,Force N"),
    "words of two parts": text("Time s,Shock Disp in,Shock Vel in/sec,Damper Force lb,Temp deg F", US),
    "capitals behind a blank": text("TIME S,DISP MM,VEL MM/S,FORCE N"),
    "a count beside a force in a unit": text("Time s,Disp mm,Vel mm/s,Load cell N,Load 2", [*SI, column("1")]),
    # Columns between blanks
    "blanks between names and units": blanks("Time s Disp mm Vel mm/s Force N"),
    "blanks, units in a row": blanks(["Time Disp Vel Force", "s mm mm/s N"]),
    "fixed width": padded("Time [s]  Disp [mm]  Vel [mm/s]  Force [N]"),
    "a word behind the numbers": blanks("t[s] x[mm] v[mm/s] F[N] Phase", [*SI, column("up")]),
    "two words, decimal comma": blanks("t[s] x[mm] v[mm/s] F[N] A B", [*SI, column("a"), column("b")], decimal=","),
    "words above a footer": blanks("t[s] x[mm] v[mm/s] F[N] Phase", [*SI, column("up")], below="End of test\n"),
    "a time between blanks": blanks("Time x[mm] v[mm/s] F[N]", [clock(AT), *SI[1:]]),
    # Dates
    "weekday": dated("%A, %d %B %Y %H:%M:%S.%f", quote='"'),
    "year of two digits past midnight": dated("%d.%m.%y %H:%M:%S.%f", start=AT.replace(hour=23, minute=59, second=59)),
    # ControlDesk
    "a recording": controldesk(),
    "a recording with paths": controldesk(['"Model Root"/"Disp"/"Out1"', '"Model Root"/"Vel"/"Out1"',
                                           '"Model Root"/"Force"/"Out1"']),
    "a recording with a slow signal first": controldesk(axes=2, slow_first=True),
    "a footer with a date": text(H, below="12-Nov-2026 11:00:01,end,,\n"),
}  # fmt: skip

REFUSED |= {
    "a unit of another quantity behind a blank": text("Time s,Disp N,Vel mm/s,Force mm"),
    "a factor before the unit": text("Time s,Disp mm,Vel mm/s,Force 10 N"),
    "an unknown unit behind a blank": text("Time s,Disp mm,Vel mm/s,Force Nm"),
    "a word in a row of numbers": blanks(
        "t[s] x[mm] v[mm/s] F[N]", [*SI[:3], ["x" if i == 300 else c for i, c in enumerate(cells("F", "N"))]]),
    "words with blanks": blanks(
        "t[s] x[mm] v[mm/s] F[N] Phase", [*SI, ["going up" if i % 7 else "up" for i in range(COUNT)]]),
    "a date of three words between blanks": blanks(
        "Time x[mm] v[mm/s] F[N]", [clock(AT, "%d %b %Y %H:%M:%S.%f"), *SI[1:]]),
    "a record over days": dated("%d-%b-%Y %H:%M:%S.%f", days=2),
    "a recording without a unit of time": controldesk(unit=""),
    "a recording without names": controldesk(["a", "b", "c"]),
    "a recording without the axis of time of a signal": controldesk(axes=2, has_index=False),
    "a recording with equal names": controldesk(["Rig/Force/Out1", "Rig2/Force/Out1", "x"]),
}  # fmt: skip


# ---- Clicks above the names of peak-velocity tables -----------------------------------------------------------------

COLUMNS = [SPEED, BUMP, DROOP, 1.2 * BUMP, 1.3 * DROOP]
HEAD = "Speed [mm/s],Comp [N],Reb [N],Comp [N],Reb [N]"

#: Rows above the names, and the settings that they give.
ABOVE = {
    "each column": (",3 clicks,3 clicks,6 clicks,6 clicks", ["3 clicks", "6 clicks"]),
    "merged cells": (",3 clicks,,6 clicks,", ["3 clicks", "6 clicks"]),
    "a name of the row": ("Setting,3,3,6,6", ["3", "6"]),
    "words": (",soft,,hard,", ["soft", "hard"]),
    "no settings, a line of a fact": ("Date,12.11.2026", [None, "(2)"]),
    "below a line of facts": ("Shock ID: 7\n,3 clicks,,6 clicks,", ["3 clicks", "6 clicks"]),
}


@pytest.mark.parametrize("layout", ABOVE)
def test_row_above_repeated_names_is_the_setting_of_its_columns(layout, tmp_path):
    above, settings = ABOVE[layout]
    first, second = read_peak_velocity(peak_velocity_file(tmp_path, f"{above}\n{HEAD}", COLUMNS))
    assert [first.clicks, second.clicks] == settings
    np.testing.assert_allclose(first.compression, BUMP)
    np.testing.assert_allclose(second.rebound, 1.3 * DROOP)


@pytest.mark.repeated(30)
@pytest.mark.parametrize("layout", READ)
def test_layout_is_read_to_the_same_values(layout, tmp_path):
    test = read_dyno_test(READ[layout](tmp_path))
    assert len(test.series) == COUNT
    check(test.series)


@pytest.mark.parametrize("layout", REFUSED)
def test_layout_is_refused_with_advice(layout, tmp_path, unchanged):
    with pytest.raises(InputError) as caught:
        read_dyno_test(REFUSED[layout](tmp_path))
    unchanged(str(caught.value))
