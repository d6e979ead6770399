"""A native shock FMU equals its law for any input, parameter and step, held or ramped."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import eightpost.shock
from eightpost.errors import StepError
from eightpost.shock import LAWS, hysteresis
from eightpost.shock import law as law_module

OUTPUTS = ("force", "static_force", "lagged_force", "lag_weight", "dissipated_power", "beyond_fit")
PARAMETERS = {
    "motion_ratio": st.floats(0.5, 1.5),
    "compression_scale": st.floats(0.0, 2.0),
    "rebound_scale": st.floats(0.0, 2.0),
    "gas_stiffness": st.floats(0.0, 5e3),
    "gas_preload": st.floats(-500.0, 500.0),
    "seal_friction": st.floats(0.0, 50.0),
    "friction_velocity": st.floats(1e-3, 0.1),
    "time_constant": st.floats(1e-5, 0.1),
    "lag_full_force": st.floats(0.0, 1e3),
    "lag_zero_force": st.floats(1.1e3, 1e4),
    "series_stiffness": st.floats(1e5, 1e9),
    **{f"time_constant[{k + 1}]": st.floats(1e-4, 0.1) for k in range(3)},
    "stop_stiffness": st.floats(0.0, 1e6),
    "stop_yield": st.floats(1e-5, 8e-3),
    "stop_time": st.floats(3e-4, 1.0),
    "curve.inner[1]": st.floats(-5e3, 5e3),
    "curve.rebound[4]": st.floats(-5e2, 5e2),
    "curve.transition_speed": st.floats(0.2, 0.6),
}
#: Step [s], velocity at its start and end [m/s], displacement [m].
moves = st.lists(
    st.tuples(st.floats(1e-7, 0.05), st.floats(-2.0, 2.0), st.floats(-2.0, 2.0), st.floats(-0.05, 0.05)),
    min_size=1,
    max_size=8,
)


#: Parameters of the port and scales that differ between the sides.
PORT = {
    "motion_ratio": 0.9, "compression_scale": 0.8, "rebound_scale": 1.25, "gas_stiffness": 900.0, "gas_preload": 40.0,
    "seal_friction": 12.0, "friction_velocity": 0.02,
}  # fmt: skip

CURVES = ("polynomials", "knots")
slopes = st.lists(st.floats(50.0, 2e4), min_size=25, max_size=25)
powers = st.floats(1.0, 2.5)
speeds = st.tuples(st.floats(0.3, 2.0), st.floats(0.3, 2.0))
#: Deviations of the forces from those of quadratic cells [N].
shares = st.lists(st.floats(0.0, 1.0), min_size=25, max_size=25)
twists = st.lists(st.floats(-50.0, 50.0), min_size=25, max_size=25)


def parameters_of(name, curve, variables):
    """Return values for the parameters that an FMU has, with or without knots."""
    ranges = PARAMETERS
    if name == "hysteresis":
        ranges = {n: s for n, s in ranges.items() if not n.startswith("curve.")}
    found = st.fixed_dictionaries({n: s for n, s in ranges.items() if n in variables})
    if name == "hysteresis" and curve == "knots":
        return st.builds(dict.__or__, found, st.builds(hysteresis_values, speeds, powers, slopes, shares))
    if curve == "polynomials":
        return found
    knots = st.builds(knot_values, speeds, powers, slopes, twists)
    return st.builds(dict.__or__, found, knots)


def hysteresis_values(speeds, power, slopes, shares):
    """Return a curve through knots and the slopes of its lagged part as parameters of an FMU."""
    ends = {"curve.rebound_slope": slopes[0], "curve.compression_slope": slopes[-1]}
    lagged = {
        f"curve.lagged_slope[{k + 1}]": s * share for k, (s, share) in enumerate(zip(slopes, shares, strict=True))
    }
    return knot_values(speeds, power, slopes, [0.0] * 25) | ends | lagged


def knot_values(speeds, power, slopes, twists):
    """Return a curve through knots as parameters of an FMU."""
    velocity = [-speeds[0] * (k / 12) ** power for k in range(12, 0, -1)]
    velocity += [speeds[1] * (k / 12) ** power for k in range(13)]
    force = integral(velocity, slopes)
    force = [0.0 if k == 12 else one + twist for k, (one, twist) in enumerate(zip(force, twists, strict=True))]
    values = {"curve.rebound_speed": speeds[0], "curve.compression_speed": speeds[1]}
    for field, numbers in (("velocity", velocity), ("force", force), ("slope", slopes)):
        values |= {f"curve.knot_{field}[{k + 1}]": number for k, number in enumerate(numbers)}
    return values


def integral(velocity, slopes):
    """Return the forces of quadratic cells, 0 at the middle knot."""
    rises = [0.5 * (a + b) * (w - v) for (v, w), (a, b) in zip(pairwise(velocity), pairwise(slopes), strict=True)]
    force = np.concatenate(([0.0], np.cumsum(rises)))
    return (force - force[12]).tolist()


def law_with(law, values):
    """Return the library's law with the FMU's parameter values."""
    curve = {name: getattr(law.curve, name) for name in law.curve.__slots__}
    for name, value in values.items():
        if name.startswith("curve.") and "lagged_slope" not in name:
            field, _, index = name.removeprefix("curve.").rstrip("]").partition("[")
            if index:
                changed = list(curve[field])
                changed[int(index) - 1] = value
                curve[field] = tuple(changed)
            else:
                curve[field] = value
    port = {name: values.get(name, getattr(law.port, name)) for name in law.port.__slots__}
    own = {name: own_value(law, name, values) for name in eightpost.shock.own_parameters(type(law))}
    return type(law)(curve=type(law.curve)(**curve), port=type(law.port)(**port), **own)


def own_value(law, name, values):
    found = getattr(law, name)
    if not isinstance(found, tuple):
        return values.get(name, found)
    prefix = "curve." if name == "lagged_slope" else ""
    return tuple(values.get(f"{prefix}{name}[{k + 1}]", one) for k, one in enumerate(found))


def run_fmu(fmu, ramps):
    fmu.set(("velocity", "displacement"), (0.0, 0.0))
    fmu.end_initialization()
    time, rows = 0.0, []
    for step, start, end, displacement in ramps:
        fmu.set(("velocity", "displacement"), (start, displacement))
        if end != start:
            fmu.set_derivatives(("velocity",), ((end - start) / step,))
        fmu.step(time, step)
        time += step
        rows.append(fmu.get(OUTPUTS))
    return np.array(rows)


def reached(ramps):
    """Return the same moves with the velocity that slope times step reaches, to its last bit."""
    return [
        (step, start, start + (end - start) / step * step if end != start else start, x)
        for step, start, end, x in ramps
    ]


@pytest.fixture
def loaded():
    """Return the FMU of a property test: loaded once, restarted for each example."""
    return []


@pytest.mark.repeated
@pytest.mark.parametrize("curve", CURVES)
@pytest.mark.parametrize("name", LAWS)
@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data(), ramps=moves, held=st.booleans())
def test_the_fmu_and_the_law_agree_bit_for_bit_with_the_same_exponential(
    name, curve, data, ramps, held, component, shocks, loaded, elementary
):
    """The C law does the same operations in the same order; only the elementary functions differ."""
    ramps = [(step, start, start if held else end, x) for step, start, end, x in ramps]
    fmu = component(name) if not loaded else loaded[0]
    loaded[:] = [fmu]
    values = data.draw(parameters_of(name, curve, fmu.variables))
    law = law_with(shocks[name].law, values)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(law_module, "expm1", elementary.exponential_minus_1)
        patch.setattr(hysteresis, "exp", elementary.exponential)
        patch.setattr(hysteresis, "log", elementary.logarithm)
        state, expected = law.start(0.0), []
        for step, start, end, displacement in reached(ramps):
            state = law.follow(state, start, end, step)
            expected.append(law.response(state, end, displacement))
    fmu.finish()
    fmu.begin(0.0, 1e6, values)
    found = run_fmu(fmu, ramps)
    assert found[:, 1:3].tolist() == np.array(expected)[:, 1:3].tolist()  # forces without friction of the seals
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-9)


@pytest.mark.repeated(2)
@pytest.mark.parametrize("curve", CURVES)
@pytest.mark.parametrize("name", LAWS)
def test_the_native_fmu_equals_the_python_one(name, curve, component, python_component):
    rng = np.random.default_rng(4)
    slopes, values = rng.uniform(50.0, 5e3, 25).tolist(), PORT
    if curve == "knots" and name == "hysteresis":
        values = PORT | hysteresis_values((1.1, 1.2), 1.8, slopes, rng.uniform(0.0, 1.0, 25).tolist())
    elif curve == "knots":
        values = PORT | knot_values((1.1, 1.2), 1.8, slopes, [0.0] * 25)
    ramps = [(10.0 ** rng.uniform(-7, -1.3), v, v, x) for v, x in rng.uniform((-2.0, -0.05), (2.0, 0.05), (200, 2))]
    native, python = (run_fmu(load(name, **values), ramps) for load in (component, python_component))
    np.testing.assert_allclose(native, python, rtol=1e-12, atol=1e-9)


@pytest.mark.parametrize("kind", ["component", "python_component"])
@pytest.mark.parametrize("name", LAWS)
def test_a_shock_starts_in_equilibrium_and_initialization_may_be_iterated(request, shocks, name, kind):
    fmu, law = request.getfixturevalue(kind)(name), shocks[name].law
    for velocity in (0.3, -0.2, 0.05):
        fmu.set(("velocity", "displacement"), (velocity, 0.01))
        static = law.static_force(velocity)
        state = law.start(velocity)
        expected = (law.response(state, velocity, 0.01).force, law.valve_force(state, velocity))
        assert name == "hysteresis" or expected[1] == static
        assert fmu.get(("force", "lagged_force")) == pytest.approx(expected, rel=1e-15)
    fmu.end_initialization()
    assert fmu.get(("lagged_force",)) == pytest.approx([law.valve_force(law.start(0.05), 0.05)], rel=1e-15)


@pytest.mark.nightly
@pytest.mark.parametrize("name", LAWS)
def test_ramped_inputs_reduce_the_error_of_a_large_step_at_least_fivefold(component, shocks, name):
    """A smooth velocity, against the law in steps of ten microseconds: the lagged force at the coupling points."""
    law, step, fine = shocks[name].law, 2e-3, 1e-5
    velocity = lambda t: 0.3 * np.sin(2 * np.pi * 5.0 * t)  # noqa: E731
    lagged, exact = law.start(0.0), []
    for k in range(int(0.2 / step)):
        for j in range(round(step / fine)):
            t = k * step + j * fine
            lagged = law.follow(lagged, velocity(t), velocity(t + fine), fine)
        exact.append(law.response(lagged, velocity((k + 1) * step), 0.0).force)
    errors = {}
    for how in ("held", "ramped"):
        fmu = component(name)
        ends = np.array([velocity(k * step) for k in range(int(0.2 / step) + 1)])
        found = run_fmu(fmu, [(step, a, b if how == "ramped" else a, 0.0) for a, b in pairwise(ends)])
        errors[how] = np.sqrt(np.mean((found[:, 0] - exact) ** 2))
    assert errors["held"] > 5.0 * errors["ramped"]


def test_a_fast_ramp_is_divided_into_pieces_with_second_order_accuracy(shocks):
    """The pieces of `follow` against ever finer ones: halving the speed change quarters the error."""
    law, errors = shocks["lpf1"].law, []
    exact = law.static_force(-0.35)
    for k in range(20000):
        exact = law.advance(exact, -0.35 + 0.7 * k / 20000, -0.35 + 0.7 * (k + 1) / 20000, 2e-3 / 20000)
    for count in (20, 40, 80):
        lagged = law.static_force(-0.35)
        for k in range(count):
            lagged = law.advance(lagged, -0.35 + 0.7 * k / count, -0.35 + 0.7 * (k + 1) / count, 2e-3 / count)
        errors.append(abs(lagged - exact))
    assert np.diff(np.log2(errors)) == pytest.approx(-2.0, abs=0.5)
    assert abs(law.follow(law.static_force(-0.35), -0.35, 0.35, 2e-3) - exact) < 1e-3 * abs(exact)


KNOTS = knot_values((1.1, 1.2), 1.8, [3e3] * 25, [0.0] * 25)


@pytest.mark.parametrize(
    "changes",
    [
        {"curve.knot_velocity[3]": -2.0},
        {"curve.knot_velocity[13]": 1e-4},
        {"curve.knot_force[13]": 1.0},
        {"curve.compression_speed": 1.3},
        {"curve.rebound_speed": 1.3},
        dict.fromkeys((f"curve.knot_velocity[{k + 1}]" for k in range(25)), 0.0),
    ],
    ids=str,
)
def test_knots_that_are_no_curve_are_refused_as_the_law_refuses_them(component, python_component, shocks, changes):
    values = KNOTS | changes
    with pytest.raises(ValueError, match="knot") as found:
        law_with(shocks["lpf1"].law, values)
    for load in (component, python_component):
        fmu = load("lpf1", **values)
        with pytest.raises(StepError, match="knot"):
            fmu.end_initialization()
        fmu.finish()
        fmu.begin(0.0, 1e6, KNOTS)
        fmu.end_initialization()
        fmu.step(0.0, 1e-3)
        if all(name.startswith("curve.knot") for name in changes):  # the others are fixed
            fmu.set(tuple(changes), tuple(changes.values()))
            with pytest.raises(StepError, match="knot"):
                fmu.step(1e-3, 1e-3)
    assert "knot" in str(found.value)


def test_knots_may_be_changed_between_steps(component, python_component, shocks):
    stiffer = knot_values((1.1, 1.2), 1.8, [6e3] * 25, [0.0] * 25)
    changed = {name: value for name, value in stiffer.items() if "knot" in name}
    for load in (component, python_component):
        fmu = load("polylinear", **KNOTS)
        fmu.set(("velocity", "displacement"), (0.4, 0.0))
        fmu.end_initialization()
        assert fmu.get(("static_force",)) == pytest.approx([3e3 * 0.4], rel=1e-12)
        fmu.set(tuple(changed), tuple(changed.values()))
        fmu.step(0.0, 1e-3)
        assert fmu.get(("static_force",)) == pytest.approx([6e3 * 0.4], rel=1e-12)
