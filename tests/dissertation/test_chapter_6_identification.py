"""Statements about the estimates of chapter 6 are true of responses that were made so, and false of others."""

from types import SimpleNamespace

import numpy as np
import pytest

from dissertation import QUICK
from dissertation import chapter_6_identification as chapter
from dissertation.chapter_6_setup import inputs_of_table, zeroed_table
from eightpost.ident.vehicle.frequency_response import FrequencyResponse
from eightpost.vehicle.statespace import Channel

OUTPUTS, MASK = zeroed_table()
INPUTS = inputs_of_table()
F = np.arange(1, 251) / 10.0
SI = {"velocity": "m/s", "tire_force": "N", "ride_height": "m", "hub_acceleration": "m/s2", "road": "m", "aero": "N",
      "force": "N"}  # fmt: skip


def response(H, coherence=None):
    """Return responses of the outputs of Table 6.5 to its inputs; H is broadcast to all paths."""
    inputs, outputs = (
        tuple(Channel(name, SI[name.rpartition(".")[2]]) for name in names) for names in (INPUTS, OUTPUTS)
    )
    H = np.broadcast_to(H, (len(OUTPUTS), len(INPUTS), F.size))
    return FrequencyResponse(F, H, inputs, outputs, coherence)


@pytest.fixture
def estimate(monkeypatch):
    """Set the estimate, and the response of the fit."""

    def given(H, *, fit=None, coherence=None):
        found = response(H, coherence)
        vehicle = SimpleNamespace(state_space=None)
        car = SimpleNamespace(response=found, vehicle=vehicle, notes=("a note",))
        monkeypatch.setattr(chapter, "identified", lambda _rig, _seconds: car)
        monkeypatch.setattr(chapter, "response_of", lambda _model, f: response(fit).band(f[0] - 1e-9, f[-1] + 1e-9))

    return given


def test_a_dip_of_the_tire_force_from_4_to_6_hz_is_found(estimate):
    coherence = np.full((len(OUTPUTS), F.size), 0.99)
    coherence[:, (F < 0.3) | (F > 20.0)] = 0.0
    tire = coherence[OUTPUTS.index("rf.tire_force")]
    tire[(F > 3.95) & (F < 6.05)] = 0.75
    estimate(1.0, coherence=coherence)
    high, dip = (chapter.figure_6_19(QUICK).claims[name] for name in ("high", "dip"))
    assert dip == (True, "right front tire force: 0.750 from 4 to 6 Hz, 0.990 elsewhere")
    assert high[0] and "rf.velocity 0.990" in high[1]
    tire[:] = np.where((F > 3.95) & (F < 6.05), 0.99, 0.85)
    estimate(1.0, coherence=coherence)
    assert [holds for holds, _ in chapter.figure_6_19(QUICK).claims.values()] == [False, False]


@pytest.mark.parametrize(
    ("figure", "paths"),
    [
        (chapter.figure_6_20, ["rf.velocity over rf.road", "rf.velocity over rf.force", "lr.velocity over lr.road"]),
        (chapter.figure_6_21, ["rf.tire_force over rf.road", "rf.tire_force over rf.force"]),
        (chapter.figure_6_22, ["front.ride_height over rf.road", "front.ride_height over rf.force"]),
        (chapter.figure_6_23, ["rf.hub_acceleration over rf.road", "rf.hub_acceleration over rf.force"]),
    ],
)
def test_a_ripple_of_half_a_decibel_is_smoothed(figure, paths, estimate, plots):
    """The second differences of an alternating half decibel are 2 dB."""
    estimate(10.0 ** (0.5 * (-1.0) ** np.arange(F.size) / 20.0))
    holds, text = figure(QUICK).claims["smooth"]
    assert holds
    before, after = text.split(": ")[1].split(", ")[0].removesuffix(" dB").split(" to ")
    assert (before, float(after) < 0.5) == ("2", True)
    assert [plot.title for plot in plots][: len(paths)] == paths
    assert len(plots) == 4


def test_a_modified_estimate_that_is_rougher_is_not_smooth(estimate, monkeypatch):
    estimate(10.0 ** (0.5 * (-1.0) ** np.arange(F.size) / 20.0))
    monkeypatch.setattr(chapter, "ZeroPhaseSmoothing", lambda: SimpleNamespace(apply=lambda _f, H: H**2))
    claim = chapter.figure_6_20(QUICK).claims["smooth"]
    assert claim == (False, "standard deviation of second differences: " + ", ".join(["2 to 4 dB"] * 4))


def test_a_path_is_shown_in_us_customary_units(estimate, plots):
    """1 m/s per metre is 0 dB in inches too; 1 m/s per newton is 39.37 in/s per 0.2248 lbf."""
    estimate(1.0)
    chapter.figure_6_20(QUICK)
    levels = {plot.title: plot.lines[0].y[0] for plot in plots}
    assert levels["rf.velocity over rf.road"] == pytest.approx(0.0, abs=1e-9)
    assert levels["rf.velocity over rf.force"] == pytest.approx(20.0 * np.log10(39.3700787 * 4.44822162))


def test_a_fit_is_judged_where_the_estimate_is_large_and_up_to_15_hz(estimate, plots):
    """Differences where the estimate is 0 and -19.5 dB count; those above 15 Hz, and at -20.5 dB, do not."""
    small, even = (F > 8.05) & (F < 9.05), np.arange(F.size) % 2 == 0
    levels = np.where(small, -20.5, np.where(even, 0.0, -19.5))
    wrong = np.where(small | (F > 14.95), 40.0, np.where(even, 1.0, np.sqrt(7.0)))  # mean square 4
    estimate(10.0 ** (levels / 20.0), fit=10.0 ** ((levels + wrong) / 20.0))
    found = chapter.figure_6_24(QUICK)
    assert found.claims["fit"] == (True, "RMS difference up to 15 Hz: 2, 2, 2, 2 dB") and found.note == "a note"
    assert found.values == {"lowest": 4, "highest": 10}
    estimate(10.0 ** (levels / 20.0), fit=10.0 ** ((levels + 2.0 * wrong) / 20.0))
    assert chapter.figure_6_24(QUICK).claims["fit"] == (False, "RMS difference up to 15 Hz: 4, 4, 4, 4 dB")


def test_paths_that_are_zeroed_in_print_are_the_small_ones(estimate, plots):
    """A tenth of the largest is -20 dB; other frequencies than 0.5 to 15 Hz do not count."""
    inside = (F > 0.45) & (F < 15.05)
    zeroed = np.where(MASK, 1.0, 0.1)[:, :, None]
    estimate(np.where(inside, zeroed, 1.0))
    found = chapter.table_6_5(QUICK)
    assert found.claims["low"] == (True, "zeroed -20 dB, others 0 dB below the largest of their kind")
    assert found.note.endswith("The table zeroes 69 paths.")
    low, kept = plots[0].lines
    assert (low.x[0], low.x[-1], low.y.size, kept.y.size) == (0.0, 100.0, 69, MASK.sum())
    assert (np.diff(low.y) >= 0.0).all()
    estimate(np.where(MASK, 0.1, 1.0)[:, :, None])
    assert not chapter.table_6_5(QUICK).claims["low"][0]
