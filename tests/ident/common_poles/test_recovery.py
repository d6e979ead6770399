"""Recovery of known models from their exact responses."""

from dataclasses import replace

import control
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eightpost.ident.vehicle.common_pole_fit import CommonPoleFit, _bring_to_rest
from eightpost.ident.vehicle.frequency_response import FrequencyResponse, response_of
from eightpost.ident.vehicle.pole_search import FASTEST, Blocks, Refinement, plausibly_damped, points_of
from eightpost.vehicle import Channel, StateSpace, discretise

from .conftest import BASELINE, FREQUENCY, noisy

HIGH = 19.9


def _close(found, model, tolerance):
    """Assert that the scaled responses of two models differ by less than the tolerance."""
    points = points_of(response_of(model, FREQUENCY), floor=1e-3)
    wrong = np.abs(found.frequency_response(FREQUENCY) - model.frequency_response(FREQUENCY))
    assert (wrong * points.input_size[:, None] / points.output_size[:, None, None]).max() < tolerance


@pytest.mark.repeated
@pytest.mark.parametrize(("name", "states"), [("quarter_car", 4), ("seven_dof", 14)])
def test_a_car_is_recovered_to_rounding_and_its_order_has_a_clear_gap(name, states, request):
    model = request.getfixturevalue(name)
    found = CommonPoleFit(high=HIGH, max_states=18).fit(response_of(model, FREQUENCY))
    assert (found.order, found.start.study.clear, found.start.mirrored) == (states, True, 0)
    _close(found.model, model, 1e-8)
    np.testing.assert_allclose(np.array(found.model.modes()), np.array(model.modes()), rtol=1e-7)


def behind_rubber(response: FrequencyResponse, stiffness: float, damping: float) -> FrequencyResponse:
    """Return the response of a quarter car with rubber between shock and car, about the same damping of the shock."""
    s, H = 2j * np.pi * response.frequency, response.H.copy()
    names, force = response.output_names, response.input_names.index("force")
    v, x = names.index("velocity"), names.index("displacement")
    H = H - (BASELINE / (1.0 + BASELINE * H[v, force])) * H[:, [force]] * H[[v]]  # without the damper
    H[v, force] -= s / (stiffness + damping * s)
    H[x, force] -= 1.0 / (stiffness + damping * s)
    return replace(response, H=H + (BASELINE / (1.0 - BASELINE * H[v, force])) * H[:, [force]] * H[[v]])


def test_rubber_in_series_with_the_shock_is_represented_by_lags_of_its_force(quarter_car: StateSpace):
    true = behind_rubber(noisy(quarter_car, 1e-3, 6), 2e6, 900.0)
    v, force = true.output_names.index("velocity"), true.input_names.index("force")
    errors = []
    for lags in (False, True):
        model = CommonPoleFit(high=HIGH, max_states=8, order=4, lags=lags).fit(true).model
        wrong = np.abs(model.frequency_response(FREQUENCY)[v, force] / true.H[v, force] - 1.0)
        errors.append(float(np.sqrt(np.mean(wrong[FREQUENCY > 5.0] ** 2))))
        assert not model.D[v].any()
    assert errors[0] > 0.04 and errors[1] < 0.015


@pytest.mark.nightly
def test_no_pole_is_far_above_the_band_however_well_it_would_imitate_the_response(seven_dof):
    """A car with a lag of 200 Hz in its accelerometers: in the band of 20 Hz, a fast pole would explain it."""
    response = noisy(seven_dof, 2e-3, 5)
    lag = 1.0 / (1.0 + 1j * FREQUENCY / 200.0)
    late = np.array([name.endswith("acceleration") for name in response.output_names])
    delayed = replace(response, H=np.where(late[:, None, None], response.H * lag, response.H))
    found = CommonPoleFit(high=HIGH, max_states=20, order=20, lags=False).fit(delayed)
    assert np.abs(found.model.poles()).max() <= 1.001 * FASTEST * 2.0 * np.pi * HIGH


@given(w=st.floats(1.0, 1e4), zeta=st.floats(1e-5, 1e4))
def test_the_faster_pole_of_a_block_is_limited_too(w, zeta):
    fastest = 100.0
    blocks = plausibly_damped(Blocks(np.array([w]), np.array([zeta]), np.ones((1, 2, 1))), fastest)
    assert np.abs(blocks.poles).max() <= 1.001 * max(FASTEST * fastest, w)
    assert blocks.zeta[0] >= np.clip(0.5 * (w / fastest - 1.0), 2e-3, 0.7)


@pytest.mark.repeated
@pytest.mark.parametrize("seed", range(4))
def test_any_stable_model_is_recovered(seed):
    generator = np.random.default_rng(seed)
    w, zeta = 2.0 * np.pi * generator.uniform(1.0, 18.0, 4), generator.uniform(0.03, 0.6, 4)
    A = np.zeros((8, 8))
    for k in range(4):
        A[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = [[0.0, w[k]], [-w[k], -2.0 * zeta[k] * w[k]]]
    T = generator.standard_normal((8, 8))
    system = control.ss(T @ A @ np.linalg.inv(T), T @ generator.standard_normal((8, 3)),
                        generator.standard_normal((2, 8)) @ np.linalg.inv(T), 0.0)  # fmt: skip
    inputs = tuple(Channel(f"{c}.road", "m") for c in ("lf", "rf", "lr"))
    H = system(2j * np.pi * FREQUENCY)
    response = FrequencyResponse(FREQUENCY, H, inputs, (Channel("heave", "m"), Channel("pitch", "rad")))
    found = CommonPoleFit(high=HIGH).fit(response)
    wrong = np.abs(found.model.frequency_response(FREQUENCY) - H).max()
    assert wrong < 1e-7 * np.abs(H).max()


@pytest.mark.nightly
def test_paths_of_inputs_without_power_over_most_of_the_band_are_recovered_over_the_whole_band(seven_dof):
    exact = response_of(seven_dof, FREQUENCY[::2])
    loads = np.array([not n.endswith(("road", "force")) or n == "heave_force" for n in exact.input_names])
    variance = np.full(exact.H.shape, 1e-20)
    variance[:, loads, :] = np.where(exact.frequency > 5.5, np.inf, 1e-20)
    partial = replace(exact, H=np.where(np.isfinite(variance), exact.H, 0.0), variance=variance)
    fit = CommonPoleFit(high=HIGH, max_states=18, refinement=Refinement(max_iterations=2))
    _close(fit.fit(partial).model, seven_dof, 1e-6)


def test_shock_velocities_have_no_direct_term_even_where_the_response_has_one(quarter_car):
    held = discretise(quarter_car, 0.004, "first")  # a direct term in everything
    found = CommonPoleFit(high=HIGH, order=6).fit(response_of(held, FREQUENCY))
    row = found.model.output_names.index("velocity")
    assert not found.model.D[row].any()
    assert held.D[row].any()


def test_a_displacement_is_the_integral_of_its_velocity(quarter_car):
    found = CommonPoleFit(high=HIGH).fit(response_of(quarter_car, FREQUENCY)).model
    H = found.frequency_response(FREQUENCY)
    v, x = found.output_names.index("velocity"), found.output_names.index("displacement")
    np.testing.assert_allclose(2j * np.pi * FREQUENCY * H[x], H[v], rtol=1e-6, atol=1e-9 * np.abs(H[v]).max())


@pytest.mark.repeated
@pytest.mark.parametrize("lags", [True, False])
def test_a_car_at_rest_under_constant_inputs_does_not_creep(quarter_car, lags):
    found = CommonPoleFit(high=HIGH, lags=lags).fit(noisy(quarter_car, 0.03, 6))
    model = found.model
    largest = np.abs(model.frequency_response(FREQUENCY)).max(axis=2)
    gain = model.D - model.C @ np.linalg.solve(model.A, model.B)
    row = model.output_names.index("velocity")
    assert (np.abs(gain[row]) < 1e-12 * largest[row]).all()


@pytest.mark.nightly
def test_damped_tires_are_modelled_by_lags_of_the_roads(quarter_car):
    # The road acts through k_t + s c_t: 0.00125 s is 2.5 lbf.s/in on 2000 lbf/in.
    exact = response_of(quarter_car, FREQUENCY)
    H = exact.H.copy()
    H[:, exact.input_names.index("road")] *= 1.0 + 0.00125 * 2j * np.pi * FREQUENCY
    damped = exact.with_response(H)
    with_lags, without = (CommonPoleFit(high=15.0, lags=lags).fit(damped) for lags in (True, False))
    assert (with_lags.order, len(with_lags.model.A)) == (4, 5)
    assert any("lag" in note for note in with_lags.notes)
    assert max(with_lags.residual.values()) < 1.5e-3
    assert max(without.residual.values()) > 5.0 * max(with_lags.residual.values())


def test_the_stabilisation_diagram_keeps_the_modes_from_the_order_of_the_car_on(quarter_car):
    found = CommonPoleFit(high=HIGH, max_states=10).fit(noisy(quarter_car, 0.01, 4))
    orders = found.orders
    for mode in quarter_car.modes():
        near = {
            one.states for one in orders.tried for p in one.poles
            if p.steady and abs(p.frequency / mode.frequency_hz - 1.0) < 0.02
        }  # fmt: skip
        assert {6, 8, 10} <= near
    assert (orders.chosen, orders.is_clear) == (4, True)


def two_modes(C, names):
    A = np.array([[-1.0, 30.0, 0.0, 0.0], [-30.0, -1.0, 0.0, 0.0], [0.0, 0.0, -4.0, 70.0], [0.0, 0.0, -70.0, -4.0]])
    B = np.array([[1.0, 0.2], [0.5, -0.3], [0.1, 1.0], [-0.4, 0.6]])
    outputs = tuple(Channel(name, "m/s") for name in names)
    inputs = (Channel("lf.road", "m"), Channel("lf.force", "N"))
    return StateSpace(A, B, C, np.zeros((len(names), 2)), inputs, outputs, None, "two modes")


@pytest.mark.parametrize(
    "rows",
    [
        [[1.0, 0.3, 0.2, -0.5], [0.1, -0.4, 0.9, 0.7]],
        [[1.0, 0.3, 0.2, -0.5], [1.0, 0.3, 0.2, -0.5]],
        [[1.0, 0.3, 0.2, -0.5], [0.0, 0.0, 0.0, 0.0]],
    ],
    ids=["two velocities", "the same velocity twice", "a velocity that never moves"],
)
def test_velocities_have_no_response_to_constant_inputs(rows):
    car = two_modes(np.array(rows), ("lf.velocity", "rf.velocity"))
    s = 2j * np.pi * np.linspace(0.5, 25.0, 50)
    still = _bring_to_rest(car, 4, s, np.ones((2, s.size)))
    response = still.C @ np.linalg.solve(still.A, still.B)
    assert np.abs(response).max() < 1e-12 * np.abs(car.C @ np.linalg.solve(car.A, car.B)).max() + 1e-14
