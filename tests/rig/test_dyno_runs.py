"""A record is split into runs at pauses and at changes of a sine; a random drive is not split."""

import numpy as np
import pytest

from eightpost.rig import DynoTest, split_runs, temperature_effect
from eightpost.signals import TimeSeries

RATE = 500.0


def sine(amplitude, frequency, cycles):
    """Displacement [m] of whole cycles."""
    count = round(RATE * cycles / frequency)
    return amplitude * np.sin(2.0 * np.pi * frequency * np.arange(count) / RATE)


def rest(seconds):
    return np.zeros(round(RATE * seconds))


def dyno(*parts, noise=1e-6, channels=("displacement", "velocity", "force"), heat=None):
    x = np.concatenate(parts)
    x = x + noise * np.random.default_rng(1).standard_normal(x.size)
    v = np.gradient(np.concatenate(parts), 1.0 / RATE)
    softer = 1.0 if heat is None else np.exp(-0.005 * (heat - 300.0))
    known = {"displacement": ("m", x), "velocity": ("m/s", v), "force": ("N", 2000.0 * v * softer + 100.0)}
    if heat is not None:
        known["temperature"] = ("K", heat)
    chosen = {name: known[name] for name in (*channels, *(["temperature"] if heat is not None else []))}
    return DynoTest(TimeSeries.from_channels(np.arange(x.size) / RATE, chosen))


@pytest.mark.parametrize("channels", [("displacement", "velocity", "force"), ("velocity", "force")])
def test_pauses_separate_runs(channels):
    test = dyno(rest(1), sine(0.02, 2.0, 8), rest(2), sine(0.01, 3.0, 9), rest(1), channels=channels)
    first, second = split_runs(test)
    assert (first.series.time[0], first.series.time[-1]) == pytest.approx((1.0, 5.0), abs=0.1)
    assert (second.series.time[0], second.series.time[-1]) == pytest.approx((7.0, 10.0), abs=0.1)
    assert first.derived[-1].startswith("run 1 of 2: ")
    assert not any("left out" in note for note in first.notes)


def test_a_random_drive_and_a_steady_sine_are_not_split():
    time = np.arange(5000) / RATE
    phase = np.random.default_rng(3).uniform(0.0, 2.0 * np.pi, 5)
    random = (0.005 * np.sin(2.0 * np.pi * time[:, None] * [0.5, 1.3, 2.1, 3.7, 6.1] + phase)).sum(1)
    for test in (dyno(random), dyno(sine(0.02, 2.0, 20)), dyno(sine(0.02, 2.0, 20), noise=1e-4)):
        assert split_runs(test) == (test,)


def test_a_record_of_runs_that_are_all_too_short_stays_whole():
    test = dyno(sine(0.02, 20.0, 2), rest(2), sine(0.01, 20.0, 2))
    assert split_runs(test) == (test,)


def test_force_change_with_temperature_is_estimated_from_repeated_runs(monkeypatch):
    parts = [part for _ in range(4) for part in (sine(0.02, 2.0, 8), rest(2))]
    heat = 300.0 + 20.0 * np.linspace(0.0, 1.0, sum(map(len, parts)))
    effect = temperature_effect(split_runs(dyno(*parts, heat=heat)))
    # The force was made 0.5 % softer per kelvin.
    assert effect.per_kelvin == pytest.approx(-0.005, abs=1e-4)
    assert (effect.runs, effect.spread > 10.0, effect.error < 1e-4) == (4, True, True)
    monkeypatch.setenv("EIGHTPOST_UNITS", "us")
    assert str(effect).startswith("force changes by -0.28 %/degF")


def test_runs_without_repetition_or_temperature_change_give_no_estimate():
    parts = sine(0.02, 2.0, 8), rest(2), sine(0.01, 2.0, 8)
    heat = 300.0 + 20.0 * np.linspace(0.0, 1.0, sum(map(len, parts)))
    assert temperature_effect(split_runs(dyno(*parts, heat=heat))) is None
    same = sine(0.02, 2.0, 8), rest(2), sine(0.02, 2.0, 8)
    assert temperature_effect(split_runs(dyno(*same, heat=np.full(sum(map(len, same)), 300.0)))) is None
