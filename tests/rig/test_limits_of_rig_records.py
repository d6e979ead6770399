"""The size from which each fault of a rig record is refused, and from which a record has another run."""

from collections.abc import Callable

import numpy as np
import pytest

from eightpost.corners import CORNERS
from eightpost.errors import EightpostError
from eightpost.rig import DynoTest, split_runs, temperature_effect
from eightpost.rig.rig_test import check_rig_record
from eightpost.signals import TimeSeries
from tests.drawn import timed
from tests.limits import first_of, limit_of

from ..ident.linear_rig import record
from .test_dyno_runs import dyno, rest, sine

REFUSED: dict[str, tuple[Callable[[TimeSeries, float], TimeSeries], str, float, float]] = {}


def refused(words: str, low: float, high: float) -> Callable[[Callable[[TimeSeries, float], TimeSeries]], None]:
    return lambda change: REFUSED.update({change.__name__: (change, words, low, high)})


def with_(series: TimeSeries, name: str, values: np.ndarray) -> TimeSeries:
    return series.with_channel(name, series.unit(name), values)


@refused("corners are swapped", 0.1, 1.0)
def another_force(series: TimeSeries, share: float) -> TimeSeries:
    return with_(series, "lf.force", (1.0 - share) * series["lf.force"] + share * series["rf.force"])


@refused("corners are swapped", 0.1, 1.0)
def another_velocity(series: TimeSeries, share: float) -> TimeSeries:
    return with_(series, "lf.velocity", (1.0 - share) * series["lf.velocity"] + share * series["lr.velocity"])


@refused("corners are swapped", 0.1, 1.0)
def another_tire_force(series: TimeSeries, share: float) -> TimeSeries:
    left, right = series["lf.tire_force"], series["rf.tire_force"]
    mixed = with_(series, "lf.tire_force", (1.0 - share) * left + share * right)
    return with_(mixed, "rf.tire_force", (1.0 - share) * right + share * left)


@refused("corners are swapped", 0.1, 1.0)
def another_hub(series: TimeSeries, share: float) -> TimeSeries:
    name = "hub_acceleration"
    return with_(series, f"rr.{name}", (1.0 - share) * series[f"rr.{name}"] + share * series[f"lr.{name}"])


@refused("wrong sign", 0.3, 2.0)
def a_reversed_force(series: TimeSeries, share: float) -> TimeSeries:
    return with_(series, "lf.force", (1.0 - share) * series["lf.force"])


@refused("wrong sign", 0.05, 1.0)
def a_reversed_force_in_noise(series: TimeSeries, share: float) -> TimeSeries:
    noise = series["lf.force"].std() * np.random.default_rng(3).standard_normal(len(series))
    return with_(series, "lf.force", noise - share * series["lf.force"])


@refused("wrong sign", 0.3, 2.0)
def a_reversed_tire_force(series: TimeSeries, share: float) -> TimeSeries:
    return with_(series, "lr.tire_force", (1.0 - share) * series["lr.tire_force"])


@refused("wrong sign", 0.1, 3.0)
def a_reversed_road_of_a_tire_that_lifts(series: TimeSeries, share: float) -> TimeSeries:
    turned = with_(series, "lr.tire_force", -series["lr.tire_force"])
    force = turned["lr.tire_force"]
    return with_(turned, "lr.tire_force", np.maximum(force, force.mean() - share * force.std()))


@refused("wrong sign", 0.02, 1.0)
def a_reversed_force_of_a_corner_almost_at_rest(series: TimeSeries, share: float) -> TimeSeries:
    still = with_(series, "lf.velocity", share * series["lf.velocity"])
    return with_(still, "lf.force", -share * series["lf.force"])


@refused("is clipped", 0.003, 0.2)
def a_clipped_force(series: TimeSeries, share: float) -> TimeSeries:
    return with_(series, "rr.force", np.minimum(series["rr.force"], np.quantile(series["rr.force"], 1.0 - share)))


@refused("changes only every", 0.2, 1.0)
def a_force_that_is_held_for_a_part_of_the_record(series: TimeSeries, share: float) -> TimeSeries:
    held = np.repeat(series["lf.force"][::4], 4)[: len(series)]
    return with_(series, "lf.force", np.where(series.time < share * series.duration, held, series["lf.force"]))


@refused("changes only every", 0.5, 8.0)
def a_force_that_is_held(series: TimeSeries, samples: float) -> TimeSeries:
    count = max(1, round(samples))
    return with_(series, "lf.force", np.repeat(series["lf.force"][::count], count)[: len(series)])


@refused("s", 3.0, 5.5)
def a_short_record(series: TimeSeries, seconds: float) -> TimeSeries:
    return series.window(0.0, seconds)


@refused("samples", 1.0, 10.0)
def a_record_of_few_samples(series: TimeSeries, every: float) -> TimeSeries:
    return series.at(slice(None, None, max(1, round(every))))


@pytest.fixture(scope="module")
def good() -> TimeSeries:
    return record("seven_dof", seconds=6.0).series


def error_of(series: TimeSeries) -> str:
    try:
        check_rig_record(series, CORNERS)
    except EightpostError as error:
        return timed(str(error))
    return ""


@pytest.mark.parametrize("name", REFUSED)
def test_the_size_from_which_a_rig_record_is_refused(
    name: str, good: TimeSeries, unchanged: Callable[..., None]
) -> None:
    change, words, low, high = REFUSED[name]
    size = limit_of(lambda size: words in error_of(change(good, size)), low, high)
    unchanged({"from": size, "at either end": [error_of(change(good, end)) for end in (low, high)]}, relative=1e-3)


def test_the_fewest_samples_of_a_rig_record(good: TimeSeries) -> None:
    slower = good.at(slice(None, None, 6))
    assert first_of(lambda count: not error_of(slower.at(slice(0, count))), 900, 1100) == 1000


def warming(kelvin: float, *speeds: float) -> DynoTest:
    parts = [part for speed in speeds for part in (sine(0.02 * speed, 2.0, 8), rest(2))]
    return dyno(*parts, heat=300.0 + kelvin * np.linspace(0.0, 1.0, sum(map(len, parts))))


#: A motion that is no steady sine, from rest at 0 to rest at 0.
ROUGH = sum(size * sine(1.0, hertz, 4.0 * hertz) for size, hertz in ((0.01, 0.5), (0.006, 1.25), (0.004, 3.5)))


def uneven(cycles: float) -> np.ndarray:
    """Return cycles of two amplitudes in turn."""
    return np.concatenate([sine(0.012 + 0.004 * (-1) ** n, 3.0, 1) for n in range(round(cycles))])


#: A record of a size, and sizes between which the number of its runs changes.
RUNS: dict[str, tuple[Callable[[float], object], float, float]] = {
    "a pause": (lambda k: split_runs(dyno(ROUGH, rest(k), ROUGH)), 0.2, 2.0),
    "a pause of a drifting machine": (
        lambda k: split_runs(dyno(ROUGH, k * 0.02 * np.linspace(0.0, 1.0, 1000), ROUGH + k * 0.02)), 2e-3, 1.0),
    "a pause of a slow sine": (
        lambda k: split_runs(dyno(sine(0.02, 0.1, 2), rest(k), sine(0.02, 0.1, 2))), 1.0, 3.0),
    "another stroke": (lambda k: split_runs(dyno(sine(0.02, 2.0, 8), sine(0.02 + 0.02 * k, 2.0, 8))), 0.02, 0.5),
    "another frequency": (lambda k: split_runs(dyno(sine(0.02, 2.0, 8), sine(0.02, 2.0 + 2.0 * k, 8))), 0.02, 0.5),
    "few cycles": (lambda k: split_runs(dyno(sine(0.02, 2.0, 8), sine(0.01, 4.0, round(k)))), 1.0, 8.0),
    "a small motion": (lambda k: split_runs(dyno(sine(0.02, 2.0, 20), sine(0.02 * k, 2.0, 8))), 2e-3, 0.2),
    "a part that is not steady": (
        lambda k: split_runs(dyno(sine(0.02, 2.0, 8), uneven(k), sine(0.01, 2.0, 8))), 1.0, 30.0),
    "a short run": (
        lambda k: split_runs(dyno(sine(0.02, 2.0, 8), rest(2), sine(0.02, 20.0, round(20.0 * k)))), 0.2, 1.0),
}  # fmt: skip


@pytest.mark.parametrize("name", RUNS)
def test_the_size_from_which_a_record_has_other_runs(name: str, unchanged: Callable[..., None]) -> None:
    runs, low, high = RUNS[name]
    alike = len(runs(low))  # type: ignore[arg-type]
    size = limit_of(lambda k: len(runs(k)) != alike, low, high)  # type: ignore[arg-type]
    unchanged({"from": size, "at either end": [
        [([timed(one) for one in run.derived], run.notes, run.series.duration, run.stroke) for run in runs(end)]  # type: ignore[attr-defined]
        for end in (low, high)]}, relative=1e-3)  # fmt: skip


def test_the_size_from_which_heat_and_repetition_count(unchanged: Callable[..., None]) -> None:
    unchanged({
        "heat": limit_of(lambda k: temperature_effect(split_runs(warming(k, 1.0, 1.0))) is not None, 0.5, 5.0),
        "other speed": limit_of(
            lambda k: temperature_effect(split_runs(warming(20.0, 1.0, 1.0 + k))) is not None, 0.01, 0.3),
        "effect": temperature_effect(split_runs(warming(20.0, 1.0, 1.02, 0.5, 0.5, 0.5))),
    }, relative=1e-3)  # fmt: skip
