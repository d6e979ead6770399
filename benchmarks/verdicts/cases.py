"""Tests of a damper, virtual or measured: motions, what the dynamometer records of them, faults."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

from benchmarks.table import log_uniform as between
from benchmarks.verdicts.dampers import RATE, Damper, Kind, Random
from eightpost.array_types import Array
from eightpost.ident import evaluate
from eightpost.rig import DynoTest, read_dyno_test
from eightpost.shock import Shock
from eightpost.signals import TimeSeries
from eightpost.signals.filters import velocity_from_displacement

#: Length of a record [s], largest peak speed of a sine [m/s], and lowest frequency of several [Hz].
DURATION, FASTEST, SLOWEST = 6.0, 1.0, 0.4

#: Tests that are fitted, and faults of every fifth of them.
PLANS = ("one sine", "sines of one stroke", "two sines", "stepped sines", "random", "track", "random and sine")
FAULTS = ("late force", "changed setting", "another damper", "clipped", "drift")


@dataclass(frozen=True, slots=True)
class Case:
    """Records of one damper."""

    name: str  #: Kind of the damper, test, and fault if there is one.
    fitted: tuple[DynoTest, ...]  #: Fitted records.
    held_out: Mapping[str, DynoTest]  #: Held-out records by name.
    is_measured: bool = False  #: Whether the damper is a real one.


def sine(amplitude: float, frequency: float, duration: float = DURATION) -> Array:
    """Return a sine of at least three cycles that starts at its lower end."""
    cycles = max(3, round(duration * frequency))
    time = np.arange(round(cycles / frequency * RATE)) / RATE
    return np.asarray(-amplitude * np.cos(2.0 * np.pi * frequency * time))


def stepped(amplitude: float, frequencies: Array) -> Array:
    """Return three cycles of each frequency, one after the other."""
    return np.concatenate([sine(amplitude, f, 3.0 / f) for f in frequencies])


def noise(random: Random, peak: float, corner: float, *, bumps: bool) -> Array:
    """Return a random motion whose slope falls above a corner frequency [Hz], with bumps if it is of a track."""
    size = round(DURATION * RATE)
    frequency = np.fft.rfftfreq(size, 1.0 / RATE)
    high = (frequency > 0.3) & (frequency < 25.0)
    spectrum = np.exp(2j * np.pi * random.random(frequency.size)) * high
    x = np.fft.irfft(spectrum / (1.0 + (frequency / corner) ** 2), size)
    if bumps:
        x /= x.std()
        for start in random.uniform(0.0, DURATION - 0.5, 6):
            width = round(between(random, 0.05, 0.3) * RATE)
            first = round(start * RATE)
            x[first : first + width] += random.choice([-3.0, 3.0]) * np.hanning(width)
    return np.asarray(peak * (x - x.mean()) / np.abs(x - x.mean()).max())


@dataclass(frozen=True, slots=True)
class Rig:
    """A dynamometer: rate of its records [Hz], corner of the force's filter [Hz], noise and resolution [1]."""

    rate: float
    corner: float
    noise: float
    resolution: float
    has_velocity: bool
    has_temperature: bool

    @classmethod
    def drawn(cls, random: Random) -> Rig:
        """Return a random dynamometer."""
        return cls(
            rate=float(random.choice([200.0, 400.0, 500.0, 1000.0])), corner=between(random, 150.0, 2000.0),
            noise=between(random, 5e-4, 1e-2), resolution=2.0 ** -float(random.integers(11, 16)),
            has_velocity=bool(random.random() < 0.6), has_temperature=bool(random.random() < 0.5),
        )  # fmt: skip

    def record(self, random: Random, damper: Damper, x: Array, fault: str = "", warm: float = 0.0) -> DynoTest:
        """Return the record of a motion."""
        force, heat = damper.respond(x, warm)
        share = np.exp(-2.0 * np.pi * self.corner / RATE)
        force = lfilter([1.0 - share], [1.0, -share], force, zi=[share * force[0]])[0]
        v = np.gradient(x, 1.0 / RATE)
        if fault == "late force":
            late = round(between(random, 3e-3, 3e-2) * RATE)
            force = np.concatenate([np.full(late, force[0]), force[:-late]])
        if fault == "changed setting":
            force[x.size // 2 :] *= between(random, 1.15, 1.6)
        if fault == "drift":
            force *= np.linspace(1.0, random.uniform(0.6, 0.9), x.size)
        if fault == "clipped":
            force = np.minimum(force, random.uniform(0.5, 0.9) * force.max())
        every = round(RATE / self.rate)
        span = float(np.ptp(force))
        force = force[::every] + self.noise * force.std() * random.standard_normal(force[::every].size)
        force = np.round(force / (self.resolution * span)) * self.resolution * span
        x, v, heat = x[::every], v[::every], heat[::every]
        if not self.has_velocity:
            x = np.round((x + 2e-6 * random.standard_normal(x.size)) / 2e-6) * 2e-6
            v = velocity_from_displacement(x, self.rate, min(50.0, 0.4 * self.rate))
        channels = {"displacement": ("m", x), "velocity": ("m/s", v), "force": ("N", force)}
        if self.has_temperature and damper.warming:
            channels["temperature"] = ("K", 300.0 + heat)
        return DynoTest(TimeSeries.from_channels(np.arange(x.size) / self.rate, channels))


def case(kinds: Mapping[str, Kind], seed: int, number: int) -> Case:
    """Return a random damper of one of the kinds, tested by one of the plans, with its held-out records."""
    random = np.random.default_rng([seed, number])
    kind, plan = list(kinds)[number % len(kinds)], PLANS[number % len(PLANS)]
    fault = str(random.choice(FAULTS)) if random.random() < 0.2 else ""
    damper, rig = kinds[kind](random), Rig.drawn(random)
    stroke = between(random, 0.008, 0.028)
    speed = min(between(random, 0.06, 0.8), FASTEST, 2.0 * np.pi * 8.0 * stroke)
    stiffer = replace(damper, laminar=(1.4 * damper.laminar[0], 1.4 * damper.laminar[1]))
    corner, fitted = between(random, 0.6, 4.0), []
    for place, x in enumerate(_motions(random, plan, stroke, speed, corner)):
        fitted.append(rig.record(random, stiffer if place and fault == "another damper" else damper, x, fault))
    held: dict[str, DynoTest] = {}
    for name in ("again", "once more"):
        shares = random.uniform(0.8, 1.0, 2)
        motions = _motions(random, plan, shares[0] * stroke, shares[1] * speed, corner)
        held[name] = rig.record(random, damper, motions[random.integers(len(motions))])
    for place, smallest in enumerate((0.3, 0.7)):
        amplitude = stroke * between(random, smallest, 1.0)
        peak = min(speed * between(random, 0.3, 1.0), 2.0 * np.pi * 10.0 * amplitude)
        held[f"sine {place}"] = rig.record(random, damper, sine(amplitude, peak / (2.0 * np.pi * amplitude), 4.0))
    for name, bumps in (("random", False), ("track", True)):
        x = noise(random, stroke * random.uniform(0.7, 1.0), between(random, 0.6, 4.0), bumps=bumps)
        held[name] = rig.record(random, damper, _limited(x, speed * random.uniform(0.7, 1.0)))
    return Case(f"{number}: " + ", ".join([kind, plan, *([fault] if fault else [])]), tuple(fitted), held)


def _limited(x: Array, speed: float) -> Array:
    """Return a motion whose peak speed is at most `speed`."""
    return np.asarray(x * min(1.0, speed / float(np.abs(np.gradient(x, 1.0 / RATE)).max())))


def _motions(random: Random, plan: str, stroke: float, speed: float, corner: float) -> list[Array]:
    frequency = speed / (2.0 * np.pi * stroke)
    if plan == "one sine":
        return [sine(stroke, frequency)]
    if plan == "two sines":
        share, slower = random.uniform(0.3, 0.9), between(random, 0.3, 1.0)
        return [sine(stroke, slower * frequency), sine(share * stroke, min(frequency / share, 10.0))]
    shares = np.geomspace(random.uniform(0.05, 0.3), 1.0, random.integers(3, 7))
    if plan == "sines of one stroke":
        return [sine(stroke, one, 2.0) for one in np.maximum(shares * frequency, SLOWEST)]
    if plan == "stepped sines":
        return [stepped(stroke, np.maximum(shares * frequency, SLOWEST))]
    moved = noise(random, stroke, corner, bumps=plan == "track")
    motions = [_limited(moved, speed)]
    return [*motions, sine(0.5 * stroke, frequency, 4.0)] if plan == "random and sine" else motions


#: Name of the rest of a record of which two thirds are fitted.
LAST_THIRD = "last third"

#: Longest part of a record that is used [s].
LONGEST = 18.0


def measured(folder: Path) -> Iterator[Case]:
    """Yield the cases of a folder, in which each folder has the runs (CSV) of one damper at one setting.

    Of each run the last third is left out once. Each run is fitted alone and judged on the others, and each is left out
    of a fit to all others.
    """
    for damper in sorted(path for path in folder.iterdir() if path.is_dir()):
        whole_runs = {path.stem: read_dyno_test(path) for path in sorted(damper.glob("*.csv"))}
        runs = {name: part(run, 0.0, min(run.series.duration, LONGEST)) for name, run in whole_runs.items()}
        for name, run in runs.items():
            end = run.series.duration
            thirds = [part(run, *ends) for ends in ((0.0, end / 1.5), (end / 1.5, end))]
            others = {other: one for other, one in runs.items() if other != name}
            held_out = {LAST_THIRD: thirds[1]} | others
            yield Case(f"{name}, its first two thirds", (thirds[0],), held_out, is_measured=True)
            if len(others) > 1:
                yield Case(f"{damper.name}, all but {name}", tuple(others.values()), {name: run}, is_measured=True)


def part(run: DynoTest, start: float, stop: float) -> DynoTest:
    """Return the seconds from `start` to `stop` of a run."""
    first = float(run.series.time[0])
    return DynoTest(run.series.window(first + start, first + stop))


def whole(run: DynoTest) -> tuple[float, float]:
    """Return start and end [s] of a run; its resampling may shorten it by a sample."""
    return 0.0, run.series.duration - 2.0 / run.series.sample_rate


def percent(shock: Shock, record: DynoTest, *, about_mean: bool) -> float:
    """Return the error of a shock on a record, or its standard deviation, over that of the force [%]."""
    judged = evaluate(shock, record, segment=whole(record))
    return 100.0 * (float(judged.error.std()) if about_mean else judged.rms) / judged.deviation
