"""Coherences and variances of an averaged response, against their definitions."""

import numpy as np
import pytest

from eightpost.ident.vehicle.estimators import regress


@pytest.fixture(scope="module")
def blocks():
    """40 blocks of three inputs and two outputs at five frequencies; the second input follows the first in part."""
    rng = np.random.default_rng(5)

    def normal(*shape):
        return rng.normal(size=shape) + 1j * rng.normal(size=shape)

    U = normal(5, 40, 3)
    U[:, :, 1] += 0.8 * U[:, :, 0]
    Y = U @ normal(5, 3, 2) + 2.0 * normal(5, 40, 2)
    return U, Y, regress(U, Y, power_floor=1e-6, names=("a", "b", "c"))


def left_over(x, inputs):
    return x - inputs @ np.linalg.lstsq(inputs, x, rcond=None)[0]


def test_multiple_coherence_is_the_share_of_power_that_all_inputs_explain(blocks):
    U, Y, solved = blocks
    found = solved.coherence()
    for k in range(5):
        for i in range(2):
            y = Y[k, :, i]
            expected = 1.0 - np.sum(np.abs(left_over(y, U[k])) ** 2) / np.sum(np.abs(y) ** 2)
            assert found[i, k] == pytest.approx(expected, rel=1e-10)
    silent = solved._replace(total=np.zeros_like(solved.total))
    assert silent.coherence().tolist() == np.zeros((2, 5)).tolist()


def test_partial_coherence_is_that_of_what_the_other_inputs_leave_of_both(blocks):
    U, Y, solved = blocks
    found = solved.partial_coherence()
    for k, i, j in np.ndindex(5, 2, 3):
        others = np.delete(U[k], j, axis=1)
        y, u = left_over(Y[k, :, i], others), left_over(U[k, :, j], others)
        expected = np.abs(np.vdot(u, y)) ** 2 / (np.vdot(u, u).real * np.vdot(y, y).real)
        assert found[i, j, k] == pytest.approx(expected, rel=1e-9)


def test_partial_coherence_is_zero_where_an_input_was_dropped_or_nothing_is_left(blocks):
    _, _, solved = blocks
    active = solved.active.copy()
    active[1, 2] = False
    found = solved._replace(active=active).partial_coherence()
    assert found[:, 1, 2].tolist() == [0.0, 0.0]
    assert (found[:, 0] > 0.0).all()
    nothing = solved._replace(H=np.zeros_like(solved.H), residual=np.zeros_like(solved.residual))
    assert nothing.partial_coherence().tolist() == np.zeros((2, 3, 5)).tolist()


def test_the_variance_of_a_response_is_that_of_least_squares(blocks):
    U, _, solved = blocks
    found = solved.variance(40, 40.0)
    for k in range(5):
        inverse = np.linalg.inv(U[k].conj().T @ U[k]).real.diagonal()
        for i in range(2):
            assert found[i, :, k] == pytest.approx(solved.residual[i, k] / (40 - 3) * inverse, rel=1e-9)
    # Blocks that overlap are worth fewer; with as many inputs as blocks one degree of freedom is left to tell.
    assert solved.variance(40, 20.0) == pytest.approx(2.0 * found, rel=1e-12)
    assert solved.variance(3, 3.0) == pytest.approx(37.0 * found, rel=1e-12)
