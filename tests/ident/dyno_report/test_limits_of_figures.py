"""The sizes at which a report knows another figure: cycles, loops, knees, slow parts and representatives."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from eightpost.ident.dyno_report.builds import dyno_report, short_names
from eightpost.ident.dyno_report.cycles import Unknown, cycles_of, force_at_rest, slow_figures
from eightpost.ident.dyno_report.entry import Entry, entry_of_test
from eightpost.ident.dyno_report.page import explained
from eightpost.signals import TimeSeries
from tests.limits import first_of, limit_of

from .conftest import run, sine, two_lines, valve, viscous

DAMPER = valve(viscous(2000.0), viscous(3000.0), gas=100.0, stiffness=800.0, friction=20.0)


def sizes(*amplitudes: float, hertz: float = 2.0) -> TimeSeries:
    """Return cycles with an amplitude each [m], which begin and end at the extended end."""
    time = np.arange(round(500.0 / hertz)) / 500.0
    w = 2.0 * np.pi * hertz
    v = np.concatenate([size * w * np.sin(w * time) for size in amplitudes])
    x = np.concatenate([size * (1.0 - np.cos(w * time)) for size in amplitudes])
    channels = {"velocity": ("m/s", v), "displacement": ("m", x), "force": ("N", DAMPER(v, x))}
    return TimeSeries.from_channels(np.arange(v.size) / 500.0, channels)


def is_known(found: object) -> bool:
    return not isinstance(found, Unknown)


def entry(series: TimeSeries, name: str = "a") -> Entry:
    return entry_of_test(run(series), name, name)


def bent(part: float, knee: float = 0.15) -> Entry:
    line = two_lines(4000.0, part * 4000.0, knee)
    return entry(sine(valve(line, line), duration=3.0))


def noisy(size: float) -> TimeSeries:
    series = sine(DAMPER, duration=3.0)
    drawn = np.random.default_rng(1).standard_normal(len(series))
    return series.with_channel("force", "N", series["force"] + size * drawn)


def slow(speed: float = 0.005, *, seconds: float = 10.0, range_: float = 0.01, varied: float = 0.5) -> Any:
    """Return the figures of a triangle with a varied speed; a fast cycle before it gives the stroke."""
    time = np.arange(round(1000.0 * seconds)) / 1000.0
    turn = 2.0 * range_ / speed
    v = speed * np.sign(np.sin(np.pi * time / (0.5 * turn))) * (1.0 + varied * np.sin(2.0 * np.pi * time / turn / 2.0))
    x = np.cumsum(v) / 1000.0
    channels = {"velocity": ("m/s", v), "displacement": ("m", x), "force": ("N", DAMPER(v, x))}
    return slow_figures(TimeSeries.from_channels(time, channels))


def turns(count: float, spread: float = 1.8) -> Any:
    """Return the force at rest of a motion of many strokes whose accelerations spread."""
    random = np.random.default_rng(4)
    return force_at_rest(sizes(*(0.01 * (1.0 + spread * (random.uniform(size=round(count)) - 0.5)))))


LIMITS: dict[str, tuple[Callable[[float], bool], float, float]] = {
    "another stroke": (lambda k: is_known(cycles_of(sizes(*[0.02] * 4, *[0.02 * (1 + k)] * 4)).energy), 0.02, 0.5),
    "a cycle of another stroke": (
        lambda k: cycles_of(sizes(*[0.02] * 4, 0.02 * (1 + k), 0.02)).count == cycles_of(sizes(*[0.02] * 6)).count,
        0.02, 0.5),
    "a knee": (lambda k: is_known(bent(1.0 - k).strokes["rebound"].knee), 0.05, 0.5),
    "a late knee": (lambda k: is_known(bent(0.3, k).strokes["rebound"].knee), 0.15, 0.32),
    "an early knee": (lambda k: is_known(bent(0.3, k).strokes["rebound"].knee), 0.002, 0.1),
    "a noisy loop": (lambda k: is_known(entry(noisy(k)).lag), 10.0, 3000.0),
    "a slow speed": (lambda k: is_known(slow(k).gas_force), 4e-3, 0.03),
    "enough of slow parts": (lambda k: is_known(slow(seconds=k).gas_force), 0.5, 9.0),
    "varied speeds": (lambda k: is_known(slow(varied=k).friction), 0.01, 0.9),
    "strokes of a random motion": (lambda k: is_known(turns(k)), 5.0, 80.0),
    "spread strokes": (lambda k: is_known(turns(60.0, k)), 0.05, 1.9),
    "a representative": (
        lambda k: len(dyno_report([entry_of_test(run(sizes(*[0.02] * 4)), "a", "A"),
                                   entry_of_test(run(sizes(*[0.02 * k] * 4)), "b", "A")]
                                  ).variants[0].representatives("measured")) == 2, 0.5, 1.0),
}  # fmt: skip


@pytest.mark.parametrize("name", LIMITS)
def test_the_size_at_which_a_figure_is_known(name: str, unchanged: Callable[..., None]) -> None:
    unchanged(limit_of(*LIMITS[name], steps=5), relative=1e-3)


def test_numbers_that_are_exact(unchanged: Callable[..., None]) -> None:
    """Names are short up to 20 letters; a mean needs two cycles; a table keeps its reasons in their order."""
    long = lambda count: short_names([f"run_{'x' * (count - 5)}1", f"run_{'x' * (count - 5)}2"])  # noqa: E731
    assert first_of(lambda count: any(key != name for key, name in long(count).items()), 10, 40) == 21
    assert first_of(lambda count: is_known(cycles_of(sizes(*[0.02] * count)).energy), 1, 8) == 4
    rows = [("a", 1.0, Unknown("few")), ("b", Unknown("none"), Unknown("few")), ("c", 3.0, 4.0)]
    table, lines = explained("title", ("name", "x [N]", "y [m]"), rows)
    unchanged([str(table.heads), str(table.rows), lines])
