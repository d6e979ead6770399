"""What each scheme does in a step, against formulas of its own: a mass on a spring and damper, without any FMU.

The mass feels the mean force that its coupling values give, the spring the mean velocity; with explicit schemes these
are the formulas of Adams and Bashforth, where the end of the step is known or found those of Adams and Moulton.
"""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cosim import (
    Adaptive,
    Algorithm,
    Bond,
    Capabilities,
    GaussSeidel,
    Implicit,
    Jacobi,
    Result,
    Scenario,
    System,
    dense_runs,
    run,
)
from cosim.algorithm import VALUES
from cosim.engine import calls, march
from cosim.engine.implicit import _broyden, _invert
from cosim.engine.plan import DISCARD
from cosim.engine.sweep import on_parabola, step_from
from cosim.functions import address_of
from cosim.isolation.callbacks import StateCallbacks
from eightpost.errors import StepError
from eightpost.signals import Drivefile, TimeSeries

MASS, STIFFNESS, DAMPING = 10.0, 4000.0, 60.0
EXPLICIT = [scheme(values=values) for scheme in (Jacobi, GaussSeidel) for values in VALUES]

#: Points of the past that an explicit scheme's coupling values follow.
POINTS = {"held": 1, "extrapolated": 2, "parabolic": 3}


@pytest.fixture
def parts(make: Any) -> Any:
    """Return a function that makes the mass and the damper; both can go back to earlier states."""

    class Restorable(make.component):
        longest = np.inf

        def functions(self) -> Any:
            table = StateCallbacks(self).table()

            def do_step(instance: Any, time: float, step: float, final: int) -> int:
                return DISCARD if step > self.longest else calls.do_step(table.do_step, 0, time, step, final)

            function = calls.STEP(do_step)
            return replace(table, do_step=address_of(function), keep=(table.keep, function))

        def refused(self, what: str, *_: Any) -> StepError:
            return StepError(f"refused to {what}")

        def save(self) -> Any:
            return self.state, dict(self.inputs), dict(self.slopes)

        def restore(self, state: Any) -> None:
            self.state, self.inputs, self.slopes = state[0], dict(state[1]), dict(state[2])

        def free(self, state: Any) -> None:
            pass

    def made(damping: float = DAMPING, law: Any = None, speed: float = 1.0) -> dict[str, Any]:
        options = {"capabilities": Capabilities(interpolates_inputs=True, state=True)}
        push = make.table(make.variable("force", "input", "N"), make.variable("velocity", "output", "m/s"))
        pull = make.table(
            make.variable("velocity", "input", "m/s"), make.variable("force", "output", "N", ["velocity"]),
            make.variable("travel", "output", "m"),
        )  # fmt: skip
        force = law or (lambda x, v: STIFFNESS * x + damping * v)
        mass = Restorable(
            push, lambda v, _: {"velocity": v},
            lambda v, a, b, h: v - 0.5 * (a["force"] + b["force"]) * h / MASS, speed, **options,
        )  # fmt: skip
        damper = Restorable(
            pull, lambda x, u: {"force": force(x, u["velocity"]), "travel": x},
            lambda x, a, b, h: x + 0.5 * (a["velocity"] + b["velocity"]) * h, **options,
        )  # fmt: skip
        return {"car": mass, "shock": damper}

    return made


def ran(parts: dict[str, Any], algorithm: Algorithm, *, step: float = 0.004, stop: float = 0.043) -> Result:
    """Steps of 4 ms, the last one of 3 ms."""
    system = System(parts, [Bond.between("car", "shock", displacement=False)])
    return run(system, Scenario(stop), algorithm=algorithm, step=step, engine="python")


def columns(result: Result) -> tuple[np.ndarray, ...]:
    names = ("car.velocity", "shock.force", "shock.travel")
    return (result.series.time, *(result.series[name] for name in names))


def integral(times: np.ndarray, values: np.ndarray, start: float, end: float) -> float:
    """Integral from `start` to `end` of the polynomial through some points."""
    polynomial = np.polyfit(times - start, values, len(times) - 1)
    return float(np.polyval(np.polyint(polynomial), end - start))


def guessed(t: np.ndarray, y: np.ndarray, n: int, values: str) -> float:
    """Integral over the step after point n of a signal whose end is not known."""
    if values == "interpolated":
        return float(0.5 * (y[n - 1] + y[n]) * (t[n + 1] - t[n]))
    past = slice(n + 1 - POINTS[values], n + 1)
    return integral(t[past], y[past], t[n], t[n + 1])


def known(t: np.ndarray, y: np.ndarray, n: int, values: str) -> float:
    """The same where the end is known."""
    if values == "held":
        return float(y[n + 1] * (t[n + 1] - t[n]))
    there = slice(n - 1 if values == "parabolic" else n, n + 2)
    return integral(t[there], y[there], t[n], t[n + 1])


@pytest.mark.parametrize("algorithm", EXPLICIT, ids=lambda a: f"{a.name} {a.values}")
def test_the_ends_of_a_bond_feel_what_the_formula_of_the_scheme_gives(parts: Any, algorithm: Any) -> None:
    t, v, f, x = columns(ran(parts(), algorithm))
    assert t.size == 12
    velocity = guessed if isinstance(algorithm, Jacobi) else known
    for n in range(2, t.size - 1):
        assert v[n + 1] - v[n] == pytest.approx(-guessed(t, f, n, algorithm.values) / MASS, abs=1e-12)
        assert x[n + 1] - x[n] == pytest.approx(velocity(t, v, n, algorithm.values), abs=1e-14)


def test_an_implicit_step_feels_the_parabola_through_the_end_that_it_found(parts: Any) -> None:
    """With a damper at which an exchange without iteration diverges."""
    result = ran(parts(damping=6000.0), Implicit(tolerance=1e-9))
    t, v, f, x = columns(result)
    assert result.converged
    for n in range(1, t.size - 1):
        assert v[n + 1] - v[n] == pytest.approx(-known(t, f, n, "parabolic") / MASS, abs=1e-7)
        assert x[n + 1] - x[n] == pytest.approx(known(t, v, n, "parabolic"), abs=1e-12)
    assert f[1:] == pytest.approx(STIFFNESS * x[1:] + 6000.0 * v[1:], rel=1e-12)
    # What is linear is solved by the first move after its slope is known: one more for the difference, at first.
    assert 2 * result.steps <= result.iterations <= 3 * result.steps + 3


def test_groups_that_nothing_couples_are_solved_each_as_if_alone(parts: Any) -> None:
    one, other = parts(damping=6000.0), parts(damping=2500.0, speed=-0.5)
    both = {f"{name}_{k}": part for k, pair in enumerate((one, other)) for name, part in pair.items()}
    bonds = [Bond.between(f"car_{k}", f"shock_{k}", displacement=False) for k in (0, 1)]
    algorithm, scenario = Implicit(tolerance=1e-10), Scenario(0.043)
    joined = run(System(both, bonds), scenario, algorithm=algorithm, step=0.004, engine="python").series
    alone = [ran(parts(damping=6000.0), algorithm), ran(parts(damping=2500.0, speed=-0.5), algorithm)]
    for k, result in enumerate(alone):
        for name in ("car.velocity", "shock.force"):
            part, _, signal = name.partition(".")
            expected = result.series[name]
            assert joined[f"{part}_{k}.{signal}"] == pytest.approx(expected, rel=1e-8, abs=1e-8 * abs(expected).max())


def test_the_first_step_holds_what_it_starts_with(parts: Any) -> None:
    for algorithm in EXPLICIT:
        t, v, f, _ = columns(ran(parts(), algorithm))
        assert v[1] - v[0] == pytest.approx(-f[0] * t[1] / MASS, abs=1e-12)


@pytest.mark.parametrize("algorithm", EXPLICIT, ids=lambda a: f"{a.name} {a.values}")
def test_the_energy_of_a_bond_is_what_one_end_gives_less_what_the_other_takes(parts: Any, algorithm: Any) -> None:
    """Each with the mean of its own motion or force, and with what it was fed."""
    result = ran(parts(), algorithm)
    t, v, f, x = columns(result)
    given = -0.5 * (v[1:] + v[:-1]) * np.diff(v) * MASS
    taken = 0.5 * (f[1:] + f[:-1]) * np.diff(x)
    (energy,) = result.energy.values()
    assert energy.residual == pytest.approx(float(np.sum(given - taken)), abs=1e-12)
    assert energy.transferred == pytest.approx(float(np.abs(taken).sum()), rel=1e-12)
    assert t.size == 12


@pytest.mark.parametrize("values", ["held", "extrapolated", "parabolic"])
def test_the_local_error_of_a_bond_is_what_its_ends_assumed_wrongly(parts: Any, values: str) -> None:
    """From the third step on; before, there is too little past, and the first steps are taken off by hand."""
    algorithm, worst = Jacobi(values), {}
    for stop in (0.012, 0.04):
        result = ran(parts(), algorithm, stop=stop)
        (found,) = result.coupled.values()
        worst[stop] = (
            np.array([found.velocity_error, found.force_error]) ** 2 * result.series.time[-1],
            columns(result),
        )
    (before, _), (after, (t, v, f, _)) = worst[0.012], worst[0.04]
    past = POINTS[values]
    for k, y in enumerate((v, f)):
        ahead = [
            np.polyval(np.polyfit(t[n + 1 - past : n + 1], y[n + 1 - past : n + 1], past - 1), t[n + 1])
            for n in range(3, t.size - 1)
        ]
        squares = float(np.sum((np.array(ahead) - y[4:]) ** 2) * 0.004)
        assert after[k] - before[k] == pytest.approx(algorithm.accuracy.share**2 * squares, rel=1e-6)
    (found,) = ran(parts(), algorithm, stop=0.04).coupled.values()
    assert found.velocity_spread == pytest.approx(float(np.std(v[1:])), rel=1e-9)
    assert found.force_spread == pytest.approx(float(np.std(f[1:])), rel=1e-9)


def test_the_local_error_of_an_implicit_step_is_that_of_a_guess_on_a_parabola(parts: Any) -> None:
    """Of the force, which is guessed; the velocity is known when the damper steps."""
    algorithm, squares = Implicit(tolerance=1e-10), {}
    for stop in (0.012, 0.04):
        result = ran(parts(), algorithm, stop=stop)
        (found,) = result.coupled.values()
        squares[stop] = found.force_error**2 * result.series.time[-1]
        assert found.velocity_error == pytest.approx(0.0, abs=1e-12)
    t, _, f, _ = columns(result)
    ahead = [np.polyval(np.polyfit(t[n - 2 : n + 1], f[n - 2 : n + 1], 2), t[n + 1]) for n in range(3, t.size - 1)]
    expected = float(np.sum((np.array(ahead) - f[4:]) ** 2) * 0.004)
    assert squares[0.04] - squares[0.012] == pytest.approx(algorithm.accuracy.share**2 * expected, rel=1e-4)


def past_of(t: np.ndarray, y: np.ndarray) -> SimpleNamespace:
    """A signal at three points, as the loop remembers it."""
    last = np.array([t[2] - t[1], t[1] - t[0]])
    return SimpleNamespace(now=y[2:], past=y[1:2], older=y[:1], last=last, pace=1.0 / last)


@pytest.mark.parametrize("steps", [(0.1, 0.1, 0.1), (0.1, 0.1, 0.03), (0.1, 0.03, 0.03), (0.1, 0.03, 0.2)])
def test_a_parabola_goes_on_exactly_whatever_the_steps(steps: tuple[float, float, float]) -> None:
    t = np.array([0.0, *np.cumsum(steps)])
    y = 3.0 - 2.0 * t + 5.0 * t**2
    past = past_of(t[:3], y[:3])
    step = step_from(past, t[2], steps[2], 4, 7)
    assert on_parabola(past, 0, step) == pytest.approx(y[3], rel=1e-13)
    assert (step.time, step.size, step.first, step.last) == (t[2], steps[2], 4, 7)
    assert step.per_second == pytest.approx(1.0 / steps[2], rel=1e-14)
    assert step.line == pytest.approx(steps[2] / steps[1], rel=1e-14)


@pytest.mark.parametrize("size", [1, 2, 3, 6])
def test_a_matrix_is_inverted_also_where_its_first_pivot_is_zero(size: int) -> None:
    a = np.random.default_rng(size).normal(size=(size, size))
    if size > 1:
        a[0, 0] = 0.0
    found = np.empty(size * size)
    _invert(a.ravel().copy(), size, found)
    np.testing.assert_allclose(found.reshape(size, size), np.linalg.inv(a), rtol=1e-9, atol=1e-12)


def test_a_matrix_without_an_inverse_leaves_numbers() -> None:
    found = np.empty(4)
    _invert(np.zeros(4), 2, found)
    assert found.tolist() == [1.0, 0.0, 0.0, 1.0]


def test_an_update_of_the_inverse_fits_the_last_move_and_leaves_what_that_says_nothing_of() -> None:
    """H y = s, and H z as before for every z that the move does not meet: s'H z = 0."""
    rng, n = np.random.default_rng(4), 4
    before, move, change = rng.normal(size=(n, n)), rng.normal(size=n), rng.normal(size=n)
    inverse = np.concatenate([[7.0], before.ravel()])
    m = SimpleNamespace(move=move, change=change, left=np.ones(n), right=np.ones(n), inverse=inverse)
    plan = SimpleNamespace(loops=SimpleNamespace(unknowns=np.array([0, n]), matrix=np.array([1])))
    _broyden(plan, m, 0)
    after = inverse[1:].reshape(n, n)
    assert after @ change == pytest.approx(move, rel=1e-10)
    met = before.T @ move
    for z in np.linalg.svd(met[None])[2][1:]:
        assert after @ z == pytest.approx(before @ z, rel=1e-10)
    assert inverse[0] == 7.0


def test_a_force_that_jumps_by_a_little_is_found_well_enough_and_by_a_lot_is_not(parts: Any) -> None:
    """Dry friction holds the mass, where no velocity has the force that is needed."""

    def stiff(jump: float) -> Any:
        return lambda x, v: 6000.0 * v + (jump if v > 0.0 else -jump)

    small, large = (
        ran(parts(law=stiff(jump)), Implicit(tolerance=1e-5, iterations=4), step=1e-3, stop=0.02)
        for jump in (0.1, 3000.0)
    )
    assert small.converged
    assert not large.converged
    assert "steps did not converge" in " ".join(large.notes)


# ---- Steps of chosen size ------------------------------------------------------------------------


def control(order: int = 2, least: float = 1e-4, largest: float = 0.5) -> march.Control:
    return march.Control(np.array([1]), np.array([0.01]), 1e-3, order, least, largest)


def test_the_next_step_follows_the_last_two_errors() -> None:
    chosen = march._next_step
    assert chosen(control(), 0.01, 1.0, 1.0) == pytest.approx(0.009, rel=1e-14)
    assert chosen(control(), 0.01, 0.5, 1.0) == pytest.approx(0.009 * 0.5 ** (-0.7 / 3.0), rel=1e-14)
    assert chosen(control(), 0.01, 1.0, 0.5) == pytest.approx(0.009 * 0.5 ** (0.4 / 3.0), rel=1e-14)
    assert chosen(control(order=1), 0.01, 0.5, 1.0) == pytest.approx(0.009 * 0.5**-0.35, rel=1e-14)


def test_the_next_step_is_at_most_four_times_the_last_and_within_its_bounds() -> None:
    chosen = march._next_step
    assert chosen(control(), 0.01, 0.0, 1.0) == pytest.approx(0.04)
    assert chosen(control(), 0.01, 1e9, 1.0) == pytest.approx(0.002)
    assert chosen(control(largest=0.015), 0.01, 0.0, 1.0) == 0.015
    assert chosen(control(least=0.005), 0.01, 1e9, 1.0) == 0.005
    # No error at all counts as one of 1e-8.
    factor = 1e-3 ** (-0.7 / 3.0) * 1e-8 ** (0.4 / 3.0)
    assert chosen(control(), 0.01, 1e-3, 0.0) == pytest.approx(0.009 * factor, rel=1e-12)


@pytest.mark.parametrize(("order", "divisor"), [(1, 1.0), (2, 3.0), (3, 7.0)])
def test_whole_step_and_halves_differ_by_the_error_of_the_halves_times_a_power_of_two_less_one(
    order: int, divisor: float
) -> None:
    """Of what is allowed: 0.01, and a thousandth of the largest value so far."""
    m = SimpleNamespace(now=np.array([9.0, -4.0]))
    once = np.array([0.0, -4.07])
    for scale, allowed in ((2.0, 0.014), (20.0, 0.03)):
        found = march._difference(m, once, control(order), np.array([scale]))
        assert found == pytest.approx(0.07 / (divisor * allowed), rel=1e-12)
    assert np.isnan(march._difference(m, np.array([0.0, np.nan]), control(order), np.array([2.0])))


@pytest.mark.parametrize("scheme", [GaussSeidel(), Jacobi("extrapolated"), Implicit()], ids=lambda s: s.name)
def test_an_adaptive_run_stays_near_the_exact_motion_and_takes_larger_steps_as_it_dies_down(
    parts: Any, scheme: Any
) -> None:
    """m v' = -c v, a velocity of exp(-6 t)."""
    law = lambda x, v: 60.0 * v  # noqa: E731
    result = ran(parts(law=law), Adaptive(scheme, relative=1e-4, largest=0.2), step=0.05, stop=2.0)
    series = result.series
    assert series["car.velocity"] == pytest.approx(np.exp(-6.0 * series.time), abs=3e-3)
    assert series.time.tolist() == pytest.approx([0.05 * k for k in range(41)])
    assert result.step < 0.5 * result.largest_step
    assert result.largest_step <= 0.05 * (1.0 + 1e-9)


@pytest.mark.parametrize(("relative", "others"), [(1e-4, [8.0]), (0.3, [8.0, 1.0 / 8.0])])
def test_an_adaptive_run_is_compared_with_one_of_eight_times_its_tolerance_and_if_need_be_an_eighth(
    parts: Any, monkeypatch: pytest.MonkeyPatch, relative: float, others: list[float]
) -> None:
    made = []
    plain = dense_runs.DenseRuns.run

    def spied(self: Any, scheme: Any, step: float) -> Result:
        made.append(scheme.relative / relative)
        return plain(self, scheme, step)

    monkeypatch.setattr(dense_runs.DenseRuns, "run", spied)
    result = ran(parts(), Adaptive(relative=relative, largest=0.2), step=0.1, stop=0.3)
    assert made == pytest.approx([1.0, *others])
    assert result.coupling_error is not None


def test_rejected_steps_leave_no_trace_in_what_is_added_up(parts: Any) -> None:
    """The first step is far too large; time, energy and spread are those of the steps that stayed."""
    result = ran(parts(), Adaptive(relative=1e-3, largest=0.2), step=0.15, stop=0.3)
    assert result.rejected_steps > 0
    (energy,), (found,) = result.energy.values(), result.coupled.values()
    # The damper and spring take from the mass what it lost, less what is wrong with the coupling.
    velocity = result.series["car.velocity"][-1]
    x, f = (result.series[name][-1] for name in ("shock.travel", "shock.force"))
    assert abs(energy.residual) < 0.05
    assert energy.transferred > 0.5 * MASS * (1.0 - velocity**2)
    assert f == pytest.approx(STIFFNESS * x + DAMPING * velocity, abs=1.0)
    assert 0.1 < found.velocity_spread < 1.0


def test_a_step_that_a_part_discards_is_made_again_smaller_and_one_that_fails_ends_the_run(parts: Any) -> None:
    made = parts()
    made["shock"].longest = 0.003
    result = ran(made, Adaptive(relative=0.1), step=0.02, stop=0.04)
    assert not result.partial
    assert result.rejected_steps > 0
    assert result.series.time[-1] == 0.04
    steps = [entry[1] for entry in made["shock"].log if len(entry) == 4]
    assert max(steps) <= 0.003
    # A fifth of 20 ms, and a fifth of that.
    assert steps[0] == pytest.approx(0.0008)
    failing = parts()
    advance = failing["shock"].advance

    def refuse(x: float, start: Any, end: Any, step: float) -> float:
        if step > 0.003:
            raise StepError("the step is too long")
        return float(advance(x, start, end, step))

    failing["shock"].advance = refuse
    with pytest.raises(StepError, match="refused to step"):
        ran(failing, Adaptive(relative=0.1), step=0.02, stop=0.04)


def test_a_system_at_rest_is_stepped_as_far_as_is_allowed(parts: Any) -> None:
    """Its error is exactly zero."""
    result = ran(parts(speed=0.0), Adaptive(largest=0.1), step=0.1, stop=1.0)
    assert not result.partial
    assert (result.steps, result.rejected_steps) == (20, 0)


def test_a_tolerance_that_no_step_meets_ends_the_run_at_its_least_step(parts: Any) -> None:
    rough = np.random.default_rng(3)
    law = lambda x, v: float(rough.normal(scale=1e3))  # noqa: E731
    result = ran(parts(law=law), Adaptive(relative=1e-6, least=1e-3), step=0.05, stop=0.2)
    assert result.partial
    assert not result.converged
    assert "went down to its least" in " ".join(result.notes)


# ---- Limits --------------------------------------------------------------------------------------


@pytest.mark.parametrize(("settling", "beyond", "off"), [(0.0, 0.5, 0.25), (0.5, 1.0, 0.5)])
def test_time_beyond_limits_is_counted_from_the_settling_time_on(
    make: Any, settling: float, beyond: float, off: float
) -> None:
    """Beyond its fit in the second half, the tire off the ground in the last quarter; at the end of a step."""
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


def test_a_drive_is_straight_between_its_points_in_an_adaptive_run(make: Any, parts: Any) -> None:
    """The mass is pushed by a drive with unequal points, through an input beside that of the bond."""
    time = np.array([0.0, 0.03, 0.05, 0.2])
    drive = Drivefile(TimeSeries.from_channels(time, {"push": ("N", np.array([0.0, 30.0, -20.0, 10.0]))}))
    made = parts(law=lambda x, v: 0.0, speed=0.0)
    mass = made["car"]
    mass.variables = {**mass.variables, "push": make.variable("push", "input", "N")}
    mass.advance = lambda v, a, b, h: v + 0.5 * (a["push"] + b["push"] - a["force"] - b["force"]) * h / MASS
    system = System(made, [Bond.between("car", "shock", displacement=False)])
    result = run(system, Scenario(0.2, drive, record_step=0.01), algorithm=Adaptive(), step=0.01, engine="python")
    t = result.series.time
    exact = [np.trapezoid(np.interp(fine := np.linspace(0.0, end, 20001), time, [0, 30, -20, 10]), fine) for end in t]
    assert result.series["car.velocity"] == pytest.approx(np.array(exact) / MASS, abs=1e-6)
