"""Tests of the modal form: exact at any step, also where modes share an eigenvector and remain coupled."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import block_diag, hadamard

from eightpost.errors import ParameterError
from eightpost.vehicle import Channel, LinearStepper, StateSpace
from eightpost.vehicle.kernel import equilibrium
from eightpost.vehicle.modal import ACCURACY, modal_form

from .test_friction import MODELS


def model_of(A, *, B=None, C=None, m=2, p=3, seed=0):
    """Return a model with a state matrix; matrices that are not given are random."""
    rng = np.random.default_rng(seed)
    B = rng.normal(size=(len(A), m)) if B is None else B
    C = rng.normal(size=(p, len(A))) if C is None else C
    inputs = [Channel(f"u{k}", "N") for k in range(B.shape[1])]
    outputs = [Channel(f"y{k}", "m") for k in range(C.shape[0])]
    return StateSpace(A, B, C, rng.normal(size=(len(outputs), len(inputs))), inputs, outputs)


def random_model(n, seed):
    """Return a random stable state matrix with eigenvalues of about 10 to 110 1/s in magnitude."""
    A = np.random.default_rng(seed).normal(size=(n, n)) * 50.0 / np.sqrt(max(n, 1)) - 60.0 * np.eye(n)
    return model_of(A, seed=seed)


def in_random_coordinates(A, seed):
    """Return the same model in coordinates that are nearly, but not exactly, orthogonal."""
    rng = np.random.default_rng(seed)
    T = np.linalg.qr(rng.normal(size=A.shape))[0] @ (np.eye(len(A)) + 0.2 * np.triu(rng.uniform(-1, 1, A.shape), 1))
    return T @ A @ np.linalg.inv(T)


def in_real_coordinates(form):
    """Return the stepper of a modal form with the real and imaginary parts of all modes as states."""
    sigma, omega = np.diag(form.sigma), np.diag(form.omega)
    sigma[form.uncoupled :, form.uncoupled :] += form.coupling
    A = np.block([[sigma, -omega], [omega, sigma]])
    return LinearStepper(A, np.vstack((form.B_re, form.B_im)), np.hstack((form.C_re, form.C_im)), form.D)


def difference(model, *, steps=60, seed=1):
    """Return the largest difference of any output from the exact stepper's, relative to that output's largest value.

    The first two steps are long ones: after 1e-7 s a displacement is what is left of much larger modes.
    """
    one, rng = LinearStepper(model.A, model.B, model.C, model.D), np.random.default_rng(seed)
    modes = in_real_coordinates(modal_form(model))
    size = np.where([c.unit == "m" for c in model.inputs], 0.01, 1000.0)
    x, z, u0 = np.zeros(len(model.A)), np.zeros(len(modes.A)), np.zeros(size.size)
    expected, found = [], []
    for h in (0.05, 0.01, *(10.0 ** rng.uniform(-7.0, np.log10(0.05), steps))):
        u1 = rng.normal(size=size.size) * size
        x, z = one.advance(x, u0, u1, float(h)), modes.advance(z, u0, u1, float(h))
        expected.append(one.output(x, u1))
        found.append(modes.output(z, u1))
        u0 = u1
    return float((np.abs(np.subtract(found, expected)).max(0) / np.abs(expected).max(0)).max(initial=0.0))


@pytest.mark.parametrize("name", MODELS)
def test_the_modal_form_of_a_car_agrees_with_the_exact_stepper(name):
    assert difference(MODELS[name]) < 1e-12


@settings(max_examples=25)
@given(n=st.integers(1, 30), seed=st.integers(0, 10_000))
def test_the_modal_form_of_a_random_model_agrees_with_the_exact_stepper(n, seed):
    assert difference(random_model(n, seed), steps=15) < ACCURACY


@pytest.mark.parametrize("copies", [2, 4])
def test_uncoupled_identical_cars_remain_exactly_uncoupled(copies):
    one = MODELS["quarter_car with damper"]
    A, B, C = (block_diag(*[matrix] * copies) for matrix in (one.A, one.B, one.C))
    form, alone = modal_form(model_of(A, B=B, C=C)), modal_form(one)
    for k in range(copies):
        rows, columns, modes = slice(9 * k, 9 * (k + 1)), slice(3 * k, 3 * (k + 1)), slice(k, None, copies)
        others = [j for j in range(2 * copies) if j % copies != k]
        assert not form.C_re[rows, others].any()
        assert not form.C_im[rows, others].any()
        assert not form.B_re[others, columns].any()
        np.testing.assert_array_equal(form.C_re[rows, modes], alone.C_re)
        np.testing.assert_array_equal(form.B_im[modes, columns], alone.B_im)


@pytest.mark.parametrize("seed", range(8))
def test_repeated_eigenvalues_with_independent_eigenvectors_have_a_modal_form(seed):
    pair, real = np.array([[-3.0, 40.0], [-40.0, -3.0]]), -10.0 * np.eye(3)
    assert difference(model_of(in_random_coordinates(block_diag(pair, pair, pair, real), seed))) < 1e-11


@pytest.mark.parametrize("seed", range(4))
def test_parts_that_are_free_to_drift_are_modes_with_eigenvalue_zero(seed):
    A = in_random_coordinates(block_diag(np.zeros((2, 2)), [[-1.0, 9.0], [-9.0, -1.0]], -5.0), seed)
    model = model_of(A)
    form = modal_form(model)
    assert np.sum(np.abs(form.eigenvalues) < 1e-12) >= 1
    assert not form.steady
    assert difference(model) < 1e-11


def test_a_mode_of_exactly_zero_integrates_its_input():
    form = modal_form(model_of(np.zeros((1, 1)), B=np.array([[3.0]]), C=np.array([[0.5]])))
    assert form.sigma.tolist() == form.omega.tolist() == [0.0]
    modes = in_real_coordinates(form)
    end = modes.advance(np.zeros(2), np.array([2.0]), np.array([4.0]), 0.1)
    np.testing.assert_allclose(modes.C @ end, [0.5 * 3.0 * 3.0 * 0.1], rtol=1e-15)


@pytest.mark.parametrize("name", MODELS)
def test_the_steady_state_gives_the_models_steady_outputs(name):
    model, form = MODELS[name], modal_form(MODELS[name])
    u = np.where([c.unit == "m" for c in model.inputs], 0.01, 800.0) * np.linspace(-1.0, 1.0, len(model.inputs))
    steady = -(form.B_re @ u + 1j * (form.B_im @ u)) / form.eigenvalues
    found = form.C_re @ steady.real + form.C_im @ steady.imag + form.D @ u
    size = np.abs(model.C) @ np.abs(equilibrium(model.A, model.B, u)) + np.abs(model.D) @ np.abs(u)
    assert (np.abs(found - model.dc_gain() @ u) <= 1e-12 * size + 1e-12).all()


@pytest.mark.parametrize("n", [0, 1])
def test_a_model_without_states_or_inputs_has_a_modal_form(n):
    form = modal_form(model_of(-np.eye(n), m=1 - n, p=2))
    assert form.sigma.size == n
    assert form.pairs == 0
    assert form.steady


def test_the_same_model_gives_the_same_bytes():
    first, second = (modal_form(MODELS["seven_dof"]) for _ in range(2))
    for name in ("sigma", "omega", "B_re", "B_im", "C_re", "C_im", "D"):
        assert getattr(first, name).tobytes() == getattr(second, name).tobytes()


@settings(max_examples=20)
@given(seed=st.integers(0, 1000))
def test_modes_do_not_depend_on_the_order_of_the_states(seed):
    model = MODELS["quarter_car with damper"]
    order = np.random.default_rng(seed).permutation(4)
    other = StateSpace(
        model.A[np.ix_(order, order)], model.B[order], model.C[:, order], model.D, model.inputs, model.outputs
    )
    first, second = modal_form(model), modal_form(other)
    np.testing.assert_allclose(first.eigenvalues, second.eigenvalues, rtol=1e-12)
    for k in range(2):
        residues = [np.outer(f.C_re[:, k] - 1j * f.C_im[:, k], f.B_re[k] + 1j * f.B_im[k]) for f in (first, second)]
        assert (np.abs(residues[1] - residues[0]) <= 1e-11 * np.abs(residues[0]).max(1, keepdims=True)).all()


@settings(max_examples=40)
@given(n=st.integers(1, 20), seed=st.integers(0, 10_000))
def test_pairs_come_first_each_group_is_sorted_and_inputs_and_outputs_are_scaled(n, seed):
    form = modal_form(random_model(n, seed))
    real = form.omega == 0.0
    assert (np.diff(real.astype(int)) >= 0).all()
    for group in (form.eigenvalues[: form.pairs], form.eigenvalues[form.pairs :]):
        assert (np.diff(np.abs(group)) >= 0.0).all()
    assert not form.B_im[real].any()
    assert not form.C_im[:, real].any()
    b = np.abs(form.B_re + 1j * form.B_im).max(1)
    c = np.abs(form.C_re + 1j * form.C_im).max(0)
    assert (np.abs(np.log2(b / c)) <= 1.0 + 1e-9).all()


def test_a_free_mass_has_two_coupled_states():
    free_mass = model_of(np.array([[0.0, 1.0], [0.0, 0.0]]))
    form = modal_form(free_mass)
    assert form.uncoupled == 0
    np.testing.assert_allclose(np.abs(form.coupling), [[0.0, 1.0], [0.0, 0.0]])
    assert not form.steady
    assert difference(free_mass) < 1e-12


def test_only_the_states_of_critical_damping_are_coupled():
    critical = model_of(block_diag([[-1.0, 30.0], [-30.0, -1.0]], [[0.0, 1.0], [-100.0, -20.0]]))
    joined = in_random_coordinates(critical.A, 5)
    for model in (critical, model_of(joined, B=critical.B, C=critical.C)):
        form = modal_form(model)
        np.testing.assert_allclose(form.eigenvalues, [-1.0 + 30.0j], rtol=1e-12)
        np.testing.assert_allclose(np.linalg.eigvals(form.coupling), [-10.0, -10.0], rtol=1e-5)
        assert difference(model) < 1e-11


def jordan(pair, copies, link):
    """Return the real form of equal pairs that share their eigenvectors: each drives the one before it."""
    return np.kron(np.eye(copies), pair) + link * np.kron(np.eye(copies, k=1), np.eye(2))


@pytest.mark.parametrize("copies", [2, 3])
@pytest.mark.parametrize("seed", range(4))
def test_a_car_with_pairs_that_share_an_eigenvector_is_exact_and_couples_only_those(copies, seed):
    defective = jordan(np.array([[-6.67, 98.18], [-98.18, -6.67]]), copies, 30.0)
    others = block_diag([[-3.0, 12.0], [-12.0, -3.0]], [[-20.0, 70.0], [-70.0, -20.0]], -4.0, -300.0)
    model = model_of(in_random_coordinates(block_diag(defective, others), seed), seed=seed)
    form = modal_form(model)
    assert len(form.coupling) == 2 * copies
    assert form.steady
    np.testing.assert_allclose(form.eigenvalues, [-3.0 + 12.0j, -20.0 + 70.0j, -4.0, -300.0], rtol=1e-9)
    assert difference(model) < ACCURACY


@pytest.mark.parametrize("power", [10, 20])
def test_a_pair_whose_states_have_different_sizes_is_a_mode_as_exact_as_its_matrix_defines_it(power):
    """Its eigenvector is nearly real in the states of the model, as that of 15.6 Hz in an identified car.

    All entries of the model are exact in binary; the response to a unit step is known for each block. A rounding error
    of the largest entry changes 98 / ratio, and so the response, by this ratio squared.
    """
    ratio, h, turn = 2.0**power, 0.05, hadamard(4) / 2.0
    pair, other = np.array([[-6.0, 98.0 * ratio], [-98.0 / ratio, -6.0]]), np.array([[-2.0, 9.0], [-9.0, -2.0]])
    B, C = np.array([[1.0, 2.0], [-1.0, 1.0], [3.0, 0.0], [1.0, 1.0]]), np.array([[1.0, 2.0, -1.0, 1.0], [0, 1, 1, 3]])
    model = model_of(turn @ block_diag(pair, other) @ turn, B=turn @ B, C=C @ turn)

    def held(value, s):
        r = (np.exp(value * h) - 1.0) / value
        return np.array([[r.real, s * r.imag], [-r.imag / s, r.real]])

    expected = C @ block_diag(held(-6.0 + 98.0j, ratio), held(-2.0 + 9.0j, 1.0)) @ B
    form = modal_form(model)
    assert (form.pairs, form.coupling.size) == (2, 0)
    modes = in_real_coordinates(form)
    found = np.column_stack([modes.C @ modes.advance(np.zeros(4), u, u, h) for u in np.eye(2)])
    np.testing.assert_allclose(found, expected, rtol=np.finfo(float).eps * ratio**2)


def test_many_dependent_modes_are_joined_only_until_the_others_are_accurate():
    """Each pair drives all before it, so strongly that no two eigenvectors alone are to blame."""
    rng = np.random.default_rng(40)
    pairs = [np.array([[-z * w, w], [-w, -z * w]]) for w, z in rng.uniform((5, 0.02), (180, 0.4), (20, 2))]
    A = block_diag(*pairs) + np.triu(60.0 * rng.normal(size=(40, 40)), 2)
    Q = np.linalg.qr(rng.normal(size=(40, 40)))[0]
    model = model_of(Q @ A @ Q.T, seed=40)
    assert np.linalg.cond(np.linalg.eig(model.A)[1]) > 1e7
    form = modal_form(model)
    assert 10 < len(form.coupling) < 35
    assert form.pairs > 4
    assert difference(model, steps=10) < ACCURACY
    found = np.concatenate([form.eigenvalues, form.eigenvalues[: form.pairs].conj(), np.linalg.eigvals(form.coupling)])
    np.testing.assert_allclose(np.sort_complex(found), np.sort_complex(np.linalg.eigvals(A)), rtol=1e-6)


def test_the_steady_state_of_coupled_states_gives_the_models_steady_outputs():
    model = model_of(in_random_coordinates(block_diag(jordan(np.array([[-3.0, 9.0], [-9.0, -3.0]]), 2, 5.0), -7.0), 1))
    form = modal_form(model)
    z = form.at_rest()
    found = form.C_re @ z.real + form.C_im @ z.imag + form.D
    np.testing.assert_allclose(found, model.dc_gain(), rtol=1e-11)


def test_eigenvalues_too_close_to_be_exchanged_are_one_block(monkeypatch):
    def refuses(chosen, T, Q, job):
        return T, Q, None, None, 0, 0.0, 0.0, int(chosen.sum() < len(T))

    monkeypatch.setattr("eightpost.vehicle.modal.lapack.dtrsen", refuses)
    form = modal_form(model_of(np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 0.0], [1.0, 0.0, -2.0]])))
    assert len(form.coupling) == 3
    np.testing.assert_allclose(np.sort(np.linalg.eigvals(form.coupling)), [-2.0, 0.0, 0.0], atol=1e-7)


def test_a_discrete_model_is_rejected():
    with pytest.raises(ParameterError, match="discrete"):
        modal_form(StateSpace([[0.5]], np.zeros((1, 0)), np.zeros((0, 1)), np.zeros((0, 0)), (), (), 0.01))


@pytest.mark.parametrize("distance", [1e-2, 1e-4, 1e-5, 1e-6, 1e-8, 0.0])
def test_near_a_double_eigenvalue_the_form_is_accurate_and_couples_two_states_if_modes_are_not(distance):
    coupled = set()
    for seed in range(6):
        rng = np.random.default_rng(seed)
        T = np.triu(rng.normal(size=(8, 8)) * 20.0, 1) - np.diag(np.arange(1.0, 9.0) * 10.0)
        T[1, 1] = T[0, 0] * (1.0 + distance)
        Q = np.linalg.qr(rng.normal(size=(8, 8)))[0]
        model = model_of(Q @ T @ Q.T, seed=seed)
        assert difference(model, steps=15) < ACCURACY
        coupled.add(len(modal_form(model).coupling))
    assert coupled == {1e-2: {0}, 1e-4: {0}, 1e-6: {2}}.get(distance, {0, 2})  # a double one may be found as a pair
