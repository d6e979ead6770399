"""Stated coupling errors of real runs against true errors; test_refinement.py has the hand calculations."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cosim import Automatic, Bond, Capabilities, FmuComponent, GaussSeidel, Jacobi, Result, Scenario, System, run
from cosim.session.result import difference
from eightpost.signals import Drivefile
from eightpost.verdict import Grade

Join = Callable[..., System]

ROAD = {"a": "car_a.road"}
DECISIVE = ("car_a.velocity", "car_a.tire_force", "shock_a.force")


class Held(FmuComponent):
    """An FMU that cannot interpolate its inputs over a step."""

    @property
    def capabilities(self) -> Any:
        return replace(super().capabilities, interpolates_inputs=False)


def true_errors(result: Result, fine: Result) -> dict[str, float]:
    return difference(result.settled(), fine.settled())


@pytest.fixture
def exact(quarter_cars: Join, bumps: Drivefile) -> Result:
    return run(quarter_cars(), Scenario(1.0, bumps, ROAD), step=5e-5, compared=False)


def test_the_default_algorithm_states_one_to_eight_times_the_true_error_for_every_channel(
    quarter_cars: Join, bumps: Drivefile, exact: Result
) -> None:
    result = run(quarter_cars(), Scenario(1.0, bumps, ROAD, record_step=0.002), algorithm=Automatic(tolerance=2.0))
    true = true_errors(result, exact)
    assert set(true) <= set(result.stated_error)
    for name, error in true.items():
        assert error < result.stated_error[name] < 8.0 * max(error, 0.02), name


def test_a_given_step_without_an_algorithm_reproduces_the_default_run_bit_by_bit(
    quarter_cars: Join, bumps: Drivefile
) -> None:
    scenario = Scenario(1.0, bumps, ROAD, record_step=0.004)
    chosen = run(quarter_cars(), scenario)
    given_step = run(quarter_cars(), scenario, step=chosen.step)
    alone = run(quarter_cars(), scenario, step=chosen.step, compared=False)
    assert chosen.scheme == given_step.scheme == "gauss-seidel"
    for other in (given_step, alone):
        assert other.series.values.tobytes() == chosen.series.values.tobytes()
    assert given_step.stated_error
    assert not alone.stated_error
    assert alone.verdict.grade == Grade.UNKNOWN


def test_a_car_at_rest_has_no_coupling_error_and_keeps_a_large_step(quarter_cars: Join) -> None:
    system = quarter_cars()
    still = replace(system, constants=dict(system.constants) | {"car_a.road": 0.0})
    result = run(still, Scenario(0.5))
    assert result.coupling_error is not None
    assert result.coupling_error < 1e-6
    assert result.step >= 1e-3
    assert result.is_clean and result.coupling_error <= result.tolerance


@pytest.mark.repeated(2)
@pytest.mark.parametrize("compared", [True, False])
@pytest.mark.parametrize("algorithm", [None, GaussSeidel(), Jacobi()], ids=str)
def test_a_run_that_oscillates_between_recorded_points_is_not_usable(make: Any, algorithm: Any, compared: bool) -> None:
    """2 kg against a force that saturates, 5000 N.s/m at rest: above 0.4 ms it oscillates from step to step.

    The oscillation is bounded and is invisible at every second step.
    """
    ports = make.table(make.variable("velocity", "output", "m/s"), make.variable("force", "input", "N"))
    damper = make.table(make.variable("velocity", "input", "m/s"), make.variable("force", "output", "N", ["velocity"]))

    def advance(v: float, start: dict[str, float], end: dict[str, float], step: float) -> float:
        return v + (10.0 - 0.5 * (start["force"] + end["force"])) / 2.0 * step

    ramps = Capabilities(interpolates_inputs=True)
    mass = make.component(ports, lambda v, _: {"velocity": v}, advance, capabilities=ramps)
    shock = make.component(damper, lambda _, u: {"force": 50.0 * np.tanh(u["velocity"] / 0.01)}, capabilities=ramps)
    system = System({"mass": mass, "shock": shock}, [Bond.between("mass", "shock", displacement=False)])
    result = run(system, Scenario(1.0, record_step=8e-3), algorithm=algorithm, step=4e-3, compared=compared)
    assert np.ptp(result.series["mass.velocity"][10:]) < 1.0  # bounded
    assert not result.acceptable
    assert result.verdict.grade == Grade.NOT_USABLE


def test_a_run_with_a_component_that_holds_its_inputs_is_refined_until_the_tolerance_is_met(
    quarter_cars: Join, bumps: Drivefile, fmus: Any
) -> None:
    """The other car, which is not coupled to it, keeps its order."""
    scenario = Scenario(0.5, bumps, ROAD | {"b": "car_b.road"})
    exact = run(quarter_cars("ab"), scenario, step=2.5e-5, compared=False)
    parts = {"shock_b": Held(fmus["lpnl2"], "shock_b")}
    result = run(quarter_cars("ab", parts), scenario, algorithm=Automatic(tolerance=1.0))
    true = true_errors(result, exact)
    assert result.is_clean and result.coupling_error <= result.tolerance
    assert max(true[name.replace("_a", "_b")] for name in DECISIVE) <= 1.0
    assert result.stated_error["shock_b.force"] > 10.0 * result.stated_error["shock_a.force"]


class Underived(Held):
    """The same, and it gives no directional derivatives."""

    @property
    def capabilities(self) -> Any:
        return replace(super().capabilities, derivatives=False)


@pytest.mark.parametrize(("kind", "is_late", "low", "high"), [(Underived, True, 0.5, 3.0), (Held, False, 1.0, 10.0)])
def test_a_car_that_holds_its_road_input_states_the_error_of_its_tire_force(
    quarter_cars: Join, bumps: Drivefile, exact: Result, fmus: Any, kind: Any, is_late: bool, low: float, high: float
) -> None:
    """It follows the mean road of a step, half a step late; directional derivatives correct it to the step's end."""
    system = quarter_cars("a", {"car_a": kind(fmus["quarter_car"], "car_a")})
    result = run(system, Scenario(1.0, bumps, ROAD), step=1e-3)
    true = true_errors(result, exact)["car_a.tire_force"]
    assert true > 0.5 if is_late else true < 0.05
    assert low * true < result.stated_error["car_a.tire_force"] < high * true
