"""What the check of a dynamometer record finds, and its false alarms: virtual dampers of many kinds, measured records.

    python -m benchmarks.detectors --shocks 60 --seed 95000 [--records FOLDER ...] [--list]

Every record is written as a file in millimetres and newtons, as it is, in two parts, and with one fault at a time, and
read like any other file. A fault is found if the file is refused, or has a finding of one of the fault's rules that the
file without it does not have. Notes do not count. FOLDER has measured records (.csv) that are taken as sound; each
eighth one gets the faults. Those of EIGHTPOST_DATA get them all. Limits were set with seeds below 90000.
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
import pyarrow as pa
from pyarrow.csv import write_csv
from scipy.ndimage import uniform_filter1d
from scipy.signal import butter, lfilter, sosfilt

from benchmarks.shock_records import measured_runs
from eightpost.array_types import Array
from eightpost.errors import InputError
from eightpost.rig import read_dyno_test
from eightpost.rig.dynamometer import random_multisine
from eightpost.rig.plausibility_rules import RULES
from eightpost.rig.synthetic import track_drivefile
from eightpost.units import convert
from eightpost.verdict import Grade

#: Columns of a file, by name.
Columns = dict[str, Array]

T, X, V, F = "t [s]", "x [mm]", "v [mm/s]", "F [N]"
_INCH, _POUND = convert(1.0, "in", "mm"), convert(1.0, "lbf", "N")
_NOTES = {rule.name for rule in RULES if rule.grade is Grade.USABLE}
_REFUSED = "refused"

# ---- Virtual dampers ------------------------------------------------------------------------------------------------


def motion(random: np.random.Generator, seed: int) -> tuple[str, Array, Array]:
    """Return kind, times (N,) [s] and displacement (N,) [m] of a random test at 2 kHz."""
    kind = str(random.choice(["sine", "sines", "multisine", "random", "track"]))
    time = np.arange(24001) / 2000.0
    if kind == "sine":
        return kind, time, random.uniform(0.005, 0.03) * np.sin(2.0 * np.pi * random.uniform(0.5, 5.0) * time)
    if kind == "sines":  # one after the other, with the same stroke
        rate = np.repeat(np.sort(random.uniform(0.5, 4.0, 3)), 8001)[: time.size]
        return kind, time, random.uniform(0.01, 0.025) * np.sin(2.0 * np.pi * np.cumsum(rate) / 2000.0)
    if kind == "multisine":
        x = random_multisine(seed, duration=12.0, peak=random.uniform(0.006, 0.025), draws=3).series["displacement"]
    elif kind == "track":
        road = track_drivefile(seed, duration=14.0).series["lf.road"][500:6501]
        x = np.interp(time, np.arange(6001) / 500.0, road - road.mean())
        x *= random.uniform(0.008, 0.03) / np.abs(x).max()
    else:
        band = butter(4, [0.3, random.uniform(4.0, 20.0)], "bandpass", fs=2000.0, output="sos")
        x = sosfilt(band, random.standard_normal(time.size + 4000))[4000:]
        x *= random.uniform(0.008, 0.025) / np.abs(x).max()
    return kind, time, np.asarray(x)


def force_of(random: np.random.Generator, time: Array, x: Array) -> Array:
    """Return the force (N,) [N] of a random damper: curve, friction, gas, lag, and in some fade and position."""
    v = np.gradient(x, time)
    size = np.exp(random.uniform(np.log(400.0), np.log(6000.0)))
    stiffer = random.uniform(0.5, 3.0)  # rebound against compression
    shape = random.choice(["digressive", "progressive", "linear"])
    knee = random.uniform(0.02, 0.2)
    curve = {"digressive": knee * np.tanh(v / knee) + 0.2 * v, "progressive": v * (1.0 + np.abs(v)), "linear": v}[shape]
    lagged = 0.5e-3 * random.uniform(0.2, 10.0)
    decay = np.exp(-1.0 / (2000.0 * lagged))
    force = lfilter([1.0 - decay], [1.0, -decay], size * curve * np.where(v > 0.0, 1.0, stiffer))
    friction = random.uniform(0.0, 80.0) * np.tanh(v / 0.003)
    place = 1.0 + random.choice([0.0, 0.3]) * (x / np.abs(x).max()) ** 2
    fade = 1.0 - random.choice([0.0, 0.03]) * time / time[-1]
    return np.asarray(place * fade * (force + friction) + random.uniform(20.0, 300.0) + random.uniform(0.0, 3e3) * x)


def virtual(seed: int) -> Iterator[tuple[str, Columns]]:
    """Yield kind and columns of the record of a random damper."""
    random = np.random.default_rng(seed)
    kind, time, x = motion(random, seed)
    force, every = force_of(random, time, x), int(random.choice([2, 4, 8]))
    if random.random() < 0.5:  # filter of the load cell
        force = sosfilt(butter(2, random.uniform(60.0, 200.0), fs=2000.0, output="sos"), force - force[0]) + force[0]
    v, noise = np.gradient(x, time), random.standard_normal((3, time.size))
    measured = {
        T: time, X: np.round(1e3 * x + 0.003 * noise[0], 3),
        V: np.round(1e3 * v + 2e-3 * np.ptp(1e3 * v) * random.uniform(0.1, 1.0) * noise[1], 2),
        F: np.round(force + np.ptp(force) * random.uniform(3e-4, 3e-3) * noise[2], 1),
    }  # fmt: skip
    if random.random() < 0.4:
        del measured[V]
    yield kind, {name: values[400::every] for name, values in measured.items()}


# ---- Faults ---------------------------------------------------------------------------------------------------------


class Fault(NamedTuple):
    """A change of a file's columns, the rules that find it, and a column that it needs."""

    change: Callable[[Columns], Columns]
    rules: tuple[str, ...]
    needs: str = F


def scaled(**factors: float) -> Callable[[Columns], Columns]:
    """Return a change that multiplies the columns that begin with the names."""
    return lambda columns: {name: factors.get(name[0], 1.0) * values for name, values in columns.items()}


def with_force(change: Callable[[Array, Array, float], Array], name: str = F) -> Callable[[Columns], Columns]:
    """Return a change of a column (N,) by its values, times from 0 [s] and sample rate [Hz]."""

    def changed(columns: Columns) -> Columns:
        time = columns[T] - columns[T][0]
        return columns | {name: change(columns[name], time, (time.size - 1) / time[-1])}

    return changed


def drift(values: Array, time: Array, _: float) -> Array:
    """Return values whose gain falls by 10 %."""
    return np.asarray(values * (1.0 - 0.1 * time / time[-1]))


def hum(values: Array, time: Array, rate: float) -> Array:
    """Return values with hum of 1 % of their range."""
    frequency = 50.0 if rate > 105.0 else 60.0
    return np.asarray(values + 0.01 * np.ptp(values) * np.sin(2.0 * np.pi * frequency * time))


def smoothed(values: Array, _: Array, rate: float) -> Array:
    """Return a moving average over 50 ms."""
    return np.asarray(uniform_filter1d(values, max(3, round(0.05 * rate))))


def clipped(values: Array, _: Array, __: float) -> Array:
    """Return values clipped at 60 % of their range."""
    return np.asarray(np.minimum(values, values.min() + 0.6 * np.ptp(values)))


def harder(values: Array, time: Array, _: float) -> Array:
    """Return a force that is 15 % harder from the middle on."""
    return np.asarray(np.where(time > 0.5 * time[-1], values.mean() + 1.15 * (values - values.mean()), values))


def dropped(values: Array, time: Array, _: float) -> Array:
    """Return values that are 0 at three samples where they are large."""
    lost = values.copy()
    lost[np.argsort(-np.abs(values) * (np.abs(time - 0.5 * time[-1]) < 0.4 * time[-1]))[:3]] = 0.0
    return lost


def run_down(columns: Columns) -> Columns:
    """Slow the motion down within 3 s from 60 % of the record on, at most 6 s: the machine's phase, with less force."""
    time = columns[T] - columns[T][0]
    start = min(0.6 * time[-1], 6.0)
    rest = min(time[-1] - start, 3.0)
    beyond = np.clip(time - start, 0.0, rest)
    pace, phase = 1.0 - beyond / rest, np.minimum(time, start) + beyond - 0.5 * beyond**2 / rest
    slowed = {name: np.interp(phase, time, values) for name, values in columns.items()} | {T: columns[T]}
    slowed[F] = slowed[F].mean() + pace * (slowed[F] - slowed[F].mean())
    return slowed | ({V: pace * slowed[V]} if V in slowed else {})


def with_column(name: str, values: Callable[[Array], Array]) -> Callable[[Columns], Columns]:
    """Return a change that adds a column, a function of the share of the record's time (N,)."""
    return lambda columns: columns | {name: values((columns[T] - columns[T][0]) / np.ptp(columns[T]))}


_UNITS, _CHANGED = ("contradictory units", "unlikely units"), ("the shock changed",)
FAULTS = {
    "time in ms labelled s": Fault(scaled(t=1e3), _UNITS),
    "displacement in inches labelled mm": Fault(scaled(x=1.0 / _INCH), _UNITS, V),
    "velocity in in/s labelled mm/s": Fault(scaled(v=1.0 / _INCH), _UNITS, V),
    "force with the wrong sign": Fault(scaled(F=-1.0), ()),
    "all signs turned": Fault(scaled(x=-1.0, v=-1.0, F=-1.0), ("negative force at standstill",)),
    "rectified force": Fault(with_force(lambda force, _, __: np.abs(force)), ("rectified force",)),
    "clipped force": Fault(with_force(clipped), ()),
    "force of zero at three samples": Fault(with_force(dropped), ("jump of a channel",)),
    "15 % harder from the middle on": Fault(with_force(harder), _CHANGED),
    "the machine runs down": Fault(run_down, ("run-down of the machine",), "sine"),
    "force drifts by 10 %": Fault(with_force(drift), ("drift", *_CHANGED)),
    "displacement drifts by 10 %": Fault(with_force(drift, X), ("drift",)),
    "hum of 1 % on the force": Fault(with_force(hum), ("hum",)),
    "velocity 10 % too large": Fault(scaled(v=1.1), ("velocity and displacement disagree",), V),
    "force averaged over 50 ms": Fault(with_force(smoothed), ("smoothed force",)),
    "a current ramps, with noise": Fault(
        with_column("current [A]", lambda s: 1.0 + s + 0.02 * np.sin(9e4 * s**2)), ("another column changes",)),
    "a voltage pulses": Fault(with_column("valve [V]", lambda s: np.where((8.0 * s) % 1.0 > 0.5, 3.0, 1.0)),
                              ("another column changes",)),
}  # fmt: skip


# ---- Judgement ------------------------------------------------------------------------------------------------------


def findings_of(columns: Columns, folder: Path) -> set[str]:
    """Return the names of the rules of the findings of a file, without notes."""
    path = folder / "run.csv"
    write_csv(pa.table(columns), path)
    try:
        return {reason.rule for reason in read_dyno_test(path).reasons} - _NOTES
    except InputError:
        return {_REFUSED}


def judged(columns: Columns, kind: str, *, seeded: bool) -> Iterator[tuple[str, bool, set[str]]]:
    """Yield what was done to a record, whether it was found, and the findings."""
    with tempfile.TemporaryDirectory() as place:
        own = findings_of(columns, Path(place))
        yield "sound: false alarm", bool(own), own
        middle = columns[T].size // 2
        for part in (slice(None, middle), slice(middle, None)):
            if np.ptp(columns[T][part]) > 3.0 and middle > 250:
                found = findings_of({name: values[part] for name, values in columns.items()}, Path(place))
                yield "half of a sound record: false alarm", bool(found), found
        for name, fault in FAULTS.items() if seeded else ():
            if fault.needs in columns or fault.needs == kind:
                found = findings_of(fault.change(columns), Path(place)) - own
                yield name, bool(found & {_REFUSED, *fault.rules}), found


def records(shocks: int, seed: int, folders: list[Path]) -> Iterator[tuple[str, str, str, Columns, bool]]:
    """Yield where a record is from, its name, its kind, its columns, and whether it gets faults."""
    for number in range(seed, seed + shocks):
        yield from (("virtual", f"seed {number}", kind, columns, True) for kind, columns in virtual(number))
    for name, run in measured_runs(Path(os.environ.get("EIGHTPOST_DATA") or "/nowhere")):
        columns = {T: np.asarray(run.series.time), X: 1e3 * run.series["displacement"], F: run.series["force"]}
        yield "measured", name, "sine", columns | ({} if run.derived else {V: 1e3 * run.series["velocity"]}), True
    paths = sorted(path for folder in folders for path in folder.glob("*.csv"))
    for number, path in enumerate(paths):
        values, names = np.loadtxt(path, delimiter=",", skiprows=1), path.read_text().split("\n")[0].split(",")
        yield "measured", path.stem, "other", dict(zip(names, values.T, strict=True)), number % 8 == 0


def main() -> None:
    """Print how many of each fault were found as a table in Markdown."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--shocks", type=int, default=60)
    parser.add_argument("--seed", type=int, default=95000)
    parser.add_argument("--records", type=Path, nargs="*", default=[], help="folders of measured records")
    parser.add_argument("--list", action="store_true", help="name the false alarms and the faults that were missed")
    chosen = parser.parse_args()
    total, hits = Counter[tuple[str, str]](), Counter[tuple[str, str]]()
    for where, name, kind, columns, seeded in records(chosen.shocks, chosen.seed, chosen.records):
        for what, hit, found in judged(columns, kind, seeded=seeded):
            total[what, where] += 1
            hits[what, where] += hit
            if chosen.list and hit == ("sound" in what):
                print(f"{name}, {kind}: {what}: {', '.join(sorted(found)) or 'nothing'}")
    print("| record | virtual dampers | measured records |\n|---|---|---|")
    for what in dict.fromkeys(key for key, _ in total):
        cells = [f"{hits[what, w]} of {total[what, w]}" if total[what, w] else "-" for w in ("virtual", "measured")]
        print(f"| {what} | {cells[0]} | {cells[1]} |")


if __name__ == "__main__":
    main()
