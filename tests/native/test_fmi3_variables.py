"""Variables, derivatives and states of FMI 3.0: values are accepted, or refused without any other effect."""

import ctypes
import math
from ctypes import byref, c_bool, c_double, c_int, c_size_t, c_uint, c_void_p

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
