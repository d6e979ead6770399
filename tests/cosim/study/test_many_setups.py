"""Setups that are simulated together respond as FMUs coupled by the master do."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from builder.build import build
from cosim import Bond, FmuComponent, Scenario, System, run
from cosim.study import Build, Drive, Measure, Study, Vehicle
from cosim.study.running import workers
from cosim.study.running.evaluator import Coupling
from eightpost.corners import CORNERS
from eightpost.ident.vehicle.many_setups import ManySetups
from eightpost.shock import LAWS, Shock
from eightpost.signals import Drivefile, TimeSeries
from eightpost.signals.formats import write_series
from eightpost.vehicle import (
    Bristle,
    Friction,
    IdentifiedVehicle,
    add_port_damping,
    read_vehicle,
    shipped,
    write_vehicle,
)

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


@pytest.mark.nightly
def test_setups_of_a_car_with_bristle_and_port_spring_respond_as_its_fmu(
    shocks: dict[str, Shock], fmus: dict[str, Path], tmp_path: Path
) -> None:
    law = {"": Friction(20.0, 0.01, Bristle(120.0, 1e-4, 1.15, 0.01), 2e5)}
    open_car = read_vehicle(shipped("quarter_car")).coupled()
    model = add_port_damping(open_car, {"": BASELINE})
    drive = TimeSeries.from_channels(TIME, {"road": ("m", ROAD)})
    shock = replace(shocks["lpnl2"].law, port=replace(shocks["lpnl2"].law.port, **PORT))
    found = ManySetups(IdentifiedVehicle("car", model, {"": BASELINE}, friction=law), [shock], drive).run([[0]])[0]
    without = ManySetups(IdentifiedVehicle("car", model, {"": BASELINE}), [shock], drive).run([[0]])[0]
    write_vehicle(tmp_path / "car.json", IdentifiedVehicle("car", open_car, friction=law))
    fmu = build([tmp_path / "car.json"], tmp_path)[0].path
    expected = coupled(fmu, fmus["lpnl2"], drive)
    for channel in OUTPUTS:
        row = model.output_names.index(channel)
        wanted = expected[f"car.{channel}"]
        error, effect = (np.std(one[row] - wanted) / wanted.std() for one in (found, without))
        assert error < 2e-4, (channel, error)
        assert effect > 1e-2, (channel, effect)
        assert found[row].std() == pytest.approx(wanted.std(), rel=1e-3)


@pytest.mark.nightly
def test_a_study_of_a_car_with_bristles_and_port_springs_has_the_measures_of_its_setups(
    shocks: dict[str, Shock], fmus: dict[str, Path], tmp_path: Path
) -> None:
    law = dict.fromkeys(CORNERS, Friction(20.0, 0.01, Bristle(120.0, 1e-4, 1.15, 0.01), 2e5))
    open_car = read_vehicle(shipped("seven_dof")).coupled()
    baseline = dict.fromkeys(CORNERS, BASELINE)
    roads = {f"{corner}.road": ("m", k * ROAD) for corner, k in zip(CORNERS, (1.0, 0.8, 0.5, -0.3), strict=True)}
    drive = TimeSeries.from_channels(TIME, roads)
    write_series(drive, tmp_path / "road.parquet")
    write_vehicle(tmp_path / "car.json", IdentifiedVehicle("car", open_car, friction=law))
    fmu = build([tmp_path / "car.json"], tmp_path)[0].path
    study = Study(
        name="bristles",
        vehicle=Vehicle(fmu, inputs=dict.fromkeys(("heave_force", "roll_moment", "pitch_moment"), 0.0)),
        bank={"one": Build(fmus["lpnl2"], PORT), "two": Build(fmus["lpnl2"], PORT | {"rebound_scale": 2.0})},
        corners=dict.fromkeys(CORNERS, ("one", "two")),
        drives=(Drive("road", tmp_path / "road.parquet", float(TIME[-1])),),
        measures=tuple(Measure(name, (f"car.{name}",), "rms") for name in MEASURED),
        settling=0.1,
        record_step=1.0 / RATE,
    )
    model = add_port_damping(open_car, baseline)
    bank = [replace(shocks["lpnl2"].law, port=replace(shocks["lpnl2"].law.port, **PORT | own))
            for own in ({}, {"rebound_scale": 2.0})]  # fmt: skip
    chosen = [0, len(study.space) - 1]
    rows = workers.rows(study.to_json(), Coupling("gauss-seidel", 0.25 / RATE), chosen)
    setups = [[study.space.setup(k).builds[corner] == "two" for corner in CORNERS] for k in chosen]
    every = ManySetups(IdentifiedVehicle("car", model, baseline, friction=law), bank, drive).run(setups)
    without = ManySetups(IdentifiedVehicle("car", model, baseline), bank, drive).run(setups)
    for found, outputs, smooth in zip(rows, every, without, strict=True):
        for name in MEASURED:
            place = model.output_names.index(name)
            wanted, other = (np.std(y[place, 200:]) for y in (outputs, smooth))
            assert found[name] == pytest.approx(wanted, rel=2e-4)
            assert found[name] != pytest.approx(other, rel=1e-2)
