"""What is read from tables of peak velocities, preambles, names of files and other columns, and the limits in it."""

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eightpost.errors import InputError
from eightpost.rig import PeakVelocityTable, read_dyno_test, read_peak_velocity
from eightpost.rig.columns import propose_map
from eightpost.rig.dyno_conditions import conditions_from, conditions_in, reversed_channels, stated_units
from eightpost.rig.geometry import displacement_modes, force_modes
from eightpost.signals import read_record
from eightpost.virtual.program import stand_in_truth
from tests.drawn import rounded, timed
from tests.limits import first_of, limit_of

from .test_dyno_exports import BRACKETS, CELLS, COLONS
from .test_dyno_peak_velocity import BROKEN, LAYOUTS, written
from .test_plausibility import UNITS, sine
from .test_rig_columns import four, record


def shown(table: Any) -> dict[str, Any]:
    known = ("speed", "compression", "rebound", "clicks", "gas_force", "gas_source", "rest_force", "notes")
    return {name: getattr(table, name) for name in known} | {"summary": timed(str(table))}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_table(layout: str, tmp_path: Path, unchanged: Callable[..., None]) -> None:
    unchanged([shown(table) for table in read_peak_velocity(written(tmp_path, LAYOUTS[layout]))])


def test_broken_tables(tmp_path: Path, unchanged: Callable[..., None]) -> None:
    said = {}
    for case, (content, error) in BROKEN.items():
        with pytest.raises(error) as caught:
            read_peak_velocity(written(tmp_path, content))
        said[case] = str(caught.value)
    unchanged(said)


def loop(rows: float) -> str:
    phase = np.linspace(0.0, 2.0 * np.pi, round(rows) + 1)[:-1]
    v, f = 0.25 * np.sin(phase), 500.0 * np.sin(phase) + 30.0 * np.cos(phase) + 20.0 * np.sin(3.0 * phase)
    return "Velocity [m/s],Force [N]\n" + "".join(f"{a:.9g},{b:.9g}\n" for a, b in zip(v, f, strict=True))


def gas(force: float, *, lowest: float = 0.01, rest: bool = False) -> str:
    speeds = np.geomspace(lowest, 0.4, 7)
    lines = "".join(f"{v:.9g},{2000 * v + force:.9g},{-3000 * v + force:.9g}\n" for v in speeds)
    return "speed [m/s],compression [N],rebound [N]\n" + f"0,{force},{force}\n" * rest + lines


def curved(bend: float) -> str:
    """Return a table whose lowest speeds bend, so that the gas force is not clear."""
    speeds = np.geomspace(0.01, 0.4, 7)
    force = 150.0 - 400.0 * np.exp(-speeds / bend)
    rows = zip(speeds, 2000.0 * speeds + force, -3000.0 * speeds + force, strict=True)
    lines = "".join(f"{v:.9g},{up:.9g},{down:.9g}\n" for v, up, down in rows)
    return f"speed [m/s],compression [N],rebound [N]\n{lines}"


def repeated(difference: float) -> str:
    return f"speed [m/s],compression [N],rebound [N]\n.1,100,-200\n.1,{100.0 + difference},-200\n.2,300,-400\n"


def test_limits_of_tables(tmp_path: Path, unchanged: Callable[..., None]) -> None:
    def tables(content: str) -> Any:
        try:
            return read_peak_velocity(written(tmp_path, content))
        except InputError:
            return None

    unchanged({
        "rows of a loop": limit_of(lambda k: bool(tables(loop(k)) and len(tables(loop(k))[0]) < 30), 20.0, 900.0),
        "gas at rest": limit_of(lambda k: bool(tables(gas(k, rest=True))[0].gas_source), 5.0, 200.0),
        "gas at low speeds": limit_of(lambda k: bool(tables(gas(k))[0].gas_source), 5.0, 200.0),
        "lowest speed": limit_of(lambda k: bool(tables(gas(150.0, lowest=k))[0].gas_source), 0.02, 0.2),
        "a bend": limit_of(lambda k: bool(tables(curved(k))[0].gas_source), 1e-3, 0.05),
        "another force": limit_of(lambda k: tables(repeated(k)) is None, 0.1, 90.0),
        "loop": shown(tables(loop(2000))[0]), "gas": shown(tables(gas(150.0))[0]),
    }, relative=1e-3)  # fmt: skip


def test_the_most_rows_of_a_list_of_peaks_and_the_fewest_of_a_record(tmp_path: Path) -> None:
    def is_read(content: str) -> bool:
        try:
            read_dyno_test(written(tmp_path, content))
        except InputError:
            return False
        return True

    def is_loop(rows: int) -> bool:
        try:
            return len(read_peak_velocity(written(tmp_path, loop(rows)))[0]) < 30
        except InputError:
            return False

    time = np.arange(400) / 100.0
    v = 0.2 * np.cos(9.0 * time)
    lines = [f"{t:.9g},{a:.9g},{2000.0 * a + 90.0:.9g}\n" for t, a in zip(time, v, strict=True)]
    assert first_of(is_loop, 190, 210) == 201
    assert first_of(lambda rows: is_read("t [s],v [m/s],F [N]\n" + "".join(lines[:rows])), 190, 210) == 200


@pytest.mark.parametrize("row", [1, 3])
def test_a_row_of_a_table_that_is_not_a_number_is_named(row: int) -> None:
    speed, force = np.array([0.1, 0.2, 0.3]), np.array([100.0, 200.0, 300.0])
    with pytest.raises(InputError, match=f"row {row} is not a number"):
        PeakVelocityTable(speed, np.where(np.arange(3) == row - 1, np.nan, force), -force)


PREAMBLES = {"colons": COLONS, "cells": CELLS, "brackets": BRACKETS}
LINES = ("Gas pressure: 10 bar", "Nitrogen [psi]: 200", "Preload,40,lbf", "Oil temperature: 40 degC", "Operator: N.N.",
         "LSC: 6", "HSR 12 clicks", "Rebound: 3 / 8", "Date: 2009-03-14", "Customer = Team", "Compression positive",
         "Force: extension is positive", "Displacement units: in", "Load unit = lbf", "Speed: 10 in/s")  # fmt: skip
NAMES = ("front_12clicks_150psi.csv", "A 3 clicks 10bar.csv", "R4_C6.csv", "run_1.5A.csv", "v2_200mA_5V.csv", "b17.csv")


def test_conditions_of_preambles_and_names(unchanged: Callable[..., None]) -> None:
    def cells(text: str) -> list[tuple[str, ...]]:
        return [tuple(line.split(",")) for line in text.format(name="PVP 10").splitlines()]

    found: dict[str, Any] = {name: str(conditions_from(cells(text))) for name, text in PREAMBLES.items()}
    for line in LINES:
        found[line] = (
            f"{conditions_from(cells(line))} {reversed_channels(cells(line), Path('a'))} {stated_units(cells(line))}"
        )
    found |= {name: str(conditions_in(Path(name))) for name in NAMES}
    unchanged({name: rounded(text) for name, text in found.items()})


def other_column(values: np.ndarray, name: str, folder: Path) -> list[str]:
    columns = sine() | {name: values}
    header = ",".join(f"{key} [{UNITS[key]}]" if key in UNITS else key for key in columns)
    path = folder / "run.csv"
    np.savetxt(path, np.column_stack(list(columns.values())), delimiter=",", header=header, comments="", fmt="%.9g")
    return [timed(reason.figure) for reason in read_dyno_test(path).reasons]


T = np.arange(5000) / 500.0
NOISE = np.random.default_rng(8).standard_normal(T.size)
COLUMNS: dict[str, tuple[Callable[[float], np.ndarray], str, float, float]] = {
    "a step": (lambda k: np.where(T > 5.0, 1.0 + k, 1.0), "setting", 2e-3, 0.2),
    "a noisy step": (lambda k: np.where(T > 5.0, 2.0, 1.0) + k * NOISE, "setting", 0.05, 3.0),
    "steps": (lambda k: np.where((T % (20.0 / k)) > 10.0 / k, 2.0, 1.0), "setting", 2.0, 200.0),
    "a drift": (lambda k: 1.0 + 0.1 * T**2 / 100.0 + k * NOISE, "setting", 2e-3, 0.5),
    "a line": (lambda k: 1.0 + T + k * T**2, "setting", 1e-4, 1.0),
    "a voltage": (lambda k: np.convolve(NOISE, np.ones(round(k)) / k, "same"), "valve [V]", 2.0, 100.0),
    "the same sensor": (lambda k: 1e-3 * sine()["F"] + k * np.cumsum(NOISE), "cell [V]", 1e-4, 1.0),
}


@pytest.mark.parametrize("name", COLUMNS)
def test_the_size_from_which_another_column_changes(name: str, tmp_path: Path, unchanged: Callable[..., None]) -> None:
    values, column, low, high = COLUMNS[name]
    size = limit_of(lambda k: bool(other_column(values(k), column, tmp_path)), low, high, steps=4)
    unchanged(
        {"from": size, "ends": [other_column(values(end), column, tmp_path) for end in (low, high)]}, relative=1e-3
    )


def test_a_proposed_map(unchanged: Callable[..., None]) -> None:
    many = four("WL {} Pos", "mm") | four("WL {} Load", "kN") | four("Damper {} Load", "N") | four("Pot {}", "mm")
    found = propose_map(record(Time="s", **many, **four("Pot {} b", "mm"), **{"RH Front": "in"}))
    assert found is not None
    unchanged({"finding": found.finding, "toml": found.toml(), "columns": found.columns})


def test_the_transforms_of_a_rig(unchanged: Callable[..., None]) -> None:
    geometry = stand_in_truth().geometry
    unchanged({"geometry": asdict(geometry), "displacement": list(displacement_modes(geometry)),
               "force": list(force_modes(geometry))})  # fmt: skip


def test_a_record_of_a_file(tmp_path: Path, unchanged: Callable[..., None]) -> None:
    other_column(T % 1.0, "cycle", tmp_path)
    test = read_dyno_test(tmp_path / "run.csv")
    unchanged({"summary": timed(str(test)), "stroke": test.stroke, "measured": test.measured, "label": test.label,
               "names": read_record(tmp_path / "run.csv").names})  # fmt: skip
