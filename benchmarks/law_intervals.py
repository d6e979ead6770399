"""Benchmark of the 95 % intervals of fitted shocks: two disjoint halves of a record are fitted and compared.

    python benchmarks/law_intervals.py [--laws hysteresis] [--measured] [--seed 12]

The records are configurations of the virtual dynamometer, with constant damping and with a damping that falls by 0.4 %
per kelvin while the shock warms, and the measured records in the folder that EIGHTPOST_DATA names. The law's own
parameters and six points of the curve are compared; an interval covers if the difference of the halves is within the
root of the sum of squares of both half-widths. Parameters at a bound are left out, and so are those that one half does
not have, such as a stop of Hysteresis. Prints the share per group.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from benchmarks.shock_records import measured_runs
from eightpost.ident import ShockFit, fit_shock
from eightpost.rig import Actuator, DynoTest, configuration, random_multisine, read_out

CONFIGURATIONS, LAWS = (1, 3, 5, 7, 9, 11), ("polylinear", "lpf1", "lpnl2", "hysteresis")

#: Seed with which the intervals were chosen.
TUNED = 11

#: Relative change of the damping per kelvin of warming [1/K].
DRIFT = -0.004

#: Velocities at which curves are compared, over the peak speed that both halves reach.
SHARES = np.array([-0.7, -0.4, -0.15, 0.15, 0.4, 0.7])


def virtual(drift: float, seed: int, *, has_temperature: bool = True) -> Iterator[DynoTest]:
    """Yield records of 21 s whose damping changes with the warming of the shock, with or without its temperature."""
    drive = Actuator().follow(random_multisine(seed, duration=21.0).series)
    for number in CONFIGURATIONS:
        truth = configuration(number).respond(drive, rate=2000.0)
        force, warming = truth["force"], truth["warming"]
        changed = force.mean() + (force - force.mean()) * (1.0 + drift * (warming - warming[0]))
        series = read_out(truth.with_channel("force", "N", changed), seed=seed)
        yield DynoTest(series if has_temperature else series.select([n for n in series.names if n != "temperature"]))


def covered(test: DynoTest, law: str) -> list[bool]:
    """Return whether each parameter and each point of the curve agrees between the halves of a record."""
    end = test.series.duration - 0.5
    middle = 0.5 * (0.5 + end)
    velocity = test.series["velocity"]
    slow = float(min(velocity.max(), -velocity.min()))
    one, other = (fit_shock(test, law, segment=part) for part in ((0.5, middle), (middle, end)))
    first, second = _own(one), _own(other)
    pairs = [(*first[name], *second[name]) for name in first if name in second]
    found = [abs(a - b) <= np.hypot(wide, wide_too) for a, wide, b, wide_too in pairs if np.isfinite(wide + wide_too)]
    (a, wide), (b, wide_too) = (_points(fit, SHARES * slow) for fit in (one, other))
    return [bool(hit) for hit in (*found, *(np.abs(a - b) <= np.hypot(wide, wide_too)))]


def _own(fit: ShockFit) -> dict[str, tuple[float, float]]:
    """Return value and half-width of the law's own parameters by name; NaN where there is no valid interval."""
    known = [parameter for parameter in fit.parameters if not parameter.name.startswith("gas_")]
    return {p.name: (p.value, np.nan if p.at_bound or p.error is None else p.reach * p.error) for p in known}


def _points(fit: ShockFit, velocity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    band = fit.band
    return np.interp(velocity, band.velocity, band.force), np.interp(velocity, band.velocity, band.half_width)


def main() -> None:
    """Print the share of intervals that cover, per group of records and law."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--laws", default=",".join(LAWS), help="names of laws, separated by commas")
    parser.add_argument("--measured", action="store_true", help="measured records alone")
    parser.add_argument("--seed", type=int, default=TUNED, help="seed of motion and noise of the virtual records")
    options = parser.parse_args()
    laws = options.laws.split(",")
    measured = measured_runs(Path(os.environ.get("EIGHTPOST_DATA") or "/nowhere"))
    groups: dict[str, Iterator[DynoTest]] = {"measured": (run for _, run in measured)}
    if not options.measured:
        groups |= {
            "constant": virtual(0.0, options.seed),
            "warming": virtual(DRIFT, options.seed),
            "warming, no temperature": virtual(DRIFT, options.seed, has_temperature=False),
        }
    for name, tests in groups.items():
        hits: dict[str, list[bool]] = {law: [] for law in laws}
        for test in tests:
            for law in laws:
                hits[law] += covered(test, law)
        for law, found in hits.items():
            if found:
                print(f"{name}, {law}: {100.0 * float(np.mean(found)):.1f} % of {len(found)}", flush=True)


if __name__ == "__main__":
    main()
