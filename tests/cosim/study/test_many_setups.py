"""Setups that are simulated together respond as FMUs coupled by the master do."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cosim import Bond, FmuComponent, Scenario, System, run
from eightpost.ident.vehicle.simulation import ManySetups
from eightpost.shock import LAWS, Shock
from eightpost.signals import Drivefile, TimeSeries
from eightpost.vehicle import IdentifiedVehicle, add_port_damping, read_vehicle, shipped

RATE, BASELINE = 2000.0, 3000.0
TIME = np.arange(2001) / RATE

#: Road [m], odd about the middle: setups are simulated without the mean of the drive.
MIDDLE = TIME - TIME[-1] / 2.0
WAVES = 0.015 * np.sin(2.0 * np.pi * 1.7 * MIDDLE) + 0.002 * np.sin(2.0 * np.pi * 11.0 * MIDDLE)
ROAD = WAVES * np.minimum((TIME[-1] / 2.0 - np.abs(MIDDLE)) / 0.2, 1.0)
MEASURED = ("lf.velocity", "rr.displacement", "lr.tire_force")
OUTPUTS = ("velocity", "displacement", "tire_force")

#: Parameters of the port that both paths have: setups are simulated about rest, where the gas preload has no effect.
PORT = {"gas_preload": 0.0, "seal_friction": 0.0, "gas_stiffness": 700.0, "rebound_scale": 1.3}


def coupled(car: Path, shock: Path, drive: TimeSeries) -> TimeSeries:
    """Return the outputs of the car with the shock FMU, which the master steps four times per sample."""
    components = {"car": FmuComponent(car, "car"), "shock": FmuComponent(shock, "shock")}
    bonds = [Bond.between("car", "shock")]
    system = System(components, bonds, constants={"car.aero_force": 0.0}, parameters={"shock": PORT})
    scenario = Scenario(float(TIME[-1]), Drivefile(drive), {"road": "car.road"}, record_step=1.0 / RATE)
    return run(system, scenario, step=0.25 / RATE, compared=False).series


def test_each_setup_of_a_bank_of_all_laws_responds_as_its_fmus(shocks: dict[str, Shock], fmus: dict[str, Path]) -> None:
    model = add_port_damping(read_vehicle(shipped("quarter_car")).coupled(), {"": BASELINE})
    drive = TimeSeries.from_channels(TIME, {"road": ("m", ROAD)})
    bank = [replace(shocks[name].law, port=replace(shocks[name].law.port, **PORT)) for name in LAWS]
    setups = ManySetups(IdentifiedVehicle("car", model, {"": BASELINE}), bank, drive).run(
        [[k] for k in range(len(bank))]
    )
    for outputs, name in zip(setups, LAWS, strict=True):
        expected = coupled(fmus["quarter_car"], fmus[name], drive)
        for channel in OUTPUTS:
            found, wanted = outputs[model.output_names.index(channel)], expected[f"car.{channel}"]
            assert np.std(found - wanted) < 2e-4 * wanted.std(), (name, channel)
            assert found.std() == pytest.approx(wanted.std(), rel=2e-4)
