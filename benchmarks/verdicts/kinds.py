"""Kinds of virtual dampers and tests of the sets `tune` and `check`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.verdicts.damper import Damper

Random = np.random.Generator
Kind = Callable[[Random], Damper]


def between(random: Random, low: float, high: float) -> float:
    """Return a number whose logarithm is uniform."""
    return float(np.exp(random.uniform(np.log(low), np.log(high))))


def pair(random: Random, low: float, high: float) -> tuple[float, float]:
    """Return one number for each stroke."""
    return between(random, low, high), between(random, low, high)


def common(random: Random) -> dict[str, Any]:
    """Return gas, friction and stiffness, which every damper has."""
    gas = random.uniform(50.0, 500.0)
    return {
        "gas": gas, "gas_stiffness": random.uniform(0.0, 3000.0), "friction": between(random, 5.0, 100.0),
        "presliding": between(random, 2e-5, 2e-4), "stiffness": between(random, 3e5, 6e6), "reach": 0.03,
    }  # fmt: skip


def digressive(random: Random) -> Damper:
    """A valve that blows off."""
    slope = pair(random, 2500.0, 12000.0)
    knee = pair(random, 0.03, 0.15)
    return Damper(laminar=slope, blow_off=(slope[0] * knee[0], slope[1] * knee[1]), opened=pair(random, 500.0, 2500.0),
                  bleed=pair(random, 0.002, 0.03), orifice=between(random, 20.0, 500.0), **common(random))  # fmt: skip


def linear(random: Random) -> Damper:
    """Laminar flow alone."""
    return Damper(laminar=pair(random, 800.0, 8000.0), blow_off=(1e5, 1e5), bleed=(1e-4, 1e-4), orifice=0.0,
                  **common(random))  # fmt: skip


def progressive(random: Random) -> Damper:
    """Orifices: little force at low speed."""
    return Damper(laminar=pair(random, 500.0, 3000.0), blow_off=(1e5, 1e5), bleed=pair(random, 0.02, 0.2),
                  orifice=between(random, 1000.0, 15000.0), **common(random))  # fmt: skip


def soft(random: Random) -> Damper:
    """Much lag: soft mounts or oil."""
    known = common(random) | {"stiffness": between(random, 6e4, 4e5)}
    slope = pair(random, 2500.0, 10000.0)
    return Damper(laminar=slope, blow_off=(0.07 * slope[0], 0.05 * slope[1]), opened=pair(random, 500.0, 2000.0),
                  **known)  # fmt: skip


def rough(random: Random) -> Damper:
    """Much dry friction, larger at standstill."""
    friction, more = between(random, 80.0, 300.0), between(random, 10.0, 200.0)
    return replace(digressive(random), friction=friction, stribeck=more)


def hysteretic(random: Random) -> Damper:
    """A valve that opens late and closes at a lower pressure."""
    opening_time = between(random, 5e-4, 1e-2)
    return replace(digressive(random), closing=random.uniform(0.4, 0.9), opening_time=opening_time)


def cavitating(random: Random) -> Damper:
    """Oil separates in fast rebound."""
    base = digressive(random)
    return replace(base, cavitation=base.blow_off[1] * random.uniform(1.1, 1.8))


def fading(random: Random) -> Damper:
    """Oil that warms and thins."""
    warming = between(random, 2e-4, 1e-2)
    return replace(digressive(random), warming=warming, fading=random.uniform(0.003, 0.015))


#: Kinds of the sets.
TUNE: Mapping[str, Kind] = {"digressive": digressive, "linear": linear, "soft": soft, "rough": rough, "fading": fading}
CHECK: Mapping[str, Kind] = {"progressive": progressive, "hysteretic": hysteretic, "cavitating": cavitating}
