"""FMUs of FMI 3.0 give the results of those of FMI 2.0, to the bit."""

import ctypes

import numpy as np
import pytest

from eightpost.shock import LAWS

ALL = (*LAWS, "seven_dof", "quarter_car", "assembly")
OK, WARNING, DISCARD, ERROR, FATAL = range(5)
HEADER = 40  # bytes of a serialized state before the instance's memory, which contain the GUID


@pytest.fixture
def both(host, host_3, c_level, c_level_3):
    """Make an instance of each version, and a function that compares their whole memories."""

    def make(name, *, kind="co-simulation", **options):
        is_exchange = kind == "model exchange"
        old = host(name, kind=c_level.MODEL_EXCHANGE if is_exchange else c_level.CO_SIMULATION)
        new = host_3(name, kind=c_level_3.MODEL_EXCHANGE if is_exchange else c_level_3.CO_SIMULATION, **options)
        return old, new

    return make


@pytest.fixture
def memories(c_level, c_level_3):
    """Return the memories of an instance of each version: variables, states, slopes, time."""

    def read(old, new):
        return (c_level.packed(old, c_level.saved(old))[HEADER:], c_level_3.packed(new, c_level_3.saved(new))[HEADER:])

    return read


def tunables(fmu):
    return [
        v
        for v in fmu.description.modelVariables
        if v.causality == "parameter" and v.variability == "tunable" and v.type == "Real"
        if "knot" not in v.name
    ]


def random_inputs(fmu, rng, share=1.0):
    return {name: rng.uniform(-0.4, 0.4) for name in fmu.inputs() if rng.random() < share}


def set_random_parameter(old, new, rng):
    """Set a tunable parameter of both to a value that is usually allowed; return the status, which is the same."""
    variable = tunables(old)[rng.integers(len(tunables(old)))]
    start = float(variable.start)
    value = start * rng.uniform(0.8, 1.2) if start else rng.uniform(0.0, 90.0)
    value = value if variable.min is None else max(value, float(variable.min))
    status = old.set_named({variable.name: value})
    assert new.set_named({variable.name: value}) == status
    return status


def random_step(old, new, rng, time):
    """Make a step of random length with random inputs and sometimes a new parameter; return its end."""
    if rng.random() < 0.3:
        set_random_parameter(old, new, rng)
    values, step = random_inputs(old, rng, 0.8), 10.0 ** rng.uniform(-6.0, -1.6)
    assert old.set_named(values) == new.set_named(values) == OK
    status = old.step(time, step)
    assert new.step(time, step) == status
    assert new.all() == old.all()
    assert [flag.value for flag in new.results[:3]] == [False] * 3
    assert new.results[3].value == new.get("time")[0] == (time + step if status == OK else time)
    return new.results[3].value


# ---- Co-simulation --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ALL)
def test_steps_with_held_inputs_and_changed_parameters_equal_those_of_fmi_2(both, memories, name):
    (old, new), rng, time = both(name), np.random.default_rng(1), -1.5
    for fmu in (old, new):
        fmu.start(time)
    assert new.all() == old.all()
    for _ in range(60):
        time = random_step(old, new, rng, time)
    assert time > -1.5
    equal = memories(old, new)
    assert equal[0] == equal[1]
    assert old.messages_text().count("fmi2") == new.messages_text().count("fmi3")


@pytest.mark.parametrize("name", ALL)
def test_start_values_and_variables_of_initialization_equal_those_of_fmi_2(both, name):
    (old, new), rng = both(name), np.random.default_rng(2)
    starts = {v.name: v.start for v in old.description.modelVariables if v.type == "Real" and v.start is not None}
    assert new.get(*starts) == [float(start) for start in starts.values()]
    assert old.call("EnterInitializationMode") == new.enter() == OK
    values = random_inputs(old, rng)
    assert old.set_named(values) == new.set_named(values) == OK
    assert set_random_parameter(old, new, rng) == OK
    assert new.all() == old.all()


@pytest.mark.parametrize("name", ALL)
def test_restored_and_serialized_states_continue_as_those_of_fmi_2(both, host_3, c_level, c_level_3, name):
    (old, new), rng, time = both(name), np.random.default_rng(3), 0.0
    for fmu in (old, new):
        fmu.start()
    for _ in range(5):
        time = random_step(old, new, rng, time)
    states = c_level.saved(old), c_level_3.saved(new)
    content, before = c_level_3.packed(new, states[1]), new.all()
    end = time
    for _ in range(5):
        end = random_step(old, new, np.random.default_rng(4), end)
    after = new.all()
    assert before != after
    assert old.call("SetFMUstate", states[0]) == new.call("SetFMUState", states[1]) == OK
    assert new.all() == before and new.get("time") == [time]
    assert c_level_3.packed(new, c_level_3.saved(new)) == content
    other = host_3(name)
    status, copy = c_level_3.unpacked(other, content)
    assert status == other.call("SetFMUState", copy) == OK
    end = time
    for _ in range(5):
        end = random_step(old, other, np.random.default_rng(4), end)
    assert other.all() == after
    assert new.call("FreeFMUState", ctypes.byref(states[1])) == OK and states[1].value is None


@pytest.mark.parametrize("name", ["lpnl2", "seven_dof"])
def test_damaged_states_and_those_of_the_other_version_or_kind_are_refused(both, c_level, c_level_3, name):
    (old, new), (_, exchange) = both(name), both(name, kind="model exchange")
    for fmu in (old, new, exchange):
        fmu.start()
    content = c_level_3.packed(new, c_level_3.saved(new))
    assert c_level_3.unpacked(new, content)[0] == OK
    for broken in (content[:-1], content[:60] + b"!" + content[61:], c_level.packed(old, c_level.saved(old))):
        assert c_level_3.unpacked(new, broken)[0] == ERROR
    assert c_level_3.unpacked(exchange, content)[0] == ERROR
    assert exchange.call("SetFMUState", c_level_3.saved(new)) == ERROR


# ---- Inputs that change during a step -------------------------------------------------------------------------------


def ramped_step(old, new, targets, time, step):
    """Make a step to new inputs: with derivatives in FMI 2.0, with an intermediate update in FMI 3.0."""
    known = dict(zip(old.inputs(), old.get(*old.inputs()), strict=True))
    slopes = {name: (value - known[name]) / step for name, value in targets.items()}
    set_statuses = []
    new.update = lambda fmu, _: set_statuses.append(fmu.set_named(targets))
    new.updates.clear()
    assert old.set_slopes(slopes) == OK
    status = old.step(time, step)
    assert new.step(time, step) == status
    assert set_statuses == [OK]
    assert new.updates == [(time + step, True, False, False, False)]
    return status


@pytest.mark.parametrize("name", ALL)
def test_inputs_of_an_intermediate_update_equal_input_derivatives_of_fmi_2(both, memories, name):
    """Of all inputs, of some and of none, after inputs that were set before the step and after none."""
    (old, new), rng, time = both(name, update=lambda *_: None), np.random.default_rng(5), 0.25
    for fmu in (old, new):
        fmu.start(time)
    for k in range(40):
        values, step = random_inputs(old, rng, 0.5 * (k % 2)), 10.0 ** rng.uniform(-5.0, -2.0)
        assert old.set_named(values) == new.set_named(values) == OK
        assert ramped_step(old, new, random_inputs(old, rng, (0.0, 0.5, 1.0)[k % 3]), time, step) == OK
        time = new.get("time")[0]
        assert new.all() == old.all()
    equal = memories(old, new)
    assert equal[0] == equal[1]


def unchanged(fmu, c_level_3, status, *step):
    """Check that a step has a status and changes nothing."""
    before = c_level_3.packed(fmu, c_level_3.saved(fmu))
    assert fmu.step(*step) == status
    assert c_level_3.packed(fmu, c_level_3.saved(fmu)) == before


@pytest.mark.parametrize("name", ALL)
def test_a_refused_step_with_an_update_changes_nothing(both, c_level_3, name):
    old, new = both(name, update=lambda fmu, _: fmu.set_named(dict.fromkeys(fmu.inputs(), 0.3)))
    for fmu in (old, new):
        fmu.start(0.0, stop=1.0)
        assert fmu.set_named(dict.fromkeys(old.inputs(), 0.1)) == OK
    for step in ((0.5, 1e-3), (0.0, 2.0), (np.nan, 1e-3), (0.0, 0.0), (0.0, -1.0), (0.0, np.inf)):
        unchanged(new, c_level_3, ERROR, *step)
    for flags in ([None] * 4, [ctypes.byref(ctypes.c_bool())] * 3 + [None]):
        assert new.call("DoStep", ctypes.c_double(0.0), ctypes.c_double(1e-3), True, *flags) == ERROR
    assert not new.updates  # the host is asked for the inputs of a valid step only
    new.update = lambda *_: None
    assert old.step(0.0) == new.step(0.0) == OK
    assert new.all() == old.all()


@pytest.mark.parametrize("name", [n for n in ALL if n not in ("polylinear",)])
def test_a_discarded_step_with_an_update_changes_nothing(both, c_level_3, name):
    old, new = both(name, update=lambda fmu, _: fmu.set_named(dict.fromkeys(fmu.inputs(), 1e308)))
    for fmu in (old, new):
        fmu.start()
        assert fmu.set_named(dict.fromkeys(old.inputs(), -1e308)) == OK
    unchanged(new, c_level_3, DISCARD, 0.0, 1e-3)
    assert new.results[3].value == 0.0
    new.update = lambda *_: None
    for fmu in (old, new):
        assert fmu.set_named(dict.fromkeys(old.inputs(), 0.1)) == fmu.step(0.0) == OK
    assert new.all() == old.all()


def test_the_slope_of_a_saved_state_is_kept_by_a_refused_step(host_3, c_level_3):
    """Another program can write a state with slopes; no call of FMI 3.0 sets them."""
    fmu = host_3("polylinear").start()
    content = bytearray(c_level_3.packed(fmu, c_level_3.saved(fmu)))
    content[HEADER + 32 : HEADER + 40] = np.float64(7.0).tobytes()
    checksum = int.from_bytes(content[16:24], "little")
    for byte in content[HEADER:]:
        checksum = (checksum ^ byte) * 1099511628211 % 2**64
    content[32:40] = checksum.to_bytes(8, "little")
    status, state = c_level_3.unpacked(fmu, bytes(content))
    assert status == fmu.call("SetFMUState", state) == OK
    unchanged(fmu, c_level_3, ERROR, 5.0, 1e-3)
    assert fmu.step(0.0, 0.01) == OK
    assert fmu.get(fmu.inputs()[0]) == [pytest.approx(0.07)]


# ---- Model exchange -------------------------------------------------------------------------------------------------


def moved(old, new, rng):
    """Set random inputs and states of about their nominal size in both."""
    values = random_inputs(old, rng)
    states = list(rng.uniform(-1.0, 1.0, len(old.state_names)) * old.nominals())
    assert old.set_named(values) == new.set_named(values) == OK
    assert old.set_states(states) == new.set_states(states) == OK


@pytest.mark.parametrize("name", ALL)
def test_states_derivatives_and_outputs_of_model_exchange_equal_those_of_fmi_2(both, memories, name):
    (old, new), rng = both(name, kind="model exchange"), np.random.default_rng(7)
    for fmu in (old, new):
        fmu.exchange(0.5)
    assert new.nominals().tolist() == old.nominals().tolist()
    assert (new.state_names, new.derivative_names) == (old.state_names, old.derivative_names)
    for k in range(8):
        time = ctypes.c_double(0.5 + k)
        assert old.call("SetTime", time) == new.call("SetTime", time) == OK
        if k % 3 == 2:
            assert old.call("EnterEventMode") == new.call("EnterEventMode") == OK
            assert set_random_parameter(old, new, rng) == OK
            assert old.call("EnterContinuousTimeMode") == new.call("EnterContinuousTimeMode") == OK
        moved(old, new, rng)
        assert new.states().tolist() == old.states().tolist()
        assert new.derivatives().tolist() == old.derivatives().tolist()
        assert new.all() == old.all()
        assert new.get("time") == [0.5 + k]
    equal = memories(old, new)
    assert equal[0] == equal[1]


def jacobian(fmu, unknowns, knowns):
    """Return the derivatives of unknowns (rows) by knowns (columns) by one directional derivative for each."""
    columns = []
    for known in knowns:
        rows = [fmu.tangent([unknown], [known], [1.0]) for unknown in unknowns]
        assert all(status == OK for status, _ in rows)
        columns.append([float(values[0]) for _, values in rows])
    return np.array(columns).T


def assert_derivatives_are_those_of_fmi_2(old, new, unknowns, knowns, rng):
    seed = rng.uniform(-1.0, 1.0, len(knowns))
    assert new.tangent(unknowns, knowns, seed)[0] == OK
    assert new.tangent(unknowns, knowns, seed)[1].tolist() == old.tangent(unknowns, knowns, seed)[1].tolist()
    matrix, seed = jacobian(old, unknowns, knowns), rng.uniform(-1.0, 1.0, len(unknowns))
    status, found = new.tangent(unknowns, knowns, seed, function="GetAdjointDerivative")
    expected = [sum(weight * value for weight, value in zip(seed, column, strict=True)) for column in matrix.T]
    assert status == OK
    assert found.tolist() == expected


@pytest.mark.parametrize("name", ALL)
def test_directional_and_adjoint_derivatives_equal_those_of_fmi_2(both, name):
    rng = np.random.default_rng(8)
    old, new = both(name, kind="model exchange")
    for fmu in (old, new):
        fmu.exchange()
    moved(old, new, rng)
    unknowns, knowns = [*old.outputs(), *old.derivative_names], [*old.inputs(), *old.state_names]
    assert_derivatives_are_those_of_fmi_2(old, new, unknowns, knowns, rng)
    old, new = both(name)
    for fmu in (old, new):
        assert fmu.start().set_named(dict.fromkeys(old.inputs(), 0.11)) == fmu.step(0.0) == OK
    assert_derivatives_are_those_of_fmi_2(old, new, old.outputs(), old.inputs(), rng)


@pytest.mark.parametrize("name", ["lpnl2", "quarter_car"])
def test_derivatives_in_initialization_equal_those_of_fmi_2(both, name):
    old, new = both(name)
    assert old.call("EnterInitializationMode") == new.enter() == OK
    knowns = [*old.inputs(), *(v.name for v in tunables(old))]
    assert_derivatives_are_those_of_fmi_2(old, new, old.outputs(), knowns, np.random.default_rng(9))
