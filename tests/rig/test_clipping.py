"""A clipped channel is named with its value and share; a channel that really stays at its extreme is not."""

import numpy as np
import pytest

from eightpost.ident import fit_shock
from eightpost.rig import dyno_test_of
from eightpost.rig.clipping import flat_tops
from eightpost.verdict import Grade

UNITS = {"time": "s", "displacement": "mm", "velocity": "mm/s", "force": "N"}
SEED = np.random.default_rng


def sine(rate, cycles=((20.0, 2.0, 12),), *, law=None):
    """Return the channels of one or several sines (stroke [mm], frequency [Hz], cycles) of a digressive damper."""
    angles = [2.0 * np.pi * f * np.arange(round(n / f * rate)) / rate for _, f, n in cycles]
    x = np.concatenate([-size * np.cos(angle) for (size, _, _), angle in zip(cycles, angles, strict=True)])
    v = np.concatenate(
        [2.0 * np.pi * f * size * np.sin(angle) for (size, f, _), angle in zip(cycles, angles, strict=True)]
    )
    force = (law or (lambda x, v: 150.0 + 500.0 * np.tanh(v / 60.0) + 2.0 * v + 1.5 * x))(x, v)
    return {"time": np.arange(x.size) / rate, "displacement": x, "velocity": v, "force": force}


def noisy(channels, share, *, bits=0):
    """Add noise of a share of the standard deviation, and round to a share of the range."""
    random = SEED(1)
    for name in ("displacement", "velocity", "force"):
        if name in channels:
            values, step = channels[name], np.ptp(channels[name]) / 2.0**bits if bits else 0.0
            values = values + share * values.std() * random.standard_normal(values.size)
            channels[name] = step * np.round(values / step) if bits else values
    return channels


def clipped(channels, name, level, sides):
    """Limit a channel to a share of its extremes."""
    values = channels[name]
    high = level * values.max() if "high" in sides else np.inf
    return channels | {name: np.clip(values, level * values.min() if "low" in sides else -np.inf, high)}


def found(channels, *, without=()):
    """Return the reasons about clipping of channels."""
    columns = {f"{name} [{UNITS[name]}]": values for name, values in channels.items() if name not in without}
    return [reason for reason in dyno_test_of(columns).reasons if reason.rule == "clipped channel"]


SPEEDS = ((20.0, 0.5, 3), (20.0, 1.0, 4), (20.0, 3.0, 9))
RANDOM = tuple((20.0, f, 1) for f in SEED(5).uniform(0.8, 3.0, 16))


@pytest.mark.parametrize("sides", ["high", "low", "high low"])
@pytest.mark.parametrize(
    ("name", "level"), [("velocity", 0.05), ("velocity", 0.7), ("displacement", 0.8), ("force", 0.8)]
)
@pytest.mark.parametrize(
    ("cycles", "rate", "noise", "bits"),
    [((((20.0, 2.0, 12)),), 200.0, 0.0, 0), (((20.0, 2.0, 12),), 2000.0, 0.005, 12), (SPEEDS, 1000.0, 0.001, 16),
     (RANDOM, 500.0, 0.001, 0)],
    ids=["sine", "noisy sine", "several speeds", "random cycles"],
)  # fmt: skip
def test_a_clipped_channel_is_named_with_its_value_and_share(name, level, sides, cycles, rate, noise, bits):
    sound = sine(rate, cycles)
    assert found(noisy(dict(sound), noise, bits=bits)) == []
    record = noisy(clipped(sound, name, level, sides), noise, bits=bits)
    reasons = found(record)
    assert {reason.statement for reason in reasons} == {f"the {name} is clipped"}
    assert len(reasons) <= len(sides.split())
    for reason in reasons:
        share, value = float(reason.figure.split()[0]), float(reason.figure.split()[-2])
        limits = [level * end for end in (sound[name].max(), sound[name].min())]
        limit = min(limits, key=lambda one: abs(one - value))
        assert value == pytest.approx(limit, abs=0.02 * np.ptp(sound[name]))
        true = np.mean(sound[name] > limit) if limit > 0.0 else np.mean(sound[name] < limit)
        assert share == pytest.approx(100.0 * true, rel=0.3)
        assert reason.grade is Grade.NOT_USABLE


@pytest.mark.parametrize("noise", [0.0, 0.002])
def test_a_clipped_displacement_is_found_by_the_force_if_there_is_no_velocity(noise):
    record = noisy(clipped(sine(500.0), "displacement", 0.8, "high"), noise)
    assert [reason.statement for reason in found(record, without=("velocity",))] == ["the displacement is clipped"]
    assert found(noisy(sine(500.0), noise), without=("velocity",)) == []


def test_a_clipped_velocity_is_found_by_the_force_if_there_is_no_displacement():
    record = noisy(clipped(sine(1000.0), "velocity", 0.7, "high low"), 0.001)
    assert [reason.statement for reason in found(record, without=("displacement",))] == ["the velocity is clipped"] * 2


def test_a_sine_that_is_fitted_well_with_a_clipped_force_has_no_usable_verdict():
    record = noisy(clipped(sine(1000.0), "force", 0.7, "high"), 0.0005)
    columns = {f"{name} [{UNITS[name]}]": values for name, values in record.items()}
    fit = fit_shock(dyno_test_of(columns), "hysteresis")
    assert fit.verdict.grade is Grade.NOT_USABLE


# ---- What stays at its extreme without a clipped instrument ----------------------------------------------------------

FRICTION = {
    "coulomb": lambda x, v: 400.0 * np.sign(v),
    "smooth": lambda x, v: 400.0 * np.tanh(v / 5.0),
    "algebraic": lambda x, v: 400.0 * v / np.hypot(v, 5.0),
    "of two heights": lambda x, v: np.where(v > 0.0, 400.0, 250.0) * np.tanh(v / 20.0),
    "steep": lambda x, v: 400.0 * np.clip(v / 5.0, -1.0, 1.0),
    "with gas": lambda x, v: 100.0 + 400.0 * np.tanh(v / 10.0) + 2.0 * x,
    "one stroke": lambda x, v: np.maximum(3.0 * v, 0.0),
}


@pytest.mark.parametrize(
    "cycles", [((20.0, 2.0, 12),), SPEEDS, RANDOM], ids=["sine", "several speeds", "random cycles"]
)
@pytest.mark.parametrize("kind", FRICTION)
def test_the_plateau_of_friction_is_not_clipped(kind, cycles):
    for noise in (0.0, 0.005):
        for rate in (200.0, 2000.0):
            record = noisy(sine(rate, cycles, law=FRICTION[kind]), noise)
            assert found(record) == []


def moved(positions, times, rate=1000.0):
    """Return the record of a motion through positions [mm] at times [s] with rounded corners, five times."""
    time = np.arange(round(5.0 * times[-1] * rate)) / rate
    window = np.hanning(31) / np.hanning(31).sum()
    x = np.convolve(np.pad(np.interp(time % times[-1], times, positions), 15, mode="edge"), window, "valid")
    v = np.gradient(x, time)
    return {
        "time": time,
        "displacement": x,
        "velocity": v,
        "force": 150.0 + 500.0 * np.tanh(v / 60.0) + 2.0 * v + 1.5 * x,
    }


MOTIONS = {
    "a triangle": ((-20.0, 20.0, -20.0), (0.0, 0.4, 0.8)),
    "a rest at both ends": ((-20.0, 20.0, 20.0, -20.0, -20.0), (0.0, 0.3, 0.7, 1.0, 1.4)),
}


@pytest.mark.parametrize("without", [(), ("velocity",), ("displacement",)])
@pytest.mark.parametrize("motion", MOTIONS)
def test_a_motion_that_rests_or_has_one_speed_is_not_clipped(motion, without):
    for noise in (0.0, 0.002):
        assert found(noisy(moved(*MOTIONS[motion]), noise), without=without) == []


@pytest.mark.parametrize("step", [0.2, 0.01])
def test_a_coarsely_rounded_sine_has_no_flat_top(step):
    assert list(flat_tops(step * np.round(np.sin(4.0 * np.pi * np.arange(2000) / 1000.0) / step))) == []
