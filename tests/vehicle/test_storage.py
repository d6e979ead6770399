"""Tests of vehicle files: they are read back bitwise equal, and errors are reported with their place."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from eightpost.errors import FileFormatError, ParameterError
from eightpost.vehicle import (
    Channel,
    Corners,
    IdentifiedVehicle,
    QuarterCar,
    SevenDof,
    StateSpace,
    StructuralVehicle,
    read_vehicle,
    shipped,
    write_vehicle,
)
from tests.unchanged import refusals

ROUND_TRIP = settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
POSITIVE = st.floats(1e-6, 1e9)
TEXT = st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=12)
CORNERS_OF = st.builds(Corners, POSITIVE, POSITIVE, POSITIVE, POSITIVE)
STATIC = {
    QuarterCar: ("tire_force", "ride_height"),
    SevenDof: (*(f"{c}.tire_force" for c in Corners._fields), "front.ride_height", "rear.ride_height"),
}


@st.composite
def structural(draw):
    kind = draw(st.sampled_from([QuarterCar, SevenDof]))
    values = {field.name: draw(CORNERS_OF if field.type == "Corners" else POSITIVE) for field in fields(kind)}
    if kind is SevenDof and draw(st.booleans()):
        values |= {"driver_ahead_of_cg": None, "driver_left_of_centreline": None}
    static = {name: draw(st.floats(-1e6, 1e6)) for name in STATIC[kind]} if draw(st.booleans()) else {}
    return StructuralVehicle(draw(TEXT), kind(**values), static)


@st.composite
def identified(draw):
    n = draw(st.integers(0, 5))
    number = st.floats(-1e12, 1e12)
    A, B, C, D = (
        np.array(draw(st.lists(number, min_size=rows * columns, max_size=rows * columns))).reshape(rows, columns)
        for rows, columns in ((n, n), (n, 2), (2, n), (2, 2))
    )
    inputs = Channel("lf.force", "N"), Channel("lf.road", "m")
    outputs = Channel("lf.velocity", "m/s"), Channel("lf.tire_force", "N")
    dt = draw(st.none() | st.floats(1e-5, 1.0))
    return IdentifiedVehicle(
        draw(TEXT),
        StateSpace(A, B, C, D, inputs, outputs, dt, draw(TEXT)),
        {"lf": draw(POSITIVE)},
        {"lf.tire_force": draw(number)},
        {"test.csv": "0" * 64},
    )


@pytest.mark.parametrize("kind", ["quarter_car", "seven_dof"])
@pytest.mark.parametrize("has_static", [True, False])
def test_a_shipped_car_with_any_name_is_read_back_equal(tmp_path, kind, has_static):
    car = replace(read_vehicle(shipped(kind)), name='back\\slash, "quotes",\nnew line and \x7f')
    static = {name: 0.1 * k for k, name in enumerate(STATIC[type(car.parameters)], 1)} if has_static else {}
    car = replace(car, static=static)
    write_vehicle(tmp_path / "car.toml", car)
    assert read_vehicle(tmp_path / "car.toml") == car


@pytest.mark.nightly
@ROUND_TRIP
@given(vehicle=identified())
def test_an_identified_model_that_is_read_back_is_equal(tmp_path, vehicle):
    write_vehicle(tmp_path / "car.json", vehicle)
    assert read_vehicle(tmp_path / "car.json") == vehicle


def test_each_kind_has_its_own_file(tmp_path):
    vehicle = read_vehicle(shipped("quarter_car"))
    with pytest.raises(FileFormatError, match=r"written as \.toml"):
        write_vehicle(tmp_path / "car.json", vehicle)
    with pytest.raises(FileFormatError, match=r"\.toml file \(parameters\)"):
        read_vehicle(tmp_path / "car.yaml")
    assert not list(tmp_path.iterdir())


def test_values_may_be_given_for_all_corners_per_axle_or_per_corner(tmp_path):
    text = shipped("seven_dof").read_text(encoding="utf-8")
    text = text.replace(
        'tire_stiffness = "2000 lbf/in"', 'tire_stiffness = { lf = "2000 lbf/in", rf = "351 N/mm", rear = "2 klbf/in" }'
    )
    text = text.replace('sprung_mass = "2550 lbm"', 'sprung_weight = "2550 lb"')
    text += '[static]\ntire_force = { front = "800 lbf", lr = "700 lbf", rr = "3200 N" }\nride_height = "4 in"\n'
    (tmp_path / "car.toml").write_text(text, encoding="utf-8")
    car = read_vehicle(tmp_path / "car.toml")
    tires = car.parameters.tire_stiffness
    assert tires.rf == pytest.approx(351e3)
    assert tires.lf == tires.lr == tires.rr == pytest.approx(2000 * 175.126835)
    assert car.parameters.sprung_mass == pytest.approx(2550 * 0.45359237)
    assert car.static["rr.tire_force"] == 3200.0
    assert car.static["rear.ride_height"] == pytest.approx(4 * 0.0254)


#: Faults of the shipped quarter car: text and its replacement.
WRONG = {
    "misspelled parameter": ("tire_stiffness", "tyre_stiffness"),
    "missing parameter": ('tire_stiffness = "1300 lbf/in"', ""),
    "missing mass": ('sprung_weight = "675 lbf"\n', "\n"),
    "mass twice": ('unsprung_weight = "75 lbf"', 'unsprung_weight = "75 lbf"\nunsprung_mass = "3 kg"'),
    "no unit": ('"1280 lbf/in"', '"1280"'),
    "bare number": ('"1280 lbf/in"', "1280"),
    "unknown unit": ('"1280 lbf/in"', '"1280 lbf/inchworm"'),
    "wrong dimension": ('"1280 lbf/in"', '"1280 lbf"'),
    "mass under a weight": ('"675 lbf"', '"675 lbm"'),
    "no mass": ('"675 lbf"', '"0 lbf"'),
    "negative": ('"1300 lbf/in"', '"-1300 lbf/in"'),
    "infinite": ('"1300 lbf/in"', '"1e999 lbf/in"'),
    "a corner of a quarter car": ('"1300 lbf/in"', '{ lf = "1300 lbf/in" }'),
    "no TOML": ("[parameters]", "[parameters"),
    "newer layout": ("schema = 1", "schema = 2"),
    "another model": ('"quarter_car"', '"half_car"'),
    "no model": ('model = "quarter_car"', ""),
    "a list of models": ('"quarter_car"', '["quarter_car"]'),
    "a number as a name": ("name = ", "name = 3 # "),
    "unknown key": ("[parameters]", "color = 1\n[parameters]"),
    "no table": ("[parameters]", "static = 3\n[parameters]"),
    "no parameters": ("[parameters]", ""),
    "static of nothing": ("[parameters]", "[static]\nx = 3\n[parameters]"),
}
#: Wrong spring rates of the shipped seven-DOF car.
CORNERS = (
    '{ front = "1 N/m" }',
    '{ front = "1 N/m", lf = "1 N/m", rear = "1 N/m" }',
    '{ left = "1 N/m" }',
    '{ front = "1 N/m", rear = "-1 N/m" }',
    '{ front = "1 N/m", rear = "1 N" }',
    '["1 N/m"]',
)


def test_a_wrong_file_is_rejected_with_line_and_key(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, unchanged: Callable[..., None]
) -> None:
    monkeypatch.chdir(tmp_path)

    def read(model: Literal["quarter_car", "seven_dof"], before: str, after: str) -> object:
        text = shipped(model).read_text(encoding="utf-8")
        assert before in text
        Path("wrong.toml").write_text(text.replace(before, after), encoding="utf-8")
        return read_vehicle("wrong.toml")

    rates = '{ front = "1280 lbf/in", rear = "588 lbf/in" }'
    quarter = {name: partial(read, "quarter_car", *texts) for name, texts in WRONG.items()}
    unchanged(refusals(quarter | {rate: partial(read, "seven_dof", rates, rate) for rate in CORNERS}))


def json_vehicle(tmp_path, **changes):
    vehicle = IdentifiedVehicle("found", read_vehicle(shipped("quarter_car")).with_damper())
    path = tmp_path / "car.json"
    write_vehicle(path, vehicle)
    content = json.loads(path.read_text(encoding="utf-8")) | changes
    path.write_text(json.dumps({key: value for key, value in content.items() if value != "gone"}), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"schema": 9}, FileFormatError, "update eightpost"),
        ({"A": "gone"}, FileFormatError, "A: is missing; eightpost identify makes vehicles"),
        ({"kind": "shock"}, FileFormatError, "is a shock file, not a vehicle file"),
        ({"model": "seven_dof"}, FileFormatError, "model: must be 'state_space', not 'seven_dof'"),
        ({"extra": 1}, FileFormatError, "extra: is not an entry of this file"),
        ({"A": [[1.0]]}, ParameterError, r"B has the shape \(4, 3\)"),
        ({"A": [[1.0], [2.0, 3.0]]}, ParameterError, "A: its rows must have one length"),
        ({"D": [[0.0] * 3] * 8 + [[0.0, 0.0, None]]}, FileFormatError, r"D\.8\.2: must be a number, not None"),
        ({"inputs": [{"name": "road"}]}, FileFormatError, r"inputs\.0\.unit: is missing"),
        ({"inputs": [{"name": n, "unit": "in"} for n in "abc"]}, FileFormatError, "not SI"),
        ({"static": {"yaw": 1.0}}, ParameterError, "static value is given for 'yaw'"),
        ({"baseline_damping": {"lf": 1.0}}, ParameterError, "no force input"),
        ({"dt": -1.0}, ParameterError, "sample time"),
    ],
)
def test_a_wrong_identified_vehicle_is_rejected_with_its_file(tmp_path, changes, error, message):
    path = json_vehicle(tmp_path, **changes)
    with pytest.raises(error, match=message) as caught:
        read_vehicle(path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("name", ["gone.toml", "gone.json"])
def test_a_missing_file_is_an_input_error(tmp_path, name):
    with pytest.raises(FileFormatError, match="no such file"):
        read_vehicle(tmp_path / name)


@pytest.mark.parametrize("text", ["{", "[1, 2]"])
def test_other_json_is_rejected(tmp_path, text):
    (tmp_path / "car.json").write_text(text, encoding="utf-8")
    with pytest.raises(FileFormatError, match="JSON"):
        read_vehicle(tmp_path / "car.json")


def test_static_values_belong_to_outputs():
    vehicle = read_vehicle(shipped("quarter_car"))
    with pytest.raises(ParameterError, match="has static values of tire_force, ride_height"):
        replace(vehicle, static={"velocity": 1.0})
    with pytest.raises(ParameterError, match="finite"):
        replace(vehicle, static={"tire_force": np.inf})
