"""Simulations of an identified car with bristle and spring: compiled, port by port, and by the kernel of the FMU."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from eightpost.drivefile.iteration import _added_damping
from eightpost.errors import InputError
from eightpost.ident.vehicle.simulation import open_at_ports, simulate_with_shocks
from eightpost.shock.file import read_shock
from eightpost.signals import TimeSeries
from eightpost.vehicle import (
    Bristle,
    Friction,
    IdentifiedVehicle,
    LinearStepper,
    add_port_damping,
    discretise,
    read_vehicle,
    shipped,
)
from eightpost.vehicle.friction import PortFriction, advance, named_ports, output

RATE, BASELINE = 2000.0, 2500.0
BANK = Path(__file__).resolve().parents[2] / "examples" / "bank"
LAW = Friction(10.0, 0.01, Bristle(120.0, 1e-4, 1.15, 0.01), 2e5)


def car(law=LAW):
    model = add_port_damping(read_vehicle(shipped("quarter_car")).coupled(), {"": BASELINE})
    return IdentifiedVehicle("car", model, {"": BASELINE}, friction={"": law})


def drive(seconds=2.0):
    time = np.arange(0.0, seconds, 1.0 / RATE)
    rng, road = np.random.default_rng(5), np.zeros_like(time)
    for frequency in np.arange(0.5, 20.0, 0.25):
        road += 0.006 / frequency**1.2 * rng.normal() * np.sin(2 * np.pi * frequency * time + rng.uniform(0.0, 6.28))
    road = (road - road[0]) * np.minimum(time, 1.0)
    return TimeSeries.from_channels(time, {"road": ("m", road - road.mean())})


def by_the_fmus_kernel(vehicle, series):
    """Return outputs with linear dampers of the baseline rate, which are a part of the identified model."""
    model = vehicle.state_space
    stepper = LinearStepper(model.A, model.B, model.C, model.D)
    ports = named_ports(stepper, (model.input_names, model.output_names), ("",), ("",))
    law = vehicle.friction[""]
    values = {"friction_force": law.force, "friction_velocity": law.velocity, "port_spring": law.spring}
    values |= {"bristle_force": law.bristle.force, "bristle_reach": law.bristle.reach,
               "bristle_static_ratio": law.bristle.static_ratio,
               "bristle_stribeck_velocity": law.bristle.stribeck_velocity}  # fmt: skip
    friction = PortFriction.of_values(ports, ("",), values)
    u = np.zeros((len(series), len(model.inputs)))
    u[:, model.input_names.index("road")] = series["road"]
    x, rows = np.zeros(len(model.A) + 1), []
    for k in range(len(u)):
        x = advance(stepper, friction, x, u[k - 1], u[k], 1.0 / RATE) if k else x
        rows.append(output(stepper, friction, x, u[k]))
    return np.array(rows).T


def difference(found, expected):
    return np.sqrt(np.mean((found - expected) ** 2, axis=1)) / expected.std(axis=1)


@pytest.mark.nightly
def test_measured_forces_with_the_laws_of_the_ports_give_back_the_motion():
    """The record's force is that of the linear damper; friction and spring come from velocity and displacement."""
    vehicle, series = car(), drive()
    names = vehicle.state_space.output_names
    motion = by_the_fmus_kernel(vehicle, series)
    rows = {name: ("1", row) for name, row in zip(names, motion, strict=True)}
    velocity, displacement = (rows[name][1] for name in ("velocity", "displacement"))
    channels = {"road": ("m", series["road"]), "velocity": ("m/s", velocity), "displacement": ("m", displacement)}
    record = TimeSeries.from_channels(series.time, channels | {"force": ("N", BASELINE * velocity)})
    found = open_at_ports(vehicle, record)
    wrong = open_at_ports(car(Friction(130.0, 0.01)), record)
    place = names.index("velocity")
    errors = [difference(one.select(names).values, motion)[place] for one in (found, wrong)]
    assert errors[0] < 0.01 < 3.0 * errors[1]


def test_the_damping_of_a_bristle_is_its_energy_over_that_of_the_velocity():
    vehicle, time = car(Friction(bristle=Bristle(120.0, 1e-5))), np.arange(0.0, 10.0, 1.0 / RATE)
    velocity = 0.2 * np.sin(2 * np.pi * 3.0 * time)
    found = _added_damping(vehicle, "", None, (velocity, RATE))
    assert found == pytest.approx(4.0 / np.pi * 120.0 / 0.2, rel=0.01)


def test_a_discrete_car_has_the_shock_forces_of_the_sample_before():
    """With steps of 0.2 ms its outputs are those of the continuous car."""
    smooth = car(Friction(40.0, 0.05))
    fine = drive(0.1).resample(5000.0)
    laws = {"": read_shock(BANK / "C_B.json").law}
    known = simulate_with_shocks(smooth, laws, fine)
    discrete = replace(smooth, state_space=discretise(smooth.state_space, 1.0 / 5000.0))
    found = simulate_with_shocks(discrete, laws, fine)
    for name in ("velocity", "tire_force", "force"):
        np.testing.assert_allclose(found[name], known[name], atol=0.02 * np.abs(known[name]).max(), err_msg=name)
    with pytest.raises(InputError, match=r"the step of .* is 0\.0002 s, that of the drive 0\.0005 s"):
        simulate_with_shocks(discrete, laws, drive(0.1))
