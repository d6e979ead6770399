"""A native FMU among hosts, honest and not: call order, bad values, saved states, many instances, threads."""

import ctypes
import gc
import json
import math
import resource
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ET
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from fmpy import fmi2, read_model_description

from eightpost.archive import extract_archive

ALL = ("polylinear", "lpf1", "lpnl2", "seven_dof", "quarter_car")
OK, WARNING, DISCARD, ERROR, FATAL = range(5)


class Host:
    """One instance at the level of C: statuses are returned, messages are kept."""

    def __init__(self, folder, *, logging=False, guid=None, name="instance", kind=fmi2.fmi2CoSimulation):
        self.description = read_model_description(str(folder))
        self.references = {v.name: v.valueReference for v in self.description.modelVariables}
        self.messages = []
        identifier = self.description.coSimulation.modelIdentifier
        self.slave = fmi2.FMU2Slave(
            guid=self.description.guid, unzipDirectory=str(folder), modelIdentifier=identifier, instanceName=name
        )
        self.callbacks = fmi2.fmi2CallbackFunctions()
        self.callbacks.logger = fmi2.fmi2CallbackLoggerTYPE(
            lambda _e, _n, status, category, message: self.messages.append(
                (status, category.decode(), message.decode())
            )
        )
        self.callbacks.allocateMemory = fmi2.fmi2CallbackAllocateMemoryTYPE(fmi2.calloc)
        self.callbacks.freeMemory = fmi2.fmi2CallbackFreeMemoryTYPE(fmi2.free)
        self.component = self.slave.dll.fmi2Instantiate
        self.component.restype = ctypes.c_void_p
        guid = self.description.guid if guid is None else guid
        self.c = self.component(
            name.encode(), kind, guid.encode(), b"file:///nowhere", ctypes.byref(self.callbacks), 0, int(logging)
        )

    def call(self, function, *arguments):
        """Return the status of fmi2<function>."""
        address = getattr(self.slave.dll, f"fmi2{function}")
        address.argtypes, address.restype = None, ctypes.c_int
        return address(ctypes.c_void_p(self.c), *arguments)

    def start(self, time=0.0, stop=None):
        assert self.call("SetupExperiment", 0, ctypes.c_double(0.0), ctypes.c_double(time), int(stop is not None),
                         ctypes.c_double(stop or 0.0)) == OK  # fmt: skip
        assert self.call("EnterInitializationMode") == OK
        assert self.call("ExitInitializationMode") == OK
        return self

    def set(self, **values):
        return self.set_named({name.replace("__", "."): value for name, value in values.items()})

    def set_named(self, values):
        references = (ctypes.c_uint * len(values))(*(self.references[n] for n in values))
        return self.call(
            "SetReal", references, ctypes.c_size_t(len(values)), (ctypes.c_double * len(values))(*values.values())
        )

    def get(self, *names):
        references, values = (
            (ctypes.c_uint * len(names))(*(self.references[n] for n in names)),
            (ctypes.c_double * len(names))(),
        )
        assert self.call("GetReal", references, ctypes.c_size_t(len(names)), values) == OK
        return list(values)

    def step(self, time, step=1e-3):
        return self.call("DoStep", ctypes.c_double(time), ctypes.c_double(step), 1)

    def all(self):
        return self.get(*(v.name for v in self.description.modelVariables if v.type == "Real"))

    def inputs(self):
        return [v.name for v in self.description.modelVariables if v.causality == "input"]

    def run(self, steps=20, time=0.0, seed=1):
        """Random inputs, 1 ms steps; all variables after each."""
        rng, rows = np.random.default_rng(seed), []
        for k in range(steps):
            values = dict(zip(self.inputs(), rng.uniform(-0.3, 0.3, len(self.inputs())), strict=True))
            assert self.set_named(values) == OK
            assert self.step(time + k * 1e-3) == OK
            rows.append(self.all())
        return rows

    def said(self):
        return " ".join(message for _, _, message in self.messages)

    def free(self):
        if self.c:
            free = self.slave.dll.fmi2FreeInstance
            free.argtypes, free.restype = None, None
            free(ctypes.c_void_p(self.c))
            self.c = None


@pytest.fixture(scope="module")
def folders(fmus, tmp_path_factory):
    found = {}
    for name, path in fmus.items():
        found[name] = tmp_path_factory.mktemp(name)
        extract_archive(path, found[name])
    return found


@pytest.fixture
def host(folders):
    made = []

    def make(model, **options):
        made.append(Host(folders[model], **options))
        return made[-1]

    yield make
    for item in made:
        item.free()


# ---- Call order ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ALL)
def test_a_step_is_refused_before_initialization_and_after_the_end(host, name):
    fmu = host(name)
    assert fmu.step(0.0) == ERROR
    assert "fmi2DoStep: is not allowed before initialization mode" in fmu.said()
    fmu.start()
    assert fmu.step(0.0) == OK
    assert fmu.call("Terminate") == OK
    assert fmu.step(1e-3) == ERROR
    assert "after fmi2Terminate" in fmu.said()


def test_a_step_begins_where_the_last_one_ended_and_ends_by_the_stop_time(host):
    fmu = host("lpnl2").start(2.0, stop=2.01)
    for time, step in (
        (0.0, 1e-3),
        (2.001, 1e-3),
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
    assert "after the stop time of 2.01 s" in fmu.said()


def test_a_host_that_adds_up_its_time_is_honest(host):
    fmu, time = host("lpf1").start(0.0, stop=10.0), 0.0
    for _ in range(30000):
        assert fmu.step(time, 1.0 / 3000.0) == OK
        time += 1.0 / 3000.0


@pytest.mark.parametrize("name", ALL)
def test_fixed_parameters_are_locked_after_initialization_and_tunable_ones_live(host, name):
    fmu = host(name).start()
    for variable in fmu.description.modelVariables:
        if variable.type == "Real" and variable.causality == "parameter":
            expected = ERROR if variable.variability == "fixed" else OK
            assert fmu.set_named({variable.name: float(variable.start)}) == expected, variable.name
        if variable.type == "Real" and variable.causality in ("output", "local"):
            assert fmu.set_named({variable.name: 0.0}) == ERROR
    assert fmu.step(0.0) == OK


# ---- Bad values ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ALL)
def test_values_that_are_no_numbers_are_refused_by_name_and_the_next_good_step_is_fine(host, name):
    fmu = host(name).start()
    for variable in fmu.inputs():
        for bad in (math.nan, math.inf, -math.inf):
            fmu.messages.clear()
            before = fmu.all()
            assert fmu.set_named({variable: bad}) == ERROR
            assert variable in fmu.said() and "the old value stays" in fmu.said()
            assert fmu.all() == before
    fmu.run(3)


@pytest.mark.parametrize("name", ALL)
def test_parameters_outside_their_range_are_refused_and_nothing_of_the_call_is_done(host, name):
    fmu = host(name)
    bounded = [v for v in fmu.description.modelVariables if v.causality == "parameter" and v.min is not None]
    first = fmu.inputs()[0]
    for variable in bounded:
        fmu.messages.clear()
        assert fmu.set_named({first: 0.2, variable.name: float(variable.min) - 1.0}) == ERROR
        assert f"{variable.name} = " in fmu.said() and "must be at least" in fmu.said()
    fmu.start()
    assert fmu.get(first) == [0.0]


def test_values_that_overflow_discard_the_step_and_leave_everything(host):
    fmu = host("lpnl2").start()
    before = fmu.all()
    assert fmu.set(velocity=1e308) == OK
    assert fmu.step(0.0) == DISCARD
    assert fmu.get("force", "lagged_force") == [before[2], before[4]]
    assert fmu.set(velocity=0.1) == OK
    assert fmu.step(0.0) == OK


def test_parameters_that_do_not_fit_each_other_keep_initialization_open_until_they_do(host):
    fmu = host("lpnl2")
    assert fmu.call("EnterInitializationMode") == OK
    assert fmu.set(lag_zero_force=1.0) == OK
    assert fmu.call("ExitInitializationMode") == ERROR
    assert "lag_zero_force must be greater than lag_full_force" in fmu.said()
    assert fmu.set(lag_zero_force=2000.0) == OK
    assert fmu.call("ExitInitializationMode") == OK


@pytest.mark.parametrize("name", ALL)
def test_null_and_unknown_references_are_errors_and_reset_makes_all_well(host, name):
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


# ---- Instances -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"guid": "{0}"}, "the GUID of modelDescription.xml is not that of this binary"),
        ({"name": ""}, "the instance has no name"),
        ({"kind": fmi2.fmi2ModelExchange}, "for co-simulation only"),
    ],
)
def test_what_is_no_instance_of_this_fmu_is_refused_with_the_reason(folders, options, said):
    fmu = Host(folders["lpnl2"], **options)
    assert fmu.c is None
    assert said in fmu.said()


@pytest.mark.parametrize("name", ALL)
def test_reset_restores_every_default_and_the_rerun_is_the_same_bit_for_bit(host, name):
    fmu = host(name)
    tunable = {v.name: float(v.start) * 1.1 + 1e-3 for v in fmu.description.modelVariables
               if v.causality == "parameter" and v.type == "Real" and v.max is None}  # fmt: skip
    first = fmu.start().run()
    assert fmu.call("Reset") == OK
    assert fmu.set_named(tunable) == OK
    changed = fmu.start().run()
    assert fmu.call("Reset") == OK
    assert fmu.start().run() == first != changed


@pytest.mark.parametrize("name", ALL)
def test_two_hundred_instances_interleaved_equal_one_alone(host, name):
    alone = host(name).start().run(5)
    crowd = [host(name, name=f"i{k}").start() for k in range(200)]
    rows = {k: [] for k in range(200)}
    rng = np.random.default_rng(1)
    for step in range(5):
        values = dict(zip(crowd[0].inputs(), rng.uniform(-0.3, 0.3, len(crowd[0].inputs())), strict=True))
        for k, fmu in enumerate(crowd):
            assert fmu.set_named(values) == OK
            assert fmu.step(step * 1e-3) == OK
            rows[k].append(fmu.all())
    assert all(found == alone for found in rows.values())


@pytest.mark.parametrize("name", ["lpnl2", "seven_dof"])
def test_four_threads_equal_one(host, name):
    alone = host(name).start().run(200)
    crowd = [host(name, name=f"t{k}").start() for k in range(4)]
    with ThreadPoolExecutor(4) as pool:
        assert all(found == alone for found in pool.map(lambda fmu: fmu.run(200), crowd))


@pytest.mark.parametrize("name", ["lpnl2", "seven_dof"])
def test_memory_does_not_grow_over_many_lives(host, name):
    fmu = host(name)
    make, free = fmu.component, fmu.slave.dll.fmi2FreeInstance
    free.argtypes = [ctypes.c_void_p]

    def lives(count):
        for _ in range(count):
            c = make(b"x", 1, fmu.description.guid.encode(), b"", ctypes.byref(fmu.callbacks), 0, 0)
            assert c
            free(c)
        gc.collect()
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss

    before = lives(500)
    assert lives(5000) - before < 2000  # KiB; 5,000 instances of the smallest FMU would take 5,000 KiB


# ---- States --------------------------------------------------------------------------------------------------------


def saved(fmu):
    state = ctypes.c_void_p()
    assert fmu.call("GetFMUstate", ctypes.byref(state)) == OK
    return state


def packed(fmu, state):
    size = ctypes.c_size_t()
    assert fmu.call("SerializedFMUstateSize", state, ctypes.byref(size)) == OK
    content = (ctypes.c_char * size.value)()
    assert fmu.call("SerializeFMUstate", state, content, size) == OK
    return content.raw


def unpacked(fmu, content):
    state = ctypes.c_void_p()
    status = fmu.call(
        "DeSerializeFMUstate",
        (ctypes.c_char * len(content))(*content),
        ctypes.c_size_t(len(content)),
        ctypes.byref(state),
    )
    return status, state


@pytest.mark.parametrize("name", ALL)
def test_a_restored_state_continues_bit_for_bit_also_in_another_instance(host, name):
    fmu = host(name).start()
    fmu.run(7)
    state = saved(fmu)
    content = packed(fmu, state)
    ahead = fmu.run(20, time=7e-3, seed=5)
    assert fmu.call("SetFMUstate", state) == OK
    assert packed(fmu, saved(fmu)) == content
    assert fmu.run(20, time=7e-3, seed=5) == ahead
    other = host(name)
    status, copy = unpacked(other, content)
    assert status == OK
    assert other.call("SetFMUstate", copy) == OK
    assert other.run(20, time=7e-3, seed=5) == ahead
    assert fmu.call("FreeFMUstate", ctypes.byref(state)) == OK and state.value is None
    assert fmu.call("FreeFMUstate", ctypes.byref(state)) == OK


@pytest.mark.parametrize("name", ["lpnl2", "seven_dof"])
def test_a_serialized_state_goes_on_in_another_process(host, folders, tmp_path, name):
    fmu = host(name).start()
    fmu.run(7)
    (tmp_path / "state").write_bytes(packed(fmu, saved(fmu)))
    ahead = fmu.run(5, time=7e-3, seed=5)
    code = (
        "import importlib.util, json, sys, pathlib;"
        "spec = importlib.util.spec_from_file_location('t', sys.argv[1]); t = importlib.util.module_from_spec(spec);"
        "spec.loader.exec_module(t); fmu = t.Host(sys.argv[2]);"
        "status, state = t.unpacked(fmu, pathlib.Path(sys.argv[3]).read_bytes());"
        "assert status == 0 and fmu.call('SetFMUstate', state) == 0;"
        "print(json.dumps(fmu.run(5, time=7e-3, seed=5)))"
    )
    ran = subprocess.run([sys.executable, "-c", code, __file__, folders[name], tmp_path / "state"],
                         capture_output=True, text=True, check=True)  # fmt: skip
    assert json.loads(ran.stdout) == ahead


@pytest.mark.parametrize("name", ALL)
def test_damaged_bytes_and_those_of_another_fmu_are_refused(host, name):
    fmu = host(name).start()
    content = packed(fmu, saved(fmu))
    for place in range(0, len(content), max(1, len(content) // 60)):
        broken = bytearray(content)
        broken[place] ^= 0x10
        assert unpacked(fmu, bytes(broken))[0] == ERROR
    assert unpacked(fmu, content[:-1])[0] == ERROR
    stranger = host("lpf1" if name != "lpf1" else "lpnl2").start()
    assert unpacked(stranger, content)[0] == ERROR


# ---- Derivatives ---------------------------------------------------------------------------------------------------


def derivative(fmu, output, known):
    result = (ctypes.c_double * 1)()
    arguments = [
        (ctypes.c_uint * 1)(fmu.references[output]),
        ctypes.c_size_t(1),
        (ctypes.c_uint * 1)(fmu.references[known]),
    ]
    status = fmu.call("GetDirectionalDerivative", *arguments, ctypes.c_size_t(1), (ctypes.c_double * 1)(1.0), result)
    return status, result[0]


@pytest.mark.parametrize("name", ALL)
def test_directional_derivatives_between_steps_equal_differences_over_a_step_of_nothing(host, name):
    fmu, change = host(name).start(), 1e-6
    fmu.set_named(dict.fromkeys(fmu.inputs(), 0.11))
    fmu.step(0.0, 0.02)
    outputs = [v.name for v in fmu.description.modelVariables if v.causality == "output"]
    state = saved(fmu)
    for known in fmu.inputs():
        ends = []
        for side in (-1.0, 1.0):
            fmu.call("SetFMUstate", state)
            fmu.set_named({known: 0.11 + side * change})
            fmu.step(0.02, 1e-13)
            ends.append(np.array(fmu.get(*outputs)))
        fmu.call("SetFMUstate", state)
        differences = (ends[1] - ends[0]) / (2.0 * change)
        found = np.array([derivative(fmu, output, known)[1] for output in outputs])
        np.testing.assert_allclose(found, differences, rtol=1e-5, atol=1e-4 * (1.0 + np.abs(differences).max()))


@pytest.mark.parametrize("name", ALL)
def test_directional_derivatives_in_initialization_equal_differences_for_inputs_and_parameters(host, name):
    fmu = host(name)
    fmu.call("EnterInitializationMode")
    fmu.set_named(dict.fromkeys(fmu.inputs(), 0.11))
    (unknown, *_) = fmu.description.initialUnknowns
    output = unknown.variable.name
    for known in unknown.dependencies:
        if known.type != "Real":
            continue
        (value,) = fmu.get(known.name)
        change = 1e-5 * max(abs(value), 1e-2)
        ends = []
        for side in (-1.0, 1.0):
            if fmu.set_named({known.name: value + side * change}) != OK:
                break  # at its bound
            ends.append(fmu.get(output)[0])
        fmu.set_named({known.name: value})
        if len(ends) == 2:
            difference = (ends[1] - ends[0]) / (2.0 * change)
            status, found = derivative(fmu, output, known.name)
            assert status == OK
            assert found == pytest.approx(difference, rel=1e-4, abs=1e-4), known.name


def test_derivatives_that_make_no_sense_are_refused(host):
    fmu = host("lpnl2").start()
    assert derivative(fmu, "lagged_force", "velocity")[0] == ERROR
    assert derivative(fmu, "force", "gas_preload")[0] == ERROR
    one = ctypes.c_size_t(1)
    for reference, order, value in ((0, 2, 1.0), (2, 1, 1.0), (0, 1, math.nan)):
        status = fmu.call("SetRealInputDerivatives", (ctypes.c_uint * 1)(reference), one,
                          (ctypes.c_int * 1)(order), (ctypes.c_double * 1)(value))  # fmt: skip
        assert status == ERROR


# ---- Messages and places -------------------------------------------------------------------------------------------


def test_errors_are_always_logged_and_the_rest_only_where_asked_for(host):
    quiet, loud = host("lpnl2"), host("lpnl2", logging=True)
    for fmu in (quiet, loud):
        fmu.start()
        assert fmu.step(5.0) == ERROR
    assert [category for _, category, _ in quiet.messages] == ["logStatusError"]
    assert "logAll" in [category for _, category, _ in loud.messages]


@pytest.mark.parametrize("name", ALL)
def test_messages_are_whole_sentences_in_declared_categories(host, folders, name):
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


@pytest.mark.parametrize("place", ["with space", "únïcödé 車", "50%", "#1", "a+b"])
def test_any_folder_will_do_read_only_and_without_an_environment(folders, tmp_path, place):
    folder = tmp_path / place
    shutil.copytree(folders["seven_dof"], folder)
    for path in (folder, *folder.rglob("*")):
        path.chmod(0o555 if path.is_dir() else 0o444)
    code = (
        "import importlib.util, sys;"
        "spec = importlib.util.spec_from_file_location('t', sys.argv[1]); t = importlib.util.module_from_spec(spec);"
        "spec.loader.exec_module(t); fmu = t.Host(sys.argv[2]).start(); fmu.run(3)"
    )
    ran = subprocess.run(
        [sys.executable, "-c", code, __file__, folder], env={}, cwd="/", capture_output=True, text=True, check=False
    )
    for path in (folder, *folder.rglob("*")):
        path.chmod(0o755)
    assert ran.returncode == 0, ran.stderr


@pytest.mark.parametrize("step", [1e-7, 3.3e-5, 1e-3, 0.05])
def test_steps_of_any_size_land_where_they_should(host, step):
    """One step, or ten of a tenth: the same for held inputs, since the step is exact."""
    for name in ALL:
        whole, parts = host(name).start(-1.5), host(name).start(-1.5)
        values = dict.fromkeys(whole.inputs(), 0.05)
        whole.set_named(values), parts.set_named(values)
        assert whole.step(-1.5, step) == OK
        for k in range(10):
            assert parts.step(-1.5 + k * step / 10, step / 10) == OK
        np.testing.assert_allclose(whole.all(), parts.all(), rtol=1e-9, atol=1e-9 * max(map(abs, whole.all())))
