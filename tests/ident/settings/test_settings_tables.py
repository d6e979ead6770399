"""A table of files and settings is read with its adjusters and temperatures; a wrong entry is rejected by name."""

from __future__ import annotations

import numpy as np
import pytest

from eightpost.errors import FileFormatError
from eightpost.ident.shock.settings_table import read_settings_table

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


def test_a_file_without_clicks_has_those_of_the_reference(tmp_path):
    table = read_settings_table(written(tmp_path, f"{ADJUSTER}reference = 5", "clicks.rebound = 1", ""))
    assert table.settings == ((1.0,), (5.0,))


@pytest.mark.parametrize(
    ("head", "entries", "message"),
    [
        ("", ("", ""), "names no adjuster and no temperature"),
        ("[adjuster.temperature]", ("", ""), "an adjuster cannot be called 'temperature'"),
        ("[adjuster.'low speed']", ("", ""), "adjuster 'low speed': use letters, digits and _"),
        (ADJUSTER, ("clicks.bump = 1", ""), r"file '0.csv': there is no section \[adjuster.bump\] for clicks.bump"),
        (ADJUSTER, ("clicks.rebound = 1", ""), "file '1.csv': clicks.rebound is missing, and .* has no reference"),
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
