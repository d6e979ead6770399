"""Tests of the bristle: exact steps, sticking, sliding, passivity, and its place in vehicle files."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from eightpost.errors import FileFormatError, ParameterError
from eightpost.vehicle import Bristle, Friction, IdentifiedVehicle, read_vehicle, shipped, write_vehicle
from eightpost.vehicle.compiled import deflections
from eightpost.vehicle.friction import deflection_after, sliding_deflection

LAW = Bristle(200.0, 1e-4, 1.2, 0.01)
LAWS = st.builds(Bristle, st.floats(1.0, 500.0), st.floats(1e-6, 1e-3), st.floats(1.0, 2.0), st.floats(1e-3, 0.1))
QUARTER = read_vehicle(shipped("quarter_car")).coupled()


@given(LAWS, st.floats(-1.0, 1.0), st.floats(-0.5, 0.5), st.floats(1e-6, 1e-2))
def test_a_step_at_a_constant_velocity_is_exact(law, share, v, h):
    z = share * law.reach * law.static_ratio
    limit = sliding_deflection(v, law.reach, law.static_ratio, law.stribeck_velocity)
    rate = solve_ivp(lambda _, y: v - abs(v) * y / limit, (0.0, h), [z], method="LSODA", rtol=1e-10, atol=1e-16)
    assert law.deflection_after(z, v, h) == pytest.approx(rate.y[0, -1], rel=1e-6, abs=1e-9 * law.reach)


@given(LAWS, st.floats(-1.0, 1.0), st.floats(-0.5, 0.5), st.floats(1e-6, 1e-3), st.floats(1e-6, 1e-3))
def test_two_steps_are_one_long_step(law, share, v, first, second):
    z = share * law.reach
    twice = law.deflection_after(law.deflection_after(z, v, first), v, second)
    assert twice == pytest.approx(law.deflection_after(z, v, first + second), rel=1e-12, abs=1e-15)


def test_a_port_at_rest_keeps_its_deflection_to_the_bit():
    for z in (0.0, 3.7e-5, -9.9e-5):
        assert LAW.deflection_after(z, 0.0, 1e-3) == z


def test_small_travel_meets_the_stiffness_and_long_travel_the_sliding_force():
    small = LAW.deflection_after(0.0, 1e-6, 1e-3)
    assert LAW.force_at(small) == pytest.approx(LAW.stiffness * 1e-9, rel=1e-4)
    assert LAW.force_at(LAW.deflection_after(0.0, 0.5, 1.0)) == pytest.approx(200.0, rel=1e-12)
    slow = LAW.force_at(LAW.deflection_after(0.0, -1e-5, 1e3))
    assert slow == pytest.approx(-240.0, rel=1e-5)  # below the Stribeck velocity: the static force


def test_with_the_ratio_one_a_cycle_dissipates_energy():
    law, time = Bristle(200.0, 1e-4), np.arange(0.0, 2.0, 1e-4)
    for amplitude in (1e-6, 1e-5, 1e-4, 1e-2):
        v = 2 * np.pi * amplitude * np.cos(2 * np.pi * time)
        force = law.force_at(deflections(v, 1e-4, law))
        cycle = slice(10000, 20000)
        assert np.sum(force[cycle] * v[cycle]) * 1e-4 > 0.0


def test_arrays_are_the_same_as_numbers_and_machine_code():
    v = np.random.default_rng(3).normal(size=400) * 0.02
    z = deflections(v, 4e-4, LAW)
    one, ports = 0.0, np.zeros(3)
    for k in range(1, v.size):
        mean = 0.5 * (v[k - 1] + v[k])
        one = LAW.deflection_after(one, mean, 4e-4)
        ports = deflection_after(ports, mean, 4e-4, LAW.reach * np.ones(3), LAW.static_ratio, LAW.stribeck_velocity)
        assert one == pytest.approx(z[k], abs=1e-18)
        np.testing.assert_array_equal(ports, one)


# ---- Vehicle files --------------------------------------------------------------------------------------------------


def car(law):
    return IdentifiedVehicle("car", QUARTER, {"": 1000.0}, friction={"": law})


def test_a_car_without_them_is_written_as_before(tmp_path):
    write_vehicle(tmp_path / "car.json", car(Friction(50.0, 0.01)))
    content = json.loads((tmp_path / "car.json").read_text())
    assert content["schema"] == 1
    assert content["friction"] == {"": {"force": 50.0, "velocity": 0.01}}


def test_the_mean_travel_of_a_spring_is_read_back_and_absent_without_one(tmp_path):
    for travel, schema in ((0.0213, 3), (0.0, 2)):
        law = Friction(spring=2e5, mean_travel=travel)
        write_vehicle(tmp_path / "car.json", car(law))
        content = json.loads((tmp_path / "car.json").read_text())
        assert content["schema"] == schema
        assert ("mean_travel" in content["friction"][""]) == (travel != 0.0)
        assert read_vehicle(tmp_path / "car.json").friction == {"": law}


def test_a_newer_schema_is_refused(tmp_path):
    write_vehicle(tmp_path / "car.json", car(Friction(bristle=LAW)))
    text = (tmp_path / "car.json").read_text().replace('"schema": 2', '"schema": 4')
    (tmp_path / "car.json").write_text(text)
    with pytest.raises(FileFormatError, match="schema"):
        read_vehicle(tmp_path / "car.json")


@pytest.mark.parametrize(
    ("law", "message"),
    [
        (Friction(bristle=Bristle(-1.0)), r"bristle.force is -1.0"),
        (Friction(bristle=Bristle(1.0, 0.0)), r"bristle.reach is 0.0"),
        (Friction(bristle=Bristle(1.0, 1e-4, 0.9)), r"bristle.static_ratio is 0.9; give a finite number \[at least 1"),
        (Friction(bristle=Bristle(1.0, 1e-4, 1.0, np.nan)), r"stribeck_velocity is nan"),
        (Friction(spring=np.inf), r"spring is inf"),
        (Friction(spring=1e5, mean_travel=np.nan), r"mean_travel is nan; give a finite number \[m"),
    ],
)
def test_values_out_of_range_are_refused_with_their_name(law, message):
    with pytest.raises(ParameterError, match=message):
        car(law)


def test_a_spring_needs_the_displacement_of_its_port():
    model = QUARTER.select(outputs=[n for n in QUARTER.output_names if n != "displacement"])
    with pytest.raises(ParameterError, match="no output displacement"):
        IdentifiedVehicle("car", model, friction={"": Friction(spring=1e5)})
