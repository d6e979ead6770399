"""A table of files and settings is read with its adjusters and temperatures; a wrong entry is rejected by name."""

from pathlib import Path

import numpy as np
import pytest

from eightpost.errors import FileFormatError, InputError
from eightpost.ident.shock.settings_table import read_settings_table, settings_of_names, states_settings
from eightpost.rig.dyno_conditions import numbers_in, setting_in

ADJUSTER = "[adjuster.rebound]\ncounted = 'from full hard'\nlowest = 0\nhighest = 9\n"


def written(folder, head, *files, celsius=None):
    """Return a table of files, each given by its entries; `celsius` are the temperatures of their channels, if any."""
    time = np.arange(300) / 200.0
    phase = 2.0 * np.pi * 4.0 * time
    entries = []
    for k, entry in enumerate(files):
        columns = {"Time [s]": time, "Velocity [m/s]": 0.3 * np.cos(phase), "Force [N]": 600.0 * np.cos(phase)}
        columns["Displacement [mm]"] = 300.0 / (8.0 * np.pi) * np.sin(phase)
        if celsius is not None and celsius[k] is not None:
            columns["Temperature [degC]"] = celsius[k] + np.linspace(-1.0, 1.0, time.size)
        rows = zip(*columns.values(), strict=True)
        lines = [",".join(columns), *(",".join(f"{value:.6f}" for value in row) for row in rows)]
        (folder / f"{k}.csv").write_text("\n".join(lines) + "\n")
        entries.append(f"[[file]]\npath = '{k}.csv'\n{entry}\n")
    path = folder / "table.toml"
    path.write_text("\n".join(["schema = 1", head, *entries]))
    return path


def test_the_temperature_of_a_file_is_the_mean_of_its_channel_or_the_one_given(tmp_path):
    """The third file has no channel, and the first two are one setting, because they differ by 2 K."""
    path = written(tmp_path, "[temperature]\nreference = '70 degC'", "", "", "temperature = '80 degC'",
                   celsius=(39.0, 41.0, None))  # fmt: skip
    table = read_settings_table(path)
    (axis,) = table.axes
    assert (axis.name, axis.unit, axis.reference) == ("temperature", "K", axis.nodes[1])
    assert axis.nodes == pytest.approx([313.15, 353.15])
    assert [setting[0] for setting in table.settings] == pytest.approx([313.15, 313.15, 353.15])


def test_without_a_reference_it_is_the_setting_of_most_files_and_of_the_temperatures_the_middle_one(tmp_path):
    entries = [f"clicks.rebound = {clicks}\ntemperature = '{warm} degC'"
               for clicks, warm in ((0, 30), (3, 50), (3, 90), (9, 30))]  # fmt: skip
    table = read_settings_table(written(tmp_path, f"{ADJUSTER}[temperature]", *entries))
    rebound, temperature = table.axes
    assert (rebound.nodes, rebound.reference, rebound.lowest, rebound.highest) == ((0.0, 3.0, 9.0), 3.0, 0.0, 9.0)
    assert temperature.reference == pytest.approx(323.15)
    assert [test.conditions.clicks for (test,) in table.tests[:2]] == ["rebound 0 from full hard",
                                                                      "rebound 3 from full hard"]  # fmt: skip
    assert (table.name, table.law, table.gas) == ("table", None, "estimate")


def test_a_file_with_empty_clicks_has_those_of_the_reference(tmp_path):
    table = read_settings_table(written(tmp_path, f"{ADJUSTER}reference = 5", "clicks.rebound = 1", "clicks = {}"))
    assert table.settings == ((1.0,), (5.0,))


@pytest.mark.parametrize(
    ("head", "entries", "message"),
    [
        ("", ("", ""), "names no adjuster and no temperature"),
        ("[adjuster.temperature]", ("", ""), "an adjuster cannot be called 'temperature'"),
        ("[adjuster.'low speed']", ("", ""), "adjuster 'low speed': use letters, digits and _"),
        (ADJUSTER, ("clicks.bump = 1", ""), r"file '0.csv': there is no section \[adjuster.bump\] for clicks.bump"),
        (ADJUSTER, ("clicks.rebound = 1", ""), "file '1.csv': clicks.rebound is missing, and .* has no reference"),
        (f"{ADJUSTER}reference = 5", ("clicks.rebound = 1", ""),
         "file '1.csv' states no clicks: add clicks.rebound = ..., or clicks = {} if it was at the reference"),
        (ADJUSTER, ("clicks.rebound = 10", ""), "clicks.rebound = 10 is beyond the adjuster's stops, 0.0 to 9.0"),
        (ADJUSTER, ("clicks.rebound = -1", ""), "clicks.rebound = -1 is beyond the adjuster's stops, 0.0 to 9.0"),
        (ADJUSTER, ("clicks.rebound = 1.5", ""), "clicks.rebound = 1.5 is not a whole number"),
        (ADJUSTER, ("clicks.rebound = 2", "clicks.rebound = 2"), "rebound has the same setting in all files"),
        (f"{ADJUSTER}reference = 4", ("clicks.rebound = 2", "clicks.rebound = 3"),
         "reference = 4 is not the setting of a file; there are: 2, 3"),
        ("[temperature]", ("temperature = '30 degC'", ""), "file '1.csv' has no temperature channel"),
        ("[temperature]", ("temperature = '30 m'", ""), "temperature = '30 m': .*; write it as '40 degC'"),
    ],
)  # fmt: skip
def test_a_wrong_entry_is_rejected_with_what_to_write(tmp_path, head, entries, message):
    with pytest.raises(FileFormatError, match=message):
        read_settings_table(written(tmp_path, head, *entries))


T = np.arange(600) / 400.0
V = 0.3 * np.cos(2.0 * np.pi * 2.5 * T)


def record(folder, name, factor=1.0):
    path = folder / name
    force = factor * (900.0 * np.tanh(V / 0.08) + 1500.0 * V) + 120.0
    rows = "\n".join(f"{t:.4f},{v:.6f},{f:.3f}" for t, v, f in zip(T, V, force, strict=True))
    path.write_text(f"t [s],v [m/s],F [N]\n{rows}\n")
    return path


@pytest.mark.parametrize(
    ("names", "adjuster", "unit", "values"),
    [(("0.3A.csv", "run_0.95A-1.csv", "2A.csv"), "current", "A", (0.3, 0.95, 2.0)),
     (("2clicks_front.csv", "damper 12 Clicks.csv"), "clicks", "click", (2.0, 12.0)),
     (("b_500mA.csv", "b_1500mA.csv"), "current", "mA", (500.0, 1500.0))],
)  # fmt: skip
def test_files_with_one_setting_in_each_name_need_no_table(tmp_path, names, adjuster, unit, values):
    table = settings_of_names([record(tmp_path, name, 1.0 + k) for k, name in enumerate(names)])
    (axis,) = table.axes
    assert (axis.name, axis.unit, table.settings) == (adjuster, unit, tuple((value,) for value in values))
    assert table.notes[0].startswith(f"settings from the names of the files: {names[0]} {adjuster} {values[0]:g}, ")
    assert f"{adjuster} {values[0]:g}" in table.tests[0][0].conditions.clicks


@pytest.mark.parametrize("names", [("0.3A.csv",), ("0.3A.csv", "b.csv"), ("0.3A_1A.csv", "0.5A.csv"),
                                   ("2clicks_0.3A.csv", "3clicks_0.5A.csv")])  # fmt: skip
def test_names_without_one_setting_each_are_refused_with_what_to_write(tmp_path, names):
    paths = [record(tmp_path, name) for name in names]
    with pytest.raises(
        InputError, match=r"do not state one setting each, such as 2clicks or 1\.5A; list them in a table"
    ):
        settings_of_names(paths)
    assert not states_settings(paths)


@pytest.mark.parametrize(
    ("names", "states"),
    [
        (("2clicks.csv", "4 clicks.csv"), True),
        (("0.3A.csv", "1A.csv"), True),
        (("1A.csv", "2A.csv"), False),  # they may be builds
        (("a_2clicks.csv", "b_2clicks.csv"), False),
        (("2clicks.csv", "b.csv"), False),
    ],
)
def test_names_that_state_different_settings_are_a_fit_over_them(names, states):
    assert states_settings([Path(name) for name in names]) is states


def test_a_table_takes_what_it_does_not_state_from_the_names_and_the_reference_comes_last(tmp_path):
    for name in ("reb3.csv", "reb_9_x.csv", "other.csv", "reb1.csv"):
        record(tmp_path, name)
    entries = "".join(f'[[file]]\npath = "{name}"\n' for name in ("reb3.csv", "reb_9_x.csv", "other.csv"))
    entries += "clicks = {}\n"
    text = f'schema = 1\n[adjuster.rebound]\nreference = 3\n{entries}[[file]]\npath = "reb1.csv"\nclicks.rebound = 7\n'
    (tmp_path / "a.toml").write_text(text)
    table = read_settings_table(tmp_path / "a.toml")
    assert table.settings == ((3.0,), (9.0,), (3.0,), (7.0,))
    assert table.notes == ("settings from the names of the files: reb3.csv rebound 3, reb_9_x.csv rebound 9",)


def test_a_number_of_clicks_belongs_to_no_adjuster_if_two_are_counted_in_clicks(tmp_path):
    for name in ("3clicks.csv", "comp5_reb2.csv"):
        record(tmp_path, name)
    adjusters = "".join(f"[adjuster.{name}]\nreference = 0\n" for name in ("rebound", "compression"))
    entries = "".join(f'[[file]]\npath = "{name}"\n{more}' for name, more in
                      (("3clicks.csv", "clicks = {}\n"), ("comp5_reb2.csv", "")))  # fmt: skip
    (tmp_path / "a.toml").write_text(f"schema = 1\n{adjusters}{entries}")
    assert read_settings_table(tmp_path / "a.toml").settings == ((0.0, 0.0), (2.0, 5.0))


@pytest.mark.parametrize(
    ("stem", "unit", "expected"),
    [("1.5A", "A", [1.5]), ("x_0,95A-1", "A", [0.95]), ("2Amp", "A", []), ("b2A", "A", []),
     ("12-Clicks", "click", [12.0]), ("3 click", "click", [3.0]), ("50psi_2bar", "psi", [50.0]),
     ("1A_2A", "A", [1.0, 2.0]), ("5a", "A", [])],
)  # fmt: skip
def test_numbers_before_a_unit_are_found_if_nothing_else_is_joined_to_them(stem, unit, expected):
    assert numbers_in(stem, unit) == expected
    assert numbers_in(stem, unit, has_decimals=True) == [one for one in expected if one != round(one)]
    assert setting_in(stem, "valve", unit) == (expected[0] if len(expected) == 1 else None)
