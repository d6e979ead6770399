"""Model exchange: modes, states and derivatives by array and by value reference, states of the FMU, refusals."""

import ctypes
import math

import numpy as np
import pytest

from eightpost.shock import LAWS
from eightpost.vehicle import read_vehicle, shipped
from eightpost.vehicle.modal import modal_form

ALL = (*LAWS, "seven_dof", "quarter_car", "assembly")
OK, WARNING, DISCARD, ERROR, FATAL = range(5)


@pytest.fixture
def exchange(host, c_level):
    """Make instances for model exchange, in continuous-time mode."""
    return lambda name, **options: host(name, kind=c_level.MODEL_EXCHANGE, **options).exchange()


def moved(fmu, seed, size=0.3):
    """Set random inputs and states of about their nominal size; return both."""
    rng = np.random.default_rng(seed)
    inputs = dict(zip(fmu.inputs(), rng.uniform(-size, size, len(fmu.inputs())), strict=True))
    states = rng.uniform(-1.0, 1.0, len(fmu.state_names)) * fmu.nominals()
    assert fmu.set_named(inputs) == OK
    assert fmu.set_states(list(states)) == OK
    return inputs, states


@pytest.mark.parametrize("name", ALL)
def test_states_are_the_same_by_array_and_by_value_reference(exchange, name):
    fmu = exchange(name)
    _, states = moved(fmu, 1)
    assert fmu.states().tolist() == states.tolist()
    if len(states) == 0:
        return
    assert fmu.get(*fmu.state_names) == states.tolist()
    assert fmu.get(*fmu.derivative_names) == fmu.derivatives().tolist()
    before = fmu.derivatives()
    assert fmu.set_named(dict(zip(fmu.state_names, (2.0 * states).tolist(), strict=True))) == OK
    assert fmu.states().tolist() == (2.0 * states).tolist()
    assert fmu.derivatives().tolist() != before.tolist()


@pytest.mark.parametrize("name", ALL)
def test_a_start_at_rest_is_an_equilibrium(exchange, name):
    fmu = exchange(name)
    sizes = np.maximum(np.abs(fmu.states()), fmu.nominals())
    assert np.all(np.abs(fmu.derivatives()) <= 1e-9 * sizes)


@pytest.mark.parametrize("name", ["seven_dof", "quarter_car"])
def test_a_cars_states_are_the_modes_of_its_model(exchange, name):
    model = read_vehicle(shipped(name)).coupled()
    form, fmu = modal_form(model), exchange(name)
    inputs, states = moved(fmu, 2)
    u = np.array([inputs[name] for name in model.input_names])
    z = states[: form.sigma.size] + 0j
    modal = form.sigma.size + form.pairs
    z[: form.pairs] += 1j * states[form.sigma.size : modal]
    rates = form.eigenvalues * z + form.B_re @ u + 1j * (form.B_im @ u)
    rest = np.zeros(states.size - modal)  # bristles without force do not move
    expected = np.concatenate([rates.real, rates.imag[: form.pairs], rest])
    np.testing.assert_allclose(fmu.derivatives(), expected, rtol=1e-12, atol=1e-12 * np.abs(expected).max())
    y = form.C_re @ z.real + form.C_im @ z.imag + form.D @ u
    np.testing.assert_allclose(fmu.get(*model.output_names), y, rtol=1e-12, atol=1e-12 * np.abs(y).max())


def test_the_derivatives_of_an_assembly_are_those_of_its_parts_with_the_forces_fed_back(host, exchange, c_level):
    """Nothing is extrapolated: a coupled car evaluated by hand from separate instances has the same derivatives."""
    whole = exchange("assembly")
    _, states = moved(whole, 3)
    laws = {"lf": "lpnl2", "rf": "hysteresis", "lr": "polylinear", "rr": "lpf1"}
    values = dict(zip(whole.state_names, states, strict=True))
    parts = {"car": exchange("seven_dof")} | {corner: exchange(law) for corner, law in laws.items()}
    for part, fmu in parts.items():
        assert fmu.set_states([values[f"{part}.{name}"] for name in fmu.state_names]) == OK
    car = parts["car"]
    own = {n.removeprefix("car."): v for n, v in zip(whole.inputs(), whole.get(*whole.inputs()), strict=True)}
    assert car.set_named(own) == OK
    for corner in laws:
        velocity, displacement = car.get(f"{corner}.velocity", f"{corner}.displacement")
        assert parts[corner].set(velocity=velocity, displacement=displacement) == OK
    assert car.set_named({f"{corner}.force": parts[corner].get("force")[0] for corner in laws}) == OK
    expected = np.concatenate([fmu.derivatives() for fmu in parts.values()])
    np.testing.assert_allclose(whole.derivatives(), expected, rtol=1e-12, atol=1e-12 * np.abs(expected).max())
    outputs = [n for n in whole.outputs() if n.startswith("car.")]
    expected = np.array(car.get(*(n.removeprefix("car.") for n in outputs)))
    np.testing.assert_allclose(whole.get(*outputs), expected, rtol=1e-12, atol=1e-10 * np.abs(expected).max())
    errors = [n for n in whole.outputs() if n.endswith("coupling_error")]
    assert whole.get(*errors) == [0.0] * len(errors)


@pytest.mark.parametrize("name", ALL)
def test_nominal_values_are_those_of_the_description(exchange, name):
    fmu = exchange(name)
    stated = {v.name: v.nominal for v in fmu.description.modelVariables}
    assert fmu.nominals().tolist() == [float(stated[n]) for n in fmu.state_names]
    assert np.all(fmu.nominals() > 0.0)


@pytest.mark.parametrize("name", ALL)
def test_there_are_no_events_and_nothing_to_iterate(host, c_level, name):
    fmu = host(name, kind=c_level.MODEL_EXCHANGE).start()
    info = c_level.fmi2.fmi2EventInfo()
    ctypes.memset(ctypes.byref(info), 0xFF, ctypes.sizeof(info))
    assert fmu.call("NewDiscreteStates", ctypes.byref(info)) == OK
    assert bytes(info) == bytes(ctypes.sizeof(info))
    assert fmu.call("EnterContinuousTimeMode") == OK
    flags = [ctypes.c_int(7), ctypes.c_int(7)]
    assert fmu.call("CompletedIntegratorStep", 1, *map(ctypes.byref, flags)) == OK
    assert [flag.value for flag in flags] == [0, 0]
    assert fmu.description.numberOfEventIndicators == 0
    assert fmu.call("GetEventIndicators", None, ctypes.c_size_t(0)) == OK
    assert fmu.call("GetEventIndicators", (ctypes.c_double * 1)(), ctypes.c_size_t(1)) == ERROR


@pytest.mark.parametrize("name", ALL)
def test_every_function_is_refused_in_the_wrong_mode_and_leaves_the_instance_usable(host, c_level, name):
    """The table of calls in FMI 2.0.4, 3.2.3."""
    info, flags = c_level.fmi2.fmi2EventInfo(), (ctypes.c_int * 2)()
    count = ctypes.c_size_t(len(host(name).state_names))
    states = (ctypes.c_double * 40)()
    calls = {
        "SetTime": (ctypes.c_double(0.0),), "SetContinuousStates": (states, count), "NewDiscreteStates": (info,),
        "GetContinuousStates": (states, count), "GetDerivatives": (states, count), "EnterEventMode": (),
        "EnterContinuousTimeMode": (), "CompletedIntegratorStep": (1, flags, flags),
        "DoStep": (ctypes.c_double(0.0), ctypes.c_double(1e-3), 1), "CancelStep": (),
    }  # fmt: skip
    calls["NewDiscreteStates"] = (ctypes.byref(info),)
    allowed = {
        "instantiated": (),
        "initialization": ("GetContinuousStates", "GetDerivatives"),
        "event": ("SetTime", "GetContinuousStates", "GetDerivatives", "NewDiscreteStates", "EnterEventMode"),
        "continuous": ("SetTime", "GetContinuousStates", "SetContinuousStates", "GetDerivatives",
                       "CompletedIntegratorStep"),
        "terminated": ("GetContinuousStates", "GetDerivatives"),
    }  # fmt: skip
    onward = {
        "instantiated": "EnterInitializationMode", "initialization": "ExitInitializationMode",
        "event": "EnterContinuousTimeMode", "continuous": "Terminate",
    }  # fmt: skip
    fmu = host(name, kind=c_level.MODEL_EXCHANGE)
    for mode, names in allowed.items():
        for function in set(calls) - {onward.get(mode)} - ({"EnterEventMode"} if mode == "continuous" else set()):
            assert (mode, function, fmu.call(function, *calls[function])) == (
                mode, function, OK if function in names else ERROR
            )  # fmt: skip
        if mode in onward:
            assert fmu.call(onward[mode]) == OK
    assert fmu.call("Reset") == OK
    assert np.all(np.isfinite(fmu.exchange().derivatives()))


@pytest.mark.parametrize("name", ALL)
def test_an_instance_for_co_simulation_refuses_model_exchange_and_its_states_cannot_be_set(host, name):
    fmu = host(name).start()
    count, numbers = ctypes.c_size_t(len(fmu.state_names)), (ctypes.c_double * 40)()
    for function, arguments in {
        "SetTime": (ctypes.c_double(0.0),), "EnterEventMode": (), "EnterContinuousTimeMode": (),
        "GetDerivatives": (numbers, count), "GetContinuousStates": (numbers, count),
    }.items():  # fmt: skip
        assert fmu.call(function, *arguments) == ERROR
        assert "this instance is for co-simulation" in fmu.messages_text()
    for state in fmu.state_names:
        assert fmu.set_named({state: 0.0}) == ERROR
        assert f"{state} is a continuous state" in fmu.messages_text()
    assert fmu.step(0.0) == OK


@pytest.mark.parametrize("name", ALL)
def test_derivatives_and_states_can_be_read_in_co_simulation_too(host, exchange, name):
    """They are those of the end of the step; the derivative of a car's mode follows the inputs of the step."""
    stepped, fmu = host(name).start(), exchange(name)
    values = dict.fromkeys(stepped.inputs(), 0.05)
    assert stepped.set_named(values) == stepped.step(0.0, 1e-3) == OK
    if not stepped.state_names:
        return
    assert fmu.set_named(values) == OK
    assert fmu.set_states(stepped.get(*stepped.state_names)) == OK
    if name == "assembly":
        return  # its car's derivatives follow the extrapolated forces
    assert stepped.get(*stepped.derivative_names) == fmu.derivatives().tolist()
    assert stepped.get(*stepped.outputs()) == fmu.get(*stepped.outputs())


@pytest.mark.parametrize("name", ALL)
def test_wrong_numbers_of_states_and_values_that_are_not_finite_are_refused(exchange, name):
    fmu = exchange(name)
    _, states = moved(fmu, 4)
    before, count = fmu.all(), len(states)
    numbers = (ctypes.c_double * 40)()
    for function in ("SetContinuousStates", "GetContinuousStates", "GetDerivatives", "GetNominalsOfContinuousStates"):
        assert fmu.call(function, numbers, ctypes.c_size_t(count + 1)) == ERROR
        if count:
            assert fmu.call(function, None, ctypes.c_size_t(count)) == ERROR
        assert f"give an array of {count} numbers" in fmu.messages_text()
    for bad in (math.nan, math.inf, -math.inf):
        assert fmu.call("SetTime", ctypes.c_double(bad)) == ERROR
        if count:
            assert fmu.set_states([*states[:-1], bad]) == ERROR
            assert fmu.set_named({fmu.state_names[0]: bad}) == ERROR
    for function in ("NewDiscreteStates", "CompletedIntegratorStep"):
        assert fmu.call(function, None, None, None) == ERROR
    assert fmu.all() == before


@pytest.mark.parametrize("name", [n for n in ALL if n not in ("polylinear",)])
def test_a_result_that_is_not_finite_asks_for_a_smaller_step(exchange, name):
    """fmi2Discard; the instance goes on with other states."""
    fmu = exchange(name)
    moved(fmu, 1)
    before, count = fmu.derivatives().tolist(), len(fmu.state_names)
    states, numbers = fmu.states().tolist(), (ctypes.c_double * count)()
    assert fmu.set_states([1e308] * count) == OK
    assert fmu.call("GetDerivatives", numbers, ctypes.c_size_t(count)) == DISCARD
    assert "take a smaller step" in fmu.messages_text()
    assert fmu.set_states(states) == OK
    assert fmu.derivatives().tolist() == before


def test_tunable_parameters_are_set_in_event_mode_and_checked_before_it_ends(exchange):
    fmu = exchange("lpnl2")
    assert fmu.set(lag_zero_force=2000.0) == ERROR
    assert "set it in event mode, not in continuous-time mode" in fmu.messages_text()
    assert fmu.set_named({"velocity": 0.3, "lagged_force": 100.0}) == OK
    before = fmu.derivatives()
    assert fmu.call("EnterEventMode") == OK
    assert fmu.set(lag_zero_force=1.0) == OK
    assert fmu.call("EnterContinuousTimeMode") == ERROR
    assert "lag_zero_force must be greater than lag_full_force" in fmu.messages_text()
    (force,) = ((ctypes.c_double * 1)(),)
    reference = (ctypes.c_uint * 1)(fmu.references["force"])
    assert fmu.call("GetReal", reference, ctypes.c_size_t(1), force) == ERROR
    assert fmu.set(lag_zero_force=2000.0) == fmu.set(time_constant=2.0 * 0.0013) == OK
    assert fmu.call("EnterContinuousTimeMode") == OK
    assert fmu.derivatives() == pytest.approx(0.5 * before, rel=1e-14)
    assert fmu.set_named({"curve.transition_width": 0.01}) == ERROR


def test_the_start_of_a_car_follows_start_at_equilibrium(host, c_level):
    for at_rest in (0, 1):
        fmu = host("seven_dof", kind=c_level.MODEL_EXCHANGE)
        reference = (ctypes.c_uint * 1)(fmu.references["start_at_equilibrium"])
        assert fmu.call("SetBoolean", reference, ctypes.c_size_t(1), (ctypes.c_int * 1)(at_rest)) == OK
        assert fmu.set_named({"heave_force": -4000.0}) == OK
        fmu.exchange()
        assert np.any(fmu.states() != 0.0) == bool(at_rest)
        assert (np.abs(fmu.derivatives()) > 1e-6 * fmu.nominals()).any() == (not at_rest)


@pytest.mark.parametrize("name", ALL)
def test_a_saved_state_restores_states_derivatives_and_mode(exchange, host, c_level, name):
    fmu = exchange(name)
    moved(fmu, 5)
    state = c_level.saved(fmu)
    content, before, rates = c_level.packed(fmu, state), fmu.all(), fmu.derivatives().tolist()
    moved(fmu, 6)
    assert fmu.call("EnterEventMode") == OK
    assert fmu.call("SetFMUstate", state) == OK
    assert (fmu.all(), fmu.derivatives().tolist()) == (before, rates)
    assert fmu.call("CompletedIntegratorStep", 1, (ctypes.c_int * 1)(), (ctypes.c_int * 1)()) == OK
    other = host(name, kind=c_level.MODEL_EXCHANGE)
    status, copy = c_level.unpacked(other, content)
    assert status == OK and other.call("SetFMUstate", copy) == OK
    assert (other.all(), other.derivatives().tolist()) == (before, rates)


@pytest.mark.parametrize("name", ALL)
def test_a_state_of_one_kind_of_instance_is_refused_by_the_other(exchange, host, c_level, name):
    fmu, stepped = exchange(name), host(name).start()
    content = c_level.packed(stepped, c_level.saved(stepped))
    assert c_level.unpacked(fmu, content)[0] == ERROR
    assert fmu.call("SetFMUstate", c_level.saved(stepped)) == ERROR
    assert stepped.call("SetFMUstate", c_level.saved(fmu)) == ERROR
