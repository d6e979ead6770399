"""Layouts of public loggers and programs of this trade: read to the numbers written, or refused with what to add."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from eightpost import errors
from eightpost.rig import read_dyno_test, read_dyno_tests
from eightpost.rig.columns import with_channels
from eightpost.rig.dyno_conditions import conditions_in
from eightpost.signals import ChannelMap, MappedChannel

from .layouts import COUNT, RATE, SI, F, T, V, X, cells, file_with, matlab, text

H = "Time [s],Displacement [mm],Velocity [mm/s],Force [N]"


def written(*columns, sep=","):
    """Return lines of cells."""
    return "\n".join(sep.join(row) for row in zip(*columns, strict=True)) + "\n"


def agrees(test, *, displacement=X, velocity=V, force=F):
    """Compare the channels of a test that are not None with those written."""
    for name, expected in (("displacement", displacement), ("velocity", velocity), ("force", force)):
        if expected is not None:
            np.testing.assert_allclose(test.series[name], expected, atol=2e-4 * np.abs(expected).max())


def daq(folder, mark="DAQ Start"):
    """Write a file of a DAQ: a preamble, dates and times, channels without units, marks of events in the first line."""
    head = "Header Size:  7\nSampling Rate:  400\nSample Number, Date/Time, CHANNEL0, CHANNEL1, Events\n"
    numbers = [str(i + 1) for i in range(COUNT)]
    clock = [f" 05/13/2026 05:00:{10 + t:07.4f} PM" for t in T]
    volts = [[f" {value:.6f}" for value in 10.0 * X], [f" {value:.6f}" for value in F / 100.0]]
    volts[1][0] += f", {mark}"
    return file_with(folder, "run.txt", head + written(numbers, clock, *volts))


def test_a_logger_with_marks_of_events_in_its_first_line_is_read_by_its_channel_names(tmp_path):
    path = daq(tmp_path)
    with pytest.raises(
        errors.MissingChannelError,
        match=r"line 3, channel 'force'.*--channel force=COLUMN --channel displacement=COLUMN; .*CHANNEL0, CHANNEL1",
    ):
        read_dyno_test(path)
    mapping = with_channels(None, {"displacement": "CHANNEL0", "force": "CHANNEL1"})
    with pytest.raises(errors.MissingUnitError, match=r"--channel 'displacement=\[unit\]' --channel 'force=\[unit\]'"):
        read_dyno_test(path, channel_map=mapping)
    test = read_dyno_test(path, channel_map=mapping, units={"displacement": "m", "force": "N"})
    agrees(test, displacement=10.0 * X, velocity=None, force=F / 100.0)
    np.testing.assert_allclose(test.series.time, T, atol=1e-4)
    assert not any("Events" in reason.statement for reason in test.reasons)


def test_a_number_that_only_the_first_line_has_is_no_mark_of_an_event_but_a_damaged_table(tmp_path):
    with pytest.raises(errors.FileFormatError, match="5 columns, but the lines of numbers have 4"):
        read_dyno_test(daq(tmp_path, mark="7.5"))


def logger(folder, *, step=2.5, lost=None):
    """Write a file of a microcontroller that rounds its milliseconds down; one sample may be lost."""
    millis = [str(int(step * i)) for i in range(COUNT)]
    columns = [millis, *(cells(*one) for one in (("F", "N"), ("x", "mm"), ("T", "degC")))]
    columns = [[cell for i, cell in enumerate(column) if i != lost] for column in columns]
    return file_with(folder, "run.csv", "Millis,Load_Cell,Linear_Pot,Thermocouple\n" + written(*columns))


UNITS = {"force": "N", "displacement": "mm", "temperature": "degC"}


def test_a_millisecond_logger_is_read_and_asks_for_all_its_units_at_once(tmp_path):
    path = logger(tmp_path)
    with pytest.raises(
        errors.MissingUnitError,
        match=r"'Linear_Pot', 'Thermocouple' have no unit.*'force=\[unit\]' --channel 'displacement=\[unit\]'",
    ):
        read_dyno_test(path)
    test = read_dyno_test(path, units=UNITS)
    agrees(test, velocity=None)
    np.testing.assert_allclose(test.series["temperature"], 300.0 + 0.5 * T)


@pytest.mark.parametrize("step", [2.0, 2.5])
def test_times_that_were_rounded_to_whole_numbers_are_spread_evenly_with_a_note(tmp_path, step):
    test = read_dyno_test(logger(tmp_path, step=step), units=UNITS)
    np.testing.assert_allclose(np.diff(test.series.time), 1e-3 * step, rtol=1e-3)
    agrees(test, velocity=None)
    assert any("spread evenly" in note for note in test.derived) == (step != 2.0)


def test_a_lost_sample_and_times_that_were_rounded_too_far_are_not_spread(tmp_path):
    with pytest.raises(errors.TimeGapError, match="there is a gap"):
        read_dyno_test(logger(tmp_path, step=2.5, lost=200), units=UNITS)
    with pytest.raises(errors.DuplicateTimeError, match="is repeated"):
        read_dyno_test(logger(tmp_path, step=0.4), units=UNITS)


def test_json_without_names_is_read_by_the_numbers_of_its_columns_with_the_units_that_it_states(tmp_path):
    data = np.column_stack([T, X / 0.0254, F / 4448.2216152605]).tolist()
    content = {"data": data, "displacement units": "in", "friction force units": "kip", "dt": 1.0 / RATE}
    path = file_with(tmp_path, "run.json", json.dumps(content))
    with pytest.raises(errors.MissingChannelError, match=r"--channel time=COLUMN .*data\(:,1\), data\(:,2\)"):
        read_dyno_test(path)
    names = {"time": "data(:,1)", "displacement": "data(:,2)", "force": "data(:,3)"}
    agrees(read_dyno_test(path, channel_map=with_channels(None, names), units={"time": "s"}), velocity=None)


@pytest.mark.parametrize("has_rows", [False, True], ids=["a list per channel", "an object per sample"])
def test_json_with_names_is_read_like_a_table(tmp_path, has_rows):
    columns = {"t [s]": T.tolist(), "x [mm]": (1e3 * X).tolist(), "F [N]": F.tolist(), "note": "12 clicks"}
    rows = [dict(zip(columns, row, strict=False)) for row in zip(*list(columns.values())[:3], strict=True)]
    agrees(read_dyno_test(file_with(tmp_path, "run.json", json.dumps(rows if has_rows else columns))), velocity=None)


@pytest.mark.parametrize(
    ("content", "message"),
    [("[1, 2]", "no names of channels"), ('{"kind": "shock"}', "is a shock file, not a record"),
     ('{"t": [0.0]}', "no numeric vector"), ("{", "cannot be read as JSON")],
)  # fmt: skip
def test_json_that_is_no_record_is_refused(tmp_path, content, message):
    with pytest.raises(errors.FileFormatError, match=message):
        read_dyno_test(file_with(tmp_path, "run.json", content))


def recordings(count):
    """Return the array of structs in which files of CTW are kept: File, Data.signals(k).Name and .Value."""
    files = np.zeros((1, count), dtype=[("File", "O"), ("Data", "O")])
    for k in range(count):
        signals = np.zeros((1, 3), dtype=[("Name", "O"), ("Value", "O")])
        for j, (name, value) in enumerate((("Time", T), ("Velocity", 1e3 * V), ("Force", (1 + k) * F))):
            signals[0, j] = (name, value)
        files[0, k] = (f"FR {k} 2 10 10.dctw", {"signals": signals})
    return {"files": files}


@pytest.mark.parametrize("count", [1, 2])
def test_an_array_of_recordings_in_a_mat_file_has_a_test_of_each(tmp_path, count):
    path = matlab(recordings(count))(tmp_path)
    with pytest.raises(
        errors.MissingUnitError,
        match=r"--channel 'time=\[unit\]' --channel 'velocity=\[unit\]' --channel 'force=\[unit\]'",
    ):
        read_dyno_tests(path)
    tests = read_dyno_tests(path, units={"time": "s", "velocity": "mm/s", "force": "N"})
    assert len(tests) == count
    for k, test in enumerate(tests):
        agrees(test, displacement=None, force=(1 + k) * F)


@pytest.mark.parametrize("name", ["run.dctw", "run.pvp"])
def test_files_of_programs_whose_layout_is_not_documented_are_refused_with_how_to_export_them(tmp_path, name):
    path = tmp_path / name
    path.write_bytes(b"\xd0\xcf\x11\xe0" + bytes(600))
    with pytest.raises(errors.FileFormatError, match=rf"{name}.*not documented: export time.*as \.csv"):
        read_dyno_test(path)


NEGATIVE = {"in parentheses": re.compile(r"-([\d.]+)"), "with the minus of a typesetter": re.compile("-")}


@pytest.mark.parametrize(
    ("notation", "replacement"), [("in parentheses", r"(\1)"), ("with the minus of a typesetter", "\u2212")]
)
@pytest.mark.parametrize("sep", [",", "   "])
def test_negative_numbers_are_read(tmp_path, notation, replacement, sep):
    columns = [[NEGATIVE[notation].sub(replacement, cell) for cell in cells(*one, ".6f")] for one in SI]
    test = read_dyno_test(text(H.replace(",", sep), columns, sep=sep, suffix=".txt")(tmp_path))
    agrees(test)
    assert any("numbers in parentheses are negative" in note for note in test.derived) == (notation == "in parentheses")


def test_a_number_in_parentheses_that_belongs_to_a_name_is_no_negative_number(tmp_path):
    test = read_dyno_test(text("t [s],x [mm],v [mm/s],F (2) [N]")(tmp_path))
    agrees(test)
    assert not any("parentheses" in note for note in test.derived)


SIGNS = {
    "Sign convention: extension positive, rebound force positive": (-1, -1),
    "Signs: compression positive": (1, 1),
    "Force: positive in rebound": (1, -1),
    "Displacement and velocity: extension is positive; compression force is positive": (-1, 1),
    "Extension positive, compression force positive": (-1, 1),
    "Tension negative": (1, 1),
    "Rebound clicks: 12": (1, 1),
}


@pytest.mark.parametrize("statement", SIGNS)
def test_a_stated_sign_convention_is_obeyed_with_a_note(tmp_path, statement):
    motion, force = SIGNS[statement]
    columns = [cells("t", "s"), *([f"{sign * x:.9g}" for x in samples]
               for sign, samples in ((motion, 1e3 * X), (motion, 1e3 * V), (force, F)))]  # fmt: skip
    test = read_dyno_test(text(H, columns, above=f"{statement}\n")(tmp_path))
    agrees(test)
    turned = [name for name, sign in (("velocity", motion), ("force", force), ("displacement", motion)) if sign < 0]
    said = [note for note in test.derived if "were reversed, because the file states" in note]
    assert len(said) == bool(turned)
    assert not said or f"the signs of {', '.join(turned)} were" in said[0]


def test_a_stated_sign_convention_that_the_data_contradict_is_asked_about(tmp_path):
    path = text(H, above="Rebound force positive\n")(tmp_path)
    with pytest.raises(errors.WrongSignError, match="--channel force=-"):
        read_dyno_test(path)
    agrees(read_dyno_test(path, flip=["none"]))
    both = text(H, above="Compression positive\nExtension positive\n")(tmp_path)
    with pytest.raises(errors.FileFormatError, match="contradict each other: Compression positive; Extension positive"):
        read_dyno_test(both)


def test_a_channel_that_is_reversed_already_is_not_reversed_by_the_statement(tmp_path):
    """A length is longest in extension anyway, and a channel map may have the sign."""
    columns = [cells("t", "s"), [f"{412.0 - 1e3 * x:.9g}" for x in X], [f"{-f:.9g}" for f in F]]
    head, above = "Time [s],Damper Length [mm],Force [N]", "Extension positive\n"
    test = read_dyno_test(text(head, columns, above=above)(tmp_path))
    agrees(test, velocity=None, displacement=X - 0.5 * (X.max() + X.min()))
    mapping = ChannelMap({"force": MappedChannel("Force", gain=-1.0)})
    agrees(read_dyno_test(text(head, columns, above=above)(tmp_path), channel_map=mapping), velocity=None,
           displacement=X - 0.5 * (X.max() + X.min()))  # fmt: skip


def test_the_length_of_a_damper_is_a_displacement_of_the_other_sign(tmp_path):
    columns = [cells("t", "s"), [f"{412.0 - 1e3 * x:.9g}" for x in X], cells("F", "N")]
    test = read_dyno_test(text("Time [s],Damper Length [mm],Force [N]", columns)(tmp_path))
    agrees(test, velocity=None, displacement=X - 0.5 * (X.max() + X.min()))
    assert any("displacement from 'Damper Length'" in step for step in test.derived)


def test_a_table_without_a_header_is_read_by_the_numbers_of_its_columns(tmp_path):
    path = text("", SI)(tmp_path)
    with pytest.raises(errors.MissingChannelError, match=r"no header line.*--channel 'force=3"):
        read_dyno_test(path)
    mapping = with_channels(None, {"time": "1", "displacement": "2", "velocity": "3", "force": "4"})
    units = {"time": "s", "displacement": "mm", "velocity": "mm/s", "force": "N"}
    agrees(read_dyno_test(path, channel_map=mapping, units=units))


def test_units_that_lines_above_the_table_state_are_used_where_the_header_has_none(tmp_path):
    above = "Time units: ms\nShock displacement units: in\nVelocity units: MM/S\nForce units: lbf\n"
    columns = [("t", "ms"), ("x", "in"), ("v", "mm/s"), ("F", "lbf")]
    agrees(read_dyno_test(text("Time,Position,Velocity [mm/s],Load", columns, above=above)(tmp_path)))
    with pytest.raises(errors.UnknownUnitError, match=r"\[mm/s\] in its header, but 'in/s' was given or stands above"):
        read_dyno_test(
            text("Time,Position,Velocity [mm/s],Load", columns, above=above.replace("MM/S", "in/s"))(tmp_path)
        )
    with pytest.raises(errors.MissingUnitError, match="'Load' has no unit"):
        read_dyno_test(
            text("Time [ms],Position [in],Velocity [mm/s],Load", columns, above="Motor units: A\n")(tmp_path)
        )


@pytest.mark.parametrize(
    ("name", "clicks", "pressure"),
    [("t1_1_1_18_18_s5_n10_150psi", None, 150 * 6894.757293168), ("damper_2clicks_front", "2 clicks", None),
     ("2#-0.3A-1", "0.3 A", None), ("run_0,95A", "0.95 A", None), ("reb12_comp_3", "reb 12, comp 3", None),
     ("12-Clicks 10bar", "12 clicks", 1e6), ("shock 1A", None, None), ("B2V_x", None, None), ("c10psi", None, None),
     ("reb12.5", None, None)],
)  # fmt: skip
def test_the_name_of_a_file_states_settings(name, clicks, pressure):
    stated, notes = conditions_in(Path(f"{name}.csv"))
    assert stated.clicks == clicks
    assert stated.gas_pressure == (pressure if pressure is None else pytest.approx(pressure))
    assert len(notes) == bool(clicks or pressure)


def test_what_a_file_states_has_precedence_over_its_name_which_is_noted_otherwise(tmp_path):
    named = read_dyno_test(text(H)(tmp_path).rename(tmp_path / "12-Clicks 10bar.csv"))
    assert (named.conditions.clicks, named.conditions.gas_pressure) == ("12 clicks", pytest.approx(1e6))
    assert any("from the name of the file" in note for note in named.derived)
    path = text(H, above="Clicks: 7\n")(tmp_path).rename(tmp_path / "2clicks.csv")
    test = read_dyno_test(path)
    assert test.conditions.clicks == "Clicks 7"
    assert not any("name of the file" in note for note in test.derived)


def test_a_crank_angle_is_no_motion_and_asks_for_one(tmp_path):
    columns = [cells("t", "s"), [f"{900.0 * t % 360.0:.3f}" for t in T], cells("F", "N")]
    with pytest.raises(errors.MissingChannelError, match=r"usual name of the displacement or velocity.*Crank Angle"):
        read_dyno_test(text("Time [s],Crank Angle [deg],Force [N]", columns)(tmp_path))


def test_a_scalar_and_a_text_of_a_mat_file_are_its_preamble(tmp_path):
    content = {"t_s": T, "x_mm": 1e3 * X, "F_N": F, "Clicks": "12", "Gas_Pressure": "150 psi"}
    scipy.io.savemat(tmp_path / "run.mat", content)
    assert read_dyno_test(tmp_path / "run.mat").conditions.clicks == "Clicks 12"
