"""Shocks of true cars: laws that the project can be given exactly, and records of a dynamometer to fit them from."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from numba import njit
from numpy.typing import NDArray

from benchmarks.cars.march import FASTEST, SPACING, Shocks, shock_force
from eightpost.shock import Lpnl2, ShockLaw, write_shock
from eightpost.shock.curve import KNOTS, StaticCurve
from eightpost.shock.file import Shock

Array = NDArray[np.float64]

#: Stiffness of the seal before it slides [N/m].
SEAL_STIFFNESS = 2e6


@dataclass(frozen=True, slots=True)
class TrueShock:
    """Digressive shock with a lag that fades, and dry friction of its seal, which no law of the project has."""

    name: str
    compression: tuple[float, float, float]  #: Damping at rest and at speed [N.s/m], speed of the knee [m/s].
    rebound: tuple[float, float, float]
    lag: float = 1e-3  #: Time constant [s].
    fades: tuple[float, float] = (1500.0, 3500.0)  #: Static forces from which the lag fades, and without lag [N].
    seal: float = 0.0  #: Dry friction [N]; 0: `law` is the truth.

    def static(self, v: Array) -> tuple[Array, Array]:
        """Return the static force and its slope at velocities."""
        low, high, knee = (np.where(v > 0.0, c, r) for c, r in zip(self.compression, self.rebound, strict=True))
        return high * v + (low - high) * knee * np.tanh(v / knee), high + (low - high) / np.cosh(v / knee) ** 2

    @property
    def law(self) -> Lpnl2:
        """The same law, without seal."""
        side = np.concatenate([np.geomspace(0.01, 1.0, KNOTS // 2 - 1), [FASTEST]])
        v = np.concatenate([-side[::-1], [0.0], side])
        force, slope = self.static(v)
        slope[KNOTS // 2] = 0.5 * (self.compression[0] + self.rebound[0])
        curve = StaticCurve.through_knots(tuple(v.tolist()), tuple(force.tolist()), tuple(slope.tolist()))
        return Lpnl2(curve, self.lag, *self.fades)

    def numbers(self, h: float) -> tuple[Array, Array]:
        """Return the table of the static force of `law`, and the other numbers, for a march with steps of h [s]."""
        ratio = h / self.lag
        rise = -math.expm1(-ratio)
        curve = self.law.curve
        return _table(curve), np.array([rise, 1.0 - rise / ratio, *self.fades, self.seal, SEAL_STIFFNESS])

    def scaled(self, factor: float, name: str) -> TrueShock:
        """Return the shock with all damping times a factor."""

        def times(side: tuple[float, float, float]) -> tuple[float, float, float]:
            return factor * side[0], factor * side[1], side[2]

        return replace(self, name=name, compression=times(self.compression), rebound=times(self.rebound))


@cache
def _table(curve: StaticCurve) -> Array:
    return np.array([curve.force(float(v)) for v in np.arange(-FASTEST, FASTEST + 0.5 * SPACING, SPACING)])


def marched(shocks: tuple[TrueShock, ...], h: float) -> Shocks:
    """Return the arrays of the shocks at the four corners."""
    numbers = {shock: shock.numbers(h) for shock in set(shocks)}
    return Shocks(np.array([numbers[s][0] for s in shocks]), np.array([numbers[s][1] for s in shocks]))


def write_bank(bank: tuple[TrueShock, ...], folder: Path, laws: tuple[ShockLaw, ...] = ()) -> list[Path]:
    """Write a shock.json of the exact law (or of the given laws) of each shock."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / f"{shock.name}.json" for shock in bank]
    for shock, path, law in zip(bank, paths, laws or [shock.law for shock in bank], strict=True):
        write_shock(Shock(shock.name, law), path)
    return paths


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _forces(table: Array, law: Array, velocity: Array, h: float) -> Array:
    found, state = np.zeros(velocity.size), (0.0, 0.0, 0.0, 0.0, 0.0)
    for k in range(velocity.size):
        found[k], state = shock_force(table, law, state, velocity[k], h)
    return found


def dyno_record(shock: TrueShock, seed: int, seconds: float = 12.0, peak: float = 0.012) -> dict[str, Array]:
    """Return time, displacement and force of a random test on a dynamometer, with noise, at 2 kHz."""
    generator, rate, finer = np.random.default_rng([5, seed]), 2000.0, 4
    count = round(seconds * rate)
    f = np.fft.rfftfreq(count, 1.0 / rate)
    size = np.where((f > 0.3) & (f < 25.0), np.maximum(f, 1.0) ** -1.0, 0.0)
    lines = size * np.exp(2j * np.pi * generator.random(f.size))
    x = np.fft.irfft(lines, finer * count)
    factor = peak / np.abs(x).max()
    pi = 2j * np.pi * f
    v = factor * np.fft.irfft(pi * lines, finer * count)
    h = 1.0 / (finer * rate)
    force = _forces(*shock.numbers(h), v, h)[::finer]
    noisy = [y + 0.003 * y.std() * generator.standard_normal(count) for y in (factor * x[::finer], force)]
    return {"time": np.arange(count) / rate, "displacement": noisy[0], "velocity": v[::finer], "force": noisy[1]}
