"""Calls in the wrong order, bad values and bad arguments are refused with the reason and have no other effect."""

import ctypes
import gc
import math
import resource
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ET
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from fmpy import fmi2

from eightpost.shock import LAWS

ALL = (*LAWS, "seven_dof", "quarter_car")
SOME = ("hysteresis", "seven_dof")  #: For what every FMU shares.
OK, WARNING, DISCARD, ERROR, FATAL = range(5)


@pytest.mark.parametrize("name", SOME)
def test_a_step_is_refused_before_initialization_and_after_the_end(host, name):
    fmu = host(name)
    assert fmu.step(0.0) == ERROR
    assert "fmi2DoStep: is not allowed before initialization mode" in fmu.messages_text()
    fmu.start()
    assert fmu.step(0.0) == OK
    assert fmu.call("Terminate") == OK
    assert fmu.step(1e-3) == ERROR
    assert "after fmi2Terminate" in fmu.messages_text()


def test_a_step_starts_at_the_end_of_the_last_one_and_ends_no_later_than_the_stop_time(host):
    fmu = host("lpnl2").start(2.0, stop=2.01)
    for time, step in (
        (0.0, 1e-3),
        (2.001, 1e-3),
        (1.999, 1e-3),
        (-2.0, 1e-3),
        (2.0, 0.0),
        (2.0, -1e-3),
        (2.0, math.nan),
        (2.0, 0.02),
        (math.inf, 1e-3),
    ):
        assert fmu.step(time, step) == ERROR
    assert fmu.step(2.0, 1e-3) == OK
    assert fmu.step(2.001, 9e-3) == OK
    assert fmu.step(2.01, 1e-3) == ERROR
    assert "after the stop time of 2.01 s" in fmu.messages_text()


@pytest.mark.parametrize("time", [-3e6, 3e6])
def test_the_time_of_a_step_has_a_relative_tolerance_of_1e_9(host, time):
    """At 3e6 s the tolerance is 3 ms; at small times it is a nanosecond."""
    for off in (0.004, -0.004):
        fmu = host("lpf1").start(time, stop=time + 1.0)
        assert fmu.step(time + off, 0.5) == ERROR
        assert fmu.step(time + 0.5 * off, 0.5) == OK
    assert host("lpf1").start(time, stop=time + 1.0).step(time, 1.004) == ERROR
    assert host("lpf1").start(time, stop=time + 1.0).step(time, 1.002) == OK
    small = host("lpf1").start(0.0, stop=1.0)
    assert small.step(2e-9, 0.1) == small.step(-2e-9, 0.1) == small.step(0.0, 1.0 + 2e-9) == ERROR
    assert small.step(5e-10, 0.1) == small.step(0.1 - 5e-10, 0.1) == OK
    assert small.step(0.2, 0.8 + 5e-10) == OK


def test_rounding_errors_of_a_hosts_accumulated_time_are_accepted(host):
    fmu, time = host("lpf1").start(0.0, stop=10.0), 0.0
    for _ in range(30000):
        assert fmu.step(time, 1.0 / 3000.0) == OK
        time += 1.0 / 3000.0


@pytest.mark.parametrize("name", ALL)
def test_fixed_parameters_are_locked_after_initialization_and_tunable_ones_are_not(host, name):
    fmu = host(name).start()
    for variable in fmu.description.modelVariables:
        if variable.type == "Real" and variable.causality == "parameter":
            expected = ERROR if variable.variability == "fixed" else OK
            assert fmu.set_named({variable.name: float(variable.start)}) == expected, variable.name
        if variable.type == "Real" and variable.causality in ("output", "local"):
            assert fmu.set_named({variable.name: 0.0}) == ERROR
    assert fmu.step(0.0) == OK


def test_the_message_on_a_refused_call_names_function_variable_and_reason(host):
    fmu = host("lpnl2").start()
    one = ctypes.c_size_t(1)

    def message(status):
        (message,) = (text for _, _, text in fmu.messages)
        fmu.messages.clear()
        return status, message

    reference, flag = (ctypes.c_uint * 1)(4321), (ctypes.c_int * 1)()
    assert message(fmu.call("GetReal", reference, one, (ctypes.c_double * 1)())) == (
        ERROR, "fmi2GetReal: value reference 4321 is not a Real variable of this FMU",
    )  # fmt: skip
    assert message(fmu.call("GetBoolean", reference, one, flag)) == (
        ERROR, "fmi2GetBoolean: value reference 4321 is not a Boolean variable of this FMU",
    )  # fmt: skip
    assert message(fmu.set(force=1.0)) == (ERROR, "fmi2SetReal: force is computed by the FMU and cannot be set")
    assert message(fmu.set(time_constant=-1.0))[1].startswith("fmi2SetReal: time_constant = -1 s must be at least ")
    assert message(fmu.set(velocity=math.nan)) == (
        ERROR, "fmi2SetReal: velocity = not a number m/s must be finite; the old value is kept",
    )  # fmt: skip
    car = fmu = host("seven_dof").start()
    (fixed, *_) = (v.name for v in car.description.modelVariables if v.variability == "fixed" and v.type == "Boolean")
    assert message(car.call("SetBoolean", (ctypes.c_uint * 1)(car.references[fixed]), one, flag)) == (
        ERROR, f"fmi2SetBoolean: {fixed} is fixed: set it before initialization ends",
    )  # fmt: skip


@pytest.mark.parametrize("name", SOME)
def test_values_that_are_not_finite_are_refused_by_name_and_the_next_valid_step_succeeds(host, name):
    fmu = host(name).start()
    for variable in fmu.inputs():
        for bad in (math.nan, math.inf, -math.inf):
            fmu.messages.clear()
            before = fmu.all()
            assert fmu.set_named({variable: bad}) == ERROR
            assert variable in fmu.messages_text() and "the old value is kept" in fmu.messages_text()
            assert fmu.all() == before
    fmu.run(3)


@pytest.mark.parametrize("name", ALL)
def test_inputs_set_at_once_equal_those_set_one_by_one_from_the_last(host, name):
    at_once, one_by_one = host(name).start(), host(name).start()
    for k in range(5):
        values = {variable: 0.01 * (i + k) for i, variable in enumerate(at_once.inputs())}
        slopes = {variable: 1.0 - i for i, variable in enumerate(values)}
        assert at_once.set_named(values) == at_once.set_slopes(slopes) == OK
        for variable in reversed(values):
            assert one_by_one.set_named({variable: values[variable]}) == OK
            assert one_by_one.set_slopes({variable: slopes[variable]}) == OK
        assert at_once.step(1e-3 * k) == one_by_one.step(1e-3 * k) == OK
        assert at_once.all() == one_by_one.all()


@pytest.mark.parametrize("name", ALL)
@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_no_input_is_set_if_one_of_them_is_not_finite(host, name, bad):
    fmu = host(name).start()
    before, good = fmu.all(), dict.fromkeys(fmu.inputs(), 0.2)
    for variable in good:
        assert fmu.set_named(good | {variable: bad}) == ERROR
        assert fmu.set_slopes(good | {variable: bad}) == ERROR
    assert fmu.set_slopes(good, order=2) == ERROR
    assert fmu.all() == before
    assert fmu.step(0.0) == OK
    unmoved = host(name).start()
    assert unmoved.step(0.0) == OK
    assert fmu.all() == unmoved.all()


@pytest.mark.parametrize("name", ALL)
def test_parameters_outside_their_range_are_refused_and_the_call_has_no_effect(host, name):
    fmu = host(name)
    bounded = [v for v in fmu.description.modelVariables if v.causality == "parameter" and v.min is not None]
    first = fmu.inputs()[0]
    for variable in bounded:
        fmu.messages.clear()
        assert fmu.set_named({first: 0.2, variable.name: float(variable.min) - 1.0}) == ERROR
        assert f"{variable.name} = " in fmu.messages_text() and "must be at least" in fmu.messages_text()
    fmu.start()
    assert fmu.get(first) == [0.0]


@pytest.mark.parametrize("name", ALL)
def test_the_ends_of_a_parameters_range_belong_to_it(host, name):
    fmu = host(name)
    parameters = [v for v in fmu.description.modelVariables if v.causality == "parameter"]
    ends = [(v.name, float(end)) for v in parameters for end in (v.min, v.max) if end is not None]
    assert [end for end in ends if fmu.set_named(dict([end])) != OK] == []


@pytest.mark.parametrize("name", LAWS)
def test_a_value_above_the_largest_one_is_refused(host, name):
    fmu = host(name)
    bounded = [v for v in fmu.description.modelVariables if v.causality == "parameter" and v.max is not None]
    assert bounded
    for variable in bounded:
        assert fmu.set_named({variable.name: float(variable.max) * 1.001}) == ERROR


def test_an_overflow_discards_the_step_and_keeps_all_values(host):
    fmu = host("lpnl2").start()
    before = fmu.all()
    assert fmu.set(velocity=1e308) == OK
    assert fmu.step(0.0) == DISCARD
    assert fmu.get("force", "lagged_force") == [before[2], before[4]]
    assert fmu.set(velocity=0.1) == OK
    assert fmu.step(0.0) == OK


@pytest.mark.parametrize("name", LAWS)
def test_a_transition_that_reaches_zero_velocity_keeps_initialization_open(host, name):
    fmu = host(name)
    (speed,) = (float(v.start) for v in fmu.description.modelVariables if v.name == "curve.transition_speed")
    assert fmu.call("EnterInitializationMode") == OK
    assert fmu.set_named({"curve.transition_width": 2.0003 * speed}) == OK
    assert fmu.call("ExitInitializationMode") == ERROR
    assert "transition_width must be less than twice" in fmu.messages_text()
    assert fmu.set_named({"curve.transition_width": 1.9997 * speed}) == OK
    assert fmu.call("ExitInitializationMode") == OK


@pytest.mark.parametrize("name", ["seven_dof", "quarter_car"])
def test_a_car_whose_state_overflows_discards_the_step_and_keeps_all_values(host, name):
    fmu = host(name).start()
    assert fmu.step(0.0) == OK
    before = fmu.all()
    force = next(variable for variable in fmu.inputs() if variable.endswith("force"))
    assert fmu.set_named({force: 1e300}) == OK
    assert fmu.set_slopes(dict.fromkeys(set(fmu.inputs()) - {force}, 1.0)) == OK
    assert fmu.step(1e-3) == DISCARD
    assert "the result is not finite; the step was not made" in fmu.messages_text()
    assert fmu.set_named({force: 0.0}) == OK
    assert fmu.all() == before
    assert fmu.step(1e-3) == OK


def test_contradicting_parameters_keep_initialization_open_until_they_are_corrected(host):
    fmu = host("lpnl2")
    assert fmu.call("EnterInitializationMode") == OK
    assert fmu.set(lag_zero_force=1.0) == OK
    assert fmu.call("ExitInitializationMode") == ERROR
    assert "lag_zero_force must be greater than lag_full_force" in fmu.messages_text()
    assert fmu.set(lag_zero_force=2000.0) == OK
    assert fmu.call("ExitInitializationMode") == OK


@pytest.mark.parametrize("name", SOME)
def test_null_and_unknown_references_are_errors_and_reset_restores_the_instance(host, name):
    fmu = host(name).start()
    one, number = ctypes.c_size_t(1), (ctypes.c_double * 1)()
    for function in ("GetReal", "SetReal", "GetBoolean", "SetBoolean"):
        assert fmu.call(function, None, one, number) == ERROR
        assert fmu.call(function, (ctypes.c_uint * 1)(9999), one, number) == ERROR
        assert fmu.call(function, (ctypes.c_uint * 1)(4294967295), one, number) == ERROR
        assert fmu.call(function, None, ctypes.c_size_t(0), None) == OK
    for function in ("GetInteger", "SetInteger", "GetString", "SetString"):
        assert fmu.call(function, (ctypes.c_uint * 1)(0), one, number) == ERROR
    assert fmu.call("SetRealInputDerivatives", None, one, None, None) == ERROR
    assert fmu.call("GetDirectionalDerivative", None, one, None, one, None, None) == ERROR
    assert fmu.call("GetFMUstate", None) == ERROR
    assert fmu.call("SetFMUstate", None) == ERROR
    assert fmu.call("CancelStep") == ERROR
    assert fmu.call("Reset") == OK
    fmu.start().run(2)


@pytest.mark.parametrize("function", ["DoStep", "GetReal", "Reset", "Terminate", "GetFMUstate", "GetStatus"])
def test_a_null_instance_is_an_error(host, function):
    fmu = host("lpf1")
    kept, fmu.c = fmu.c, None
    assert fmu.call(function, None, None, None) == ERROR
    fmu.c = kept


def test_a_boolean_that_is_set_is_returned(host):
    car = host("seven_dof")
    assert car.call("EnterInitializationMode") == OK
    (name, *_) = (v.name for v in car.description.modelVariables if v.type == "Boolean")
    reference, one = (ctypes.c_uint * 1)(car.references[name]), ctypes.c_size_t(1)
    for value, expected in ((0, 0), (1, 1), (7, 1), (0, 0)):
        assert car.call("SetBoolean", reference, one, (ctypes.c_int * 1)(value)) == OK
        flag = (ctypes.c_int * 1)(-1)
        assert car.call("GetBoolean", reference, one, flag) == OK
        assert flag[0] == expected


@pytest.mark.parametrize("name", SOME)
def test_output_derivatives_are_refused_and_an_empty_list_of_them_is_accepted(host, name):
    fmu = host(name).start()
    reference, order, value = (ctypes.c_uint * 1)(0), (ctypes.c_int * 1)(1), (ctypes.c_double * 1)()
    assert fmu.step(0.0) == OK
    assert fmu.call("GetRealOutputDerivatives", reference, ctypes.c_size_t(0), order, value) == OK
    assert fmu.call("GetRealOutputDerivatives", reference, ctypes.c_size_t(1), order, value) == ERROR
    assert "output derivatives are not supported" in fmu.messages[-1][2]


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"guid": "{0}"}, "the GUID of modelDescription.xml is not that of this binary"),
        ({"name": ""}, "the instance has no name"),
        ({"kind": 2}, "neither co-simulation nor model exchange"),
    ],
)
def test_an_invalid_instantiation_is_refused_with_the_reason(folders, options, reason, c_level):
    fmu = c_level.Host(folders["lpnl2"], **options)
    assert fmu.c is None
    assert reason in fmu.messages_text()


@pytest.mark.parametrize("name", ALL)
def test_reset_restores_every_default_and_the_rerun_is_the_same_bit_for_bit(host, name):
    fmu = host(name)
    tunable = {v.name: float(v.start) * 1.1 + 1e-3 for v in fmu.description.modelVariables
               if v.causality == "parameter" and v.type == "Real" and v.max is None
               if not ("knot" in v.name or (name == "hysteresis" and v.name.startswith("curve.")))}  # fmt: skip
    first = fmu.start().run()
    assert fmu.call("Reset") == OK
    assert fmu.set_named(tunable) == OK
    changed = fmu.start().run()
    assert fmu.call("Reset") == OK
    assert fmu.start().run() == first != changed


@pytest.mark.repeated
@pytest.mark.parametrize(("name", "count"), [(name, 200 if name == "seven_dof" else 20) for name in ALL])
def test_interleaved_instances_equal_a_single_instance(host, name, count):
    single = host(name).start().run(5)
    instances = [host(name, name=f"i{k}").start() for k in range(count)]
    rows = {k: [] for k in range(count)}
    rng = np.random.default_rng(1)
    for step in range(5):
        values = dict(zip(instances[0].inputs(), rng.uniform(-0.3, 0.3, len(instances[0].inputs())), strict=True))
        for k, fmu in enumerate(instances):
            assert fmu.set_named(values) == OK
            assert fmu.step(step * 1e-3) == OK
            rows[k].append(fmu.all())
    assert all(found == single for found in rows.values())


@pytest.mark.parametrize("name", ["lpnl2", "seven_dof"])
def test_instances_in_four_threads_equal_a_single_instance(host, name):
    single = host(name).start().run(200)
    instances = [host(name, name=f"t{k}").start() for k in range(4)]
    with ThreadPoolExecutor(4) as pool:
        assert all(found == single for found in pool.map(lambda fmu: fmu.run(200), instances))


@pytest.mark.repeated
@pytest.mark.parametrize("name", ["lpnl2", "seven_dof"])
def test_memory_does_not_grow_with_the_number_of_instances_created_and_freed(host, name):
    fmu = host(name)
    make, free = fmu.component, fmu.slave.dll.fmi2FreeInstance
    free.argtypes = [ctypes.c_void_p]

    def create_and_free(count):
        for _ in range(count):
            c = make(b"x", 1, fmu.description.guid.encode(), b"", ctypes.byref(fmu.callbacks), 0, 0)
            assert c
            free(c)
        gc.collect()
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss

    before = create_and_free(500)
    assert create_and_free(5000) - before < 2000  # KiB; 5,000 instances of the smallest FMU would take 5,000 KiB


@pytest.mark.parametrize("name", ["lpnl2", "seven_dof"])
def test_an_instantiation_without_enough_memory_fails_and_frees_its_memory(host, name):
    fmu, held, calls = host(name), set(), []

    def allocate(count, size):
        calls.append(size)
        address = 0 if len(calls) == fails_at else libc.calloc(count, size)
        held.update({address} - {0})
        return address

    def release(address):
        held.discard(address)
        libc.free(address)

    libc = ctypes.CDLL(None)
    libc.calloc.argtypes, libc.calloc.restype = [ctypes.c_size_t, ctypes.c_size_t], ctypes.c_void_p
    libc.free.argtypes, libc.free.restype = [ctypes.c_void_p], None
    callbacks = fmi2.fmi2CallbackFunctions()
    callbacks.logger = fmu.callbacks.logger
    callbacks.allocateMemory = fmi2.fmi2CallbackAllocateMemoryTYPE(allocate)
    callbacks.freeMemory = fmi2.fmi2CallbackFreeMemoryTYPE(release)
    for fails_at in range(1, 10):
        calls.clear()
        c = fmu.component(b"x", 1, fmu.description.guid.encode(), b"", ctypes.byref(callbacks), 0, 0)
        if c:
            break
        assert len(calls) >= fails_at
        assert not held
    assert fails_at == 4  # after the instance, its name and its work arrays
    fmu.slave.dll.fmi2FreeInstance.argtypes = [ctypes.c_void_p]
    fmu.slave.dll.fmi2FreeInstance(c)
    assert not held


def test_the_instance_name_is_copied_exactly(host):
    fmu = host("lpf1")
    guid, free = fmu.description.guid.encode(), fmu.slave.dll.fmi2FreeInstance
    free.argtypes = [ctypes.c_void_p]
    for content, is_named in ((b"\0a\0", True), (b"a\0b\0", False)):
        buffer = ctypes.create_string_buffer(content)
        fmu.component.argtypes = None
        c = fmu.component(
            ctypes.c_void_p(ctypes.addressof(buffer) + 1), 1, guid, b"", ctypes.byref(fmu.callbacks), 0, 0
        )
        assert bool(c) == is_named
        if c:
            free(c)


def test_errors_are_always_logged_and_other_messages_only_on_request(host):
    quiet, loud = host("lpnl2"), host("lpnl2", logging=True)
    for fmu in (quiet, loud):
        fmu.start()
        assert fmu.step(5.0) == ERROR
    assert [category for _, category, _ in quiet.messages] == ["logStatusError"]
    assert "logAll" in [category for _, category, _ in loud.messages]


@pytest.mark.parametrize("name", ALL)
def test_messages_are_formatted_and_in_declared_categories(host, folders, name):
    fmu = host(name, logging=True)
    xml = ET.fromstring((folders[name] / "modelDescription.xml").read_text())
    declared = {c.get("name") for c in xml.iter("Category")}
    fmu.start()
    fmu.set_named({fmu.inputs()[0]: math.nan})
    fmu.step(99.0)
    fmu.call("CancelStep")
    assert fmu.messages
    for _, category, message in fmu.messages:
        assert category in declared
        assert message.isprintable() and "%" not in message and "#" not in message


def test_unknown_log_categories_are_refused(host):
    fmu = host("lpnl2")
    assert fmu.call("SetDebugLogging", 1, ctypes.c_size_t(1), (ctypes.c_char_p * 1)(b"logAll")) == OK
    assert fmu.call("SetDebugLogging", 1, ctypes.c_size_t(1), (ctypes.c_char_p * 1)(b"gossip")) == ERROR


@pytest.mark.repeated
@pytest.mark.parametrize("place", ["with space", "únïcödé 車", "50%", "#1", "a+b"])
def test_an_fmu_runs_from_any_read_only_folder_without_environment_variables(folders, tmp_path, place):
    folder = tmp_path / place
    shutil.copytree(folders["seven_dof"], folder)
    for path in (folder, *folder.rglob("*")):
        path.chmod(0o555 if path.is_dir() else 0o444)
    code = (
        "import importlib.util, sys;"
        "spec = importlib.util.spec_from_file_location('t', sys.argv[1]); t = importlib.util.module_from_spec(spec);"
        "spec.loader.exec_module(t); fmu = t.Host(sys.argv[2]).start(); fmu.run(3)"
    )
    line = [sys.executable, "-c", code, Path(__file__).with_name("host.py"), folder]
    ran = subprocess.run(line, env={}, cwd="/", capture_output=True, text=True, check=False)
    for path in (folder, *folder.rglob("*")):
        path.chmod(0o755)
    assert ran.returncode == 0, ran.stderr


@pytest.mark.repeated
@pytest.mark.parametrize("step", [1e-7, 3.3e-5, 1e-3, 0.05])
def test_the_result_does_not_depend_on_the_step_size(host, step):
    """One step equals ten steps of a tenth for held inputs, because the step is exact.

    That of Hysteresis, whose time constant changes with its state, is of second order.
    """
    for name in (each for each in ALL if each != "hysteresis"):
        whole, parts = host(name).start(-1.5), host(name).start(-1.5)
        values = dict.fromkeys(whole.inputs(), 0.05)
        whole.set_named(values), parts.set_named(values)
        assert whole.step(-1.5, step) == OK
        for k in range(10):
            assert parts.step(-1.5 + k * step / 10, step / 10) == OK
        names = [v.name for v in whole.description.modelVariables if v.type == "Real" and v.derivative is None]
        found, expected = parts.get(*names), whole.get(*names)
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * max(map(abs, expected)))
