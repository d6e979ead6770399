"""Settings are read from the names of files where neither a table nor the caller states them."""

import numpy as np
import pytest
from click.testing import CliRunner

from eightpost.__main__ import main
from eightpost.errors import InputError
from eightpost.ident.shock.settings_table import read_settings_table, settings_of_names
from eightpost.rig.dyno_conditions import numbers_in, setting_in

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
    shown = CliRunner().invoke(main, ["settings", *map(str, paths)])
    assert shown.exit_code == 2
    assert "list them in a table" in " ".join(shown.output.split())


def test_a_table_takes_what_it_does_not_state_from_the_names_and_the_reference_comes_last(tmp_path):
    for name in ("reb3.csv", "reb_9_x.csv", "other.csv", "reb1.csv"):
        record(tmp_path, name)
    entries = "".join(f'[[file]]\npath = "{name}"\n' for name in ("reb3.csv", "reb_9_x.csv", "other.csv"))
    text = f'schema = 1\n[adjuster.rebound]\nreference = 3\n{entries}[[file]]\npath = "reb1.csv"\nclicks.rebound = 7\n'
    (tmp_path / "a.toml").write_text(text)
    table = read_settings_table(tmp_path / "a.toml")
    assert table.settings == ((3.0,), (9.0,), (3.0,), (7.0,))
    assert table.notes == ("settings from the names of the files: reb3.csv rebound 3, reb_9_x.csv rebound 9",)


def test_a_number_of_clicks_belongs_to_no_adjuster_if_two_are_counted_in_clicks(tmp_path):
    for name in ("3clicks.csv", "comp5_reb2.csv"):
        record(tmp_path, name)
    adjusters = "".join(f"[adjuster.{name}]\nreference = 0\n" for name in ("rebound", "compression"))
    entries = "".join(f'[[file]]\npath = "{name}"\n' for name in ("3clicks.csv", "comp5_reb2.csv"))
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
