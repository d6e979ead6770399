"""Error-controlled step sizes, on a mass with a spring and damper."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cosim import Adaptive, Bond, GaussSeidel, Implicit, Jacobi, Result, Scenario, System, run
from cosim.engine import march
from cosim.session import run as run_module
from eightpost.errors import StepError
from eightpost.signals import Drivefile, TimeSeries

from .mass_and_damper import DAMPING, MASS, STIFFNESS, ran


@pytest.mark.parametrize("scheme", [GaussSeidel(), Jacobi("extrapolated"), Implicit()], ids=lambda s: s.name)
def test_an_adaptive_run_matches_the_exact_solution_and_takes_larger_steps_as_the_motion_decays(
    parts: Any, scheme: Any
) -> None:
    """m v' = -c v has the solution v = exp(-6 t)."""
    law = lambda x, v: 60.0 * v  # noqa: E731
    result = ran(parts(law=law), Adaptive(scheme, relative=1e-4, largest=0.2), step=0.05, stop=2.0)
    series = result.series
    assert series["car.velocity"] == pytest.approx(np.exp(-6.0 * series.time), abs=3e-3)
    assert series.time.tolist() == pytest.approx([0.05 * k for k in range(41)])
    assert result.step < 0.5 * result.largest_step
    assert result.largest_step <= 0.05 * (1.0 + 1e-9)


@pytest.mark.parametrize(("relative", "others"), [(1e-4, [8.0]), (0.3, [8.0, 1.0 / 8.0])])
def test_an_adaptive_run_is_compared_at_eight_times_its_tolerance_and_if_needed_at_an_eighth(
    parts: Any, monkeypatch: pytest.MonkeyPatch, relative: float, others: list[float]
) -> None:
    made = []
    plain = run_module._DenseRuns.run

    def spied(self: Any, scheme: Any, step: float) -> Result:
        made.append(scheme.relative / relative)
        return plain(self, scheme, step)

    monkeypatch.setattr(run_module._DenseRuns, "run", spied)
    result = ran(parts(), Adaptive(relative=relative, largest=0.2), step=0.1, stop=0.3)
    assert made == pytest.approx([1.0, *others])
    assert result.coupling_error is not None


def test_rejected_steps_do_not_change_the_accumulated_time_energy_and_spread(parts: Any) -> None:
    """The first step is far too large; time, energy and spread are those of the accepted steps."""
    result = ran(parts(), Adaptive(relative=1e-3, largest=0.2), step=0.15, stop=0.3)
    assert result.rejected_steps > 0
    (energy,), (bond,) = result.energy.values(), result.coupled.values()
    # The damper and spring receive the energy that the mass lost, except for the coupling error.
    velocity = result.series["car.velocity"][-1]
    x, f = (result.series[name][-1] for name in ("shock.travel", "shock.force"))
    assert abs(energy.residual) < 0.05
    assert energy.transferred > 0.5 * MASS * (1.0 - velocity**2)
    assert f == pytest.approx(STIFFNESS * x + DAMPING * velocity, abs=1.0)
    assert 0.1 < bond.velocity_spread < 1.0


def test_a_step_discarded_by_a_component_is_retried_smaller_and_a_failed_step_ends_the_run(parts: Any) -> None:
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


def test_a_system_at_rest_takes_the_largest_allowed_steps(parts: Any) -> None:
    """Its error is exactly zero."""
    result = ran(parts(speed=0.0), Adaptive(largest=0.1), step=0.1, stop=1.0)
    assert not result.partial
    assert (result.steps, result.rejected_steps) == (20, 0)


def test_an_adaptive_run_ends_if_its_minimum_step_does_not_meet_the_tolerance(parts: Any) -> None:
    rough = np.random.default_rng(3)
    law = lambda x, v: float(rough.normal(scale=1e3))  # noqa: E731
    result = ran(parts(law=law), Adaptive(relative=1e-6, least=1e-3), step=0.05, stop=0.2)
    assert result.partial
    assert not result.converged
    assert "reached its minimum" in " ".join(result.notes)


def test_an_adaptive_run_interpolates_the_drive_linearly_between_its_points(make: Any, parts: Any) -> None:
    """A drive with unequal intervals pushes the mass through an input of its own, beside that of the bond."""
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


@pytest.mark.nightly
def test_a_retried_step_is_not_counted_as_not_converged(quarter_cars: Any, bumps: Drivefile) -> None:
    """One iteration is sufficient at the steps that meet the tolerance, but not at 4 ms."""
    system, scenario = quarter_cars(), Scenario(0.4, bumps, {"a": "car_a.road"}, record_step=0.4)
    few = Implicit(tolerance=1e-8, iterations=1)
    assert not run(system, scenario, algorithm=few, step=0.004).converged
    only_relative = dict.fromkeys(("car_a.velocity", "car_a.displacement", "shock_a.force"), 1e-12)
    result = run(system, scenario, algorithm=Adaptive(few, relative=1e-6, absolute=only_relative), step=0.004)
    assert result.rejected_steps > 0
    assert result.converged
    assert result.notes == ()


def test_a_value_that_is_no_number_makes_the_error_of_a_step_no_number() -> None:
    """Otherwise a step whose halves give no number would be accepted."""
    control = march.Control(np.array([0, 1]), np.full(2, 0.01), 1e-3, 1, 1e-4, 0.5)
    for values in ([np.nan, -4.07], [9.1, np.nan]):
        found = march._difference(SimpleNamespace(now=np.array([9.0, -4.0])), np.array(values), control, np.zeros(2))
        assert np.isnan(found)
