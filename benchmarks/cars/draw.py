"""True cars of several kinds, with parameters drawn by a seed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, cast

import numpy as np

from benchmarks.cars.car import Car, Four, Sensors, TrueShock, times

#: Friction that one car has as a whole at each wheel, times a factor by kind [N].
FRICTION = 55.0

#: Factors on the damping of the bank, compression and rebound; the fourth is the baseline.
_BANK = ((0.7, 0.7), (0.7, 1.5), (1.4, 0.75), (1.0, 1.0), (1.0, 1.5), (1.5, 1.0), (1.6, 1.6))


class _Draw:
    """Random parameters about given ones."""

    def __init__(self, kind: str, seed: int) -> None:
        self.kind, self.seed = kind, seed
        self.generator = np.random.default_rng([40, *kind.encode(), seed])

    def one(self, value: float, spread: float) -> float:
        return float(value * np.exp(spread * np.clip(self.generator.standard_normal(), -2.0, 2.0)))

    def between(self, low: float, high: float) -> float:
        return float(self.generator.uniform(low, high))

    def four(self, front: float, rear: float, spread: float, sides: float = 0.02) -> Four:
        axles = [self.one(front, spread), self.one(rear, spread)]
        return cast(Four, tuple(self.one(axle, sides) for axle in axles for _ in "lr"))


def draw(kind: str, seed: int) -> Car:
    """Return a car of one of `KINDS`."""
    return KINDS[kind](_Draw(kind, seed))


def _bank(some: _Draw, wheel: float, ratio: float) -> tuple[TrueShock, ...]:
    """Return seven shocks about one that damps a wheel by `wheel` [N.s/m] at low speed."""
    low = some.one(wheel, 0.1) / ratio**2
    compression = (low, low * some.between(0.25, 0.45), some.between(0.05, 0.1))
    rebound = (low * some.between(1.1, 1.5), low * some.between(0.3, 0.5), some.between(0.06, 0.12))
    lag, fades = some.one(1.2e-3, 0.25), (some.one(1500.0, 0.2), some.one(4000.0, 0.2))
    return tuple(
        TrueShock(f"build{k}", times(compression, c), times(rebound, r), lag, fades) for k, (c, r) in enumerate(_BANK)
    )


def _car(some: _Draw, wheel: float = 3600.0, **given: Any) -> Car:
    """Return a front-engined touring car, in which given parameters are replaced."""
    ratio = some.four(0.85, 0.9, 0.06, 0.0)
    bank = _bank(some, wheel, float(np.mean(given.get("ratio", ratio))))
    front = some.between(1.15, 1.35)
    car = Car(
        name=f"{some.kind}_{some.seed}",
        kind=some.kind,
        body=(some.one(980.0, 0.08), some.one(1350.0, 0.1), some.one(430.0, 0.1)),
        engine=(200.0, 14.0, some.between(0.9, 1.1), 0.3, 9e5, 1500.0),
        axles=(front, 2.6 - front),
        track=(some.one(0.78, 0.03), some.one(0.77, 0.03)),
        hubs=some.four(42.0, 46.0, 0.08),
        bending=(some.one(160.0, 0.1), some.between(24.0, 32.0), 0.03),
        torsion=(some.one(120.0, 0.1), some.between(19.0, 28.0), 0.03),
        springs=some.four(70e3, 60e3, 0.12),
        ratio=ratio,
        rising=some.four(0.6, 0.5, 0.4),
        bumps=(some.between(0.03, 0.045), some.one(6e6, 0.3)),
        links=(0.0,) * 4,
        link_stiffness=some.one(4e6, 0.3),
        bushes=(0.0,) * 4,
        rubber=(some.one(6e5, 0.3), some.one(150.0, 0.3)),
        mounts=(0.0, 0.0),
        tires=some.four(255e3, 265e3, 0.08),
        tire_growth=some.one(8.0, 0.3),
        tire_damping=some.one(220.0, 0.25),
        bars=(some.one(18e3, 0.2), some.one(9e3, 0.2)),
        bar_friction=(some.one(20.0, 0.4), some.one(12.0, 0.4)),
        downforce=(some.one(700.0, 0.2), some.one(800.0, 0.2)),
        bank=bank,
        baseline=3,
        alternate=bank[3].scaled(0.55, "alternate"),
        sensors=Sensors(seed=some.seed),
    )
    return replace(car, **given)


def _friction(some: _Draw, factor: tuple[float, float]) -> Four:
    force = FRICTION * some.between(*factor)
    return some.four(force, force, 0.15, 0.1)


def _links(some: _Draw) -> Car:
    delays = {"force": 2e-4, "hub_acceleration": 3e-4, "chassis_acceleration": 3e-4}
    return _car(some, links=_friction(some, (1.0, 2.0)), sensors=Sensors(delays=delays, gain=0.002, seed=some.seed))


def _rubber(some: _Draw) -> Car:
    return _car(
        some,
        bushes=_friction(some, (1.0, 2.0)),
        links=_friction(some, (0.1, 0.3)),
        mounts=(some.one(2e6, 0.3), some.one(900.0, 0.3)),
        sensors=Sensors(delays={"displacement": 3e-4}, gain=0.004, seed=some.seed, units="us"),
    )


def _engine_mid(some: _Draw) -> Car:
    delays = {"force": 6e-4, "tire_force": 2e-4, "hub_acceleration": 6e-4, "chassis_acceleration": 6e-4}
    return _car(
        some,
        engine=(some.one(210.0, 0.1), 16.0, -some.between(0.5, 0.8), 0.35, some.one(7e5, 0.2), some.one(1600.0, 0.3)),
        axles=(1.5, 1.1),
        links=_friction(some, (0.5, 1.0)),
        bushes=_friction(some, (0.3, 0.7)),
        mounts=(some.one(3.5e6, 0.3), some.one(1200.0, 0.3)),
        sensors=Sensors(delays=delays, gain=0.008, seed=some.seed),
    )


def _engine_front(some: _Draw) -> Car:
    delays = {"force": 4e-4, "aero": 1e-3, "ride_height": 1e-3}
    return _car(
        some,
        engine=(some.one(270.0, 0.1), 22.0, some.between(1.0, 1.3), 0.35, some.one(5.5e5, 0.2), some.one(1200.0, 0.3)),
        links=_friction(some, (1.0, 2.0)),
        torsion=(some.one(140.0, 0.1), some.between(15.0, 20.0), 0.03),
        sensors=Sensors(delays=delays, gain=0.004, seed=some.seed, units="us"),
    )


def _light_winged(some: _Draw) -> Car:
    delays = {"hub_acceleration": 2e-4, "chassis_acceleration": 2e-4}
    return _car(
        some,
        wheel=4200.0,
        body=(some.one(430.0, 0.06), some.one(480.0, 0.08), some.one(95.0, 0.08)),
        engine=(150.0, 8.0, -0.75, 0.3, 2.5e7, 4000.0),
        axles=(1.55, 1.25),
        track=(0.76, 0.74),
        hubs=some.four(16.0, 18.0, 0.05),
        bending=(90.0, some.between(32.0, 40.0), 0.02),
        torsion=(35.0, some.between(26.0, 34.0), 0.02),
        springs=some.four(150e3, 140e3, 0.1),
        ratio=some.four(0.95, 1.0, 0.05, 0.0),
        rising=some.four(4.0, 3.5, 0.3),
        links=_friction(some, (0.6, 1.0)),
        tires=some.four(230e3, 250e3, 0.06),
        tire_growth=some.one(12.0, 0.3),
        bars=(some.one(60e3, 0.2), some.one(25e3, 0.2)),
        downforce=(some.one(1300.0, 0.1), some.one(1600.0, 0.1)),
        sensors=Sensors(delays=delays, gain=0.004, seed=some.seed),
    )


def _rough(some: _Draw) -> Car:
    return _car(
        some,
        links=_friction(some, (1.2, 1.8)),
        bushes=_friction(some, (0.8, 1.2)),
        bar_friction=(some.one(50.0, 0.3), some.one(40.0, 0.3)),
        mounts=(some.one(3e6, 0.3), some.one(1000.0, 0.3)),
        sensors=Sensors(delays={"force": 3e-4, "displacement": 3e-4}, gain=0.003, seed=some.seed, pot="whole"),
    )


#: links: stiff friction in the links; rubber: friction and shocks behind rubber; engine_mid, engine_front: engines on
#: soft mounts; light_winged: light, stiff, with downforce and rising motion ratios; rough: 2 to 3 times the friction.
KINDS: dict[str, Callable[[_Draw], Car]] = {
    kind.__name__[1:]: kind for kind in (_links, _rubber, _engine_mid, _engine_front, _light_winged, _rough)
}
