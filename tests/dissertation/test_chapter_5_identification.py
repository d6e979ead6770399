"""Statements about the identified car of chapter 5 are true of responses that were made so, and false of others."""

from types import SimpleNamespace

import numpy as np
import pytest

from dissertation import QUICK
from dissertation import chapter_5_identification as chapter
from eightpost.ident.vehicle.frequency_response import FrequencyResponse
from eightpost.vehicle import CORNERS
from eightpost.vehicle.statespace import Channel

from .conftest import claims

F = np.arange(1, 251) / 10.0
OUTPUTS = ("lf.velocity", "lf.tire_force", "front.ride_height")
FORCES = tuple(f"{corner}.force" for corner in CORNERS)
#: Outputs and errors of a path: 0 dB and -19.5 dB in turns count, -20.5 dB and other frequencies than 0.5 to 20 Hz not.
EVEN, SMALL = np.arange(F.size) % 2 == 0, (F > 8.05) & (F < 9.05)
LEVELS = np.where(SMALL, -20.5, np.where(EVEN, 0.0, -19.5))
COUNTED = ~SMALL & (F > 0.45) & (F < 20.05)


def errors(size):
    """Return errors with a root mean square, larger where the response is smaller, and 40 dB where none counts."""
    return np.where(COUNTED, size * np.where(EVEN, 0.5, np.sqrt(1.75)), 40.0)


@pytest.fixture
def paths(monkeypatch):
    """Set the errors of estimate and model [dB] by (output, input), and the coherence by input."""

    def made(errors, coherence):
        H = np.array([[LEVELS + errors.get((output, source), 0.0) for source in FORCES] for output in OUTPUTS])
        rows = np.array([np.broadcast_to(coherence.get(source, 0.5), F.shape) for source in FORCES])
        shares = np.broadcast_to(rows, H.shape)
        inputs, outputs = (tuple(Channel(name, "N") for name in names) for names in (FORCES, OUTPUTS))
        return FrequencyResponse(F, 10.0 ** (H / 20.0), inputs, outputs, partial_coherence=shares)

    def given(estimate=None, model=None, coherence=None):
        responses = {"ideal": made({}, {}), "model": made(model or {}, {})}
        vehicle = SimpleNamespace(baseline_damping={"lf": 1.0}, state_space="model")
        found = SimpleNamespace(response=made(estimate or {}, coherence or {}), vehicle=vehicle, notes=("one", "two"))
        monkeypatch.setattr(chapter, "identified", lambda _rig, _seconds: found)
        monkeypatch.setattr(chapter, "baseline_car", lambda damping: "ideal" if damping == {"lf": 1.0} else "")
        monkeypatch.setattr(chapter, "response_of", lambda name, f: responses[name].band(f[0] - 1e-9, f[-1] + 1e-9))
        chapter._paths.cache_clear()

    yield given
    chapter._paths.cache_clear()


@pytest.mark.parametrize(
    ("figure", "output", "good", "names"),
    [
        (chapter.figure_5_9, "lf.velocity", ["lf"], ("own", "others")),
        (chapter.figure_5_10, "lf.tire_force", ["lf"], ("own", "others")),
        (chapter.figure_5_11, "front.ride_height", ["lf", "rf"], ("front", "rear")),
    ],
)
def test_an_estimate_is_judged_where_the_ideal_response_is_large(figure, output, good, names, paths):
    last = f"{good[-1]}.force"
    coherence = {f"{corner}.force": np.where((F > 0.45) & (F < 20.05), 0.9, 0.0) for corner in good}
    paths({(output, last): errors(1.9), (output, "rr.force"): 30.0}, coherence=coherence)
    found = figure(QUICK)
    assert claims(found) == dict.fromkeys(names, True)
    assert found.claims[names[0]][1].endswith("1.9 dB") and f"{good[-1]} 0.90" in found.claims[names[1]][1]
    paths({(output, last): errors(2.1)}, coherence=coherence | {"rr.force": 0.95})
    assert claims(figure(QUICK)) == dict.fromkeys(names, False)


def test_the_antiresonance_of_the_ideal_response_and_the_printed_resolution_are_stated(paths, monkeypatch):
    """Forty half-overlapping blocks of 800 s have a length of 2 x 800 / 41 s."""
    notch = np.where((F > 3.05) & (F < 11.95), np.abs(F - 5.8), -30.0)
    monkeypatch.setattr("tests.dissertation.test_chapter_5_identification.LEVELS", notch)
    paths()
    assert chapter.figure_5_9(QUICK).values == pytest.approx({"resolution": 1.0 / 39.0244, "anti": 5.8}, rel=1e-4)


def test_estimate_and_coherence_of_each_force_are_shown_in_us_customary_units(paths, plots):
    """1 m/s per newton is 39.37 in/s per 0.2248 lbf."""
    paths(coherence={"rr.force": 0.3})
    chapter.figure_5_9(QUICK)
    assert [plot.title for plot in plots] == [*FORCES, *FORCES]
    assert plots[3].lines[0].y.max() == pytest.approx(20.0 * np.log10(39.3700787 * 4.44822162))
    assert (plots[7].lines[0].y == 0.3).all()
    assert (plots[0].lines[0].x[0], plots[0].lines[0].x[-1]) == (0.5, 20.0)


def test_an_estimate_is_rougher_than_its_modified_one(paths, monkeypatch):
    """The second differences of an alternating half decibel are 2 dB."""
    monkeypatch.setattr("tests.dissertation.test_chapter_5_identification.LEVELS", np.zeros(F.size))
    paths({("lf.velocity", "lf.force"): np.where(EVEN, 0.5, -0.5)})
    found = chapter.figure_5_12(QUICK)
    assert found.claims["smooth"][0] and "differences 2 dB, modified 0" in found.claims["smooth"][1]
    assert found.values == {"width": 0.6}
    monkeypatch.setattr(chapter, "ZeroPhaseSmoothing", lambda: SimpleNamespace(apply=lambda _f, H: H**2))
    assert not claims(chapter.figure_5_12(QUICK))["smooth"]


@pytest.mark.parametrize(("size", "holds"), [(1.95, True), (2.1, False)])
def test_a_fit_is_judged_by_its_worst_path_at_the_same_corner(size, holds, paths, plots):
    paths(model={("front.ride_height", "lf.force"): errors(size), ("lf.velocity", "rf.force"): 30.0})
    found = chapter.figure_5_13(QUICK)
    assert claims(found) == {"fit": holds} and found.note == "one two"
    assert [plot.title.partition(" ")[0] for plot in plots] == list(OUTPUTS)


# ---- Figs 5.15 to 5.17 ----------------------------------------------------------------------------------------------


def lap_of_tones(monkeypatch, tire, ride):
    """Set a lap with a tone of 5 Hz, slow drift, and relative errors of both signals by setup."""
    fast, slow = np.arange(12500) / 1250.0, np.arange(2500) / 250.0
    tone, drift = lambda t: np.sin(10.0 * np.pi * t), lambda t: 5.0 * np.sin(0.1 * np.pi * t)
    true = {"lf.tire_force": tone(fast) + drift(fast), "front.ride_height": 0.01 * tone(fast)}
    found = [
        {"lf.tire_force": (1.0 + a) * tone(slow) - drift(slow), "front.ride_height": 0.01 * (1.0 + b) * tone(slow)}
        for a, b in zip(tire, ride, strict=True)
    ]
    lap = chapter._Lap((true,) * len(found), tuple(found))
    monkeypatch.setattr(chapter, "_lap", lambda _effort: lap)
    return lap


def test_errors_of_traces_are_relative_to_the_signal_from_1_to_20_hz(monkeypatch, plots):
    lap = lap_of_tones(monkeypatch, (0.0, 0.2, 0.0), (0.3, 0.1, 0.0))
    assert [row.size for row in lap.pair("lf.tire_force", 0)] == [2500 - 750] * 2  # 3 s are left out
    found = chapter.figure_5_15(QUICK)
    assert found.values["worst"] == pytest.approx(20.0, rel=0.02)
    assert found.claims["ride"] == (True, "with another left front shock 10 % and 20 %")
    true, identified, error = plots[1].lines
    assert (true.x[0], true.x[-1]) == (2.0, 3.996)
    assert error.y == pytest.approx(identified.y - true.y)
    lap_of_tones(monkeypatch, (0.0, 0.1, 0.0), (0.0, 0.2, 0.0))
    assert not claims(chapter.figure_5_15(QUICK))["ride"]


def test_errors_of_spectra_are_in_decibels_below_the_signal_with_the_baseline_shocks(monkeypatch, plots):
    """A tenth of the amplitude is 20 dB below, a hundredth 40 dB."""
    lap_of_tones(monkeypatch, (0.1, 0.5, 0.5), (0.01, 0.5, 0.5))
    assert chapter.figure_5_16(QUICK).values == pytest.approx({"tire": 20.0, "ride": 40.0}, abs=0.2)
    assert all(line.x[0] >= 1.0 and line.x[-1] <= 20.0 for plot in plots for line in plot.lines)
    assert len(plots) == 6


@pytest.mark.parametrize(("factor", "text"), [(1.04, "mean 4 %, largest 4 %"), (0.94, "mean 6 %, largest 6 %")])
def test_rms_measures_match_within_5_percent_on_average(factor, text, monkeypatch, plots):
    names = ("lf.velocity", "lf.tire_force", "front.ride_height", "lf.hub_acceleration")

    def channels(level, count):
        return dict.fromkeys(names, level * np.resize([1.0, -1.0], count))

    def lap(order):
        true = tuple(channels(level, 5000) for level in (1.0, 2.0, 3.0, 4.0, 5.0))
        found = tuple(channels(factor * level, 1000) for level in order)
        monkeypatch.setattr(chapter, "_lap", lambda _effort: chapter._Lap(true, found))
        return chapter.figure_5_17(QUICK)

    found = lap((1.0, 2.0, 3.0, 4.0, 5.0))
    assert found.claims["levels"] == (factor > 1.0, text)
    assert found.claims["trend"] == (True, "mean Spearman 1.000, lowest 1.000 over 5 setups")
    assert [plot.y.unit for plot in plots] == ["m/s", "N", "N", "m", "m/s2"]
    found = lap((2.0, 1.0, 3.0, 4.0, 5.0))
    assert found.claims["trend"] == (False, "mean Spearman 0.900, lowest 0.900 over 5 setups")
