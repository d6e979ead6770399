"""Directional derivatives are slopes of the outputs on each side of the curve; input derivatives apply to one step."""

import ctypes
from dataclasses import replace

import numpy as np
import pytest

from eightpost.shock import LAWS
from eightpost.shock.laws import state_names

OK, ERROR = 0, 3

#: Damper velocities [m/s] in every part of the curve: beyond the fit, outer cubic, transition, inner polynomial.
VELOCITIES = (-1.4, -0.8, -0.384, -0.379, -0.2, -0.02, 0.02, 0.2, 0.379, 0.384, 0.8, 1.5)

#: Parameters of the port, all of which matter, and scales that differ between the sides.
PORT = {
    "motion_ratio": 0.9, "compression_scale": 0.8, "rebound_scale": 1.25, "gas_stiffness": 700.0, "gas_preload": 50.0,
    "seal_friction": 15.0, "friction_velocity": 0.02,
}  # fmt: skip


def state_of(fmu, law):
    """Return the state of an FMU as its law has it: a number, or a tuple."""
    states = fmu.get(*state_names(type(law)))
    return states[0] if len(states) == 1 else tuple(states)


@pytest.mark.parametrize("damper_velocity", VELOCITIES)
@pytest.mark.parametrize("name", LAWS)
def test_a_shocks_derivative_along_both_inputs_is_the_slope_of_its_law(host, shocks, name, damper_velocity):
    """The states are fixed at values that differ from those of steady motion after a step."""
    fmu, velocity = host(name), damper_velocity / PORT["motion_ratio"]
    fmu.call("SetupExperiment", 0, ctypes.c_double(0.0), ctypes.c_double(0.0), 0, ctypes.c_double(0.0))
    assert fmu.set_named(PORT) == fmu.call("EnterInitializationMode") == fmu.call("ExitInitializationMode") == OK
    law = replace(shocks[name].law, port=type(shocks[name].law.port)(**PORT))
    fmu.set_named({"velocity": velocity, "displacement": 0.01})
    assert fmu.step(0.0, 3e-4) == OK
    state = state_of(fmu, law)
    per_velocity, per_displacement, change = 0.7, -30.0, 1e-6
    ends = [
        law.response(state, velocity + d * per_velocity, 0.01 + d * per_displacement).force for d in (-change, change)
    ]
    status, (found,) = fmu.tangent(["force"], ["velocity", "displacement"], [per_velocity, per_displacement])
    assert status == OK
    assert found == pytest.approx((ends[1] - ends[0]) / (2.0 * change), rel=1e-5, abs=1e-3)


@pytest.mark.parametrize("name", LAWS)
def test_the_end_of_the_fitted_range_belongs_to_it(host, shocks, name):
    """The slope there is that from inside, and beyond_fit is 0."""
    fmu, law = host(name).start(), shocks[name].law
    for k, edge in enumerate((law.curve.compression_speed, -law.curve.rebound_speed)):
        fmu.set_named({"velocity": edge, "displacement": 0.0})
        assert fmu.step(0.1 * k, 0.1) == OK
        state, (beyond,) = state_of(fmu, law), fmu.get("beyond_fit")
        assert beyond == 0.0 == law.response(state, edge, 0.0).beyond_fit
        inside = edge * (1.0 - 1e-6)
        difference = law.response(state, edge, 0.0).force - law.response(state, inside, 0.0).force
        status, (found,) = fmu.tangent(["force"], ["velocity"], [1.0])
        assert status == OK
        assert found == pytest.approx(difference / (edge - inside), rel=1e-4, abs=1.0)
        fmu.set_named({"velocity": edge * 1.001})
        assert fmu.step(0.1 * k + 0.05, 0.05) == ERROR  # a step must start where the last one ended
    assert fmu.step(0.2, 0.1) == OK
    assert fmu.get("beyond_fit") == [1.0]


@pytest.mark.parametrize("name", ["lpnl2", "quarter_car"])
def test_a_directional_derivative_without_known_variables_is_zero(host, name):
    output = "force" if name == "lpnl2" else "tire_force"
    assert host(name).start().tangent([output], [], []) == (OK, np.zeros(1))


@pytest.mark.parametrize("name", LAWS)
def test_an_input_derivative_applies_to_one_step(host, shocks, name):
    """The first step changes the velocity from 0.1 to 0.2 m/s, the second holds it."""
    fmu, law = host(name).start(), shocks[name].law
    fmu.set_named({"velocity": 0.1, "displacement": 0.0})
    assert fmu.set_slopes({"velocity": 50.0}) == OK
    state = law.start(0.0)
    for k, (start, end) in enumerate(((0.1, 0.2), (0.2, 0.2), (0.2, 0.2))):
        assert fmu.step(2e-3 * k, 2e-3) == OK
        state = law.follow(state, start, end, 2e-3)
        assert fmu.get("velocity", "force") == pytest.approx([end, law.response(state, end, 0.0).force], rel=1e-12)


def test_an_input_derivative_of_one_input_does_not_affect_another(host):
    fmu = host("lpnl2").start()
    assert fmu.set_slopes({"velocity": 50.0}) == OK
    assert fmu.set_slopes({"displacement": 0.4}) == OK
    assert fmu.step(0.0, 1e-3) == OK
    assert fmu.get("velocity", "displacement") == pytest.approx([0.05, 4e-4], rel=1e-12)
    assert fmu.set_slopes({"displacement": 0.4}) == OK
    assert fmu.step(1e-3, 1e-3) == OK
    assert fmu.get("velocity", "displacement") == pytest.approx([0.05, 8e-4], rel=1e-12)
