"""Every misreading that the reader detects, as files: random virtual shocks, and the measured records.

    python -m benchmarks.misreading_files --shocks 60 --seed 91000

Each record is written as a file in millimetres and newtons, as it is and with one fault, and read like any other file.
A fault is found if the file is refused or has a reason of one of the fault's rules that the file without it does not
have. Each virtual shock is tested with a random motion or a steady sine, and its table of peak velocities contains its
gas force.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.misreading import motion
from benchmarks.settings import MOST, RandomShock
from benchmarks.shock_records import measured_runs
from eightpost.array_types import Array
from eightpost.errors import InputError
from eightpost.rig import read_dyno_test, read_peak_velocity
from eightpost.rig.damper import PhysicalDamper
from eightpost.rig.dynamometer import Actuator, measure
from eightpost.rig.plausibility_rules import (
    CHANGED_COLUMN,
    CONTRADICTORY_UNITS,
    NEGATIVE_REST,
    RECTIFIED,
    RUN_DOWN,
    SMALL_CHANGE,
    TWO_SETTINGS,
    UNLIKELY_UNITS,
)
from eightpost.signals import TimeSeries
from eightpost.units import convert

#: Columns of a file, by name; the velocity may be left out.
Columns = dict[str, Array]

_INCH, _POUND = convert(1.0, "in", "mm"), convert(1.0, "lbf", "N")
_UNITS = (CONTRADICTORY_UNITS.name, UNLIKELY_UNITS.name)


class Fault(NamedTuple):
    """A change of a file's columns, the rules that find it, and the motion it needs, if any."""

    change: Callable[[Columns], Columns]
    rules: tuple[str, ...]
    needs: str = ""


def _without_velocity(columns: Columns) -> Columns:
    return {name: values for name, values in columns.items() if name != "v [mm/s]"}


def _scaled(**factors: float) -> Callable[[Columns], Columns]:
    """Return a change that multiplies the columns that begin with the names."""
    return lambda columns: {name: factors.get(name[0], 1.0) * values for name, values in columns.items()}


def _rectified(columns: Columns) -> Columns:
    return columns | {"F [N]": np.abs(columns["F [N]"])}


def _harder(columns: Columns) -> Columns:
    force = columns["F [N]"]
    late = np.arange(force.size) > 0.5 * force.size
    return columns | {"F [N]": np.where(late, force.mean() + 1.15 * (force - force.mean()), force)}


def _valve_voltage(columns: Columns) -> Columns:
    size = columns["F [N]"].size
    return columns | {"valve [V]": np.where(np.arange(size) > 0.6 * size, 3.0, 1.0)}


def _run_down(columns: Columns) -> Columns:
    """Slow the motion down within 3 s from 60 % of the record on, at most 6 s: the machine's phase, with less force."""
    time = columns["t [s]"] - columns["t [s]"][0]
    start = min(0.6 * time[-1], 6.0)
    rest = min(time[-1] - start, 3.0)
    beyond = np.clip(time - start, 0.0, rest)
    pace = 1.0 - beyond / rest
    phase = np.minimum(time, start) + beyond - 0.5 * beyond**2 / rest + columns["t [s]"][0]
    slowed = {name: np.interp(phase, columns["t [s]"], values) for name, values in columns.items()}
    slowed |= {
        "t [s]": columns["t [s]"],
        "F [N]": slowed["F [N]"].mean() + pace * (slowed["F [N]"] - slowed["F [N]"].mean()),
    }
    return slowed | ({"v [mm/s]": pace * slowed["v [mm/s]"]} if "v [mm/s]" in slowed else {})


FAULTS = {
    "time in ms labelled s": Fault(_scaled(t=1e3), _UNITS),
    "time in ms labelled s, no velocity": Fault(lambda c: _scaled(t=1e3)(_without_velocity(c)), _UNITS),
    "displacement in inches labelled mm": Fault(_scaled(x=1.0 / _INCH), _UNITS),
    "all motion in inches labelled mm": Fault(_scaled(x=1.0 / _INCH, v=1.0 / _INCH), _UNITS),
    "inches labelled mm, no velocity": Fault(lambda c: _scaled(x=1.0 / _INCH)(_without_velocity(c)), _UNITS),
    "lbf labelled N": Fault(_scaled(F=1.0 / _POUND), _UNITS),
    "rectified force": Fault(_rectified, (RECTIFIED.name,)),
    "force reversed": Fault(_scaled(F=-1.0), ()),
    "all signs reversed": Fault(_scaled(x=-1.0, v=-1.0, F=-1.0), (NEGATIVE_REST.name,)),
    "a valve's voltage steps": Fault(_valve_voltage, (CHANGED_COLUMN.name,)),
    "15 % harder from the middle on": Fault(_harder, (TWO_SETTINGS.name, SMALL_CHANGE.name)),
    "the machine runs down": Fault(_run_down, (RUN_DOWN.name,), needs="sine"),
}  # fmt: skip


def columns_of(series: TimeSeries) -> Columns:
    """Return the columns of a record in millimetres and newtons."""
    columns = {"t [s]": np.asarray(series.time)}
    if "displacement" in series:
        columns["x [mm]"] = 1e3 * series["displacement"]
    return columns | {"v [mm/s]": 1e3 * series["velocity"], "F [N]": np.asarray(series["force"])}


def rules_of(columns: Columns, folder: Path) -> set[str] | None:
    """Return the names of the rules of the reasons of a file; None if it is refused."""
    path = folder / "run.csv"
    body = np.column_stack(list(columns.values()))
    np.savetxt(path, body, delimiter=",", header=",".join(columns), comments="", fmt="%.9g")
    try:
        return {reason.rule for reason in read_dyno_test(path).reasons}
    except InputError:
        return None


def judged(columns: Columns, kind: str) -> Iterator[tuple[str, bool]]:
    """Yield each fault with whether it was found, and whether the record itself has a reason that is one of these."""
    with tempfile.TemporaryDirectory() as place:
        known = rules_of(columns, Path(place))
        every = {rule for fault in FAULTS.values() for rule in fault.rules}
        yield "no fault: refused or a reason", known is None or bool(known & every)
        for name, fault in FAULTS.items():
            if fault.needs and fault.needs != kind:
                continue
            rules = rules_of(fault.change(columns), Path(place))
            yield name, rules is None or bool(rules & set(fault.rules) - (known or set()))


def gas_in_table(shock: PhysicalDamper, gas: float, folder: Path) -> bool:
    """Return whether the gas force in a peak-velocity table is found within 20 %; without gas, whether 0 is found."""
    speeds = np.array([0.013, 0.025, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5])
    rest = shock.static_force(0.0)
    rows = [(v, shock.static_force(v) - rest + gas, shock.static_force(-v) - rest + gas) for v in speeds.tolist()]
    path = folder / "table.csv"
    np.savetxt(path, np.array(rows), delimiter=",", header="speed [m/s],compression [N],rebound [N]", comments="")
    (table,) = read_peak_velocity(path)
    return abs(table.gas_force - gas) <= 0.2 * gas if gas else table.gas_force == 0.0


def virtual(seed: int) -> Iterator[tuple[str, bool]]:
    """Yield what was found in the files of a random virtual shock."""
    random = np.random.default_rng(seed)
    shock = RandomShock.drawn(random).at(float(random.integers(round(MOST) + 1)))
    drive = motion(random, seed)
    series = measure(shock, drive, rate=500.0, actuator=Actuator(), seed=seed)
    kind = "sine" if series["velocity"].std() > 0.6 * np.abs(series["velocity"]).max() else "random"
    yield from judged(columns_of(series), kind)
    largest = max(abs(shock.static_force(v) - shock.static_force(0.0)) for v in (-0.5, 0.5))
    with tempfile.TemporaryDirectory() as place:
        yield "gas of 10 % in a table of peak velocities", gas_in_table(shock, 0.1 * largest, Path(place))
        yield "table of peak velocities without gas: false alarm", not gas_in_table(shock, 0.0, Path(place))


def main() -> None:
    """Print how many of each fault were found as a table in Markdown."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--shocks", type=int, default=60)
    parser.add_argument("--seed", type=int, default=91000)
    chosen = parser.parse_args()
    total: dict[str, Counter[str]] = {"virtual": Counter(), "measured": Counter()}
    hits: dict[str, Counter[str]] = {"virtual": Counter(), "measured": Counter()}
    results = [("virtual", *one) for seed in range(chosen.seed, chosen.seed + chosen.shocks) for one in virtual(seed)]
    folder = Path(os.environ.get("EIGHTPOST_DATA") or "/nowhere")
    results += [
        ("measured", *one) for _, run in measured_runs(folder) for one in judged(columns_of(run.series), "sine")
    ]
    for where, name, hit in results:
        total[where][name] += 1
        hits[where][name] += hit
    print("| file | virtual shocks | measured records |\n|---|---|---|")
    for name in total["virtual"] | total["measured"]:
        cells = [f"{hits[w][name]} of {total[w][name]}" if total[w][name] else "-" for w in ("virtual", "measured")]
        print(f"| {name} | {cells[0]} | {cells[1]} |")


if __name__ == "__main__":
    main()
