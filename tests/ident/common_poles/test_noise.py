"""Common-pole fits to noisy responses: the errors are those that the likelihood predicts."""

from dataclasses import replace

import numpy as np
import pytest

from eightpost.errors import InputError, ParameterError
from eightpost.ident.vehicle.common_pole_fit import CommonPoleFit, refitted
from eightpost.ident.vehicle.common_poles import response_deviation, sampled_models
from eightpost.ident.vehicle.frequency_response import FrequencyResponse, response_of
from eightpost.ident.vehicle.pole_search import Blocks, Feedthrough, Lag, Refinement, curvature, evaluate, points_of

from .conftest import FREQUENCY, noisy

FIT = CommonPoleFit(order=4, high=19.9, floor=1e-5, max_states=4)


def test_the_gradient_is_that_of_the_cost():
    generator = np.random.default_rng(1)
    H = generator.standard_normal((3, 2, 40)) + 1j * generator.standard_normal((3, 2, 40))
    from eightpost.vehicle import Channel  # noqa: PLC0415  only here

    response = FrequencyResponse(
        np.linspace(0.5, 20.0, 40), H, tuple(Channel(n, "N") for n in "ab"), tuple(Channel(n, "m") for n in "xyz")
    )
    points = points_of(response, floor=0.1)
    direct = np.array([[True, False], [False, False], [True, True]])
    through = Feedthrough(direct, (Lag(0, 900.0, np.ones(3, bool)), Lag(1, 300.0, np.array([True, False, True]))))
    w, zeta, B = np.array([20.0, 70.0]), np.array([0.1, 1.4]), generator.standard_normal((2, 2, 2))
    here = evaluate(points, Blocks(w, zeta, B), through)
    gradient = curvature(points, here).gradient
    small = 1e-6
    for k in range(4 + B.size):
        moved = [_moved(w, zeta, B, k, sign * small) for sign in (1.0, -1.0)]
        costs = [evaluate(points, blocks, through).cost for blocks in moved]
        assert gradient[k] == pytest.approx(0.25 * (costs[0] - costs[1]) / small, rel=1e-4, abs=1e-3)


def _moved(w, zeta, B, k, step):
    moves = np.zeros(4 + B.size)
    moves[k] = step
    return Blocks(w * np.exp(moves[:2]), zeta * np.exp(moves[2:4]), B + moves[4:].reshape(B.shape))


@pytest.mark.parametrize("order", [None, 6])
def test_a_fit_is_the_kept_one(quarter_car, order, unchanged):
    """Its order is chosen among 2 to 8, or given; some frequencies of the load are unknown."""
    noise = noisy(quarter_car, 0.03, 3, FREQUENCY[::2])
    variance = np.array(noise.variance)
    variance[:, 1, 60:] = np.inf
    found = CommonPoleFit(order=order, high=19.9, max_states=8).fit(replace(noise, variance=variance))
    drawn = sampled_models(found, 3)
    at = np.array([0.5, 2.0, 5.0, 15.0])
    kept = {name: getattr(found, name) for name in ("order", "orders", "residual", "excess", "notes", "band")}
    unchanged(
        {**kept, "cost": found.refined.solution.cost, "start": found.start.cost, "modes": np.array(found.model.modes()),
         "model": found.model.frequency_response(at), "deviation": response_deviation(drawn, at)}, relative=1e-3,
    )  # fmt: skip


@pytest.mark.slow
def test_errors_agree_with_the_reported_uncertainty(quarter_car):
    found = [FIT.fit(noisy(quarter_car, 0.02, seed)) for seed in range(16)]
    at = np.array([1.0, 3.0, 8.0, 16.0])
    exact = quarter_car.frequency_response(at)
    errors = np.stack([model.model.frequency_response(at) - exact for model in found])
    scatter = np.sqrt(np.mean(np.abs(errors) ** 2, axis=0))
    reported = response_deviation(sampled_models(found[0], 16, seed=9), at)
    ratio = reported / scatter
    assert 0.8 < np.median(ratio) < 1.25
    assert ratio.min() > 0.4
    assert ratio.max() < 2.5


def test_modes_of_a_noisy_response_are_those_of_the_car(quarter_car):
    exact = quarter_car.modes()
    for seed in range(2):
        modes = FIT.fit(noisy(quarter_car, 0.02, seed)).model.modes()
        for mode, truth in zip(modes, exact, strict=True):
            assert mode.frequency_hz == pytest.approx(truth.frequency_hz, rel=5e-3)
            assert mode.damping_ratio == pytest.approx(truth.damping_ratio, abs=5e-3)


def test_a_model_that_is_refitted_to_another_response_is_that_of_its_car(quarter_car):
    """One step from a model of a car whose responses are 5 % smaller; its order remains."""
    smaller = replace(quarter_car, B=0.95 * quarter_car.B, D=0.95 * quarter_car.D)
    found = FIT.fit(noisy(smaller, 0.002, 3))
    model = refitted(found, noisy(quarter_car, 0.002, 4), floor=FIT.floor)
    exact = quarter_car.frequency_response(FREQUENCY[10:])
    wrong = np.abs(model.frequency_response(FREQUENCY[10:]) - exact).max(axis=2)
    assert (wrong < 0.02 * np.abs(exact).max(axis=2)).all()
    assert model.A.shape == found.model.A.shape


def test_a_model_of_pure_noise_is_stable_and_a_note_reports_no_clear_gap(quarter_car):
    empty = noisy(quarter_car, 0.02, 1)
    generator = np.random.default_rng(2)
    wild = empty.with_response(generator.standard_normal(empty.H.shape) * np.abs(empty.H).mean())
    found = CommonPoleFit(high=19.9, max_states=8, refinement=Refinement(max_iterations=5)).fit(wild)
    assert (found.model.poles().real < 0.0).all()
    assert any("no clear gap" in note for note in found.notes)


def test_odd_orders_and_channels_without_a_value_are_refused(quarter_car):
    with pytest.raises(ParameterError, match="pairs"):
        CommonPoleFit(order=5)
    with pytest.raises(ParameterError, match="low must be at least 0"):
        CommonPoleFit(low=-0.1)
    assert CommonPoleFit(low=0.0).low == 0.0
    response = response_of(quarter_car, FREQUENCY)
    silent = response.H.copy()
    silent[:, response.input_names.index("aero_force")] = 0.0
    with pytest.raises(InputError, match="aero_force"):
        CommonPoleFit(high=19.9).fit(response.with_response(silent))
