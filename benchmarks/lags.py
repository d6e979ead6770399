"""How right the lag of a force is that `eightpost inspect` states: known laws, random virtual shocks, Bouc-Wen dampers.

    python -m benchmarks.lags --shocks 40 --seed 3000

Every record's force is delayed by -5 to 30 ms. The known laws are a random curve with gas and friction and no lag of
their own. The own lag of a virtual shock is that in another random motion; Bouc-Wen dampers, whose hysteresis is no
lag, count as if they had none.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from collections.abc import Iterator

import numpy as np

from benchmarks.random_shocks import BoucWenDamper
from benchmarks.settings import MOST, RandomShock
from eightpost.array_types import Array
from eightpost.rig.dynamometer import Actuator, Damper, measure, random_multisine, read_out, sine_test
from eightpost.rig.motion import Lag, force_lag
from eightpost.signals import TimeSeries

#: Rate of the simulation [Hz], and numbers of its samples per sample of a record.
RATE, EVERY = 2000.0, (2, 4, 8)


def delayed(series: TimeSeries, delay: float, every: int) -> TimeSeries:
    """Return every so manieth sample of a record whose force is late by a delay [s]."""
    late = np.interp(series.time - delay, series.time, series["force"])
    return series.with_channel("force", "N", late).at(slice(None, None, every))


def in_turn(parts: list[TimeSeries]) -> TimeSeries:
    """Return records one after the other."""
    rows = {name: (unit, np.concatenate([part[name] for part in parts]))
            for name, unit in zip(parts[0].names, parts[0].units, strict=True)}  # fmt: skip
    return TimeSeries.from_channels(np.arange(sum(map(len, parts))) / RATE, rows)


def known_force(random: np.random.Generator, series: TimeSeries) -> TimeSeries:
    """Return a motion with the force of a random curve with gas and friction, without lag, and with noise."""
    velocity, path = series["velocity"], series["displacement"]
    knee, high, low = random.uniform(0.03, 0.15), random.uniform(100.0, 800.0), random.uniform(500.0, 3000.0)
    curve = high * np.tanh(velocity / knee) + low * velocity * (1.0 + random.uniform(0.0, 2.0) * np.abs(velocity))
    curve = np.where(velocity < 0.0, random.uniform(0.5, 2.5), 1.0) * curve
    force = curve + random.uniform(0.0, 5000.0) * path + random.uniform(0.0, 80.0) * np.tanh(velocity / 4e-3)
    noise = 10.0 ** random.uniform(-3.0, -1.5) * force.std() * random.standard_normal(force.size)
    return series.with_channel("force", "N", random.uniform(0.0, 300.0) + force + noise)


def records(seed: int) -> Iterator[tuple[str, TimeSeries, float]]:
    """Yield kind, record and own lag [s] of the shocks of a seed."""
    random = np.random.default_rng(seed)
    shock = RandomShock.drawn(random).at(float(random.integers(round(MOST) + 1)))
    drives = [random_multisine(seed, duration=10.0, rate=RATE)]
    for _ in range(5):
        amplitude, speed = random.choice([0.0127, 0.0254]), random.uniform(0.03, 0.6)
        drives.append(sine_test(float(amplitude), float(speed), cycles=6, rate=RATE).drivefile)

    def run(damper: Damper, number: int) -> TimeSeries:
        return measure(damper, drives[number], rate=RATE, actuator=Actuator(), seed=seed + number)

    runs = [run(shock, number) for number in range(len(drives))]
    other = measure(shock, random_multisine(seed + 1, duration=20.0, rate=RATE), rate=RATE, seed=seed + 99)
    own = force_lag(other)
    assert own is not None
    motions = {"random": runs[0], "five sines": in_turn(runs[1:]), "two sines": in_turn(runs[1:3]), "one sine": runs[1]}
    for kind, motion in motions.items():
        yield f"known law, {kind}", known_force(random, motion), 0.0
        yield f"virtual shock, {kind}", motion, own.seconds
    hysteretic = BoucWenDamper.drawn(random).respond(Actuator().follow(drives[0].series), rate=RATE)
    yield "Bouc-Wen, random", read_out(hysteretic, seed=seed), 0.0


def main() -> None:
    """Print how often the lag is known and in its interval, its error, and the half-width of the interval."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--shocks", type=int, default=40)
    parser.add_argument("--seed", type=int, default=3000)
    chosen = parser.parse_args()
    rows: dict[str, list[tuple[Lag | None, float]]] = defaultdict(list)
    for seed in range(chosen.seed, chosen.seed + chosen.shocks):
        random = np.random.default_rng(seed + 1)
        for kind, series, own in records(seed):
            delay = float(random.uniform(-5e-3, 0.03))
            lag = force_lag(delayed(series, delay, int(random.choice(EVERY))))
            rows[kind].append((lag, delay + own))
    print("| record | known | in the interval | error in ms: mean, largest | half-width in ms: median, 90 % |")
    print("|---|---|---|---|---|")
    for kind, pairs in rows.items():
        known = [(lag, truth) for lag, truth in pairs if lag is not None]
        error = 1e3 * np.array([lag.seconds - truth for lag, truth in known])
        inside = sum(lag.low <= truth <= lag.high for lag, truth in known)
        width = 500.0 * np.array([lag.high - lag.low for lag, _ in known])
        print(
            f"| {kind} | {len(known)} of {len(pairs)} | {inside} of {len(known)} | {error.mean():.2f}, "
            f"{_largest(error):.2f} | {np.median(width):.2f}, {np.quantile(width, 0.9):.2f} |"
        )


def _largest(error: Array) -> float:
    return float(np.abs(error).max())


if __name__ == "__main__":
    main()
