"""Tests of the seven-DOF car against an independent construction, and of every sign of ports.md."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eightpost.errors import ParameterError
from eightpost.vehicle import CORNERS, Corners, SevenDof, read_vehicle, shipped

TABLE_5_1 = read_vehicle(shipped("seven_dof")).parameters
UNEVEN = SevenDof(
    track_width=1.6,
    cg_to_front_axle=1.4,
    cg_to_rear_axle=1.2,
    sprung_mass=1100.0,
    roll_inertia=420.0,
    pitch_inertia=1700.0,
    unsprung_mass=Corners(40.0, 44.0, 52.0, 55.0),
    spring_rate=Corners(1.9e5, 2.3e5, 0.9e5, 1.1e5),
    tire_stiffness=Corners(3.1e5, 3.4e5, 3.6e5, 3.7e5),
    damping=Corners(4000.0, 4500.0, 5000.0, 5500.0),
    front_anti_roll_rate=3.0e4,
    rear_anti_roll_rate=1.2e4,
    front_overhang=1.0,
    rear_overhang=0.8,
    driver_ahead_of_cg=-0.2,
    driver_left_of_centreline=0.4,
)


def rms_equal(found, expected):
    np.testing.assert_allclose(found, expected, atol=1e-12 * np.abs(expected).max(initial=1e-300))


def test_table_5_1_in_si(monolithic):
    table = monolithic.Car()  # typed again from the dissertation, with the units' definitions
    for name in table.__dataclass_fields__:
        assert getattr(TABLE_5_1, name) == pytest.approx(getattr(table, name), rel=1e-8), name


positive = st.floats(0.2, 5.0)


@pytest.mark.nightly
@given(scales=st.lists(positive, min_size=24, max_size=24), bars=st.tuples(st.floats(0.0, 1e5), st.floats(0.0, 1e5)))
def test_state_matrices_follow_from_the_energies(monolithic, scales, bars):
    """T = q'M q'/2 and V = sum k (b q)^2 / 2, element by element, agree with Eq 5.17 to 5.19 as printed."""
    s = iter(scales)
    corners = {
        name: Corners(*(value * next(s) for value in getattr(UNEVEN, name)))
        for name in ("unsprung_mass", "spring_rate", "tire_stiffness", "damping")
    }
    scalars = {
        name: getattr(UNEVEN, name) * next(s)
        for name in ("track_width", "cg_to_front_axle", "cg_to_rear_axle", "sprung_mass", "roll_inertia")
    }
    car = replace(UNEVEN, **corners, **scalars, front_anti_roll_rate=bars[0], rear_anti_roll_rate=bars[1])
    S, m, K = monolithic.struts(car), monolithic.mass(car), monolithic.stiffness(car)
    C = sum(c * np.outer(b, b) for c, b in zip(car.damping, S, strict=True))
    model = car.with_damper()
    rms_equal(model.A, np.block([[np.zeros((7, 7)), np.eye(7)], [-K / m[:, None], -C / m[:, None]]]))
    work = np.zeros((7, 11))  # generalised forces: work of each input per unit of each coordinate
    for i in range(4):
        work[3 + i, i] = car.tire_stiffness[i]
        work[:, 7 + i] = -S[i]
    work[:3, 4:7] = np.eye(3)
    rms_equal(model.B, np.vstack([np.zeros((7, 11)), work / m[:, None]]))


def test_outputs_from_geometry(monolithic):
    car, random = UNEVEN, np.random.default_rng(3)
    model = car.with_damper()
    q, v, u = random.normal(size=7), random.normal(size=7), random.normal(size=11)
    x = np.concatenate([q, v])
    y = dict(zip(model.output_names, model.C @ x + model.D @ u, strict=True))
    acceleration = (model.A @ x + model.B @ u)[7:]
    for i, corner in enumerate(CORNERS):
        side, forward = (1 if i % 2 == 0 else -1) * car.track_width / 2, car.cg_to_front_axle
        forward = forward if i < 2 else -car.cg_to_rear_axle
        at_corner = np.array([1.0, side, -forward])
        chassis, wheel = at_corner @ q[:3], q[3 + i]
        assert y[f"{corner}.velocity"] == pytest.approx(v[3 + i] - at_corner @ v[:3])
        assert y[f"{corner}.displacement"] == pytest.approx(wheel - chassis)
        assert y[f"{corner}.tire_force"] == pytest.approx(car.tire_stiffness[i] * (u[i] - wheel))
        assert y[f"{corner}.spring_force"] == pytest.approx(car.spring_rate[i] * (wheel - chassis))
        assert y[f"{corner}.hub_acceleration"] == pytest.approx(acceleration[3 + i])
        assert y[f"{corner}.chassis_acceleration"] == pytest.approx(at_corner @ acceleration[:3])
        assert y[f"{corner}.wheel_position"] == pytest.approx(wheel)
        assert y[f"{corner}.chassis_position"] == pytest.approx(chassis)
    assert (y["heave"], y["roll"], y["pitch"]) == pytest.approx(tuple(q[:3]))
    assert y["driver.acceleration"] == pytest.approx(np.array([1.0, 0.4, 0.2]) @ acceleration[:3])
    heights, road = monolithic.nose_and_spoiler(car)
    found = y["front.ride_height"], y["rear.ride_height"]
    assert found == pytest.approx(tuple(heights @ q + road @ u[:4]))


def test_names_and_units_are_those_of_the_documentation():
    model = TABLE_5_1.coupled()
    assert model.input_names == (
        *("lf.road", "rf.road", "lr.road", "rr.road", "heave_force", "roll_moment", "pitch_moment"),
        *("lf.force", "rf.force", "lr.force", "rr.force"),
    )
    units = {channel.name.split(".")[-1]: channel.unit for channel in model.outputs}
    assert units == {
        "velocity": "m/s", "displacement": "m", "tire_force": "N", "spring_force": "N", "ride_height": "m",
        "hub_acceleration": "m/s2", "chassis_acceleration": "m/s2", "heave": "m", "roll": "rad",
        "pitch": "rad", "wheel_position": "m", "chassis_position": "m",
    }  # fmt: skip
    assert "driver.acceleration" not in model.output_names  # Table 5.1 does not give the driver's position


#: Signs of ports.md: by input, those of outputs of Table 5.1's car. A positive roll lifts the left side, a positive
#: pitch lowers the nose, and a road that rises at the rear lowers the road plane at the nose.
STEADY = {
    "heave_force": {
        "heave": +1,
        "lf.tire_force": -1,
        "lr.displacement": -1,
        "lf.wheel_position": +1,
        "rf.chassis_position": +1,
        "front.ride_height": +1,
        "rear.ride_height": +1,
    },
    "roll_moment": {
        "roll": +1,
        "lf.chassis_position": +1,
        "rr.chassis_position": -1,
        "lf.tire_force": -1,
        "rf.spring_force": +1,
    },
    "pitch_moment": {
        "pitch": +1,
        "lf.chassis_position": -1,
        "lr.chassis_position": +1,
        "front.ride_height": -1,
        "rear.ride_height": +1,
        "lf.tire_force": +1,
    },
    "lf.road": {"heave": +1, "roll": +1, "pitch": -1},
    "lr.road": {"pitch": +1},
    "rr.road": {"roll": -1},
    "lf.force": {"lf.chassis_position": +1, "lf.displacement": -1},
    "rr.force": {"rr.displacement": -1},
}  # fmt: skip
INITIAL = {
    "lf.force": {"lf.hub_acceleration": -1, "lf.chassis_acceleration": +1},
    "lf.road": {"lf.hub_acceleration": +1, "lf.tire_force": +1, "front.ride_height": -1},
    "heave_force": {"rr.chassis_acceleration": +1},
    "lr.road": {"front.ride_height": +1},
    "rr.road": {"rear.ride_height": -1},
}  # fmt: skip


def signs_of(gain: Callable[[str, str], float], stated: Mapping[str, Mapping[str, int]]) -> dict[str, dict[str, int]]:
    return {i: {o: int(np.sign(gain(i, o))) for o in outputs} for i, outputs in stated.items()}


def test_signs_are_those_of_the_ports():
    car = TABLE_5_1.coupled()
    parts = {
        (i, o): car.select(inputs=[i], outputs=[o]) for s in (STEADY, INITIAL) for i, outs in s.items() for o in outs
    }
    assert signs_of(lambda i, o: parts[i, o].dc_gain()[0, 0], STEADY) == STEADY
    assert signs_of(lambda i, o: parts[i, o].D[0, 0], INITIAL) == INITIAL


def test_direct_terms_are_exactly_zero_where_the_physics_has_none():
    model = UNEVEN.coupled()
    found = {(o, i) for o, i in np.ndindex(model.D.shape) if model.D[o, i] != 0.0}
    expected = set()
    for o, output in enumerate(model.output_names):
        place, _, quantity = output.partition(".")
        for i, source in enumerate(model.input_names):
            own = source.startswith(place)
            if (
                (quantity == "tire_force" and source == f"{place}.road")
                or (quantity == "hub_acceleration" and own)
                or (quantity in ("chassis_acceleration", "acceleration") and not source.endswith("road"))
                or (quantity == "ride_height" and source.endswith("road"))
            ):
                expected.add((o, i))
    assert found == expected
    np.testing.assert_array_equal(model.direct_terms(), model.D != 0.0)


def test_what_a_car_does_not_state_is_not_there():
    stated = ("track_width", "cg_to_front_axle", "cg_to_rear_axle", "sprung_mass", "roll_inertia", "pitch_inertia",
              "unsprung_mass", "spring_rate", "tire_stiffness", "front_overhang", "rear_overhang")  # fmt: skip
    car = SevenDof(**{name: getattr(UNEVEN, name) for name in stated})
    nothing = replace(car, damping=Corners.same(0.0), front_anti_roll_rate=0.0, rear_anti_roll_rate=0.0)
    assert car == nothing


@pytest.mark.parametrize("changes", [{"driver_ahead_of_cg": 0.3}, {"driver_left_of_centreline": 0.3}])
def test_an_incomplete_drivers_position_is_rejected(changes):
    with pytest.raises(ParameterError, match="driver_ahead_of_cg and driver_left_of_centreline, or neither"):
        replace(TABLE_5_1, **changes)
