"""Linear models with named channels and discrete ones, compared with python-control and scipy."""

from __future__ import annotations

import pickle

import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.signal import cont2discrete

from eightpost.errors import ParameterError, UnknownUnitError
from eightpost.vehicle import Channel, StateSpace, discretise, read_vehicle, shipped

CAR = read_vehicle(shipped("seven_dof")).with_damper()
QUARTER = read_vehicle(shipped("quarter_car")).with_damper()
UNITS = st.sampled_from(["m", "m/s", "N", "N.m", "rad", "m/s2", "1"])
NAMES = st.from_regex(r"[a-z][a-z0-9_ ]{0,6}[a-z](\.[a-z_]{1,8})?", fullmatch=True)
NUMBERS = st.floats(-1e6, 1e6, allow_subnormal=False)


@st.composite
def state_spaces(draw):
    n, m, p = draw(st.integers(0, 4)), draw(st.integers(1, 3)), draw(st.integers(1, 3))
    names = draw(st.lists(NAMES, min_size=m + p, max_size=m + p, unique=True))
    channels = [Channel(name, draw(UNITS)) for name in names]
    shapes = [(n, n), (n, m), (p, n), (p, m)]
    matrices = [draw(arrays(float, shape, elements=NUMBERS)) for shape in shapes]
    dt = draw(st.one_of(st.none(), st.floats(1e-4, 1.0)))
    return StateSpace(*matrices, tuple(channels[:m]), tuple(channels[m:]), dt, draw(NAMES))


def integrator(**changes):
    given = {"A": [[0.0]], "B": [[1.0]], "C": [[1.0]], "D": [[0.0]]} | changes
    return StateSpace(**{"inputs": (Channel("u", "N"),), "outputs": (Channel("y", "m"),)} | given)


@pytest.mark.parametrize("model", [CAR, QUARTER, discretise(CAR, 0.002)], ids=["car", "quarter", "discrete"])
def test_frequency_response_agrees_with_python_control(model):
    frequency = np.geomspace(0.05, 200.0, 60)
    expected = control.frequency_response(model.to_control(), 2 * np.pi * frequency).complex
    found = model.frequency_response(frequency)
    assert found.shape == (len(model.outputs), len(model.inputs), 60)
    column = np.abs(expected).max(axis=(0, 2), keepdims=True)  # scales of inputs, then of outputs
    scale = column * np.abs(expected / column).max(axis=(1, 2), keepdims=True)
    np.testing.assert_allclose(found / scale, expected / scale, atol=1e-11)


def test_frequency_response_of_many_repeated_poles_is_exact():
    # A chain of 40 equal first-order lags: eigenvectors do not exist, H = 1 / (1 + 2 pi j f)^40.
    n = 40
    A = -np.eye(n) + np.eye(n, k=-1)
    model = integrator(A=A, B=np.eye(n)[:, :1], C=np.eye(n)[-1:], D=[[0.0]])
    f = np.array([0.0, 0.01, 0.1, 0.3])
    np.testing.assert_allclose(model.frequency_response(f)[0, 0], (1 + 2j * np.pi * f) ** -n, rtol=1e-10)


def test_frequency_response_at_a_pole_is_rejected():
    with pytest.raises(ParameterError, match="infinite at 0 Hz"):
        integrator().frequency_response([1.0, 0.0])


@pytest.mark.parametrize("step", [None, 0.002])
def test_modes_agree_with_python_control(step):
    model = CAR if step is None else discretise(CAR, step)
    frequency, damping, _ = control.damp(model.to_control(), doprint=False)
    found = np.array(sorted(model.modes()))
    expected = np.unique(np.round(np.array([frequency / (2 * np.pi), damping]).T, 7), axis=0)
    np.testing.assert_allclose(found, expected, rtol=1e-6)
    np.testing.assert_allclose(sorted(model.poles(), key=abs), sorted(model.to_control().poles(), key=abs), rtol=1e-9)


def test_real_unstable_and_zero_poles_are_separate_modes():
    model = integrator(A=np.diag([0.0, 2 * np.pi, -4 * np.pi]), B=np.ones((3, 1)), C=np.ones((1, 3)))
    drift, unstable, slow = model.modes()
    assert drift.frequency_hz == 0.0 and np.isnan(drift.damping_ratio)
    assert unstable == pytest.approx((1.0, -1.0))
    assert slow == pytest.approx((2.0, 1.0))


def test_dc_gain_agrees_with_python_control_and_the_response_at_zero():
    np.testing.assert_allclose(CAR.dc_gain(), CAR.to_control().dcgain(), atol=1e-9)
    np.testing.assert_allclose(CAR.dc_gain(), CAR.frequency_response([0.0])[..., 0].real, atol=1e-9)
    np.testing.assert_allclose(discretise(CAR, 0.01).dc_gain(), CAR.dc_gain(), atol=1e-8)


def test_a_model_without_a_steady_state_is_rejected_with_the_reason():
    with pytest.raises(ParameterError, match="model: no unique steady state"):
        integrator().dc_gain()


@given(gains=st.tuples(st.floats(1e-6, 1e6), st.floats(1e-6, 1e6)))
def test_direct_terms_do_not_depend_on_units(gains):
    noise = 1e-13 * np.abs(CAR.C).max(axis=1, keepdims=True) * np.ones_like(CAR.D) * np.abs(CAR.B).max(axis=0) * 1e-4
    noisy = StateSpace(
        CAR.A, CAR.B * gains[0], CAR.C * gains[1], (CAR.D + noise) * gains[0] * gains[1], CAR.inputs, CAR.outputs
    )
    velocities = [name.endswith("velocity") for name in CAR.output_names]
    assert not noisy.select(outputs=np.array(CAR.output_names)[velocities]).direct_terms()[:, :4].any()
    assert noisy.direct_terms()[CAR.D != 0.0].all()


def test_first_order_hold_adds_a_direct_term_and_zero_order_hold_does_not():
    velocities = [name for name in CAR.output_names if name.endswith("velocity")]
    ports = {"inputs": ["lf.force"], "outputs": velocities}
    assert not discretise(CAR, 0.002).select(**ports).direct_terms().any()
    assert discretise(CAR, 0.002, "first").select(**ports).direct_terms()[0, 0]


@pytest.mark.nightly
@settings(max_examples=40)
@given(model=state_spaces())
def test_to_python_control_and_back_is_the_same_model(model):
    back = StateSpace.from_control(
        model.to_control(),
        input_units=[channel.unit for channel in model.inputs],
        output_units=[channel.unit for channel in model.outputs],
    )
    assert back == model and hash(back) == hash(model)


def test_a_system_without_a_time_base_is_rejected():
    with pytest.raises(ParameterError, match="time base"):
        StateSpace.from_control(control.ss(-1, 1, 1, 0, True), input_units=["N"], output_units=["m"])
    with pytest.raises(ParameterError, match="2 input units given"):
        StateSpace.from_control(control.ss(-1, 1, 1, 0, 0), input_units=["N", "N"], output_units=["m"])


def test_select_keeps_the_given_order():
    part = CAR.select(inputs=["rr.force", "lf.road"], outputs=["pitch", "lf.velocity"])
    assert (part.input_names, part.output_names) == (("rr.force", "lf.road"), ("pitch", "lf.velocity"))
    f = [1.0, 7.0]
    i, o = [10, 0], [CAR.output_names.index("pitch"), 0]
    np.testing.assert_allclose(part.frequency_response(f), CAR.frequency_response(f)[np.ix_(o, i)])
    with pytest.raises(ParameterError, match=r"unknown output 'yaw'; the names are lf\.velocity"):
        CAR.select(outputs=["yaw"])


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"B": [[1.0, 2.0]]}, ParameterError, r"B has the shape \(1, 2\).*need \(1, 1\)"),
        ({"A": [[np.nan]]}, ParameterError, r"A contains nan at \(0, 0\)"),
        ({"dt": 0.0}, ParameterError, "sample time is 0.0"),
        ({"outputs": (Channel("y", "m"),) * 2, "C": [[1.0]] * 2, "D": [[0.0]] * 2}, ParameterError, "y more than once"),
    ],
)
def test_inconsistent_models_are_rejected(changes, error, message):
    with pytest.raises(error, match=message):
        integrator(**changes)


@pytest.mark.parametrize(
    ("name", "unit", "error", "message"),
    [
        ("", "m", ParameterError, "must not be empty"),
        ("a:b", "m", ParameterError, "colon"),
        ("velocity", "in/s", UnknownUnitError, "not SI.*convert"),
        ("velocity", "furlong/parsec/x", UnknownUnitError, "unknown unit"),
    ],
)
def test_a_channel_has_a_name_and_an_si_unit(name, unit, error, message):
    with pytest.raises(error, match=message):
        Channel(name, unit)


def test_a_model_is_read_only_and_can_be_pickled():
    with pytest.raises(ValueError, match="read-only"):
        CAR.A[0, 0] = 1.0
    assert pickle.loads(pickle.dumps(CAR)) == CAR
    assert CAR not in (QUARTER, 3)


# ---- Discrete models -------------------------------------------------------------------------------------------------

MODELS = [read_vehicle(shipped(name)).with_damper() for name in ("quarter_car", "seven_dof")]
MATRICES = ("A", "B", "C", "D")


def assert_same(found, expected):
    for name, matrix in zip(MATRICES, expected, strict=True):
        np.testing.assert_allclose(getattr(found, name), matrix, rtol=1e-9, atol=1e-11 * np.abs(matrix).max())


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.name)
@pytest.mark.parametrize("step", [1e-4, 0.002, 0.01])
def test_zero_order_hold_agrees_with_scipy_and_python_control(model, step):
    found = discretise(model, step)
    matrices = tuple(getattr(model, name) for name in MATRICES)
    assert_same(found, cont2discrete(matrices, step, "zoh")[:4])
    witness = control.c2d(model.to_control(), step, "zoh")
    assert_same(found, tuple(getattr(witness, name) for name in MATRICES))
    assert (found.dt, found.inputs, found.outputs) == (step, model.inputs, model.outputs)


def test_first_order_hold_is_exact_for_straight_lines():
    model = MODELS[0]
    t = np.arange(0.0, 0.5, 0.005)
    u = np.interp(t, [0.0, 0.1, 0.3, 0.5], [0.0, 0.01, -0.01, 0.0]) * np.array([[1.0], [1e4], [5e4]])
    expected = control.forced_response(model.to_control(), t, u).outputs
    found = control.forced_response(discretise(model, 0.005, "first").to_control(), t, u).outputs
    np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize(
    ("step", "hold", "message"), [(0.0, "zero", "above zero"), (0.01, "second", "choose 'zero' or 'first'")]
)
def test_invalid_steps_and_holds_are_rejected(step, hold, message):
    with pytest.raises(ParameterError, match=message):
        discretise(MODELS[0], step, hold)


def test_a_discrete_model_is_rejected():
    with pytest.raises(ParameterError, match="already discrete"):
        discretise(discretise(MODELS[0], 0.01), 0.01)
