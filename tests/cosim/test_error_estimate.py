"""The stated coupling error: what it is divided by, what it is in percent of, and what it is worth on real runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim import Automatic, Bond, Capabilities, FmuComponent, GaussSeidel, Jacobi, Result, Scenario, System, run
from cosim.difference import difference, judged_by, scales
from cosim.error_estimate import Comparison, stated_error
from eightpost.signals import Drivefile, TimeSeries
from eightpost.verdict import Grade

Join = Callable[..., System]

ROAD = {"a": "car_a.road"}
DECISIVE = ("car_a.velocity", "car_a.tire_force", "shock_a.force")


def falling(*differences: float, local_order: float | None = None, reliable: bool = True) -> list[Comparison]:
    """Comparisons of runs at steps that halve, of one channel."""
    return [Comparison({"a.y": d}, reliable, local_order) for d in differences]


class Held(FmuComponent):
    """An FMU that cannot follow inputs over a step."""

    @property
    def capabilities(self) -> Any:
        return replace(super().capabilities, interpolates_inputs=False)


# What the difference is divided by.


@given(error=st.floats(1e-3, 10.0), order=st.floats(0.4, 1.99))
def test_an_error_of_an_order_that_was_seen_twice_is_stated_exactly(error: float, order: float) -> None:
    """The error at step h is c h^p: the difference of runs at 2 h and h is (2^p - 1) times that of the finer."""
    apart = [(2.0**order - 1.0) * error * 2.0 ** (order * k) for k in (2, 1, 0)]
    assert stated_error(falling(*apart))["a.y"] == pytest.approx(error, rel=1e-9)


def test_without_an_observed_order_the_difference_itself_is_stated() -> None:
    assert stated_error(falling(0.7)) == {"a.y": 0.7}
    assert stated_error(falling(0.7, local_order=3.0, reliable=False)) == {"a.y": 0.7}


def test_no_error_falls_faster_than_second_order_nor_faster_than_the_local_errors() -> None:
    assert stated_error(falling(64.0, 8.0, 1.0))["a.y"] == pytest.approx(1.0 / 3.0)
    assert stated_error(falling(64.0, 8.0, 1.0, local_order=1.0))["a.y"] == pytest.approx(1.0)
    assert stated_error(falling(1.0, local_order=3.0))["a.y"] == pytest.approx(1.0 / (2.0**1.5 - 1.0))


def test_a_difference_that_is_small_by_chance_counts_as_an_eighth_of_the_one_before() -> None:
    assert stated_error(falling(8.0, 8.0, 1e-6, local_order=1.0))["a.y"] == pytest.approx(1.0 / (2.0**0.38 - 1.0))


def test_beside_a_component_that_holds_its_inputs_the_order_is_one_at_most() -> None:
    both = [Comparison({"a.y": d, "b.y": d}, reliable=True, local_order=3.0) for d in (4.0, 1.0)]
    stated = stated_error(both, held={"a"})
    assert stated["a.y"] == pytest.approx(1.0)
    assert stated["b.y"] == pytest.approx(1.0 / 3.0)


# What it is in percent of.


def test_a_signal_at_rest_is_judged_by_a_floor_or_by_others_of_its_unit() -> None:
    spread = {"still": 0.0, "moving": 2.0, "alone": 0.0, "unitless": 0.0, "large": 1e3}
    units = {"still": "m/s", "moving": "m/s", "alone": "N", "unitless": "1", "large": "1"}
    assert judged_by(spread, units) == {"still": 0.02, "moving": 2.0, "alone": 1e-3, "unitless": 1e-9, "large": 1e3}


def test_differences_are_root_mean_squares_at_common_times_in_percent_of_the_finer_ones_scale() -> None:
    time = np.arange(8) * 0.5
    fine = TimeSeries.from_channels(time, {"v": ("m/s", np.sin(time))})
    coarse = TimeSeries.from_channels(time[::2], {"v": ("m/s", np.sin(time[::2]) + 0.1)})
    assert difference(coarse, fine)["v"] == pytest.approx(10.0 / scales(fine)["v"])
    later = TimeSeries.from_channels(time + 0.1, {"v": ("m/s", np.sin(time))})
    assert difference(later, fine)["v"] == np.inf


# What it is worth.


def true_errors(result: Result, fine: Result) -> dict[str, float]:
    return difference(result.settled(), fine.settled())


@pytest.fixture
def exact(quarter_cars: Join, bumps: Drivefile) -> Result:
    return run(quarter_cars(), Scenario(1.0, bumps, ROAD), step=5e-5, compared=False)


def test_the_default_states_between_its_true_error_and_eight_times_it_for_every_channel(
    quarter_cars: Join, bumps: Drivefile, exact: Result
) -> None:
    result = run(quarter_cars(), Scenario(1.0, bumps, ROAD, record_step=0.002), algorithm=Automatic(tolerance=2.0))
    true = true_errors(result, exact)
    assert set(true) <= set(result.stated_error)
    for name, error in true.items():
        assert error < result.stated_error[name] < 8.0 * max(error, 0.02), name


@pytest.mark.parametrize("algorithm", [None, GaussSeidel(), Jacobi(), Jacobi("interpolated")], ids=str)
@pytest.mark.parametrize("step", [2e-3, 5e-4])
def test_a_run_at_a_given_step_states_its_error_too(
    quarter_cars: Join, bumps: Drivefile, exact: Result, algorithm: Any, step: float
) -> None:
    result = run(quarter_cars(), Scenario(1.0, bumps, ROAD), algorithm=algorithm, step=step)
    worst = max(true_errors(result, exact)[name] for name in DECISIVE)
    assert result.coupling_error is not None
    assert 0.5 * worst < result.coupling_error < 12.0 * max(worst, 0.02)
    assert result.acceptable == (result.coupling_error <= 5.0 and result.is_clean)


def test_a_step_alone_means_the_defaults_scheme_to_the_bit(quarter_cars: Join, bumps: Drivefile) -> None:
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


def test_a_car_at_rest_has_no_error_and_needs_no_small_step(quarter_cars: Join) -> None:
    system = quarter_cars()
    still = replace(system, constants=dict(system.constants) | {"car_a.road": 0.0})
    result = run(still, Scenario(0.5))
    assert result.coupling_error is not None
    assert result.coupling_error < 1e-6
    assert result.step >= 1e-3
    assert result.tolerance_met


@pytest.mark.parametrize("compared", [True, False])
@pytest.mark.parametrize("algorithm", [None, GaussSeidel(), Jacobi()], ids=str)
def test_chatter_between_recorded_points_is_refused(make: Any, algorithm: Any, compared: bool) -> None:
    """2 kg against a force that saturates, 5000 N.s/m at rest: above 0.4 ms it alternates from step to step.

    The oscillation is bounded, and every second step it shows nothing.
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


def test_a_component_that_holds_its_inputs_is_refined_until_the_tolerance_is_met(
    quarter_cars: Join, bumps: Drivefile, fmus: Any
) -> None:
    """And the other car, which it is not coupled with, keeps its order."""
    scenario = Scenario(0.5, bumps, ROAD | {"b": "car_b.road"})
    exact = run(quarter_cars("ab"), scenario, step=2.5e-5, compared=False)
    parts = {"shock_b": Held(fmus["lpnl2"], "shock_b")}
    result = run(quarter_cars("ab", parts), scenario, algorithm=Automatic(tolerance=1.0))
    true = true_errors(result, exact)
    assert result.tolerance_met
    assert max(true[name.replace("_a", "_b")] for name in DECISIVE) <= 1.0
    assert result.stated_error["shock_b.force"] > 10.0 * result.stated_error["shock_a.force"]


def test_a_car_that_holds_its_road_states_the_error_of_its_tire_force(
    quarter_cars: Join, bumps: Drivefile, exact: Result, fmus: Any
) -> None:
    """The tire force follows the road, of which such a car gets the mean: half a step late, at any step."""
    system = quarter_cars("a", {"car_a": Held(fmus["quarter_car"], "car_a")})
    result = run(system, Scenario(1.0, bumps, ROAD), step=1e-3)
    true = true_errors(result, exact)["car_a.tire_force"]
    assert true > 0.5
    assert 0.5 * true < result.stated_error["car_a.tire_force"] < 3.0 * true
