"""What a batch gives with every law, friction and statistic, kept number by number."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields
from typing import Any

import numpy as np
import pytest
import scipy.signal

from cosim.study.measures import Sections
from eightpost.errors import FmuError
from eightpost.machine import Batch, Drive, LinearCar, Port, Quantity, Run, ShockData, Vehicle
from eightpost.machine.car import built
from eightpost.machine.run import SIGNALS, Limit
from eightpost.shock import LAWS, law_name

A = np.array([[0.0, 1.0], [-400.0, -1.0]])
B = np.array([[0.0, 1.0], [-0.02, 0.0]])
C = np.array([[0.0, 1.0], [1.0, 0.0], [-400.0, -1.0]])
D = np.array([[0.0, 1.0], [0.0, 0.0], [-0.02, 0.0]])
TIME = np.arange(501) / 500.0
#: Drive between whose points the steps end, or not.
POINTS = np.union1d(TIME, [0.0013, 0.4505, 0.4511])
INPUTS = np.stack([np.full(POINTS.size, 30.0), 3.0 * np.sin(2.0 * np.pi * 3.0 * POINTS) * POINTS], axis=1)

OUTPUTS = {"velocity": (-1, 0), "travel": (-1, 1), "acceleration": (-1, 2)}
CHANNELS = OUTPUTS | {name: (0, place) for place, name in enumerate(SIGNALS)}
QUANTITIES = (
    Quantity(("travel", "acceleration"), (2.0, 1e-3), (3, 90), limits=True, inside=(-1e-3, 2e-3)),
    Quantity(("velocity", "force"), (1.0, 0.5), (10, 101), product=True),
    Quantity(("static_force",), (-1.0,), (0, 50), limits=True, inside=(1e-3, 100.0)),
)

FRICTION: Mapping[str, tuple[float, ...]] = {
    "none": (0.0, 1.0, 0.0, 1.0, 1.0, 1.0, 0.0),
    "creeps": (20.0, 0.004, 0.0, 1.0, 1.0, 1.0, 0.0),
    "sticks": (0.0, 1.0, 30.0, 2e-4, 1.4, 0.02, 0.0),
    "spring": (5.0, 0.01, 10.0, 1e-4, 1.0, 1.0, -900.0),
}

CHANGES: dict[str, dict[str, float]] = {
    "plain": {}, "geared": {"motion_ratio": 1.3, "rebound_scale": 0.6, "compression_scale": 1.7,
               "curve.compression_speed": 0.1, "curve.rebound_speed": 0.15},
    "gas": {"gas_stiffness": 900.0, "gas_preload": 25.0, "seal_friction": 12.0, "friction_velocity": 0.003},
}  # fmt: skip

#: Places of the parameters that the tests change.
PLACES = {
    "motion_ratio": 0, "compression_scale": 1, "rebound_scale": 2, "gas_stiffness": 3, "gas_preload": 4,
    "seal_friction": 5, "friction_velocity": 6, "curve.compression_speed": 9, "curve.rebound_speed": 10,
}  # fmt: skip


def shock_of(shock: Any, changes: Mapping[str, float]) -> ShockData:
    found = ShockData.of_law(law_name(type(shock.law)), shock.law)
    parameters = found.parameters.copy()
    for name, value in changes.items():
        parameters[PLACES[name]] = value
    return ShockData(found.law, parameters)


def ran(
    shock: ShockData, port: Port, *, at_rest: bool = False, settling: int = 7, single: bool = False
) -> dict[str, Any]:
    vehicle = Vehicle(A, B, C, D, np.array([0.0, 0.0, 3.0]), at_rest)
    car = LinearCar.of(vehicle, [port], np.array([shock.mean_slope(0.2)]))
    run = Run(car, Drive(TIME, 5, POINTS, INPUTS), CHANNELS, quantities=QUANTITIES, settling=settling,
              limits=[Limit(1.0, 0.002, 1), Limit(-1.0, 5.0, 2)], series=tuple(CHANNELS), single=single)  # fmt: skip
    batch = Batch(run)
    found = batch.run([[shock]])
    result = {field.name: np.array(getattr(found, field.name))[..., 0] for field in fields(found)}
    values, statistics = result.pop("values"), result.pop("statistics")
    result |= {f"quantity {k}": row for k, row in enumerate(statistics)}
    result |= {f"channel {name}": values[:, k] for k, name in enumerate(CHANNELS)}
    for order in (1, 5):
        rows = scipy.signal.butter(order, 8.0, fs=100.0, output="sos")
        sections = Sections(rows, scipy.signal.sosfilt_zi(rows))
        filtered = batch.filtered("force", sections)
        result[f"filtered {order}"] = filtered[:, 0].copy()
        result[f"statistics {order}"] = batch.statistics_of(QUANTITIES[2], [filtered])[:, 0]
    return result


@pytest.mark.parametrize("name", LAWS)
def test_a_batch_of_each_law_is_unchanged(name: str, shocks: Any, unchanged: Callable[..., None]) -> None:
    if name == "maxwell":
        pytest.skip("the machine does not have the law")
    for change, values in CHANGES.items():
        found = ran(shock_of(shocks[name], values), Port(0, 0, 1), at_rest=change == "gas")
        unchanged(found, change, relative=1e-6)


@pytest.mark.parametrize("kind", [kind for kind in FRICTION if kind != "none"])
def test_a_batch_with_friction_is_unchanged(kind: str, shocks: Any, unchanged: Callable[..., None]) -> None:
    found = ran(shock_of(shocks["lpnl2"], {}), Port(0, 0, 1, FRICTION[kind]))
    unchanged({name: found[name] for name in ("channel travel", "channel velocity", "channel force", "transferred")},
              relative=1e-6)  # fmt: skip


def test_the_data_of_a_car_are_unchanged(unchanged: Callable[..., None]) -> None:
    """A car with a real mode."""
    slow = np.pad(A, (0, 1))
    slow[2, 2] = -25.0
    matrices = [slow, np.vstack([B, [0.3, -0.2]]), np.column_stack([C, [0.01, 0.0, 0.4]]), D]
    car = LinearCar.of(Vehicle(*matrices, np.zeros(3), True), [Port(0, 1, 1, FRICTION["sticks"])], np.array([60.0]))
    order = np.lexsort((car.poles.imag, car.poles.real))
    size = car.into[order] * np.abs(car.out.T[order]).sum(axis=1)[:, None]
    unchanged({"poles": car.poles[order].view(float), "size": np.abs(size),
               "gain": np.real(car.out @ (car.into / -car.poles[:, None])), "A": car.vehicle.A, "B": car.vehicle.B,
               "C": car.vehicle.C, "D": car.vehicle.D,
               "moved": car.data(2e-3)[-12:]})  # fmt: skip


@pytest.mark.parametrize("name", ["polylinear", "lpnl2"])
def test_the_mean_slope_of_a_shock_is_unchanged(name: str, shocks: Any, unchanged: Callable[..., None]) -> None:
    unchanged({change: [shock_of(shocks[name], values).mean_slope(v) for v in (0.02, 0.2, 2.0)]
               for change, values in CHANGES.items()})  # fmt: skip


def test_the_first_error_of_a_compiler_is_stated() -> None:
    with pytest.raises(FmuError, match=r"the machine does not compile with .*: bad\.c:1:\d+: (fatal )?error"):
        built({"bad.c": b"int x = ;\nint y = ;\n"})
