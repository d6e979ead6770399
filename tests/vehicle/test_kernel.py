"""Tests of the stepping kernel: exact at any step, even if the state matrix is singular."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from eightpost.vehicle import kernel, read_vehicle, shipped
from eightpost.vehicle.kernel import LinearStepper

MODELS = {
    "quarter_car": read_vehicle(shipped("quarter_car")).coupled(),
    "seven_dof": read_vehicle(shipped("seven_dof")).coupled(),
    "seven_dof with damper": read_vehicle(shipped("seven_dof")).with_damper(),
}
STEPS = st.floats(np.log(1e-7), np.log(0.05)).map(lambda x: float(np.exp(x)))


def free_mass():
    """Return a free mass: A is singular and defective, and the step is known in closed form."""
    return np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]])


def stepper(name):
    model = MODELS[name]
    return LinearStepper(model.A, model.B, model.C, model.D)


def by_series(A, B, h):
    """Return exp and its two integrals in extended precision, by Taylor series over h / 2^k and doublings."""
    A, B = A.astype(np.longdouble), B.astype(np.longdouble)
    n, halvings = len(A), max(0, int(np.ceil(np.log2(max(np.abs(A).sum(axis=1).max() * h, 1e-300)))) + 2)
    h = np.longdouble(h) / 2**halvings
    term, total, first, second = (np.eye(n, dtype=np.longdouble) for _ in range(4))
    first, second = first * h, second * h / 2
    for k in range(1, 40):
        term = term @ A * (h / k)
        total = total + term
        first = first + term * h / (k + 1)
        second = second + term * h / ((k + 1) * (k + 2))
    held, ramp = first @ B, second @ B
    for _ in range(
        halvings
    ):  # combine two steps: a ramp over both is half a ramp, then a constant half plus half a ramp
        held, ramp = total @ held + held, total @ ramp / 2 + held / 2 + ramp / 2
        total = total @ total
    return total, held - ramp, ramp


@pytest.mark.repeated
@pytest.mark.parametrize("name", MODELS)
@given(step=STEPS)
def test_discretisation_equals_a_series_in_extended_precision(name, step):
    model = MODELS[name]
    found = kernel.discretise(model.A, model.B, step)
    for matrix, expected in zip(found, by_series(model.A, model.B, step), strict=True):
        # Positions and velocities, roads and forces have different scales, so compare by column and block.
        n = len(model.A) // 2
        for rows in (slice(0, n), slice(n, None)):
            scale = np.abs(expected[rows]).max(axis=0)
            assert np.all(np.abs(matrix[rows] - expected[rows]) <= 2e-12 * scale + 1e-300)


@given(step=STEPS)
def test_a_free_mass_agrees_with_the_closed_form(step):
    Ad, B0, B1 = kernel.discretise(*free_mass(), step)
    np.testing.assert_allclose(Ad, [[1.0, step], [0.0, 1.0]], rtol=1e-14)
    np.testing.assert_allclose(B0[:, 0], [step**2 / 3, step / 2], rtol=1e-13)  # force falling from 1 to 0
    np.testing.assert_allclose(B1[:, 0], [step**2 / 6, step / 2], rtol=1e-13)  # force rising from 0 to 1


@pytest.mark.parametrize("name", MODELS)
def test_irregular_steps_with_ramps_follow_a_fine_integration(name):
    one, random = stepper(name), np.random.default_rng(11)
    t = np.concatenate([[0.0], np.cumsum(random.choice([1e-6, 3e-4, 1.7e-3, 0.008, 0.05], 40))])
    m = one.B.shape[1]
    scale = np.where([unit == "m" for unit in (c.unit for c in MODELS[name].inputs)], 0.01, 1000.0)
    u = random.normal(size=(m, len(t))) * scale[:, None]
    x = exact = one.equilibrium(u[:, 0])
    for k, h in enumerate(np.diff(t)):
        x = one.advance(x, u[:, k], u[:, k + 1], float(h))
        rise = (u[:, k + 1] - u[:, k]) / h

        def slope(s, y, start=u[:, k], rise=rise):
            return one.A @ y + one.B @ (start + s * rise)

        exact = solve_ivp(slope, (0.0, h), exact, method="DOP853", rtol=1e-12, atol=1e-16).y[:, -1]
        np.testing.assert_allclose(x, exact, rtol=1e-8, atol=1e-9 * np.abs(exact).max())


@pytest.mark.parametrize("name", MODELS)
def test_equilibrium_is_steady(name):
    one = stepper(name)
    u = np.random.default_rng(2).normal(size=one.B.shape[1])
    rest = one.equilibrium(u)
    assert np.abs(one.A @ rest + one.B @ u).max() < 1e-9
    np.testing.assert_allclose(one.advance(rest, u, u, 0.01), rest, rtol=1e-9, atol=1e-11)  # u is of order 1


def test_a_model_without_a_steady_state_is_rejected_with_the_reason():
    A, B = free_mass()
    with pytest.raises(ValueError, match=r"no unique steady state.*drift"):
        LinearStepper(A, B, np.eye(2), np.zeros((2, 1))).equilibrium(np.ones(1))


@pytest.mark.parametrize("step", [0.0, -1e-3, np.nan, np.inf])
def test_an_invalid_step_is_rejected(step):
    with pytest.raises(ValueError, match="above zero"):
        kernel.discretise(*free_mass(), step)


def test_the_cache_is_bounded_and_keeps_recently_used_entries():
    one = stepper("quarter_car")
    used = one.discrete(1e-3)
    for k in range(3 * kernel.CACHE_SIZE):
        one.discrete(1e-3 + 1e-6 * (k + 1))
        assert one.discrete(1e-3) is used
    assert len(one._steps) == kernel.CACHE_SIZE


def test_the_kernel_needs_numpy_and_scipy_only():
    """The python FMU contains the file, so it is loaded by its path in a process that may not import eightpost."""
    code = (
        "import importlib.util, sys; sys.modules['eightpost'] = None;"
        f"spec = importlib.util.spec_from_file_location('alone', {kernel.__file__!r});"
        "module = importlib.util.module_from_spec(spec); sys.modules['alone'] = module;"
        "spec.loader.exec_module(module);"
        "import numpy as np; print(module.discretise(-np.eye(1), np.eye(1), 1.0).Ad[0, 0])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert float(done.stdout) == pytest.approx(np.exp(-1.0))
