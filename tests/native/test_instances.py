"""Instances: creation, many at once, threads, reset, folders and messages."""

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
OK, WARNING, DISCARD, ERROR, FATAL = range(5)


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
