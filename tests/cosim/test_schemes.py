"""A step of each scheme against its formula: a mass on a spring and damper, without any FMU.

The mass receives the mean force of its coupling values, the spring the mean velocity. If the value at the end of the
step is unknown, these are the Adams-Bashforth formulas; if it is known or iterated, the Adams-Moulton formulas.
"""

from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cosim import Adaptive, Automatic, Bond, Capabilities, GaussSeidel, Implicit, Jacobi, Result, Scenario, System, run
from cosim.engine import sweep
from cosim.engine.sweep import _invert, _on_parabola, step_from
from cosim.systems.algorithm import VALUES
from eightpost.errors import WiringError
from tests.unchanged import refusals

from .mass_and_damper import MASS, STIFFNESS, ran

EXPLICIT = [scheme(values=values) for scheme in (Jacobi, GaussSeidel) for values in VALUES]

#: Number of past points from which an explicit scheme extrapolates its coupling values.
POINTS = {"held": 1, "extrapolated": 2, "parabolic": 3}


def columns(result: Result) -> tuple[np.ndarray, ...]:
    names = ("car.velocity", "shock.force", "shock.travel")
    return (result.series.time, *(result.series[name] for name in names))


def integral(times: np.ndarray, values: np.ndarray, start: float, end: float) -> float:
    """Integral from `start` to `end` of the polynomial through some points."""
    polynomial = np.polyfit(times - start, values, len(times) - 1)
    return float(np.polyval(np.polyint(polynomial), end - start))


def guessed(t: np.ndarray, y: np.ndarray, n: int, values: str) -> float:
    """Integral over the step after point n of a coupling value whose end value is unknown."""
    if values == "interpolated":
        return float(0.5 * (y[n - 1] + y[n]) * (t[n + 1] - t[n]))
    past = slice(n + 1 - POINTS[values], n + 1)
    return integral(t[past], y[past], t[n], t[n + 1])


def known(t: np.ndarray, y: np.ndarray, n: int, values: str) -> float:
    """Integral over the step after point n of a coupling value whose end value is known."""
    if values == "held":
        return float(y[n + 1] * (t[n + 1] - t[n]))
    there = slice(n - 1 if values == "parabolic" else n, n + 2)
    return integral(t[there], y[there], t[n], t[n + 1])


@pytest.mark.parametrize("algorithm", EXPLICIT, ids=lambda a: f"{a.name} {a.values}")
def test_both_ends_of_a_bond_receive_the_coupling_values_of_the_schemes_formula(parts: Any, algorithm: Any) -> None:
    t, v, f, x = columns(ran(parts(), algorithm))
    assert t.size == 12
    velocity = guessed if isinstance(algorithm, Jacobi) else known
    for n in range(2, t.size - 1):
        assert v[n + 1] - v[n] == pytest.approx(-guessed(t, f, n, algorithm.values) / MASS, abs=1e-12)
        assert x[n + 1] - x[n] == pytest.approx(velocity(t, v, n, algorithm.values), abs=1e-14)


def test_an_implicit_step_applies_the_parabola_through_the_converged_end_value(parts: Any) -> None:
    """With a damper so stiff that explicit schemes diverge."""
    result = ran(parts(damping=6000.0), Implicit(tolerance=1e-9))
    t, v, f, x = columns(result)
    assert result.converged
    for n in range(1, t.size - 1):
        assert v[n + 1] - v[n] == pytest.approx(-known(t, f, n, "parabolic") / MASS, abs=1e-7)
        assert x[n + 1] - x[n] == pytest.approx(known(t, v, n, "parabolic"), abs=1e-12)
    assert f[1:] == pytest.approx(STIFFNESS * x[1:] + 6000.0 * v[1:], rel=1e-12)
    # The first update with a known slope solves a linear system; at first the slope needs one more iteration.
    assert 2 * result.steps <= result.iterations <= 3 * result.steps + 3


@pytest.mark.parametrize("algorithm", [Implicit(tolerance=1e-10), GaussSeidel(), Jacobi("extrapolated")], ids=str)
def test_uncoupled_groups_are_solved_independently(parts: Any, algorithm: Any) -> None:
    damping = 6000.0 if isinstance(algorithm, Implicit) else 60.0
    one, other = parts(damping=damping), parts(damping=250.0, speed=-0.5)
    both = {f"{name}_{k}": part for k, pair in enumerate((one, other)) for name, part in pair.items()}
    bonds = [Bond.between(f"car_{k}", f"shock_{k}", displacement=False) for k in (0, 1)]
    joined = run(System(both, bonds), Scenario(0.043), algorithm=algorithm, step=0.004, engine="python")
    alone = [ran(parts(**given), algorithm) for given in ({"damping": damping}, {"damping": 250.0, "speed": -0.5})]
    for k, result in enumerate(alone):
        for name in ("car.velocity", "shock.force"):
            part, _, signal = name.partition(".")
            assert joined.series[f"{part}_{k}.{signal}"].tobytes() == result.series[name].tobytes()
    assert joined.iterations == sum(result.iterations for result in alone)


def test_the_first_step_holds_the_start_values(parts: Any) -> None:
    for algorithm in EXPLICIT:
        t, v, f, _ = columns(ran(parts(), algorithm))
        assert v[1] - v[0] == pytest.approx(-f[0] * t[1] / MASS, abs=1e-12)


@pytest.mark.parametrize("algorithm", EXPLICIT, ids=lambda a: f"{a.name} {a.values}")
def test_the_energy_residual_of_a_bond_is_the_energy_supplied_minus_the_energy_received(
    parts: Any, algorithm: Any
) -> None:
    """Each end's energy is the mean of its own output times the mean of its input."""
    result = ran(parts(), algorithm)
    t, v, f, x = columns(result)
    given = -0.5 * (v[1:] + v[:-1]) * np.diff(v) * MASS
    taken = 0.5 * (f[1:] + f[:-1]) * np.diff(x)
    (energy,) = result.energy.values()
    assert energy.residual == pytest.approx(float(np.sum(given - taken)), abs=1e-12)
    assert energy.transferred == pytest.approx(float(np.abs(taken).sum()), rel=1e-12)
    assert t.size == 12


@pytest.mark.parametrize("algorithm", EXPLICIT, ids=lambda a: f"{a.name} {a.values}")
def test_the_local_error_of_a_bond_is_the_extrapolation_error_of_its_coupling_values(
    parts: Any, algorithm: Any
) -> None:
    """From the third step on; the first steps have too few past points and are subtracted."""
    squares = {}
    for stop in (0.012, 0.04):
        result = ran(parts(), algorithm, stop=stop)
        (bond,) = result.coupled.values()
        squares[stop] = np.array([bond.velocity_error, bond.force_error]) ** 2 * result.series.time[-1]
    t, v, f, _ = columns(result)
    past = POINTS.get(algorithm.values, 1)
    expected = []
    for y in (v, f):
        ahead = [
            np.polyval(np.polyfit(t[n + 1 - past : n + 1], y[n + 1 - past : n + 1], past - 1), t[n + 1])
            for n in range(3, t.size - 1)
        ]
        expected.append(algorithm.accuracy.share**2 * float(np.sum((np.array(ahead) - y[4:]) ** 2) * 0.004))
    if isinstance(algorithm, GaussSeidel):  # the mass has stepped first, so its velocity at the end is known
        expected[0] = 0.0
    assert squares[0.04] - squares[0.012] == pytest.approx(expected, rel=1e-6)
    assert bond.velocity_spread == pytest.approx(float(np.std(v[1:])), rel=1e-9)
    assert bond.force_spread == pytest.approx(float(np.std(f[1:])), rel=1e-9)


def test_the_local_error_of_an_implicit_step_is_that_of_a_parabolic_predictor(parts: Any) -> None:
    """This is the error of the force, which is predicted; the velocity is known when the damper steps."""
    algorithm, squares = Implicit(tolerance=1e-10), {}
    for stop in (0.012, 0.04):
        result = ran(parts(), algorithm, stop=stop)
        (bond,) = result.coupled.values()
        squares[stop] = bond.force_error**2 * result.series.time[-1]
        assert bond.velocity_error == pytest.approx(0.0, abs=1e-12)
    t, _, f, _ = columns(result)
    ahead = [np.polyval(np.polyfit(t[n - 2 : n + 1], f[n - 2 : n + 1], 2), t[n + 1]) for n in range(3, t.size - 1)]
    expected = float(np.sum((np.array(ahead) - f[4:]) ** 2) * 0.004)
    assert squares[0.04] - squares[0.012] == pytest.approx(algorithm.accuracy.share**2 * expected, rel=1e-4)


def past_of(t: np.ndarray, y: np.ndarray) -> SimpleNamespace:
    """A signal at three points, in the form that the loop stores."""
    last = np.array([t[2] - t[1], t[1] - t[0]])
    return SimpleNamespace(now=y[2:], past=y[1:2], older=y[:1], last=last, pace=1.0 / last)


@pytest.mark.parametrize("steps", [(0.1, 0.1, 0.1), (0.1, 0.03, 0.2)])
def test_a_parabola_is_extrapolated_exactly_for_any_step_sizes(steps: tuple[float, float, float]) -> None:
    t = np.array([0.0, *np.cumsum(steps)])
    y = 3.0 - 2.0 * t + 5.0 * t**2
    past = past_of(t[:3], y[:3])
    step = step_from(past, t[2], steps[2], 4, 7)
    assert _on_parabola(past, 0, step) == pytest.approx(y[3], rel=1e-13)
    assert (step.time, step.size, step.first, step.last) == (t[2], steps[2], 4, 7)
    assert step.per_second == pytest.approx(1.0 / steps[2], rel=1e-14)
    assert step.line == pytest.approx(steps[2] / steps[1], rel=1e-14)


@pytest.mark.parametrize("size", [1, 2, 3, 6])
def test_a_matrix_with_a_zero_first_pivot_is_inverted(size: int) -> None:
    a = np.random.default_rng(size).normal(size=(size, size))
    if size > 1:
        a[0, 0] = 0.0
    inverse = np.empty(size * size)
    _invert(a.ravel().copy(), size, inverse)
    np.testing.assert_allclose(inverse.reshape(size, size), np.linalg.inv(a), rtol=1e-9, atol=1e-12)


def test_a_zero_matrix_gives_the_identity_as_its_inverse() -> None:
    inverse = np.empty(4)
    _invert(np.zeros(4), 2, inverse)
    assert inverse.tolist() == [1.0, 0.0, 0.0, 1.0]


def test_an_implicit_step_converges_with_a_small_force_jump_and_not_with_a_large_one(parts: Any) -> None:
    """Dry friction stops the mass: no velocity gives the force of the equilibrium."""

    def stiff(jump: float) -> Any:
        return lambda x, v: 6000.0 * v + (jump if v > 0.0 else -jump)

    small, large = (
        ran(parts(law=stiff(jump)), Implicit(tolerance=1e-5, iterations=4), step=1e-3, stop=0.02)
        for jump in (0.1, 3000.0)
    )
    assert small.converged
    assert not large.converged
    assert "steps did not converge" in " ".join(large.notes)


# ---- Limits --------------------------------------------------------------------------------------


@pytest.mark.parametrize(("settling", "beyond", "off"), [(0.0, 0.5, 0.25), (0.5, 1.0, 0.5)])
def test_time_beyond_limits_is_counted_after_the_settling_time(
    make: Any, settling: float, beyond: float, off: float
) -> None:
    """Beyond the fitted range in the second half, tire off the ground in the last quarter, at the end of each step."""
    ports = make.table(
        make.variable("u", "input", "N"), make.variable("static_tire_force", "parameter", "N"),
        make.variable("beyond_fit", "output"), make.variable("tire_force", "output", "N"),
    )  # fmt: skip
    part = make.component(
        ports,
        lambda t, _: {"beyond_fit": float(t > 0.5), "tire_force": 1.0 if t <= 0.75 else -1.0},
        lambda t, _a, _b, h: t + h,
    )
    system = System({"car": part}, constants={"car.u": 0.0}, parameters={"car": {"static_tire_force": 1.0}})
    result = run(system, Scenario(1.0, settling=settling), step=0.0625, engine="python", algorithm=Jacobi())
    assert result.share_beyond_fit == {"car": pytest.approx(beyond)}
    assert result.share_tire_off == {"car.tire_force": pytest.approx(off)}


def test_schemes_with_rollback_refuse_components_without_state_and_held_inputs_are_reported(make: Any) -> None:
    system = System({"a": make.integrator(capabilities=Capabilities())}, constants={"a.u": 1.0})
    for algorithm in (Implicit(), Adaptive()):
        with pytest.raises(WiringError, match="cannot save and restore its state"):
            run(system, Scenario(0.1), algorithm=algorithm, step=0.01)
    assert any("held over each step" in note for note in run(system, Scenario(0.1), step=0.01).notes)


def test_a_scheme_and_a_run_refuse_a_wrong_argument_with_what_to_write(parts: Any, unchanged: Any) -> None:
    given = [{"algorithm": GaussSeidel}, {"algorithm": 1e-3}, {"step": "1 ms"}, {"parameters": ["shock.stiffness"]},
             {"progress": 3}]  # fmt: skip
    calls = {
        "a step as the sequence": lambda: GaussSeidel(1e-3), "a step as the values": lambda: Jacobi(1e-3),
        "a step of an implicit scheme": lambda: Implicit(1e-3), "a step of an adaptive scheme": lambda: Adaptive(1e-3),
        "one name as the sequence": lambda: GaussSeidel("car"),
        "a text as a tolerance": lambda: Implicit(tolerance="1 %"),
        "a text as the smallest step": lambda: Adaptive(least="1 ms"), "a text as an error": lambda: Automatic("0.2"),
    }  # fmt: skip
    calls |= {f"run {k}": partial(run, System(parts()), Scenario(0.1), **one) for k, one in enumerate(given)}
    unchanged(refusals(calls))


@pytest.mark.parametrize(("status", "refused"), [(0, 0), (1, 0), (2, 1), (3, 1), (4, 1), (-1, 1)])
def test_a_warning_is_no_failure(status: int, refused: int) -> None:
    m = SimpleNamespace(failure=np.zeros(3))
    assert sweep.failed(m, status, 5, 7) == refused
    assert m.failure.tolist() == ([status, 5, 7] if refused else [0, 0, 0])
