"""Layouts of a third attack on the reader: read to the same values, read with a reason, or refused with advice."""

import datetime
from pathlib import Path

import h5py
import numpy as np
import pytest
import xlsxwriter
from nptdms import ChannelObject, TdmsWriter

from eightpost.errors import InputError, UnknownUnitError
from eightpost.rig import read_dyno_test, read_dyno_tests, read_peak_velocity
from eightpost.rig.peak_velocity import peak_velocity_tables
from eightpost.rig.rig_test import check_rig_units
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
    column,
    grid,
    peak_velocity_file,
    sheets,
    text,
)
from .test_layouts import check

NAMES = ["t [s]", "x [mm]", "v [mm/s]", "F [N]"]
H = ",".join(NAMES)
OLDER = [[*row[:3], 1.7 * row[3]] for row in grid()]


def book(contents, *, hidden=()):
    """Return a writer of a workbook with hidden sheets."""

    def write(folder: Path) -> Path:
        path = folder / "run.xlsx"
        with xlsxwriter.Workbook(path) as made:
            pages = [(made.add_worksheet(name), lines) for name, lines in contents.items()]
            for page, lines in pages:
                for i, line in enumerate(lines):
                    page.write_row(i, 0, line)
                if page.name in hidden:
                    page.hide()
                else:
                    page.activate()
                    page.set_first_sheet()
        return path

    return write


CHANNELS = [("Disp", "mm", 1e3 * X), ("Vel", "mm/s", 1e3 * V), ("Force", "N", F)]
TRIGGER = np.datetime64("2024-05-03T10:00:00", "us")


def waveforms(*, late=0.0, unit_key="unit_string", step=1.0 / RATE, x_unit="s", count=COUNT):
    """Return a writer of a .tdms file of waveforms with a trigger; that of the force is `late` seconds later."""

    def write(folder: Path) -> Path:
        path = folder / "run.tdms"
        with TdmsWriter(path) as writer:
            writer.write_segment([
                ChannelObject("Data", name, samples[: count if name == "Force" else COUNT], properties={
                    unit_key: unit, "wf_increment": step, "wf_start_offset": 0.0, "wf_xunit_string": x_unit,
                    "wf_start_time": TRIGGER + np.timedelta64(round(1e6 * late * (name == "Force")), "us")})
                for name, unit, samples in CHANNELS
            ])  # fmt: skip
        return path

    return write


def array_of_structs(folder: Path) -> Path:
    """Write a MATLAB 7.3 file with an array of structs, which MATLAB stores as references."""
    path = folder / "run.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        store, group = file.create_group("#refs#"), file.create_group("run")
        fields = {"name": 0, "unit": 1, "data": 2}
        columns = {field: group.create_dataset(field, (1, 4), dtype=h5py.ref_dtype) for field in fields}
        for i, one in enumerate([("Time", "s", T), *CHANNELS]):
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


#: Read and refused in test_attacked_layouts.py.
READ = {
    "a row of units that is shorter than the names": units_row("s,mm,mm/s,N", more=[column("1")]),
    "seconds, metres and pounds in capitals": text(
        "TIME [S],DISP [MM],VEL [M/S],LOAD [LBF]", [*SI[:2], ("v", "m/s"), ("F", "lbf")]),
    "thousandths of an inch as mils": text(
        "t [s],x [mils],v [in/s],F [lbf]", [SI[0], [f"{1e3 * x / 0.0254:.12g}" for x in X], *US[2:4]]),
    "quotes behind spaces": text(
        ", ".join(f'"{name}"' for name in NAMES), [[f'"{c}"' for c in cells(*one)] for one in SI], sep=", "),
    "a hidden sheet with an older run": book({"Old": [NAMES, *OLDER], "Data": [NAMES, *grid()]}, hidden=("Old",)),
    "a sheet that is hidden, and no other": book({"Data": [NAMES, *grid()], "Page": [["Test 7"]]}, hidden=("Data",)),
    "a remark beside one row": sheets(
        {"Data": [NAMES, *([*row, "bump stop"] if i == 9 else row for i, row in enumerate(grid()))]}),
    "feedback channels": text(
        "Time [s],Position Cmd [mm],Position Fbk [mm],Velocity [mm/s],Load Fbk [N]",
        [SI[0], cells("x", "m"), *SI[1:]]),
    "triggered waveforms": waveforms(),
    "waveforms with the unit of a scale": waveforms(unit_key="NI_UnitDescription"),
    "waveforms with steps in milliseconds": waveforms(step=1e3 / RATE, x_unit="ms"),
    "mat 7.3 with an array of structs": array_of_structs,
    "numbered names and units behind a slash": text("Time / s,Disp 1 / mm,Vel 1 / mm/s,Force 1 / N"),
    "kilograms-force as a suffix": text("t_s,x_mm,v_mm_s,Force_kgf", [*SI[:3], ("F", "kgf")]),
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

REFUSED = {
    "a force that is triggered 10 ms later": (waveforms(late=0.01), "'Force' was left out: it has steps"),
    "a waveform that is shorter": (waveforms(count=300), "it has 300 samples, and the time has 480"),
    "elapsed times of a spreadsheet, rounded to 1 ms": (
        sheets({"Data": [["Time", *NAMES[1:]], *([datetime.timedelta(seconds=r[0]), *r[1:]] for r in grid())]}),
        "read to 1 ms"),
}  # fmt: skip


@pytest.mark.repeated(2)
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


@pytest.mark.parametrize(("capitals", "unit"), [("S", "s"), ("MS", "ms"), ("mS", "ms"), ("M/S", "m/s"), ("m/S", "m/s")])
def test_capitals_of_seconds_are_not_siemens(capitals, unit):
    assert convert(1.0, capitals, unit) == 1.0


@pytest.mark.parametrize("unit", ["mm.s-1", "mm*s^-1", "mm s^-1", "mm.s^-1"])
def test_powers_of_units_may_be_negative(unit):
    assert convert(1.0, unit, "mm/s") == pytest.approx(1.0)


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
    "targets": ("Speed [mm/s],Comp [N],Reb [N],Comp Target [N],Reb Target [N]", [SPEED, BUMP, DROOP, BUMP, 9 * DROOP]),
    "smallest, mean and largest": (
        "Speed [mm/s],Comp Min [N],Comp Avg [N],Comp Max [N],Reb Min [N],Reb Avg [N],Reb Max [N]",
        [SPEED, BUMP / 2, BUMP, 2 * BUMP, DROOP / 2, DROOP, 2 * DROOP]),
    "peaks beside means": (
        "Speed [mm/s],Peak Comp Force [N],Peak Reb Force [N],Avg Comp Force [N]", [SPEED, BUMP, DROOP, BUMP / 2]),
    "German": ("Geschwindigkeit [mm/s],Druckstufe [N],Zugstufe [N]", [SPEED, BUMP, -DROOP]),
    "French": ("Vitesse [mm/s],Compression [N],D\u00e9tente [N]", [SPEED, BUMP, DROOP]),
    "Italian": ("Velocit\u00e0 [mm/s],Compressione [N],Estensione [N]", [SPEED, BUMP, DROOP]),
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
    check_rig_units(pair(), ("lf",), origin=IN_MEMORY)
    with pytest.raises(UnknownUnitError, match="displacement is in inches but labelled mm"):
        check_rig_units(pair(displacement=X / 25.4), ("lf",), origin=IN_MEMORY)
    with pytest.raises(UnknownUnitError, match=r"0\.4 samples per second.*in ms but labelled s"):
        check_rig_units(pair(time=1e3 * T), ("lf",), origin=IN_MEMORY)


def test_shock_at_rest_does_not_show_the_units_of_its_corner():
    noise = np.random.default_rng(1).standard_normal((2, COUNT)) * 1e-4
    series = TimeSeries.from_channels(T, {"displacement": ("m", noise[0]), "velocity": ("m/s", noise[1])})
    check_rig_units(series, ("",), origin=IN_MEMORY)
