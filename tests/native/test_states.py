"""Saved states and derivatives."""

import ctypes
import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from eightpost.shock import LAWS

ALL = (*LAWS, "seven_dof", "quarter_car")
OK, WARNING, DISCARD, ERROR, FATAL = range(5)


@pytest.mark.parametrize("name", ALL)
def test_a_restored_state_continues_bit_for_bit_also_in_another_instance(host, name, c_level):
    fmu = host(name).start()
    fmu.run(7)
    state = c_level.saved(fmu)
    content = c_level.packed(fmu, state)
    ahead = fmu.run(20, time=7e-3, seed=5)
    assert fmu.call("SetFMUstate", state) == OK
    assert c_level.packed(fmu, c_level.saved(fmu)) == content
    assert fmu.run(20, time=7e-3, seed=5) == ahead
    other = host(name)
    status, copy = c_level.unpacked(other, content)
    assert status == OK
    assert other.call("SetFMUstate", copy) == OK
    assert other.run(20, time=7e-3, seed=5) == ahead
    assert fmu.call("FreeFMUstate", ctypes.byref(state)) == OK and state.value is None
    assert fmu.call("FreeFMUstate", ctypes.byref(state)) == OK


@pytest.mark.parametrize("name", ["lpnl2", "seven_dof"])
def test_a_serialized_state_goes_on_in_another_process(host, folders, tmp_path, name, c_level):
    fmu = host(name).start()
    fmu.run(7)
    (tmp_path / "state").write_bytes(c_level.packed(fmu, c_level.saved(fmu)))
    ahead = fmu.run(5, time=7e-3, seed=5)
    code = (
        "import importlib.util, json, sys, pathlib;"
        "spec = importlib.util.spec_from_file_location('t', sys.argv[1]); t = importlib.util.module_from_spec(spec);"
        "spec.loader.exec_module(t); fmu = t.Host(sys.argv[2]);"
        "status, state = t.unpacked(fmu, pathlib.Path(sys.argv[3]).read_bytes());"
        "assert status == 0 and fmu.call('SetFMUstate', state) == 0;"
        "print(json.dumps(fmu.run(5, time=7e-3, seed=5)))"
    )
    line = [sys.executable, "-c", code, Path(__file__).with_name("host.py"), folders[name], tmp_path / "state"]
    ran = subprocess.run(line, capture_output=True, text=True, check=True)
    assert json.loads(ran.stdout) == ahead


@pytest.mark.parametrize("name", ALL)
def test_damaged_bytes_and_those_of_another_fmu_are_refused(host, name, c_level):
    fmu = host(name).start()
    content = c_level.packed(fmu, c_level.saved(fmu))
    for place in range(0, len(content), max(1, len(content) // 60)):
        broken = bytearray(content)
        broken[place] ^= 0x10
        assert c_level.unpacked(fmu, bytes(broken))[0] == ERROR
    assert c_level.unpacked(fmu, content[:-1])[0] == ERROR
    stranger = host("lpf1" if name != "lpf1" else "lpnl2").start()
    assert c_level.unpacked(stranger, content)[0] == ERROR


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
def test_directional_derivatives_between_steps_equal_differences_over_a_step_of_nothing(host, name, c_level):
    fmu, change = host(name).start(), 1e-6
    fmu.set_named(dict.fromkeys(fmu.inputs(), 0.11))
    fmu.step(0.0, 0.02)
    outputs = [v.name for v in fmu.description.modelVariables if v.causality == "output"]
    state = c_level.saved(fmu)
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
