"""Differences and stated errors against hand calculations, and the steps of the default and of comparison runs."""

from dataclasses import replace
from math import inf
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cosim import Automatic, Bond, Capabilities, GaussSeidel, Result, Scenario, System, run
from cosim.session import run as run_module
from cosim.session.result import Comparison, compare, difference, scales, stated_error
from cosim.session.verdict import Coupled
from eightpost.errors import InputError
from eightpost.signals import TimeSeries

from .mass_and_damper import MASS, STIFFNESS, restorable_parts

# ---- Differences --------------------------------------------------------------------------------


def series(time: Any, **channels: Any) -> TimeSeries:
    return TimeSeries.from_channels(np.asarray(time, dtype=float), channels)


def test_a_difference_is_in_percent_of_the_standard_deviation_of_the_finer_run() -> None:
    """The values at 0, 2 and 4 s differ by 1, 1 and 2 m/s; the standard deviation is that of all fine samples."""
    fine = series([0, 1, 2, 3, 4], v=("m/s", [0.0, 2.0, 3.0, 5.0, 5.0]))
    coarse = series([0, 2, 4], v=("m/s", [1.0, 2.0, 7.0]))
    spread = float(np.std([0.0, 2.0, 3.0, 5.0, 5.0]))
    assert difference(coarse, fine) == {"v": pytest.approx(100.0 * 2.0**0.5 / spread)}
    assert difference(series([0.5, 1.5], v=("m/s", [1.0, 2.0])), fine) == {"v": inf}
    assert difference(series([0, 2], w=("m/s", [1.0, 2.0])), fine) == {}


def test_only_times_that_differ_by_rounding_are_treated_as_equal() -> None:
    fine = series([0.0, 0.1 + 1e-14, 0.2], v=("m/s", [0.0, 1.0, 0.0]))
    assert difference(series([0.1], v=("m/s", [1.0])), fine) == {"v": 0.0}
    assert difference(series([0.1 + 1e-10], v=("m/s", [1.0])), fine) == {"v": inf}
    # Times of a step that is not a decimal fraction: summed in one series and multiplied in the other.
    thirds = np.cumsum([1.0 / 3000.0] * 300)
    same = series(thirds, v=("m/s", np.arange(300.0)))
    multiplied = series(np.arange(1, 301) / 3000.0, v=("m/s", np.arange(300.0) + 1.0))
    assert difference(same, multiplied) == {"v": pytest.approx(100.0 / np.std(np.arange(300.0)))}


@pytest.mark.parametrize(("unit", "floor"), [("m/s", 1e-6), ("m", 1e-8), ("N", 1e-3), ("m/s2", 1e-3), ("rad", 1e-9)])
def test_the_scale_of_a_constant_signal_is_the_floor_of_its_unit(unit: str, floor: float) -> None:
    assert scales(series([0, 1], x=(unit, [3.0, 3.0]))) == {"x": pytest.approx(floor)}


def test_the_scale_of_a_signal_is_at_least_a_hundredth_of_the_largest_scale_of_its_unit() -> None:
    result = scales(
        series(
            [0, 1], small=("N", [0.0, 0.2]), large=("N", [0.0, 100.0]), calm=("m", [0.0, 1e-4]), a=("1", [0.0, 1e-4]),
            b=("1", [0.0, 100.0]),
        )
    )  # fmt: skip
    assert result == pytest.approx({"small": 0.5, "large": 50.0, "calm": 5e-5, "a": 5e-5, "b": 50.0})


# ---- Stated errors ------------------------------------------------------------------------------


def seen(*differences: float, reliable: bool = True, local: float | None = None) -> list[Comparison]:
    return [Comparison({"car.v": value}, reliable, local) for value in differences]


def stated(comparisons: list[Comparison], held: tuple[str, ...] = ()) -> float:
    return stated_error(comparisons, held)["car.v"]


@pytest.mark.parametrize(
    ("differences", "expected"),
    [
        ((0.6,), 0.6),  # no order observed: first order
        ((1.2, 0.6), 0.6),  # halves: first order
        ((1.2, 0.3), 0.1),  # quarters: second order, divided by three
        ((1.6, 0.2), 0.2 / 3.0),  # eighths, but at most second order is assumed
        ((1.6, 0.1), 0.2 / 3.0),  # sixteenths: treated as eighths
        ((0.6, 0.5), 0.5 / (2.0**0.38 - 1.0)),  # almost constant: order 0.38
        ((0.5, 0.6), 0.6 / (2.0**0.38 - 1.0)),  # rises
        ((4.0, 2.0, 0.5), 0.5),  # the smaller order of the last two pairs
        ((4.0, 1.0, 0.5), 0.5),
        ((9.0, 8.0, 2.0, 0.5), 0.5 / 3.0),  # earlier differences are not used
        ((0.0, 0.5), 0.5),
        ((inf, 0.5), 0.5),
        ((0.5, 0.0), 0.5 / 8.0),  # zero by chance
    ],
)
def test_the_stated_error_is_extrapolated_from_the_last_difference_and_the_observed_order(
    differences: tuple[float, ...], expected: float
) -> None:
    assert stated(seen(*differences)) == pytest.approx(expected, rel=1e-12)


def test_local_errors_of_bonds_can_lower_the_observed_order_but_never_raise_it() -> None:
    assert stated(seen(1.2, 0.3, local=1.0)) == pytest.approx(0.3)
    assert stated(seen(1.2, 0.3, local=3.0)) == pytest.approx(0.1)
    # The local order is that of the last two runs.
    both = [*seen(1.2, local=1.0), *seen(0.3, local=2.0)]
    assert stated(both) == pytest.approx(0.1)
    assert stated(both[::-1]) == pytest.approx(stated(seen(0.3, 1.2, local=1.0)))
    # Without two differences to compare, at most order 1.5 is assumed.
    assert stated(seen(0.3, local=1.2)) == pytest.approx(0.3 / (2.0**1.2 - 1.0))
    assert stated(seen(0.3, local=3.0)) == pytest.approx(0.3 / (2.0**1.5 - 1.0))
    assert stated(seen(0.3, local=-1.0)) == pytest.approx(0.3 / (2.0**0.38 - 1.0))


def test_no_order_is_derived_from_unreliable_runs() -> None:
    assert stated(seen(1.2, 0.3, reliable=False, local=2.0)) == pytest.approx(0.3)
    for one in (0, 1):
        mixed = seen(1.2, 0.3, local=2.0)
        mixed[one] = replace(mixed[one], reliable=False)
        assert stated(mixed) == pytest.approx(0.3 if one else 0.3 / (2.0**1.5 - 1.0))


def test_a_component_that_holds_its_inputs_has_at_most_first_order() -> None:
    assert stated(seen(1.2, 0.3), held=("car",)) == pytest.approx(0.3)
    assert stated(seen(0.6, 0.5), held=("car",)) == pytest.approx(0.5 / (2.0**0.38 - 1.0))
    assert stated(seen(1.2, 0.3), held=("shock",)) == pytest.approx(0.1)
    # Without two differences to compare, order 0.5 is assumed.
    assert stated(seen(0.3, local=2.0), held=("car",)) == pytest.approx(0.3 / (2.0**0.5 - 1.0))


def test_a_channel_missing_from_earlier_runs_counts_as_compared_once() -> None:
    comparisons = [Comparison({}, True, None), Comparison({"car.v": 0.3}, True, None)]
    assert stated(comparisons) == pytest.approx(0.3)


def bond(velocity: float, force: float = 0.0) -> Coupled:
    return Coupled(velocity, 1.0, force, 1.0, velocity_scale=1.0, force_scale=1.0)


def outcome(time: Any, values: Any, *, clean: bool = True, **coupled: Coupled) -> Any:
    settled = series(time, v=("m/s", values))
    return SimpleNamespace(settled=lambda: settled, is_clean=clean, coupled=coupled)


def test_a_comparison_needs_two_reliable_runs_and_takes_the_smallest_local_order_of_the_bonds() -> None:
    time, values = [0, 1, 2], [0.0, 1.0, 0.0]
    coarse = outcome(time, values, lf=bond(0.08), rf=bond(0.04), rr=bond(0.9), gone=bond(5.0))
    fine = outcome(time, values, lf=bond(0.02), rf=bond(0.02), rr=bond(2e-4), new=bond(0.01))
    comparison = compare(coarse, fine)
    assert comparison.difference == {"v": 0.0}
    assert comparison.reliable
    assert comparison.local_order == pytest.approx(1.0)
    for pair in ((coarse, fine), (fine, coarse)):
        one, other = pair
        unclean = outcome(time, values, clean=False)
        assert not compare(one, unclean).reliable
        assert not compare(unclean, other).reliable
    assert compare(outcome(time, values), outcome(time, values)).local_order is None
    # A local error of zero, or one below a hundredth of the largest, is not used.
    assert compare(outcome(time, values, a=bond(0.0)), outcome(time, values, a=bond(0.1))).local_order is None
    negligible = compare(
        outcome(time, values, a=bond(0.4), b=bond(1.01e-3)), outcome(time, values, a=bond(0.1), b=bond(1.005e-3))
    )
    assert negligible.local_order == pytest.approx(np.log2(1.01 / 1.005))
    negligible = compare(
        outcome(time, values, a=bond(0.4), b=bond(1.01e-3)), outcome(time, values, a=bond(0.1), b=bond(0.995e-3))
    )
    assert negligible.local_order == pytest.approx(2.0)


# ---- The default --------------------------------------------------------------------------------


def coupled(make: Any, damping: float, *, ramps: bool = True) -> System:
    """A mass at 1 m/s on a spring and a damper; neither component supports rollback."""
    parts = restorable_parts(make)(damping)
    for part in parts.values():
        part.capabilities = Capabilities(interpolates_inputs=ramps)
    return System(parts, [Bond.between("car", "shock", displacement=False)])


def exact(damping: float, time: Any) -> Any:
    """Velocity of m x'' + c x' + k x = 0 from rest at 1 m/s."""
    decay = 0.5 * damping / MASS
    pulse = np.sqrt(STIFFNESS / MASS - decay**2)
    return np.exp(-decay * time) * (np.cos(pulse * time) - decay / pulse * np.sin(pulse * time))


def true_error(result: Result, damping: float) -> float:
    velocity = result.series["car.velocity"]
    miss = velocity - exact(damping, result.series.time)
    return 100.0 * float(np.sqrt(np.mean(miss**2)) / np.std(velocity))


@pytest.mark.repeated
@pytest.mark.parametrize("tolerance", [1.0, 0.02, 5e-4])
def test_the_default_algorithm_halves_its_step_only_until_the_tolerance_is_met(make: Any, tolerance: float) -> None:
    scenario = Scenario(0.4, record_step=0.01)
    result = run(coupled(make, 60.0), scenario, algorithm=Automatic(tolerance=tolerance), engine="python")
    assert result.coupling_error is not None
    assert result.coupling_error <= tolerance
    assert true_error(result, 60.0) <= result.coupling_error
    assert result.series.time.tolist() == pytest.approx([0.01 * k for k in range(41)])
    halvings = round(np.log2(0.002 / result.step))
    assert result.step == pytest.approx(0.002 / 2**halvings)
    assert halvings >= 1
    # Steps of all runs are counted: at 2 ms, at 1 ms, and so on.
    assert result.steps_of_all_runs == 200 * (2 ** (halvings + 1) - 1)
    assert result.steps == 200 * 2**halvings
    if halvings > 1:
        coarser = replace(Automatic(tolerance=tolerance), least=2.0 * result.step)
        before = run(coupled(make, 60.0), scenario, algorithm=coarser, engine="python")
        assert before.step == pytest.approx(2.0 * result.step)
        assert before.coupling_error > tolerance
        assert "does not meet the tolerance" in " ".join(before.notes)


@pytest.mark.parametrize(("least", "smallest"), [(6e-4, 1e-3), (5e-4, 5e-4), (4e-4, 5e-4)])
def test_an_unreachable_tolerance_ends_at_the_smallest_step_and_is_reported(
    make: Any, least: float, smallest: float
) -> None:
    request = Automatic(tolerance=1e-9, least=least)
    result = run(coupled(make, 60.0), Scenario(0.1), algorithm=request, engine="python")
    assert result.step == pytest.approx(smallest)
    notes = " ".join(result.notes)
    assert f"does not meet the tolerance of 1e-09 %, and steps below {1e3 * least:g} ms were not tried" in notes
    assert "2 ms not compared" in notes


@pytest.mark.parametrize(
    ("stop", "record_step", "first"),
    [(0.12, 0.003, 1.5), (0.12, 0.002, 2.0), (0.12, 0.004, 2.0), (0.12, 0.0005, 0.5), (0.0012, None, 1.2)],
)
def test_the_first_step_divides_the_record_step_and_is_at_most_two_milliseconds(
    make: Any, stop: float, record_step: float | None, first: float
) -> None:
    scenario = Scenario(stop, record_step=record_step)
    result = run(coupled(make, 60.0), scenario, algorithm=Automatic(tolerance=50.0), engine="python")
    notes = " ".join(result.notes).replace(", not settled", "")
    assert f"comparing runs: {first:g} ms not compared, {0.5 * first:g} ms" in notes


def test_a_step_at_which_the_coupling_diverges_is_reported_and_halved(make: Any) -> None:
    result = run(coupled(make, 8000.0), Scenario(0.1), algorithm=Automatic(tolerance=1.0), engine="python")
    assert "comparing runs: 2 ms diverged, 1 ms " in " ".join(result.notes)
    assert result.step < 1e-3


@pytest.mark.nightly
def test_gauss_seidel_is_replaced_only_after_two_unstable_runs(parts: Any) -> None:
    """Stable runs never cause a change of scheme, however many of them the tolerance needs."""

    def ran(damping: float, tolerance: float) -> Result:
        system = System(parts(damping), [Bond.between("car", "shock", displacement=False)])
        scenario = Scenario(0.4, record_step=0.01)
        return run(system, scenario, algorithm=Automatic(tolerance=tolerance), engine="python")

    stable = ran(60.0, 5e-4)
    assert stable.scheme == "gauss-seidel"
    assert stable.step < 0.002 / 4
    assert "implicit" not in " ".join(stable.notes)
    assert ran(8000.0, 1.0).scheme == "implicit"


def test_a_run_at_a_given_step_is_compared_unless_the_comparison_is_disabled(make: Any) -> None:
    scenario = Scenario(0.4)
    alone, compared = (
        run(coupled(make, 60.0), scenario, algorithm=GaussSeidel(), step=0.004, engine="python", compared=compared)
        for compared in (False, True)
    )
    assert (alone.steps_of_all_runs, compared.steps_of_all_runs) == (100, 150)
    assert alone.stated_error == {}
    assert compared.stated_error.keys() == set(compared.series.names)
    assert alone.series.values.tobytes() == compared.series.values.tobytes()


def test_the_default_tolerance_is_the_documented_value_of_0_2_percent() -> None:
    assert Automatic() == Automatic(tolerance=0.2, least=1e-5)


@pytest.mark.parametrize("arguments", [{"tolerance": 0.0}, {"tolerance": -1.0}, {"least": 0.0}, {"tolerance": np.nan}])
def test_a_tolerance_or_minimum_step_that_is_not_positive_is_refused(arguments: dict[str, float]) -> None:
    with pytest.raises(InputError, match="must be positive"):
        Automatic(**arguments)


def test_a_run_at_a_given_step_states_at_least_its_true_error(make: Any) -> None:
    system, scenario, step = coupled(make, 60.0), Scenario(0.4, record_step=0.02), 0.004
    result = run(system, scenario, algorithm=GaussSeidel(values="extrapolated"), step=step, engine="python")
    assert result.step == step
    assert true_error(result, 60.0) <= result.coupling_error <= 5.0 * true_error(result, 60.0)
    assert result.series.time.tolist() == pytest.approx([0.02 * k for k in range(21)])
    # One comparison run at twice the step.
    assert result.steps_of_all_runs == round(1.5 * 0.4 / step)


@pytest.mark.parametrize(
    ("stop", "variable", "steps"),
    [(0.4, False, 100 + 50), (0.4, True, 100 + 50), (0.404, True, 101 + 51), (0.404, False, 101 + 202)],
)
def test_fixed_step_components_are_compared_at_half_the_step_if_twice_the_step_does_not_fit(
    make: Any, stop: float, variable: bool, steps: int
) -> None:
    system = coupled(make, 60.0)
    for component in system.components.values():
        component.capabilities = replace(component.capabilities, variable_step=variable)
    result = run(system, Scenario(stop), algorithm=GaussSeidel(), step=0.004, engine="python")
    assert result.steps_of_all_runs == steps
    assert result.steps == round(stop / 0.004)
    assert result.series.time.tolist() == pytest.approx([0.004 * k for k in range(result.steps + 1)])
    assert result.coupling_error is not None
    assert 0.5 * true_error(result, 60.0) <= result.coupling_error <= 5.0 * true_error(result, 60.0)


@pytest.mark.repeated
@pytest.mark.parametrize(("record_step", "fewest", "every"), [(0.012, 3, 0.003), (0.012, 5, 0.006), (0.0125, 5, 0.005)])
def test_compared_runs_record_every_step_or_the_shortest_interval_that_fits_in_memory(
    make: Any, monkeypatch: pytest.MonkeyPatch, record_step: float, fewest: int, every: float
) -> None:
    system, scenario = coupled(make, 60.0), Scenario(1.2, record=("car.velocity",))
    runs = run_module._DenseRuns(
        run_module.Request(system, scenario, GaussSeidel(), 0.001, engine="python"), record_step
    )
    # There are two decisive channels, i.e. 2400 values at 1 ms.
    monkeypatch.setattr(run_module, "_MOST_VALUES", 2400 / fewest * (1.0 + 1e-9))
    time = runs.run(GaussSeidel(), 0.001).series.time
    assert np.diff(time)[0] == pytest.approx(every)


def test_a_run_of_two_steps_has_the_requested_record_times(make: Any) -> None:
    scenario = Scenario(0.004, record_step=0.004)
    result = run(coupled(make, 60.0), scenario, algorithm=GaussSeidel(), step=0.002, engine="python")
    assert result.series.time.tolist() == [0.0, 0.004]
    assert result.steps == 2
