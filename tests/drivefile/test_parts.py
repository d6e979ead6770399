"""Parts of a drive file iteration, compared with their definitions and with the results in tests/results."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eightpost.drivefile import ActuatorBands, Limits, Settings, Target, start_response
from eightpost.drivefile.iteration import TYPICAL, Outcome, _start_gains, correction, gains, regularised_inverse
from eightpost.drivefile.page import _reasons, error_table
from eightpost.drivefile.target import Lines, PassErrors, at_rate, pass_errors, within_limits
from eightpost.ident.vehicle.frequency_response import response_of
from eightpost.shock import read_shock
from eightpost.signals import TimeSeries
from eightpost.vehicle import Bristle, Friction, IdentifiedVehicle, add_port_damping, read_vehicle, shipped
from tests.unchanged import refusals

from .conftest import problem_of

Unchanged = Callable[..., None]
BANK = Path(__file__).parents[2] / "examples" / "bank"
BANK = Path(__file__).parents[2] / "examples" / "bank"


def random_response(seed, lines, outputs, inputs):
    generator = np.random.default_rng(seed)
    shape = (lines, outputs, inputs)
    return generator.standard_normal(shape) + 1j * generator.standard_normal(shape)


@pytest.mark.parametrize("share", [0.0, 0.01, 0.1, 0.5])
def test_the_inverse_minimises_the_error_and_the_command_together(share):
    """The normal equations of |Y^-1 (e - H x)|^2 + lambda^2 |U^-1 x|^2 give the same command."""
    H, scale = random_response(2, 4, 5, 3), np.random.default_rng(3).uniform(0.5, 2.0, (4, 5))
    units = ("m", "N", "N.m")
    found = regularised_inverse(H, scale, units, share)
    U = np.diag([TYPICAL[unit] for unit in units])
    for k in range(4):
        S = np.diag(1.0 / scale[k]) @ H[k] @ U
        floor = (share * np.linalg.norm(S, 2)) ** 2 * np.eye(3)
        expected = U @ np.linalg.solve(S.conj().T @ S + floor, S.conj().T @ np.diag(1.0 / scale[k]))
        assert found.G[k] == pytest.approx(expected, rel=1e-9)
        assert found.condition[k] == pytest.approx(np.linalg.cond(S))


def test_a_direction_that_the_rig_cannot_reach_is_not_driven():
    H = np.array([[[1.0, 1.0], [1.0, 1.0 + 1e-6]]], dtype=complex)
    found = regularised_inverse(H, np.ones((1, 2)), ("m", "m"), 0.02)
    assert found.rank[0] == pytest.approx(1.0, abs=1e-3)
    assert np.abs(found.G).max() < 1.0  # the exact inverse has 1e6


LINES = Lines(1500, 100.0, 20.0)
WINDOW = np.concatenate([np.linspace(0, 1, 100), np.ones(1300), np.linspace(1, 0, 100)])


@pytest.mark.parametrize(("width", "half"), [(0.0, 4), (20.0 * LINES.spacing, 10), (1e308, 1500)])
def test_a_band_has_its_lines_and_at_most_those_of_the_record(width, half):
    assert LINES.half_width(width) == half


@settings(max_examples=40)
@given(
    seed=st.integers(0, 10_000),
    size=st.floats(1e-4, 1.0),
    mean=st.floats(-8000.0, 8000.0),
    stroke=st.floats(1e-3, 0.2),
    velocity=st.floats(1e-2, 5.0),
    force=st.floats(10.0, 2e4),
)
def test_no_command_exceeds_a_limit(seed, size, mean, stroke, velocity, force):
    noise = np.random.default_rng(seed).standard_normal((2, LINES.samples))
    rows = WINDOW * LINES.rows(LINES.spectrum(noise)) * np.array([[size], [5000.0 * size]]) + np.array([[0.0], [mean]])
    limits = Limits(stroke, velocity, force)
    found, hits = within_limits(rows, ("lf.road", "lf.aero"), ("m", "N"), LINES, limits, WINDOW)
    slack = 1.0 + 1e-6
    assert np.abs(found[0]).max() <= slack * stroke
    assert np.abs(np.diff(found[0])).max() * LINES.rate <= slack * velocity
    assert np.abs(found[1]).max() <= slack * force
    if not hits:
        assert np.array_equal(found, rows)


def test_a_limited_command_has_no_power_above_the_band():
    rows = WINDOW * LINES.rows(LINES.spectrum(np.random.default_rng(5).standard_normal((1, LINES.samples))))
    limits = Limits(stroke=0.4 * float(np.abs(rows).max()), velocity=1e6)
    found, hits = within_limits(rows, ("road",), ("m",), LINES, limits, WINDOW)
    assert [hit.kind for hit in hits] == ["stroke"]
    clipped = np.clip(rows, -limits.stroke, limits.stroke)

    def above(signal):
        return np.std(signal - LINES.rows(LINES.spectrum(signal))) / np.std(signal)

    assert above(found) < 0.2 * above(clipped)


def test_the_gain_is_the_coherence_of_the_step_without_the_bias_of_few_lines():
    """Noise of power n in a step of power 1 has the coherence 1 / (1 + n)."""
    lines = Lines(60_000, 100.0, 20.0)
    generator = np.random.default_rng(6)
    K = lines.frequency.size

    def white():
        return (generator.standard_normal((K, 1)) + 1j * generator.standard_normal((K, 1))) / np.sqrt(2.0)

    H, drive = np.ones((K, 1, 1)), white()
    for noise in (0.0, 1.0, 100.0):
        found = correction(H, [(drive, drive + np.sqrt(noise) * white())], lines, 1.0)
        assert found[1].mean() == pytest.approx(1.0 / (1.0 + noise), abs=0.02)
    assert gains(np.array([[1.0], [0.5], [0.0]]), 0.8) == pytest.approx(np.array([[0.8], [0.4], [0.12]]))


def test_a_repeated_drive_neither_corrects_the_response_nor_changes_the_gains():
    lines = Lines(2000, 100.0, 20.0)
    K = lines.frequency.size
    drive = random_response(7, K, 1, 1)[:, :, 0]
    one = (drive, 0.5 * drive)
    once, twice = (correction(np.ones((K, 1, 1)), passes, lines, 1.0) for passes in ([one], [one, one]))
    assert twice[1] == pytest.approx(once[1])
    assert twice[0] == pytest.approx(once[0])
    assert once[0] == pytest.approx(np.full((K, 1), (0.5 + 0.1) / 1.1))


def test_the_first_gains_follow_the_coherence_of_the_identification():
    coherence = np.array([[0.9, 0.99, 0.0]])
    assert _start_gains(coherence, (3, 1), 1.0)[:, 0] == pytest.approx([0.9, 0.99, 0.6])
    assert _start_gains(None, (3, 1), 0.7)[:, 0] == pytest.approx([0.7] * 3)


def test_the_error_of_a_pass_is_the_rms_of_the_difference_over_that_of_the_target(quarter):
    rig, _ = quarter
    target = rig.target
    found = pass_errors(target, 1.1 * target.rows + target.means[:, None])
    assert list(found.channels.values()) == pytest.approx([0.1, 0.1], rel=1e-3)
    assert list(found.peaks.values()) == pytest.approx([0.1, 0.1], rel=1e-3)
    assert max(map(abs, found.means.values())) < 1e-4
    for name, bands in found.bands.items():
        assert np.sqrt(np.sum(np.square(bands))) == pytest.approx(found.channels[name], rel=0.02)
    assert found.total == pytest.approx(0.1, rel=1e-3)
    shifted = pass_errors(target, target.rows + 0.5 * target.rows.std(axis=1, keepdims=True))
    assert shifted.total < 1e-6
    assert min(shifted.means.values()) > 0.3


# ---- Compared with kept results --------------------------------------------------------------------------------------

BANK = Path(__file__).parents[2] / "examples" / "bank"


def errors_of(one: PassErrors) -> dict[str, object]:
    """Return the errors of a pass, an array for each kind."""
    kinds = {name: np.array(list(getattr(one, name).values())) for name in ("channels", "peaks", "beyond", "means")}
    return {**kinds, **{f"bands of {name}": np.array(bands) for name, bands in one.bands.items()}}


def described(outcome: Outcome) -> dict[str, object]:
    """Return the numbers of an outcome, with the errors of its last pass."""
    simple = {name: getattr(outcome, name) for name in ("status", "best", "rejections", "drive", "unreachable")}
    totals, hits = np.array([one.total for one in outcome.errors]), [str(hit) for hit in outcome.hits]
    last = errors_of(outcome.errors[-1]) if outcome.errors else {}
    return {**simple, "totals": totals, "hits": hits, "last": last}


def test_the_passes_of_an_iteration_with_means_and_limits(seven_dof, unchanged: Unchanged) -> None:
    """The target has means, and noise that the rig cannot reproduce; the stroke is half of what it needs."""
    rig, drive = seven_dof
    series = rig.target.series.values
    noise = 0.1 * series.std(axis=1, keepdims=True) * np.random.default_rng(3).standard_normal(series.shape)
    values = series + noise + (rig.start.static @ np.array([0.0] * 4 + [-3000.0, 200.0, 400.0]))[:, None]
    loaded = rig.with_target(values)
    stroke = 0.8 * float(np.abs(drive[0]).max())
    problem = problem_of(loaded, Settings(limits=Limits(stroke=stroke, velocity=0.2, force=2500.0)))
    outcomes = loaded.passes(problem, 3)
    texts = [f"{one.statement}; {one.figure}; {one.rule}" for one in _reasons(problem, outcomes[-1], ("a hit",))]
    table = error_table(problem, outcomes[-1])
    cells = [" ".join(str(getattr(cell, "value", cell)) for cell in row) for row in table.rows]
    passes = {f"after {k}": described(one) for k, one in enumerate(outcomes) if k in (0, 1, 3)}
    unchanged({**passes, "reasons": texts, "table": cells}, relative=1e-3)


@pytest.mark.parametrize("shock", ["C_B", ""])
def test_the_start_response_of_an_identified_car_about_its_track(quarter, shock: str, unchanged: Unchanged) -> None:
    target = quarter[0].target
    model = add_port_damping(read_vehicle(shipped("quarter_car")).coupled(), {"": 3000.0})
    law = Friction(60.0, 0.004, Bristle(80.0, 1e-4, 1.2, 0.01))
    car = IdentifiedVehicle("car", model, {"": 3000.0}, friction={"": law})
    shocks = {"": read_shock(BANK / f"{shock}.json").law} if shock else {}
    frequency = np.linspace(2.0, 15.0, 30)
    measured = replace(response_of(model, frequency), coherence=np.tile(np.linspace(1.0, 0.7, 30), (9, 1)))
    found = start_response(car, target, shocks=shocks, actuators=ActuatorBands(80.0, 6.0), measured=measured)
    coherence = found.response.coherence
    unchanged({"H": dict(zip(target.names, found.response.H, strict=True)), "static": found.static,
               "coherence": coherence, "notes": found.notes})  # fmt: skip


def test_a_corner_that_is_no_target_keeps_its_damping(quarter) -> None:
    target = quarter[0].target
    car = IdentifiedVehicle("car", read_vehicle(shipped("quarter_car")).with_damper(), {"": 1500.0})
    without = Target(target.series.select(["hub_acceleration"]), target.high)
    assert "displacement is not a target" in start_response(car, without).notes[0]


def test_what_cannot_be_iterated_is_refused(quarter, unchanged: Unchanged) -> None:
    target, law = quarter[0].target, read_shock(BANK / "C_B.json").law
    series, car = target.series, read_vehicle(shipped("quarter_car"))
    undamped = IdentifiedVehicle("car", car.with_damper(), {"": 1500.0})

    def flat(height: float) -> Target:
        return Target(series.with_channel("displacement", "m", np.full(len(series), height)), 20.0)

    settings = ({"gain": 0.0}, {"gain": 1.5}, {"regularisation": 1.0}, {"acceleration": 0.0})
    bands = ({"wheelloader": 0.0}, {"aeroloader": 0.0})
    limits = ({"stroke": 0.0}, {"velocity": 0.0}, {"force": 0.0})
    given = ((Settings, settings), (ActuatorBands, bands), (Limits, limits))
    unchanged(refusals({f"{kind.__name__} {one}": partial(kind, **one) for kind, all_ in given for one in all_} | {
        "5 s": lambda: Target(series.window(0.0, 5.0), 20.0), "90 Hz": lambda: Target(series, 90.0),
        "a constant channel": lambda: flat(0.01), "1e308 m": lambda: flat(1e308), "1e12 m": lambda: flat(1e12),
        "an unknown corner": lambda: start_response(undamped, target, shocks={"lf": law}),
        "a second damper": lambda: start_response(car, target, shocks={"": law}),
        "an input in Pa": lambda: regularised_inverse(np.ones((1, 2, 1)), np.ones((1, 2)), ("Pa",), 0.1),
    }))  # fmt: skip


@pytest.mark.parametrize("rate", [400.0, 200.0, 80.0])
def test_a_record_at_another_rate(rate: float, unchanged: Unchanged) -> None:
    time = 2.0 + np.arange(801) / 200.0
    series = TimeSeries.from_channels(time, {"a": ("m", np.sin(20.0 * time) + 0.2 * np.sin(400.0 * time))})
    found = at_rate(series, rate)
    unchanged({"time": found.time, "a": found["a"]})


def test_commands_within_their_limits(unchanged: Unchanged) -> None:
    noise = LINES.rows(LINES.spectrum(np.random.default_rng(2).standard_normal((3, 1500))))
    rows = WINDOW * noise * np.array([[0.1], [0.1], [4000.0]]) + np.array([[0.0], [0.02], [1500.0]])
    limits = Limits(0.08, 1.5, 4000.0)
    found, hits = within_limits(rows, ("lf.road", "rf.road", "lf.aero"), ("m", "m", "N"), LINES, limits, WINDOW)
    unchanged({"rows": list(found), "hits": [str(hit) for hit in hits]})


def test_a_correction_its_gains_and_an_inverse(unchanged: Unchanged) -> None:
    lines = Lines(1000, 100.0, 20.0)
    generator, count = np.random.default_rng(5), lines.frequency.size
    H, *drives = generator.standard_normal((4, count, 3, 2)) + 1j * generator.standard_normal((4, count, 3, 2))
    passes = [(one[:, 0], np.einsum("kij,kj->ki", 0.8 * H, one[:, 0]) + 0.3 * one[:, :, 0]) for one in drives]
    factor, coherence = correction(H, passes, lines, 2.0)
    inverse = regularised_inverse(H, 1.0 + np.abs(H[:, :, 0]), ("m", "N"), 0.05)
    unchanged({"factor": factor, "coherence": coherence, "gains": gains(coherence, 0.8), "inverse": inverse.G,
               "condition": inverse.condition, "rank": inverse.rank})  # fmt: skip
