"""Saved and serialized states, and derivatives."""

import ctypes
import json
import math
import struct
import subprocess
import sys
from pathlib import Path

import pytest

from eightpost.shock import LAWS

ALL = (*LAWS, "seven_dof", "quarter_car")
OK, WARNING, DISCARD, ERROR, FATAL = range(5)


@pytest.mark.parametrize("name", [*ALL, "assembly"])
def test_a_restored_state_continues_bit_for_bit_also_in_another_instance(host, name, c_level):
    fmu = host(name)
    bristles = [v for v in fmu.references if v.endswith("bristle_force")]  # with them, cars keep deflections too
    assert fmu.set_named(dict.fromkeys(bristles, 150.0)) == OK
    fmu.start().run(7)
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


@pytest.mark.repeated
@pytest.mark.parametrize("name", ["lpnl2", "seven_dof"])
def test_a_serialized_state_resumes_in_another_process(host, folders, tmp_path, name, c_level):
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
def test_a_damaged_serialized_state_and_one_of_another_fmu_are_refused(host, name, c_level):
    fmu = host(name).start()
    content = c_level.packed(fmu, c_level.saved(fmu))
    for place in range(0, len(content), max(1, len(content) // 60)):
        broken = bytearray(content)
        broken[place] ^= 0x10
        assert c_level.unpacked(fmu, bytes(broken))[0] == ERROR
    assert c_level.unpacked(fmu, content[:-1])[0] == ERROR
    stranger = host("lpf1" if name != "lpf1" else "lpnl2").start()
    assert c_level.unpacked(stranger, content)[0] == ERROR


def digest(content, value):
    """Return the FNV-1a hash."""
    for byte in content:
        value = (value ^ byte) * 1099511628211 % 2**64
    return value.to_bytes(8, "little")


@pytest.mark.parametrize("name", ALL)
def test_a_state_is_marked_by_the_hash_of_the_guid(host, name, c_level):
    fmu = host(name).start()
    marked = digest(fmu.description.guid.encode(), 14695981039346656037)
    assert c_level.packed(fmu, c_level.saved(fmu))[16:24] == marked


def signed(content, changes):
    """Return a serialized state with changed 8-byte words in its body, {place: word}, and a correct checksum."""
    words = [content[k : k + 8] for k in range(0, len(content), 8)]
    for place, word in changes.items():
        words[HEADER + place] = word
    words[4] = digest(b"".join(words[HEADER:]), int.from_bytes(words[2], "little"))
    return b"".join(words)


#: Words before the body, and the body's first words: phase, time, stop, stale, then numbers and flags.
HEADER, PHASE, TIME, STOP, STALE, FIRST_SLOPE = 5, 0, 1, 2, 3, 4
NOT_A_NUMBER = struct.pack("<d", math.nan)


@pytest.mark.parametrize(
    ("place", "word", "reason"),
    [
        (PHASE, struct.pack("<q", 3), "its phase is unknown"),
        (PHASE, struct.pack("<q", -1), "its phase is unknown"),
        (TIME, NOT_A_NUMBER, "a number is not finite"),
        (STOP, struct.pack("<d", math.inf), "a number is not finite"),
        (STALE, struct.pack("<q", 2), "a Boolean is neither true nor false"),
        (FIRST_SLOPE, NOT_A_NUMBER, "a number is not finite"),
    ],
)
@pytest.mark.parametrize("name", ["lpnl2", "seven_dof"])
def test_an_invalid_state_with_a_correct_checksum_is_refused(host, name, c_level, place, word, reason):
    fmu = host(name).start()
    fmu.run(3)
    content = c_level.packed(fmu, c_level.saved(fmu))
    assert c_level.unpacked(fmu, signed(content, {}))[0] == OK
    assert c_level.unpacked(fmu, signed(content, {place: word}))[0] == ERROR
    assert f"this state is not valid for this FMU: {reason}" in fmu.messages_text()


@pytest.mark.repeated(2)
@pytest.mark.parametrize("name", ALL)
def test_no_word_of_a_state_may_be_nan(host, name, c_level):
    """A NaN lagged force was once used as an index (a number of pieces) and as an exponent."""
    fmu = host(name).start()
    fmu.run(3)
    content = c_level.packed(fmu, c_level.saved(fmu))
    for place in range(len(content) // 8 - HEADER):
        assert c_level.unpacked(fmu, signed(content, {place: NOT_A_NUMBER}))[0] == ERROR


def test_a_state_with_parameters_out_of_range_or_contradicting_is_refused(host, c_level):
    fmu, values = host("lpnl2"), {"motion_ratio": 1.2345, "lag_zero_force": 2345.0}
    assert fmu.set_named(values) == OK
    fmu.start()
    content = c_level.packed(fmu, c_level.saved(fmu))
    numbers = struct.unpack(f"<{len(content) // 8 - HEADER}d", content[8 * HEADER :])
    at = {name: numbers.index(value) for name, value in values.items()}
    for name, value, reason in (
        ("motion_ratio", -1.0, "motion_ratio is out of its range"),
        ("lag_zero_force", 1.0, "lag_zero_force must be greater than lag_full_force"),
    ):
        assert c_level.unpacked(fmu, signed(content, {at[name]: struct.pack("<d", value)}))[0] == ERROR
        assert reason in fmu.messages_text()


@pytest.mark.parametrize("name", ["lpnl2", "seven_dof"])
def test_a_state_of_another_fmu_is_refused(host, name, c_level):
    """It may be shorter, so reading it as a state of this FMU would go beyond its end."""
    fmu, stranger = host(name).start(), host("polylinear").start()
    state = c_level.saved(stranger)
    assert fmu.call("SetFMUstate", state) == ERROR
    assert fmu.call("GetFMUstate", ctypes.byref(state)) == ERROR
    assert "this is not a state of this FMU" in fmu.messages_text()
    assert stranger.call("SetFMUstate", state) == OK


#: Parameters that are refused if they change alone.
PARTS_OF_A_CURVE = {f"curve.knot_{of}[{k + 1}]" for of in ("velocity", "force", "slope") for k in range(25)}
PARTS_OF_A_CURVE |= {"curve.compression_speed", "curve.rebound_speed"}


@pytest.mark.parametrize("name", ALL)
def test_directional_derivatives_in_initialization_equal_finite_differences(host, name):
    fmu = host(name)
    fmu.call("EnterInitializationMode")
    fmu.set_named(dict.fromkeys(fmu.inputs(), 0.11))
    (unknown, *_) = fmu.description.initialUnknowns
    output = unknown.variable.name
    for known in unknown.dependencies:
        if known.type != "Real" or known.name in PARTS_OF_A_CURVE:
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
            status, found = fmu.tangent([output], [known.name], [1.0])
            assert status == OK
            assert found == pytest.approx(difference, rel=1e-4, abs=1e-4), known.name


def test_invalid_derivatives_are_refused(host):
    fmu = host("lpnl2").start()
    assert fmu.tangent(["lagged_force"], ["velocity"], [1.0])[0] == ERROR
    assert fmu.tangent(["force"], ["gas_preload"], [1.0])[0] == ERROR
    one = ctypes.c_size_t(1)
    for reference, order, value in ((0, 2, 1.0), (2, 1, 1.0), (0, 1, math.nan)):
        status = fmu.call("SetRealInputDerivatives", (ctypes.c_uint * 1)(reference), one,
                          (ctypes.c_int * 1)(order), (ctypes.c_double * 1)(value))  # fmt: skip
        assert status == ERROR
