"""The life cycle of FMI 3.0: every call is accepted, or refused with the reason and without any other effect."""

import ctypes
import math
import re
import xml.etree.ElementTree as ET
from ctypes import byref, c_bool, c_double, c_size_t, c_uint, c_void_p

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


# ---- Creation -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"token": "{0}"}, "fmi3InstantiateCoSimulation: the instantiationToken of modelDescription.xml is not that"),
        ({"token": "{0}", "kind": "ModelExchange"}, "fmi3InstantiateModelExchange: the instantiationToken"),
        ({"name": ""}, "the instance has no name"),
        ({"event_mode": True}, "event mode is not offered"),
        ({"required": [2]}, "a required intermediate variable is not an input"),
        ({"required": [0, 1000000]}, "a required intermediate variable is not an input"),
        ({"required": [4294967295]}, "a required intermediate variable is not an input"),
        ({"kind": "ScheduledExecution"}, "fmi3InstantiateScheduledExecution: scheduled execution is not offered"),
    ],
)
def test_an_invalid_instantiation_is_refused_with_the_reason(host_3, options, reason):
    fmu = host_3("lpnl2", **options)
    assert fmu.c is None
    ((status, category, message),) = fmu.messages
    assert (status, category) == (ERROR, "logStatusError") and reason in message
    assert host_3("lpnl2", has_log=False, **options).c is None


def test_all_inputs_may_be_required_intermediate_variables(host_3):
    assert host_3("seven_dof", required=[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10]).start().step(0.0) == OK
    make = host_3("lpf1").dll.fmi3InstantiateCoSimulation
    token = host_3("lpf1").description.instantiationToken.encode()
    flags = [c_bool(False)] * 4
    assert make(b"x", token, None, *flags, None, c_size_t(2), None, None, None) is None
    assert make(None, token, None, *flags, None, NOTHING, None, None, None) is None
    assert make(b"x", None, None, *flags, None, NOTHING, None, None, None) is None


def test_the_version_is_that_of_the_headers(host_3):
    version = host_3("lpf1").dll.fmi3GetVersion
    version.restype = ctypes.c_char_p
    assert version() == b"3.0"


# ---- Phases ---------------------------------------------------------------------------------------------------------


def phase_calls(fmu):
    """Return calls with valid arguments, as functions without arguments."""
    flags, number = [c_bool() for _ in range(5)], c_double()
    states = (c_double * 40)()
    count = c_size_t(len(fmu.state_names))
    size = c_size_t()
    return {
        "ExitInitializationMode": (),
        "Terminate": (),
        "DoStep": (c_double(0.0), c_double(1e-3), True, *map(byref, flags[:3]), byref(number)),
        "EnterStepMode": (),
        "EnterConfigurationMode": (),
        "ExitConfigurationMode": (),
        "ActivateModelPartition": (c_uint(0), c_double(0.0)),
        "EnterEventMode": (),
        "EvaluateDiscreteStates": (),
        "UpdateDiscreteStates": (*map(byref, flags), byref(number)),
        "EnterContinuousTimeMode": (),
        "CompletedIntegratorStep": (True, byref(flags[0]), byref(flags[1])),
        "SetTime": (c_double(0.0),),
        "GetContinuousStates": (states, count),
        "SetContinuousStates": (states, count),
        "GetContinuousStateDerivatives": (states, count),
        "GetNominalsOfContinuousStates": (states, count),
        "GetEventIndicators": (None, NOTHING),
        "GetNumberOfContinuousStates": (byref(size),),
        "GetNumberOfEventIndicators": (byref(size),),
        "GetOutputDerivatives": (None, NOTHING, None, None, NOTHING),
        "GetDirectionalDerivative": (None, NOTHING, None, NOTHING, None, NOTHING, None, NOTHING),
        "GetAdjointDerivative": (None, NOTHING, None, NOTHING, None, NOTHING, None, NOTHING),
        "GetNumberOfVariableDependencies": (c_uint(2), byref(size)),
        "GetVariableDependencies": (c_uint(2), None, None, None, None, NOTHING),
    }


DERIVATIVES = ("GetDirectionalDerivative", "GetAdjointDerivative")
COUNTS = ("GetNumberOfContinuousStates", "GetNumberOfEventIndicators", "GetNominalsOfContinuousStates")
READ = ("GetContinuousStates", "GetContinuousStateDerivatives", "GetEventIndicators")

#: Kind of instance -> phase -> functions that are allowed, and the one that leads to the next phase.
ALLOWED = {
    "CoSimulation": {
        "instantiated": ((), None),
        "initialization": (("EvaluateDiscreteStates", *DERIVATIVES), "ExitInitializationMode"),
        "step": (("DoStep", "GetOutputDerivatives", *DERIVATIVES), "Terminate"),
        "terminated": (("GetOutputDerivatives", *DERIVATIVES), None),
    },
    "ModelExchange": {
        "instantiated": (COUNTS, None),
        "initialization": (("EvaluateDiscreteStates", *COUNTS, *READ, *DERIVATIVES), "ExitInitializationMode"),
        "event": (("EvaluateDiscreteStates", "UpdateDiscreteStates", "EnterEventMode", "SetTime", *COUNTS, *READ,
                   *DERIVATIVES), "EnterContinuousTimeMode"),
        "continuous": (("CompletedIntegratorStep", "SetTime", "SetContinuousStates", *COUNTS, *READ, *DERIVATIVES),
                       "Terminate"),
        "terminated": (("GetOutputDerivatives", *COUNTS, *READ, *DERIVATIVES), None),
    },
}  # fmt: skip


@pytest.mark.parametrize("kind", ALLOWED)
@pytest.mark.parametrize("name", ALL)
def test_every_function_is_allowed_in_its_phases_only(host_3, name, kind):
    fmu = host_3(name, kind=kind)
    calls = phase_calls(fmu)
    for phase, (allowed, onward) in ALLOWED[kind].items():
        if phase == "continuous":
            assert fmu.call("EnterEventMode") == fmu.call("EnterContinuousTimeMode") == OK
        for function in set(calls) - {onward, "EnterEventMode" if phase == "continuous" else "", "Terminate"}:
            fmu.messages.clear()
            status = fmu.call(function, *calls[function])
            assert (phase, function, status) == (phase, function, OK if function in allowed else ERROR)
            assert status == OK or fmu.messages[-1][2].startswith(f"fmi3{function}: ")
        if phase == "instantiated":
            assert fmu.call("Terminate") == ERROR
            assert fmu.enter() == OK
            assert fmu.enter() == ERROR
        elif onward is not None:
            assert fmu.call(onward) == OK
    assert fmu.call("Terminate") == ERROR
    assert fmu.call("Reset") == OK
    assert fmu.start().get("time") == [0.0]


@pytest.mark.parametrize("name", SOME)
def test_a_reset_restores_start_values_and_the_rerun_is_the_same(host_3, name):
    fmu, name = host_3(name), host_3(name).inputs()[0]

    def run():
        fmu.start(1.0)
        assert fmu.set_named({name: 0.2}) == fmu.step(1.0) == OK
        return fmu.all()

    first = run()
    assert fmu.step(1.001) == OK
    assert fmu.call("Reset") == OK
    assert fmu.get(name, "time") == [0.0, 0.0]
    assert run() == first


def test_start_and_stop_time_are_checked(host_3):
    fmu = host_3("lpf1")
    for start, stop in ((math.nan, None), (math.inf, None), (1.0, 0.5), (0.0, math.nan)):
        assert fmu.enter(start, stop) == ERROR
        assert fmu.messages[-1][2].startswith("fmi3EnterInitializationMode: the st")
    fmu.start(2.0, stop=2.001)
    assert fmu.get("time") == [2.0]
    assert fmu.step(2.0) == OK
    assert fmu.step(2.001) == ERROR
    assert "after the stop time" in fmu.messages_text()


def test_a_null_instance_is_an_error_for_every_function(host_3):
    fmu = host_3("lpf1")
    kept, fmu.c = fmu.c, None
    calls = phase_calls(fmu) | {
        "Reset": (),
        "SetDebugLogging": (False, NOTHING, None),
        "EnterInitializationMode": (False, c_double(), c_double(), False, c_double()),
        "GetFMUState": (byref(c_void_p()),),
        "SetFMUState": (None,),
        "FreeFMUState": (byref(c_void_p()),),
        "SerializedFMUStateSize": (None, byref(c_size_t())),
        "SerializeFMUState": (None, None, NOTHING),
        "DeserializeFMUState": (None, NOTHING, byref(c_void_p())),
        **{f"{way}{kind}": (None, NOTHING, None, NOTHING) for way in ("Get", "Set")
           for kind in ("Float64", "Boolean", *OTHER_TYPES)},
        **{f"{way}Binary": (None, NOTHING, None, None, NOTHING) for way in ("Get", "Set")},
        **{function: (None, NOTHING, *[None] * arrays) for function, arrays in CLOCKS.items()},
    }  # fmt: skip
    for function, arguments in calls.items():
        assert (function, fmu.call(function, *arguments)) == (function, ERROR)
    fmu.dll.fmi3FreeInstance(None)
    fmu.c = kept


@pytest.mark.parametrize("name", SOME)
def test_in_an_intermediate_update_inputs_can_be_set_and_every_other_call_is_refused(host_3, c_level_3, name):
    """A refused call has no effect on the step."""
    found = {}

    def meddle(fmu, time):
        number, state = (c_double * 1)(0.5), c_void_p()
        reference = fmu.of(fmu.inputs()[:1])
        calls = phase_calls(fmu) | {
            "GetFloat64": (reference, ONE, number, ONE),
            "GetBoolean": (None, NOTHING, None, NOTHING),
            "SetBoolean": (None, NOTHING, None, NOTHING),
            "GetInt32": (None, NOTHING, None, NOTHING),
            "SetClock": (None, NOTHING, None),
            "GetFMUState": (byref(state),),
            "SetFMUState": (kept,),
            "FreeFMUState": (byref(kept),),
            "SerializedFMUStateSize": (kept, byref(c_size_t())),
            "SerializeFMUState": (kept, (ctypes.c_char * 10**5)(), c_size_t(10**5)),
            "DeserializeFMUState": (content, c_size_t(len(content)), byref(state)),
            "Reset": (),
            "SetDebugLogging": (False, NOTHING, None),
            "EnterInitializationMode": (False, c_double(), c_double(), False, c_double()),
        }
        for function, arguments in calls.items():
            fmu.messages.clear()
            found[function] = fmu.call(function, *arguments)
            assert fmu.messages[-1][2].startswith(f"fmi3{function}: is not allowed during an intermediate update") or (
                function in ("EnterStepMode", "EnterConfigurationMode", "ExitConfigurationMode",
                             "ActivateModelPartition", "GetNumberOfVariableDependencies", "GetVariableDependencies")
            )  # fmt: skip
        tunable = next(v for v in fmu.description.modelVariables if v.variability == "tunable")
        found["parameter"] = fmu.set_named({fmu.inputs()[0]: 0.2, tunable.name: float(tunable.start)})
        found["not finite"] = fmu.set_named({fmu.inputs()[0]: math.nan})
        found["output"] = fmu.set_named({fmu.outputs()[0]: 0.2})
        found["time"] = fmu.set_named({"time": time})
        found["null"] = fmu.call("SetFloat64", None, ONE, number, ONE)
        assert fmu.set_named({}) == fmu.set_named({fmu.inputs()[0]: 0.1}) == OK

    fmu = host_3(name, update=meddle).start()
    kept = c_level_3.saved(fmu)
    content = c_level_3.packed(fmu, kept)
    assert fmu.step(0.0) == OK
    assert set(found.values()) == {ERROR} and len(found) > 40
    plain = host_3(name, update=lambda fmu, _: fmu.set_named({fmu.inputs()[0]: 0.1})).start()
    assert plain.step(0.0) == OK
    assert fmu.all() == plain.all()
    assert fmu.get("time") == [1e-3] and fmu.call("FreeFMUState", byref(kept)) == OK


def test_an_update_is_asked_for_in_steps_only(host_3, exchange):
    fmu = host_3("lpnl2", update=lambda *_: None)
    assert fmu.step(0.0) == ERROR
    fmu.start()
    for k in range(3):
        assert fmu.step(k * 1e-3) == OK
    assert [time for time, *_ in fmu.updates] == [1e-3, 2e-3, 3e-3]
    assert fmu.call("Terminate") == OK
    assert fmu.step(3e-3) == ERROR
    assert len(fmu.updates) == 3


# ---- Messages -------------------------------------------------------------------------------------------------------


def test_with_logging_off_only_errors_are_logged(host_3):
    """FMI 3.0.2, 2.3.1."""
    quiet, loud = host_3("lpnl2"), host_3("lpnl2", logging=True)
    for fmu in (quiet, loud):
        fmu.start()
        assert fmu.step(5.0) == ERROR
        assert fmu.set(velocity=1e308) == OK
        assert fmu.step(0.0) == DISCARD
    assert [category for _, category, _ in quiet.messages] == ["logStatusError"]
    assert [category for _, category, _ in loud.messages] == ["logAll", "logStatusError", "logStatusDiscard"]


@pytest.mark.parametrize(
    ("calls", "expected"),
    [
        ([(False,)], ["logStatusError"]),
        ([(False,), (True, "logStatusDiscard")], ["logStatusError", "logStatusDiscard"]),
        ([(True, "logStatusWarning"), (False, "logStatusDiscard", "logAll")], ["logStatusError"]),
        ([(False, "logStatusDiscard", "logAll"), (True, "logStatusDiscard")], ["logStatusError", "logStatusDiscard"]),
        ([(False,), (True, "logStatusDiscard"), (True, "logStatusWarning")], ["logStatusError", "logStatusDiscard"]),
        ([(False,), (True, "logAll")], ["logAll", "logStatusError", "logStatusDiscard"]),
        ([(False,), (True,)], ["logAll", "logStatusError", "logStatusDiscard"]),
        ([(False, "logAll")], ["logStatusError", "logStatusDiscard"]),
    ],
)
def test_categories_are_turned_on_and_off_one_by_one(host_3, calls, expected):
    fmu = host_3("lpnl2", logging=True)
    for on, *names in calls:
        assert fmu.categories(on, *names) == OK
    fmu.start()
    assert fmu.step(5.0) == ERROR
    assert fmu.set(velocity=1e308) == OK
    assert fmu.step(0.0) == DISCARD
    assert [category for _, category, _ in fmu.messages] == expected


def test_unknown_log_categories_are_refused_and_change_nothing(host_3):
    fmu = host_3("lpnl2")
    assert fmu.categories(True, "gossip") == ERROR
    assert fmu.call("SetDebugLogging", True, ONE, None) == ERROR
    fmu.messages.clear()
    fmu.start()
    assert fmu.messages == []
    assert fmu.categories(True, "logAll") == fmu.call("Reset") == OK
    fmu.start()
    assert [category for _, category, _ in fmu.messages] == ["logAll"]


@pytest.mark.parametrize("name", ALL)
def test_messages_name_functions_of_fmi_3_and_are_in_declared_categories(host_3, exchange, folders_3, name):
    xml = ET.fromstring((folders_3[name] / "modelDescription.xml").read_text())
    declared = {c.get("name") for c in xml.iter("Category")}
    header = (folders_3[name] / "sources" / "fmi3Functions.h").read_text()
    functions = set(re.findall(r"\bfmi3\w+(?=\s+fmi3FullName)", header))
    fmu, other = host_3(name, logging=True), exchange(name, logging=True)
    for instance in (fmu, other):
        for phase in ("EnterInitializationMode", "ExitInitializationMode", "Terminate", ""):
            for function, arguments in phase_calls(instance).items():
                if function not in ("ExitInitializationMode", "Terminate"):
                    instance.call(function, *arguments)
            instance.read("velocity") if name in LAWS else instance.read(instance.outputs()[0])
            instance.set_named({instance.inputs()[0]: math.nan})
            instance.set_named({instance.outputs()[0]: 0.0})
            instance.call("GetFloat64", (c_uint * 1)(9999999), ONE, (c_double * 1)(), ONE)
            for function in ("GetFMUState", "SetFMUState", "SetDebugLogging"):
                instance.call(function, None, ONE, None)
            instance.enter() if phase.startswith("Enter") else phase and instance.call(phase)
        instance.call("Terminate")
    assert len(fmu.messages) > 60 and len(other.messages) > 60
    for _, category, message in fmu.messages + other.messages:
        assert category in declared
        assert message.isprintable() and "%" not in message and "#" not in message
        assert "fmi2" not in message and "Real" not in message.split()
        assert set(re.findall(r"\bfmi3\w+", message)) <= functions, message


def test_messages_name_function_variable_and_reason(host_3):
    fmu = host_3("lpnl2").start()

    def message(status):
        ((_, _, text),) = fmu.messages
        fmu.messages.clear()
        return status, text

    values = (c_double * 1)()
    assert message(fmu.call("GetFloat64", (c_uint * 1)(4321), ONE, values, ONE)) == (
        ERROR, "fmi3GetFloat64: value reference 4321 is not a Float64 variable of this FMU",
    )  # fmt: skip
    assert message(fmu.set(force=1.0)) == (ERROR, "fmi3SetFloat64: force is computed by the FMU and cannot be set")
    assert message(fmu.call("EnterEventMode")) == (ERROR, "fmi3EnterEventMode: this instance is for co-simulation")
    assert fmu.call("Terminate") == OK
    assert message(fmu.step(0.0)) == (ERROR, "fmi3DoStep: is not allowed after fmi3Terminate")


@pytest.mark.parametrize("name", ["lpnl2", "seven_dof"])
def test_interleaved_instances_with_and_without_updates_equal_single_ones(host_3, name):
    def of(k, **options):
        value = 0.01 * k
        update = (lambda fmu, _: fmu.set_named({fmu.inputs()[0]: value})) if k % 2 else None
        return host_3(name, update=update, **options).start()

    single = []
    for k in range(8):
        fmu = of(k)
        for step in range(3):
            assert fmu.step(step * 1e-3) == OK
        single.append(fmu.all())
    together = [of(k, name=f"i{k}") for k in range(8)]
    for step in range(3):
        assert all(fmu.step(step * 1e-3) == OK for fmu in together)
    assert [fmu.all() for fmu in together] == single
    assert np.ptp([row[0] for row in single]) > 0.0
