"""Conversion of cars, shocks and drives to arrays for the compiled integration, and runs on all cores."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from eightpost.errors import StepError
from eightpost.processors import usable_processors
from eightpost.rig.damper import PhysicalDamper
from eightpost.rig.post.drive import RATE
from eightpost.rig.post.kernel import (
    FLUID,
    LAGGED,
    LINEAR,
    NUMBERS,
    PHYSICAL,
    STATES,
    STATIC,
    WEIGHTED,
    CarNumbers,
    Inputs,
    ShockNumbers,
    march,
)
from eightpost.rig.post.shocks import TABLE_SPACING, LinearDamper, static_table
from eightpost.rig.truth_damper import TruthDamper
from eightpost.shock.lpf1 import Lpf1
from eightpost.shock.lpnl2 import Lpnl2
from eightpost.shock.polylinear import Polylinear

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from eightpost.rig.damper.restriction import Passage
    from eightpost.rig.post.car import Car
    from eightpost.rig.post.drive import Drives
    from eightpost.rig.post.shocks import Shock
    from eightpost.rig.truth_damper import ValveSide

    Array = NDArray[np.float64]


def can_compile(shocks: Sequence[Sequence[Shock]]) -> bool:
    """Return whether the compiled integration supports all shocks; other laws are called from Python."""
    known = (LinearDamper, Polylinear, Lpf1, Lpnl2, TruthDamper, PhysicalDamper)
    return all(isinstance(shock, known) for corners in shocks for shock in corners)


def compiled_march(car: Car, shocks: Sequence[Sequence[Shock]], drives: Drives) -> list[Array]:
    """Return the records (N, 3 D + 3 C) of each run, like `reference_march`, using all cores in parallel."""
    own = {id(shock): shock for corners in shocks for shock in corners}
    places = {key: k for k, key in enumerate(own)}
    numbers, bank = _car_numbers(car), _shock_numbers(tuple(own.values()))

    def run_records(run: int) -> Array:
        which = np.array([places[id(shock)] for shock in shocks[run]])
        values, slopes = drives.values[run], drives.slopes[run]
        records = np.empty((len(values), 3 * car.mass.size + 3 * len(car.corners)))
        inputs = Inputs(values, slopes, drives.lead, drives.growth, drives.weights, RATE)
        failed = march(numbers, which, bank, inputs, records)
        if failed >= -drives.lead:
            raise StepError(divergence_message(car, failed))
        return records

    with ThreadPoolExecutor(usable_processors()) as pool:
        return list(pool.map(run_records, range(len(shocks))))


def divergence_message(car: Car, sample: int) -> str:
    """Return the message for a motion that is no longer finite at a sample."""
    return f"the motion of the {car.name} diverged near {sample / RATE:.2f} s; check its shocks and its drive"


def _car_numbers(car: Car) -> CarNumbers:
    inverse = (1.0 / car.mass)[:, None]
    springs, tires, friction = car.springs, car.tires, car.friction
    stribeck = np.full_like(friction.coulomb, friction.stribeck_velocity)
    return CarNumbers(
        np.vstack([car.shock, car.wheel, car.spring]).astype(np.float64),
        np.ascontiguousarray(inverse * np.hstack([-car.shock.T, car.wheel.T, -car.spring.T, car.load.T])),
        np.ascontiguousarray(-inverse * car.stiffness),
        np.ascontiguousarray(-inverse * car.damping),
        np.hstack([springs.rate, springs.progression, springs.stop_gap, springs.stop_rate]),
        np.hstack([tires.stiffness, tires.damping, tires.static_load]),
        np.hstack([friction.coulomb, friction.breakaway, friction.stiffness, stribeck]),
    )


def _shock_numbers(shocks: tuple[Shock, ...]) -> ShockNumbers:
    kinds, numbers, starts, tables = [], np.zeros((len(shocks), NUMBERS)), np.zeros((len(shocks), STATES)), []
    for k, shock in enumerate(shocks):
        kind, row = _numbers_of(shock)
        kinds.append(kind)
        numbers[k, : len(row)] = row
        if isinstance(shock, PhysicalDamper):
            starts[k, :3] = shock._rest(0.0)
        tabulated = isinstance(shock, Polylinear | Lpf1 | Lpnl2)
        tables.append(static_table(shock)[1] if tabulated else None)
    longest = max((table.size for table in tables if table is not None), default=2)
    padded = np.stack([np.zeros(longest) if table is None else table for table in tables])
    return ShockNumbers(np.array(kinds), numbers, starts, padded, TABLE_SPACING)


def _numbers_of(shock: Shock) -> tuple[int, list[float]]:
    """Return a shock's type and its row of numbers, in the order documented in the kernel."""
    if isinstance(shock, LinearDamper):
        return LINEAR, [shock.damping]
    if isinstance(shock, TruthDamper):
        return FLUID, _fluid_numbers(shock)
    if isinstance(shock, PhysicalDamper):
        return PHYSICAL, list(_physical_numbers(shock))
    if isinstance(shock, Lpf1):
        return LAGGED, [*_port_numbers(shock), shock.time_constant]
    if isinstance(shock, Lpnl2):
        return WEIGHTED, [*_port_numbers(shock), shock.time_constant, shock.lag_full_force, shock.lag_zero_force]
    assert isinstance(shock, Polylinear)
    return STATIC, _port_numbers(shock)


def _port_numbers(law: Polylinear | Lpf1 | Lpnl2) -> list[float]:
    port = law.port
    return [port.motion_ratio, port.seal_friction, port.friction_velocity, port.gas_preload, port.gas_stiffness]


def _fluid_numbers(damper: TruthDamper) -> list[float]:
    own = [damper.fluid_stiffness, damper.stiffening_force, damper.gas_stiffness, damper.gas_preload]
    return [*own, damper.seal_drag, damper.seal_velocity, *_side(damper.compression), *_side(damper.rebound)]


def _side(side: ValveSide) -> list[float]:
    return [side.bleed_linear, side.bleed_square, side.opening_force, side.opening_width, side.open_damping]


@lru_cache(maxsize=64)
def _physical_numbers(damper: PhysicalDamper) -> tuple[float, ...]:
    fluid, cylinder, gas, plant = damper.fluid, damper.cylinder, damper.gas, damper.plant
    oil = (fluid.vapour_pressure, fluid.span, fluid.gas_exponent, fluid.gas_fraction)
    give = (1.0 / fluid.bulk_modulus, 1.0 / fluid.wall_modulus)
    room = (cylinder.compression_area, cylinder.rebound_area, cylinder.compression_length, cylinder.rebound_length)
    passages = [_passage(p) for valve in (plant.main, plant.head) for p in (valve.forward, valve.backward)]
    flows = tuple(number for passage in passages for number in passage)
    own = (gas.charge, gas.exponent, 1.0 / gas.volume)
    return (*oil, *give, *room, *own, *flows, plant.force(0.0, 0.0), damper.seals.drag, damper.seals.length)


def _passage(passage: Passage) -> tuple[float, ...]:
    return (passage.orifice, passage.transition, passage.opening, passage.port, passage.preload)
