"""Variables, derivatives and states of FMI 3.0: values are accepted, or refused without any other effect."""

import ctypes
import math
from ctypes import byref, c_bool, c_double, c_int, c_size_t, c_uint, c_void_p

import numpy as np
import pytest

from eightpost.shock import LAWS

from .host3 import CLOCKS, OTHER_TYPES

ALL = (*LAWS, "seven_dof", "quarter_car", "assembly")
SOME = ("lpnl2", "seven_dof", "assembly")
OK, WARNING, DISCARD, ERROR, FATAL = range(5)
NOTHING, ONE = c_size_t(0), c_size_t(1)


@pytest.fixture
def exchange(host_3, c_level_3):
    """Make instances for model exchange."""
    return lambda name, **options: host_3(name, kind=c_level_3.MODEL_EXCHANGE, **options)


@pytest.mark.parametrize("name", ALL)
def test_before_initialization_start_values_and_time_can_be_read_and_nothing_else(host_3, name):
    fmu = host_3(name)
    real = [v for v in fmu.description.modelVariables if v.type == "Float64"]
    given = {v.name: float(v.start) for v in real if v.start is not None}
    assert fmu.get("time", *given, "time") == [0.0, *given.values(), 0.0]
    (first,) = fmu.inputs()[:1]
    assert fmu.set_named({first: 0.25}) == OK
    assert fmu.get(first) == [0.25]
    for variable in real:
        if variable.name not in {*given, "time"}:
            assert fmu.read(variable.name)[0] == ERROR
            assert "a variable has no value before initialization mode" in fmu.messages[-1][2]


def test_time_is_read_at_any_place_of_a_list_and_cannot_be_set(host_3):
    fmu = host_3("lpnl2").start(0.5)
    assert fmu.set(velocity=0.2) == fmu.step(0.5, 0.25) == OK
    velocity, force = fmu.get("velocity", "force")
    assert fmu.get("time", "velocity", "time", "time", "force") == [0.75, velocity, 0.75, 0.75, force]
    assert fmu.get("velocity", "time") == [velocity, 0.75]
    assert fmu.set_named({"velocity": 0.3, "time": 1.0}) == ERROR
    assert "time is not set as a variable" in fmu.messages_text()
    assert fmu.get("velocity", "time") == [velocity, 0.75]


def test_a_refused_list_with_time_computes_nothing(exchange, c_level_3):
    fmu = exchange("lpnl2").exchange()
    assert fmu.set(velocity=0.3) == OK
    before, values = c_level_3.packed(fmu, c_level_3.saved(fmu)), (c_double * 3)()
    references = (c_uint * 3)(fmu.references["force"], fmu.references["time"], 9999999)
    assert fmu.call("GetFloat64", references, c_size_t(3), values, c_size_t(3)) == ERROR
    assert c_level_3.packed(fmu, c_level_3.saved(fmu)) == before
    assert fmu.get("force")[0] != 0.0


def booleans(fmu):
    return [v.name for v in fmu.description.modelVariables if v.type == "Boolean"]


def set_boolean(fmu, *values, names=None):
    count = c_size_t(len(values))
    return fmu.call("SetBoolean", fmu.of(names or booleans(fmu)[:1] * len(values)), count,
                    (c_bool * len(values))(*values), count)  # fmt: skip


def get_boolean(fmu, count=1):
    values = (c_bool * count)(*[None] * count)
    status = fmu.call("GetBoolean", fmu.of(booleans(fmu)[:1] * count), c_size_t(count), values, c_size_t(count))
    return status, list(values)


@pytest.mark.parametrize("name", ["seven_dof", "quarter_car", "assembly"])
def test_a_boolean_that_is_set_is_returned_also_twice_in_a_list(host_3, c_level_3, name):
    fmu = host_3(name)
    start = next(v.start for v in fmu.description.modelVariables if v.type == "Boolean") == "true"
    assert get_boolean(fmu) == (OK, [start])
    for value in (False, True, False):
        assert set_boolean(fmu, value) == OK
        assert get_boolean(fmu, 3) == (OK, [value] * 3)
    assert fmu.enter() == OK
    assert set_boolean(fmu, False, True, True) == OK
    assert get_boolean(fmu) == (OK, [True])
    references = (c_uint * 2)(fmu.references[booleans(fmu)[0]], 0)
    fmu.get(*fmu.outputs())  # computes them
    before = c_level_3.packed(fmu, c_level_3.saved(fmu))
    assert fmu.call("SetBoolean", references, c_size_t(2), (c_bool * 2)(False, False), c_size_t(2)) == ERROR
    assert c_level_3.packed(fmu, c_level_3.saved(fmu)) == before
    assert get_boolean(fmu) == (OK, [True])
    assert fmu.call("ExitInitializationMode") == OK
    assert set_boolean(fmu, False) == ERROR
    assert "is fixed: set it before initialization ends" in fmu.messages_text()
    assert get_boolean(fmu) == (OK, [True])


def test_a_start_follows_a_boolean_parameter(host_3):
    found = []
    for at_rest in (False, True):
        fmu = host_3("seven_dof")
        assert set_boolean(fmu, at_rest) == fmu.set(heave_force=-4000.0) == OK
        found.append(fmu.start().get("lf.displacement")[0])
    assert found[0] == 0.0 and abs(found[1]) > 1e-3


@pytest.mark.parametrize("name", SOME)
def test_null_arrays_unknown_references_and_wrong_counts_are_errors(host_3, name):
    fmu = host_3(name)
    for phase in range(4):
        if phase:
            fmu.enter() if phase == 1 else fmu.call("ExitInitializationMode" if phase == 2 else "Terminate")
        number, flag = (c_double * 2)(), (c_bool * 2)()
        for function, values in (("GetFloat64", number), ("SetFloat64", number), ("GetBoolean", flag),
                                 ("SetBoolean", flag)):  # fmt: skip
            known = (c_uint * 2)(*[fmu.references[(fmu.inputs() if "Float" in function else booleans(fmu) or [
                fmu.inputs()[0]])[0]]] * 2)  # fmt: skip
            assert fmu.call(function, None, ONE, values, ONE) == ERROR
            assert fmu.call(function, known, ONE, None, ONE) == ERROR
            for unknown in (9999999, 4294967295, 1000000 if function != "GetFloat64" else 1000001):
                assert fmu.call(function, (c_uint * 1)(unknown), ONE, values, ONE) == ERROR
            for counts in ((ONE, c_size_t(2)), (c_size_t(2), ONE), (ONE, NOTHING), (NOTHING, ONE)):
                assert fmu.call(function, known, counts[0], values, counts[1]) == ERROR
                assert "give one value for each reference" in fmu.messages[-1][2]
        if phase < 3:
            assert fmu.call("SetFloat64", None, NOTHING, None, NOTHING) == OK
        assert fmu.call("GetFloat64", None, NOTHING, None, NOTHING) == OK


@pytest.mark.parametrize("name", SOME)
def test_of_other_types_an_empty_list_is_accepted_and_any_reference_is_an_error(host_3, name):
    fmu, eight = host_3(name).start(), (ctypes.c_int64 * 4)()
    for other in OTHER_TYPES:
        for function in (f"Get{other}", f"Set{other}"):
            assert fmu.call(function, None, NOTHING, None, NOTHING) == OK
            for counts in ((ONE, ONE), (NOTHING, ONE), (ONE, NOTHING)):
                assert fmu.call(function, (c_uint * 1)(0), counts[0], eight, counts[1]) == ERROR
                assert fmu.messages[-1][2] == f"fmi3{function}: this FMU has no variable of that type"
    for function in ("GetBinary", "SetBinary"):
        assert fmu.call(function, None, NOTHING, None, None, NOTHING) == OK
        for counts in ((ONE, ONE), (NOTHING, ONE), (ONE, NOTHING)):
            assert fmu.call(function, (c_uint * 1)(0), counts[0], eight, eight, counts[1]) == ERROR
    for function, arrays in CLOCKS.items():
        assert fmu.call(function, None, NOTHING, *[None] * arrays) == OK
        assert fmu.call(function, (c_uint * 1)(0), ONE, *[eight] * arrays) == ERROR
        assert fmu.messages[-1][2] == f"fmi3{function}: this FMU has no variable of that type"
    assert fmu.step(0.0) == OK


@pytest.mark.parametrize("name", SOME)
def test_invalid_derivatives_are_refused(host_3, exchange, name):
    fmu = host_3(name).start()
    known, output = fmu.inputs()[0], fmu.outputs()[0]
    for function in ("GetDirectionalDerivative", "GetAdjointDerivative"):
        assert fmu.tangent([output], [known], [1.0], function=function)[0] == OK
        assert fmu.tangent([known], [known], [1.0], function=function)[0] == ERROR
        assert fmu.tangent([output], [output], [1.0], function=function)[0] == ERROR
        assert fmu.tangent([output], ["time"], [1.0], function=function)[0] == ERROR
        assert fmu.tangent([output], [known], [1.0, 1.0], function=function)[0] == ERROR
        one = (c_double * 1)(1.0)
        for k in (0, 2, 4, 6):
            arguments = [fmu.of([output]), ONE, fmu.of([known]), ONE, one, ONE, one, ONE]
            assert fmu.call(function, *arguments[:k], None, *arguments[k + 1 :]) == ERROR
            assert fmu.call(function, *arguments[:k], arguments[k], NOTHING, *arguments[k + 2 :]) == ERROR
    assert fmu.tangent([output], [], [1.0], function="GetAdjointDerivative")[0] == OK
    status, found = fmu.tangent([], [known], [], function="GetAdjointDerivative")
    assert status == OK and found.tolist() == [0.0]
    assert fmu.call("GetOutputDerivatives", fmu.of([output]), ONE, (c_int * 1)(1), one, ONE) == ERROR
    assert "fmi3GetOutputDerivatives: output derivatives are not supported" in fmu.messages[-1][2]
    assert fmu.call("GetOutputDerivatives", fmu.of([output]), ONE, (c_int * 1)(1), one, NOTHING) == ERROR


@pytest.mark.parametrize("name", ALL)
def test_states_of_model_exchange_are_counted_and_wrong_arrays_are_refused(exchange, name):
    fmu, size = exchange(name), c_size_t(99)
    assert fmu.call("GetNumberOfContinuousStates", byref(size)) == OK
    assert size.value == len(fmu.state_names)
    assert fmu.call("GetNumberOfEventIndicators", byref(size)) == OK
    assert size.value == 0
    fmu.exchange()
    numbers, count = (c_double * 40)(), len(fmu.state_names)
    before = fmu.all()
    for function in (
        "SetContinuousStates",
        "GetContinuousStates",
        "GetContinuousStateDerivatives",
        "GetNominalsOfContinuousStates",
    ):
        assert fmu.call(function, numbers, c_size_t(count + 1)) == ERROR
        assert count == 0 or fmu.call(function, None, c_size_t(count)) == ERROR
    assert fmu.call("GetEventIndicators", numbers, ONE) == ERROR
    assert fmu.call("SetTime", c_double(math.nan)) == ERROR
    flags = [c_bool(True), c_bool(True)]
    assert fmu.call("CompletedIntegratorStep", False, *map(byref, flags)) == OK
    assert [flag.value for flag in flags] == [False, False]
    flag = byref(c_bool())
    for arguments in ((None, flag), (flag, None)):
        assert fmu.call("CompletedIntegratorStep", True, *arguments) == ERROR
    for function in ("GetNumberOfContinuousStates", "GetNumberOfEventIndicators"):
        assert fmu.call(function, None) == ERROR
    assert fmu.call("EnterEventMode") == OK
    assert fmu.discrete() == (OK, [False] * 5, 0.0)
    for k in range(6):
        arguments = [flag] * 5 + [byref(c_double())]
        assert fmu.call("UpdateDiscreteStates", *arguments[:k], None, *arguments[k + 1 :]) == ERROR
    assert fmu.all() == before


@pytest.mark.parametrize("name", ["lpnl2", "seven_dof"])
def test_a_state_that_is_not_one_of_this_fmu_is_refused(host_3, c_level_3, name):
    fmu, size = host_3(name).start(), c_size_t()
    state, stranger = c_level_3.saved(fmu), host_3("lpf1").start()
    foreign = c_level_3.saved(stranger)
    for function, arguments in {
        "GetFMUState": (None,),
        "SetFMUState": (None,),
        "SerializedFMUStateSize": (state, None),
        "SerializeFMUState": (state, None, c_size_t(10**6)),
        "DeserializeFMUState": (None, c_size_t(4), byref(c_void_p())),
    }.items():
        assert fmu.call(function, *arguments) == ERROR
        assert fmu.messages[-1][2].startswith(f"fmi3{function}: ")
    assert fmu.call("SetFMUState", foreign) == fmu.call("SerializedFMUStateSize", foreign, byref(size)) == ERROR
    assert fmu.call("FreeFMUState", byref(foreign)) == ERROR
    assert fmu.call("FreeFMUState", byref(c_void_p())) == fmu.call("FreeFMUState", None) == OK
    assert fmu.call("SerializeFMUState", state, (ctypes.c_char * 8)(), c_size_t(8)) == ERROR


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
