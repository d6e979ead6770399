"""The flexible car, and cars drawn at random around it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from eightpost.array_types import Array
from eightpost.rig.post.car import Geometry
from eightpost.rig.post.flexible.car import CurvedTires, Engine, FlexibleCar, Shell, Sliders, Suspension
from eightpost.units import convert

_GRAVITY = convert(1.0, "g_0", "m/s2")


class _Spread(NamedTuple):
    """Generator of factors around 1 with a log-normal distribution that is cut at two standard deviations."""

    generator: np.random.Generator | None

    def one(self, deviation: float) -> float:
        """Return a factor."""
        return float(self.many(1, deviation)[0])

    def many(self, count: int, deviation: float) -> Array:
        """Return independent factors (count,)."""
        if self.generator is None:
            return np.ones(count)
        return np.asarray(np.exp(deviation * np.clip(self.generator.standard_normal(count), -2.0, 2.0)))

    def corners(self, deviation: float, between_sides: float = 0.02) -> Array:
        """Return factors (4,): one per axle, times a small difference between the sides."""
        return np.repeat(self.many(2, deviation), 2) * self.many(4, between_sides)


def base_car() -> FlexibleCar:
    """Return the flexible car with its base parameters; all of them are our own choice."""
    return _car(_Spread(None), "flexible")


def flexible_truth(seed: int) -> FlexibleCar:
    """Return a car drawn around `base_car`: another seed is another car.

    Masses have standard deviations of 6 to 10 %, springs, bars and tires 8 to 20 %, natural frequencies 6 to 8 %,
    friction 30 %, curvatures of motion ratios and tires 40 %; left and right differ by 2 %, friction by 10 %.

    Args:
        seed: Seed of the random parameters. Seeds 0 to 99 are for tuning, seeds from 1000 are for reports.
    """
    return _car(_Spread(np.random.default_rng([8, seed])), f"flexible:{seed}")


def _car(spread: _Spread, name: str) -> FlexibleCar:
    axle, geometry, tracks = 0.02, _geometry(spread), (1.62 * spread.one(0.02), 1.58 * spread.one(0.02))
    shell = _shell(spread)
    engine = _engine(spread)
    wheels = np.array([43.0, 43.0, 48.0, 48.0]) * spread.corners(0.08, axle)
    sprung = _corner_loads(shell, engine, geometry) * spread.corners(0.0)
    return FlexibleCar(
        name=name,
        shell=shell,
        engine=engine,
        wheels=wheels,
        suspension=_suspension(spread),
        friction=_friction(spread),
        tires=_tires(spread, sprung + wheels * _GRAVITY),
        geometry=geometry,
        tracks=tracks,
    )


def _geometry(spread: _Spread) -> Geometry:
    front, rear = 1.38 * spread.one(0.03), 1.36 * spread.one(0.03)
    return Geometry(front, rear, front + 0.30, rear + 0.22, 1.05, 1.05, 0.95, 0.95)


def _shell(spread: _Spread) -> Shell:
    bending = (480.0 * spread.one(0.1), 23.0 * spread.one(0.06), 0.03 * spread.one(0.2))
    torsion = (260.0 * spread.one(0.1), 17.0 * spread.one(0.08), 0.03 * spread.one(0.2))
    mass = 930.0 * spread.one(0.06)
    return Shell(mass, 1.45 * mass * spread.one(0.06), 0.44 * mass * spread.one(0.06), bending, torsion, 1.37)


def _engine(spread: _Spread) -> Engine:
    mass = 225.0 * spread.one(0.08)
    natural = 2.0 * np.pi * 11.0 * spread.one(0.06)
    whole, share = mass * natural**2, 0.70 * spread.one(0.04)
    stiffness = (whole * share, whole * (1.0 - share))
    loss = 2.0 * 0.06 * spread.one(0.25) / natural
    damping = (stiffness[0] * loss, stiffness[1] * loss)
    return Engine(mass, 0.12 * mass * spread.one(0.08), 0.95, (0.20, -0.70), stiffness, damping)


def _corner_loads(shell: Shell, engine: Engine, geometry: Geometry) -> Array:
    """Return the static loads (4,) of the sprung mass [N]."""
    base = geometry.front_axle + geometry.rear_axle
    moment = engine.mass * engine.ahead
    whole = shell.mass + engine.mass
    front = (whole * geometry.rear_axle + moment) / base
    return np.repeat([0.5 * _GRAVITY * front, 0.5 * _GRAVITY * (whole - front)], 2)


def _suspension(spread: _Spread) -> Suspension:
    level = np.array([0.80, 0.80, 0.90, 0.90]) * spread.corners(0.05, 0.01)
    slope = np.array([1.2, 1.2, -0.9, -0.9]) * spread.corners(0.4)
    curve = np.array([8.0, 8.0, 6.0, 6.0]) * spread.corners(0.4)
    wheel_rate = np.array([195e3, 195e3, 125e3, 125e3]) * spread.corners(0.12)
    return Suspension(
        ratio=np.stack([level, slope, curve], axis=1),
        rate=wheel_rate / level**2,
        stop_gap=np.array([0.045, 0.045, 0.055, 0.055]),
        stop_rate=np.full(4, 4e7),
        damping=np.array([60.0, 60.0, 60.0, 60.0]) * spread.corners(0.3),
        bars=np.array([16e3, 6e3]) * spread.many(2, 0.2),
    )


def _friction(spread: _Spread) -> Sliders:
    sliding = np.concatenate(
        (np.array([48.0, 48.0, 60.0, 60.0]) * spread.corners(0.3, 0.1), np.array([32.0, 20.0]) * spread.many(2, 0.3))
    )
    reach = np.array([3e-5, 3e-5, 4e-5, 4e-5, 6e-5, 6e-5]) * spread.many(6, 0.3)
    return Sliders(sliding, 1.12 * sliding, sliding / reach)


def _tires(spread: _Spread, static_load: Array) -> CurvedTires:
    stiffness = np.array([310e3, 310e3, 330e3, 330e3]) * spread.corners(0.08, 0.015)
    share = np.tile([0.03, 0.03], 4) * np.repeat(spread.corners(0.3), 2)
    sliding = np.tile([12.0, 45.0], 4) * np.repeat(spread.corners(0.3), 2)
    return CurvedTires(
        static_load=static_load,
        stiffness=stiffness,
        stiffening=np.array([3.0, 3.0, 3.0, 3.0]) * stiffness * spread.corners(0.4),
        damping=np.array([250.0, 250.0, 250.0, 250.0]) * spread.corners(0.25),
        hysteresis=Sliders(sliding, sliding, np.repeat(stiffness, 2) * share),
    )
