"""Exports of dynamometer programs: preamble, units in a separate row, several tests in one file.

The samples below are written for these tests after what is publicly known of such exports; no vendor's file is copied.
"""

import numpy as np
import pytest

from eightpost.rig import DynoConditions, read_dyno_test, read_dyno_tests
from eightpost.units import convert

RATE = 500.0
TIME = np.arange(1000) / RATE
OMEGA = 2.0 * np.pi * 2.0


def table(speed: float, *, separator: str = ",", heat: float = 75.0) -> str:
    """A sine of peak `speed` [in/s] on a damper of 20 lb/(in/s), in inches and pounds, with noise."""
    noise = np.random.default_rng(int(speed)).standard_normal((3, TIME.size)) * [[2e-4], [0.02], [0.3]]
    velocity = speed * np.cos(OMEGA * TIME)
    force = 40.0 + 20.0 * speed * np.cos(OMEGA * (TIME - 1e-3))
    rows = (TIME, speed / OMEGA * np.sin(OMEGA * TIME) + noise[0], velocity + noise[1], force + noise[2], heat + TIME)
    lines = [separator.join(("Time", "Displacement", "Velocity", "Load", "Temperature"))]
    lines.append(separator.join(("(sec)", "(in)", "(in/sec)", "(lbs)", "(F)")))
    return (
        "\n".join([*lines, *(separator.join(f"{cell:.6f}" for cell in row) for row in zip(*rows, strict=True))]) + "\n"
    )


COLONS = """\
Shock dynamometer export
Test Name: {name}
Date: 3/14/2009 10:22:05
Shock ID: 8760-17
Compression Clicks: 6 from closed
Rebound Clicks: 3 from closed
Gas Pressure: 150 psi
Start Temperature: 75 F

"""
CELLS = """\
Shock dynamometer export,,,,
Test Name,{name},,,
Date,3/14/2009 10:22:05,,,
Shock ID,8760-17,,,
Compression Clicks,6 from closed,,,
Rebound Clicks,3 from closed,,,
Gas Pressure,150,psi,,
Start Temperature,75,F,,
,,,,
"""
BRACKETS = COLONS.replace("Gas Pressure: 150 psi", "Gas Pressure (psi) = 150").replace(
    "Start Temperature: 75 F", "Temp [F]: 75"
)


def written(folder, content):
    path = folder / "export.csv"
    path.write_text(content)
    return path


@pytest.mark.repeated
@pytest.mark.parametrize("preamble", [COLONS, CELLS, BRACKETS, CELLS.replace(",", "\t"), CELLS.replace(",", ";")])
def test_the_preamble_gives_the_conditions(tmp_path, preamble):
    separator = next((mark for mark in "\t;" if mark in preamble), ",")
    test = read_dyno_test(written(tmp_path, preamble.format(name="PVP 10") + table(10.0, separator=separator)))
    known = test.conditions
    assert (known.run, known.build, known.date) == ("PVP 10", "8760-17", "3/14/2009 10:22:05")
    assert known.clicks == "Compression Clicks 6 from closed; Rebound Clicks 3 from closed"
    assert known.gas_pressure == pytest.approx(150.0 * 6894.757293168)
    assert known.temperature == pytest.approx(convert(75.0, "degF", "K"))
    assert test.notes == ()


def test_units_are_read_from_the_row_under_the_names(tmp_path):
    series = read_dyno_test(written(tmp_path, COLONS + table(10.0))).series
    assert np.abs(series["velocity"]).max() == pytest.approx(0.254, rel=0.02)
    assert series["force"].mean() == pytest.approx(40.0 * 4.4482216152605, rel=0.01)
    assert np.ptp(series["displacement"]) == pytest.approx(2.0 * 0.254 / OMEGA, rel=0.02)
    assert series["temperature"][0] == pytest.approx(297.039, abs=1e-3)


def test_all_tests_of_a_file_are_read_and_a_preamble_applies_until_the_next(tmp_path):
    first = COLONS.format(name="slow") + table(5.0)
    path = written(tmp_path, first + "Test Name: fast\nGas Pressure: 50 psi\n" + table(10.0))
    slow, fast = read_dyno_tests(path)
    assert (slow.conditions.run, fast.conditions.run) == ("slow", "fast")
    assert slow.conditions.gas_pressure == pytest.approx(3.0 * fast.conditions.gas_pressure)
    assert fast.conditions.build == "8760-17"
    assert fast.series["velocity"].std() == pytest.approx(2.0 * slow.series["velocity"].std(), rel=1e-2)
    assert slow.sha256 == fast.sha256


def test_arguments_take_precedence_over_the_preamble(tmp_path):
    conditions_given = DynoConditions(build="C", gas_pressure=1e5)
    test = read_dyno_test(written(tmp_path, COLONS + table(10.0)), conditions=conditions_given)
    assert (test.conditions.build, test.conditions.gas_pressure) == ("C", 1e5)
    assert test.conditions.clicks is not None


def test_gas_is_a_force_or_a_pressure_depending_on_its_unit_and_ignored_without_a_unit(tmp_path):
    force = read_dyno_test(written(tmp_path, "Preload,40,lbf\n" + table(10.0)))
    assert force.conditions.gas_force == pytest.approx(40.0 * 4.4482216152605)
    assert force.conditions.gas_pressure is None
    unknown = read_dyno_test(written(tmp_path, "Preload,40\n" + table(10.0)))
    assert unknown.conditions == DynoConditions()
    assert any("'Preload' of the preamble is ignored: '40' has no unit" in note for note in unknown.notes)
