"""Saved and serialized states, and derivatives."""

import ctypes
import json
import math
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from builder.assembly import Assembly, read_parts
from builder.assembly.assembled_fmu import _vehicle_model
from builder.build import build
from builder.product import vehicle_product
from cosim import FmuComponent
from eightpost.archive import extract_archive
from eightpost.corners import CORNERS
from eightpost.shock import LAWS
from eightpost.vehicle import LinearStepper, write_vehicle
from eightpost.vehicle.modal import modal_form
from eightpost.wiring import Wire
from tests.double_modes import car_with_seat

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


MODEL = car_with_seat().coupled()
STEPPER = LinearStepper(MODEL.A, MODEL.B, MODEL.C, MODEL.D)
INPUTS, OUTPUTS = MODEL.input_names, MODEL.output_names
SCALE = np.where([name.endswith("road") for name in INPUTS], 0.01, 300.0)


@pytest.fixture(scope="module")
def fmu_of_car(tmp_path_factory):
    """Return the path of the car's FMU."""
    folder = tmp_path_factory.mktemp("seat")
    write_vehicle(folder / "car.json", car_with_seat())
    return build([folder / "car.json"], folder)[0].path


@pytest.fixture
def car(fmu_of_car):
    """Return instances of the car's FMU with parameters, before the end of their initialization."""
    loaded = []

    def load(**parameters):
        loaded.append(FmuComponent(fmu_of_car, f"car{len(loaded)}"))
        loaded[-1].begin(0.0, 1e6, parameters)
        return loaded[-1]

    yield load
    for fmu in loaded:
        fmu.finish()


def agree(found, expected):
    """Compare outputs relative to the size of each over the run."""
    difference = np.abs(np.subtract(found, expected)).max(axis=0) / np.abs(expected).max(axis=0)
    assert difference.max() < 1e-10, OUTPUTS[difference.argmax()]


def stepped(fmu, advance, x, *, longest):
    """Return outputs of an FMU and of a function that advances a state, over random steps with ramps."""
    rng, time, rows = np.random.default_rng(7), 0.0, []
    for step in 10.0 ** rng.uniform(-7.0, np.log10(longest), 60):
        start, end = SCALE * rng.standard_normal((2, SCALE.size))
        fmu.set(INPUTS, start)
        fmu.set_derivatives(INPUTS, (end - start) / step)
        fmu.step(time, step)
        time += step
        x, y = advance(x, start, end, step)
        rows.append((fmu.get(OUTPUTS), y))
    return zip(*rows, strict=True)


@pytest.mark.slow
def test_the_states_step_as_the_matrix_exponential_says(car):
    def exact(x, start, end, step):
        x = STEPPER.advance(x, start, end, step)
        return x, STEPPER.output(x, end)

    assert len(modal_form(MODEL).coupling) == 4
    fmu = car(start_at_equilibrium=False)
    fmu.end_initialization()
    agree(*map(np.array, stepped(fmu, exact, np.zeros(len(MODEL.A)), longest=5.0)))


@pytest.mark.slow
def test_the_car_starts_and_stays_in_the_steady_state_of_its_inputs(car):
    u = np.linspace(-1.0, 1.0, SCALE.size) * SCALE
    expected = MODEL.dc_gain() @ u
    fmu = car()
    fmu.set(INPUTS, u)
    np.testing.assert_allclose(fmu.get(OUTPUTS), expected, rtol=1e-9, atol=1e-7)
    fmu.end_initialization()
    fmu.step(0.0, 0.37)
    np.testing.assert_allclose(fmu.get(OUTPUTS), expected, rtol=1e-7, atol=1e-6)


@pytest.mark.slow
def test_model_exchange_has_the_derivatives_of_the_modal_form_and_their_slopes(fmu_of_car, c_level, tmp_path):
    extract_archive(fmu_of_car, tmp_path)
    fmu = c_level.Host(tmp_path, kind=c_level.MODEL_EXCHANGE).exchange()
    form, rng = modal_form(MODEL), np.random.default_rng(3)
    pairs, count = form.pairs, form.sigma.size
    states = np.append(rng.normal(size=count + pairs), np.zeros(4))
    u = SCALE * rng.standard_normal(SCALE.size)
    fmu.set_named(dict(zip(INPUTS, u, strict=True)))
    fmu.set_states(list(states))
    z = states[:count] + 1j * np.append(states[count : count + pairs], np.zeros(count - pairs))
    rates = np.append(form.eigenvalues * z[:-4], form.coupling @ z[-4:]) + (form.B_re + 1j * form.B_im) @ u
    expected = np.concatenate([rates.real, rates.imag[:pairs], np.zeros(4)])
    np.testing.assert_allclose(fmu.derivatives()[:-4], expected[:-4], rtol=1e-12, atol=1e-12 * np.abs(expected).max())
    one = fmu.state_names[count - 1]
    _, slopes = fmu.tangent(fmu.derivative_names[count - 4 : count], [one], [1.0])
    np.testing.assert_allclose(slopes, form.coupling[:, -1], rtol=1e-12)
    fmu.free()


def test_a_coupled_state_depends_on_those_that_drive_it_and_on_no_other():
    interface, form = vehicle_product(car_with_seat(), "car").interface, modal_form(MODEL)
    coupled = interface.states[form.uncoupled : form.sigma.size]
    for row, of in enumerate(form.coupling, start=form.uncoupled):
        found = set(interface.direct[interface.derivatives[row]])
        driving = {coupled[k] for k in np.flatnonzero(of)}
        assert found & set(coupled) == driving | {interface.states[row]}


@pytest.mark.slow
def test_the_reference_of_an_assembly_has_the_frequency_response_of_the_car(fmu_of_car, fmus):
    links = [
        Wire(*ends)
        for corner in CORNERS
        for ends in ((f"car.{corner}.velocity", f"{corner}.velocity"), (f"{corner}.force", f"car.{corner}.force"))
    ]
    parts = read_parts({"car": fmu_of_car} | dict.fromkeys(CORNERS, fmus["lpf1"]))
    found, *_ = _vehicle_model(Assembly("assembly", "An assembly", parts, tuple(links)))
    order = MODEL.select(inputs=parts[0].interface.names("input"), outputs=parts[0].interface.names("output"))
    for s in (2.0j, 98.0j, 300.0j + 1.0):
        expected, same = (m.C @ np.linalg.solve(s * np.eye(len(m.A)) - m.A, m.B) + m.D for m in (order, found))
        np.testing.assert_allclose(same, expected, rtol=1e-9, atol=1e-10 * np.abs(expected).max())
