"""A native car whose modes share eigenvectors steps, starts and differentiates exactly: their states remain coupled."""

import numpy as np
import pytest

from builder.assembly import Assembly, read_parts
from builder.assembly.assembled_fmu import _vehicle_model
from builder.build import build
from builder.product import vehicle_product
from cosim import FmuComponent
from eightpost.archive import extract_archive
from eightpost.corners import CORNERS
from eightpost.vehicle import LinearStepper, write_vehicle
from eightpost.vehicle.modal import modal_form
from eightpost.wiring import Wire
from tests.double_modes import car_with_seat

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
