"""The laws satisfy their equations (Eq 3.23 to 3.25), exactly and for any step."""

from collections.abc import Callable
from dataclasses import replace
from math import exp
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicHermiteSpline

from eightpost.shock import LAWS as SHIPPED
from eightpost.shock import (
    Lpf1,
    Lpnl2,
    Polylinear,
    Port,
    Shock,
    fit_parameters,
    law_title,
    own_values,
    parameter_units,
    state_names,
)
from eightpost.shock.curve import outer_share
from eightpost.shock.law import MOST_PIECES, STRAIGHT, Piece, valve_force
from eightpost.shock.laws import law_module, own_parameters
from tests.drawn import rounded

from .example_curve import curve, knot_curve

TAU = 0.0013

LAWS = {
    "polylinear": Polylinear(curve()),
    "lpf1": Lpf1(curve(), TAU),
    "lpnl2": Lpnl2(curve(), TAU, 800.0, 1600.0),
    "polylinear, knots": Polylinear(knot_curve()),
    "lpf1, knots": Lpf1(knot_curve(), TAU),
    "lpnl2, knots": Lpnl2(knot_curve(), TAU, 800.0, 1600.0),
}
velocities = st.floats(-2.0, 2.0)
forces = st.floats(-5000.0, 5000.0)


def test_the_inner_polynomial_is_evaluated_as_written():
    v = 0.2
    s = v / 0.381
    assert curve().force(v) == pytest.approx(1800 * s + 60 * s**2 - 400 * s**3 + 30 * s**15, rel=1e-14)


def test_the_outer_cubics_are_evaluated_as_written():
    s = (0.9 - 0.381) / 0.381
    assert curve().force(0.9) == pytest.approx(1490 + 900 * s + 40 * s**2 + 5 * s**3, rel=1e-14)
    assert curve().force(-0.9) == pytest.approx(-1400 - 1100 * s - 20 * s**2 + 3 * s**3, rel=1e-14)


@given(velocities)
def test_the_curve_is_continuous(v):
    step = 1e-9
    assert abs(curve().force(v + step) - curve().force(v)) < 1e-9 * 5e5


#: No force inside, 1000 N of the outer cubic in compression and -500 N in rebound, about 0.4 m/s over 0.02 m/s.
PLATEAUS = {
    "inner": (0.0,) * 15, "compression": (1000.0, 0.0, 0.0, 0.0), "rebound": (-500.0, 0.0, 0.0, 0.0),
    "transition_speed": 0.4, "transition_width": 0.02,
}  # fmt: skip


@pytest.mark.parametrize(
    ("speed", "share"),
    [(0.0, 0.0), (0.389, 0.0), (0.391, 0.05), (0.395, 0.25), (0.4, 0.5), (0.409, 0.95), (0.411, 1.0), (0.9, 1.0)],
)
def test_the_outer_cubics_share_rises_linearly_over_the_transitions_width(speed, share):
    plateaus = curve(**PLATEAUS)
    assert outer_share(plateaus, speed) == pytest.approx(share, abs=1e-12)
    assert plateaus.force(speed) == pytest.approx(1000.0 * share, abs=1e-9)
    assert plateaus.force(-speed) == pytest.approx(-500.0 * share, abs=1e-9)


@given(st.floats(0.0, 10.0))
def test_beyond_the_fitted_range_the_curve_is_a_straight_line(beyond):
    c = curve()
    assert c.force(1.2 + beyond) == pytest.approx(c.force(1.2) + 3000.0 * beyond, rel=1e-12)
    assert c.force(-1.1 - beyond) == pytest.approx(c.force(-1.1) - 3500.0 * beyond, rel=1e-12)


def test_between_knots_the_curve_is_the_cubic_of_hermite():
    c = knot_curve(knot_force=tuple(force + 40.0 * np.sin(force) for force in knot_curve().knot_force))
    exact = CubicHermiteSpline(c.knot_velocity, c.knot_force, c.knot_slope)
    for v in np.linspace(-1.1, 1.2, 500).tolist():
        assert c.force(v) == pytest.approx(float(exact(v)), abs=1e-9)


def test_a_quadratic_cell_has_a_straight_slope_between_those_of_its_knots():
    c = knot_curve()
    for k in range(24):
        v, w = c.knot_velocity[k], c.knot_velocity[k + 1]
        middle = 0.5 * (v + w)
        rise = c.force(middle + 0.25 * (w - v)) - c.force(middle - 0.25 * (w - v))
        assert rise / (0.5 * (w - v)) == pytest.approx(0.5 * (c.knot_slope[k] + c.knot_slope[k + 1]), rel=1e-9)


@given(velocities)
def test_a_rising_curve_through_knots_is_continuous(v):
    step = 1e-9
    assert 0.0 <= knot_curve().force(v + step) - knot_curve().force(v) < 1e-9 * 1e5


def test_the_lag_covers_1_minus_1_over_e_of_a_step_in_one_time_constant():
    law, static = LAWS["lpf1"], LAWS["lpf1"].static_force(0.2)
    assert law.advance(0.0, 0.2, 0.2, TAU) == pytest.approx(static * (1.0 - exp(-1.0)), rel=1e-14)


@pytest.mark.parametrize("step", [1e-4, 1e-3, 1e-2])
def test_the_lag_solves_its_differential_equation(step):
    law = LAWS["lpf1"]

    def slope(t, lagged):
        return (100.0 + 900.0 * t / step - lagged) / TAU

    exact = solve_ivp(slope, (0.0, step), [400.0], method="DOP853", rtol=1e-12, atol=1e-9).y[0, -1]
    assert law.advance_lag(400.0, 100.0, 1000.0, step) == pytest.approx(exact, rel=1e-9)


@given(velocities, st.floats(1e-7, 0.05))
def test_a_shock_in_equilibrium_stays_there(v, step):
    for law in LAWS.values():
        static = law.static_force(v)
        assert law.advance(static, v, v, step) == static


@pytest.mark.parametrize(
    ("static", "weight"), [(0.0, 1.0), (-800.0, 1.0), (1200.0, 0.5), (-1400.0, 0.25), (1600.0, 0.0), (9e9, 0.0)]
)
def test_the_weight_of_lpnl2_falls_linearly_between_its_two_forces(static, weight):
    assert LAWS["lpnl2"].lag_weight(static) == pytest.approx(weight)


@pytest.mark.parametrize("static", [-300.0, -801.0, 1200.0, -1400.0, 1599.0, 5000.0])
def test_the_slopes_of_lpnl2s_weight_are_its_differences(static):
    core, small = law_module(Lpnl2), 1e-3
    here = np.array([static, 800.0, 1600.0])

    def weight(values):
        return core.weight_core(values[0], (TAU, *values[1:]))

    differences = [(weight(here + step) - weight(here - step)) / (2.0 * small) for step in small * np.eye(3)]
    assert core.weight_slopes_core(static, 30.0, (TAU, 800.0, 1600.0)) == pytest.approx(30.0 * np.array(differences))


@given(velocities, forces)
def test_lpnl2_is_lpf1_at_low_force_and_polylinear_at_high_force(v, lagged):
    law = LAWS["lpnl2"]
    static = law.static_force(v)
    force = law.response(lagged, v, 0.0).force
    if abs(static) <= 800.0:
        assert force == LAWS["lpf1"].response(lagged, v, 0.0).force
    elif abs(static) >= 1600.0:
        assert force == LAWS["polylinear"].response(lagged, v, 0.0).force
    else:
        assert min(static, lagged) - 1e-9 <= force <= max(static, lagged) + 1e-9


@pytest.mark.parametrize("name", LAWS)
def test_a_motion_ratio_scales_velocity_and_force(name):
    law = LAWS[name]
    geared = type(law)(**{f: getattr(law, f) for f in law.__dataclass_fields__} | {"port": Port(motion_ratio=0.8)})
    plain, through = law.response(300.0, 0.8 * 0.25, 0.0), geared.response(300.0, 0.25, 0.0)
    assert through.force == pytest.approx(0.8 * plain.force, rel=1e-14)
    assert through.dissipated_power == pytest.approx(plain.dissipated_power, rel=1e-14)


def test_gas_and_seal_add_to_the_valves():
    port = Port(gas_stiffness=700.0, gas_preload=90.0, seal_friction=18.0, friction_velocity=0.005)
    response = Polylinear(curve(), port=port).response(0.0, 0.1, 0.02)
    static = curve().force(0.1)
    assert response.force == pytest.approx(static + 18.0 * np.tanh(20.0) + 90.0 + 700.0 * 0.02, rel=1e-14)
    assert response.dissipated_power == pytest.approx((static + 18.0 * np.tanh(20.0)) * 0.1, rel=1e-14)


def test_a_gas_spring_acts_through_the_motion_ratio_twice():
    port = Port(gas_stiffness=700.0, gas_preload=90.0, motion_ratio=0.8)
    assert port.gas_force(0.02) == pytest.approx(90.0 + 700.0 * 0.8 * 0.02, rel=1e-14)
    response = Polylinear(curve(), port=port).response(0.0, 0.0, 0.02)
    assert response.force == pytest.approx(0.8 * (90.0 + 700.0 * 0.8 * 0.02), rel=1e-14)


def test_the_scales_act_on_their_own_side_in_the_core_functions_too():
    valve = Polylinear(curve(), port=Port(compression_scale=1.5, rebound_scale=0.5)).valve
    for velocity, scale in ((0.3, 1.5), (1e-3, 1.5), (-1e-3, 0.5), (-0.3, 0.5)):
        assert valve_force(valve, velocity) == scale * curve().force(velocity)


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_the_core_functions_give_the_same_results_as_the_law(law):
    own = tuple(getattr(law, name) for name in own_parameters(type(law)))
    core, piece = law_module(type(law)), Piece(0.1, 0.3, 500.0, 1700.0, 1e-3)
    assert core.advance_core(300.0, piece, own, law.valve) == law.advance_piece(300.0, piece)
    for static in (0.0, -900.0, 1300.0, 5000.0):
        assert core.weight_core(static, own) == law.lag_weight(static)


@pytest.mark.parametrize(
    ("start", "end", "count"),
    [(0.1, 0.1, 1), (0.1, 0.1124, 1), (0.1, 0.1126, 2), (-0.2, 0.25, 37), (0.0, 5.001, 401), (0.0, 90.0, 1000)],
)
def test_a_step_is_divided_into_equal_pieces_of_at_most_a_hundredth_of_damper_velocity(start, end, count):
    """The motion ratio is 0.8; there are never more than a thousand pieces."""
    pieces = []

    class Recorder(Polylinear):
        def advance_piece(self, lagged, piece):
            pieces.append(piece)
            return lagged + 1.0

    law = Recorder(curve(), port=Port(motion_ratio=0.8))
    assert law.follow(5.0, start, end, 0.004) == 5.0 + count
    edges = np.linspace(0.8 * start, 0.8 * end, count + 1)
    assert [piece.velocity_start for piece in pieces] == pytest.approx(edges[:-1], abs=1e-13)
    assert [piece.velocity_end for piece in pieces] == pytest.approx(edges[1:], abs=1e-13)
    assert {piece.step for piece in pieces} == {0.004 / count}
    for piece in pieces:
        assert piece.static_end == pytest.approx(curve().force(piece.velocity_end), abs=1e-7)
        assert piece.static_start == pytest.approx(curve().force(piece.velocity_start), abs=1e-7)


POUND = 4.4482216152605


def test_the_bounds_of_the_fit_are_the_dissertations():
    """3.3.2: 0.1 to 10 ms; 3.3.3: 10 to 1000 lbf, at least 1 lbf apart."""
    (lag,) = fit_parameters(Lpf1)
    same, full, zero = fit_parameters(Lpnl2)
    assert (lag.name, lag.low, lag.high, lag.scale) == ("time_constant", 1e-4, 1e-2, "logarithmic")
    assert same == lag
    assert (full.low, full.high) == pytest.approx((10.0 * POUND, 999.0 * POUND), rel=1e-12)
    assert (zero.low, zero.high, zero.gap) == pytest.approx((11.0 * POUND, 1000.0 * POUND, POUND), rel=1e-12)
    assert (zero.above, full.above, full.gap) == ("lag_full_force", "", 0.0)


@pytest.mark.parametrize(
    ("build", "named"),
    [
        (lambda: curve(inner=(1.0,) * 14), "inner"),
        (lambda: curve(rebound=(1.0, float("nan"), 0.0, 0.0)), "rebound"),
        (lambda: curve(transition_speed=0.0), "transition_speed"),
        (lambda: curve(compression_speed=float("inf")), "compression_speed"),
        (lambda: curve(rebound_speed=float("nan")), "rebound_speed"),
        (lambda: curve(rebound_slope=float("inf")), "rebound_slope"),
        (lambda: curve(transition_width=2.0 * 0.381), "transition_width"),
        (lambda: Port(friction_velocity=0.0), "friction_velocity"),
        (lambda: Port(compression_scale=-1e-9), "compression_scale"),
        (lambda: Lpf1(curve(), float("inf")), "time_constant"),
        (lambda: Lpnl2(curve(), TAU, -1.0, 1000.0), "lag_full_force"),
        (lambda: Lpnl2(curve(), TAU, 1.0, float("inf")), "lag_zero_force"),
        (lambda: curve(transition_width=0.8), "transition_width"),
        (lambda: curve(compression_slope=-1.0), "compression_slope"),
        (lambda: Port(motion_ratio=0.0), "motion_ratio"),
        (lambda: Port(gas_preload=float("inf")), "gas_preload"),
        (lambda: Port(seal_friction=-1.0), "seal_friction"),
        (lambda: Lpf1(curve(), 0.0), "time_constant"),
        (lambda: Lpnl2(curve(), TAU, 1000.0, 1000.0), "lag_zero_force"),
        (lambda: knot_curve(knot_velocity=(0.0,) * 25), "knot_velocity is all zeros"),
        (lambda: knot_curve(knot_slope=(1.0,) * 24), "knot_slope"),
        (lambda: knot_curve(knot_slope=(-1.0, *[1.0] * 24)), "knot_slope must not be negative"),
        (lambda: knot_curve(knot_force=(1.0,) * 25), "middle knot"),
        (lambda: knot_curve(compression_speed=1.3), "must end at"),
        (lambda: knot_curve(knot_velocity=knot_curve().knot_velocity[::-1]), "ascending"),
    ],
)
def test_a_parameter_out_of_range_is_named(build, named):
    with pytest.raises(ValueError, match=named):
        build()


def test_the_c_code_divides_a_ramp_into_pieces_like_the_law():
    source = (Path(__file__).parents[2] / "fmus" / "common" / "shock.c").read_text(encoding="utf-8")
    assert f"STRAIGHT = {STRAIGHT};" in source
    assert f"MOST_PIECES = {MOST_PIECES} }}" in source


PORT = Port(motion_ratio=0.8, compression_scale=1.1, rebound_scale=0.9, gas_preload=50.0, gas_stiffness=700.0,
            seal_friction=15.0)  # fmt: skip


SPEEDS = np.concatenate([-np.geomspace(1.5, 1e-3, 12), [0.0], np.geomspace(1e-3, 1.5, 12)])


@pytest.mark.parametrize("name", SHIPPED)
def test_a_law(name: str, shocks: dict[str, Shock], unchanged: Callable[..., None]) -> None:
    law = replace(shocks[name].law, port=PORT)
    time = np.arange(401) * 1e-3
    velocity = 0.5 * np.sin(12.0 * time) + 0.2 * np.sin(70.0 * time)
    travel = 0.04 * (1.0 - np.cos(12.0 * time))
    state, forces = law.start(float(velocity[0])), []
    for before, after, place in zip(velocity[:-1], velocity[1:], travel[1:], strict=True):
        state = law.follow(state, float(before), float(after), 1e-3)
        forces.append(tuple(law.response(state, float(after), float(place))))
    kind = type(law)
    unchanged({
        "title": law_title(name), "states": state_names(kind), "parameters": own_parameters(kind),
        "units": parameter_units(kind), "fit": [rounded(str(one)) for one in fit_parameters(kind)],
        "own": np.array(own_values(law)),
        "static": np.array([law.static_force(v) for v in SPEEDS.tolist()]),
        "curve": np.array([law.curve.force(v) for v in SPEEDS.tolist()]),
        "beyond": [law.curve.is_beyond_fit(v) for v in (-1.2, -1.0, 1.0, 1.3)],
        "seal": np.array([law.port.seal_force(v) for v in (-0.1, -1e-3, 1e-4, 2e-3)]),
        "weight": np.array([law.lag_weight(f) for f in (-3000.0, -900.0, 0.0, 400.0, 1200.0, 5000.0)]),
        "responses": list(np.array(forces, dtype=float).T),
        "last state": np.array(state if isinstance(state, tuple) else [state]),
        "summary": str(Shock(name, law)),
    })  # fmt: skip
