"""Inverse, limits, gains and errors of a drive file iteration, each compared with its definition."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eightpost.drivefile import Limits
from eightpost.drivefile.iteration import TYPICAL, _start_gains, correction, gains, regularised_inverse
from eightpost.drivefile.target import Lines, pass_errors, within_limits


def random_response(seed, lines, outputs, inputs):
    generator = np.random.default_rng(seed)
    shape = (lines, outputs, inputs)
    return generator.standard_normal(shape) + 1j * generator.standard_normal(shape)


def test_without_regularisation_the_inverse_is_exact():
    H = random_response(1, 5, 3, 3)
    found = regularised_inverse(H, np.ones((5, 3)), ("m", "m", "N"), 0.0)
    assert np.einsum("kij,kjl->kil", H, found.G) == pytest.approx(np.broadcast_to(np.eye(3), (5, 3, 3)), abs=1e-9)
    assert found.rank == pytest.approx(np.full(5, 3.0))


@pytest.mark.parametrize("share", [0.01, 0.1, 0.5])
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
