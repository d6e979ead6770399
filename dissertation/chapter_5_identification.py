"""Chapter 5.3: identification of the seven-DOF car from simulated rig tests, and simulation with the result."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.signal import butter, sosfiltfilt, welch
from scipy.stats import spearmanr

from dissertation.chapter_5_model import baseline_car
from dissertation.effort import Effort
from dissertation.findings import Findings
from dissertation.plots import (
    COHERENCE,
    LINEAR_FREQUENCY,
    TIME,
    TRUTH,
    Line,
    Plot,
    decibel_axis,
    decibels,
    figure_of,
)
from dissertation.rig_bench import (
    EVERY,
    FIVE_NAMES,
    FIVE_SETUPS,
    RATE_OF_MODEL,
    SEVEN_DOF,
    Channels,
    about_mean,
    identified,
    identified_channels,
    lap_of,
    linear_law,
    true_channels,
)
from dissertation.true_cars import TOTAL, measures_of
from eightpost.array_types import Array
from eightpost.ident.vehicle.frequency_response import (
    SMOOTHING_WIDTH,
    FrequencyResponse,
    ZeroPhaseSmoothing,
    response_of,
)
from eightpost.report.charts import Axis, Figure
from eightpost.units import si_factor
from eightpost.vehicle import CORNERS
from eightpost.virtual.drivefiles import RATE

_BAND = (0.5, 20.0)

#: Response below this level under the peak of its path is small [dB].
_LARGE = 20.0

_UNITS = {"velocity": "in/s", "tire_force": "lbf", "ride_height": "in", "hub_acceleration": "g_0"}


@dataclass(frozen=True, slots=True, eq=False)
class _Paths:
    """Estimate, ideal response and model of the identified car in the shown band."""

    estimate: FrequencyResponse
    ideal: FrequencyResponse
    model: FrequencyResponse

    def level(self, which: FrequencyResponse, output: str, source: str) -> Array:
        """Return a path (K,) in decibels, in US customary units."""
        return decibels(which.between(output, source), si_factor(_unit(output)) / si_factor("lbf"))

    def error(self, which: FrequencyResponse, output: str, source: str) -> float:
        """Return the RMS difference from the ideal response where that is large [dB]."""
        ideal = self.level(self.ideal, output, source)
        large = ideal > ideal.max() - _LARGE
        return float(np.sqrt(np.mean((self.level(which, output, source) - ideal)[large] ** 2)))

    def coherence(self, output: str, source: str) -> Array:
        """Return the partial coherence (K,) of a path."""
        partial, names = self.estimate.partial_coherence, self.estimate
        assert partial is not None
        return np.asarray(partial[names.output_names.index(output), names.input_names.index(source)])


def _unit(output: str) -> str:
    return _UNITS[output.rpartition(".")[2]]


@cache
def _paths(seconds: float) -> _Paths:
    fit = identified(SEVEN_DOF, seconds)
    estimate = fit.response.band(*_BAND)
    f = estimate.frequency
    ideal = baseline_car(fit.vehicle.baseline_damping)
    return _Paths(estimate, response_of(ideal, f), response_of(fit.vehicle.state_space, f))


def _estimate_figure(paths: _Paths, output: str) -> Figure:
    plots = []
    f = paths.estimate.frequency
    for corner in CORNERS:
        source = f"{corner}.force"
        rows = {TRUTH: paths.ideal, "estimate": paths.estimate}
        lines = [Line(name, f, paths.level(which, output, source)) for name, which in rows.items()]
        plots.append(Plot(source, LINEAR_FREQUENCY, decibel_axis(f"{_unit(output)}/lbf"), lines))
    for corner in CORNERS:
        line = Line("coherence", f, paths.coherence(output, f"{corner}.force"))
        plots.append(Plot(f"{corner}.force", LINEAR_FREQUENCY, COHERENCE, [line]))
    caption = f"{output} over the four shock forces: ideal response (truth), H1 estimate and partial coherence."
    return figure_of(caption, plots, columns=4, row=180)


def _own_and_others(effort: Effort, output: str, good: Sequence[str]) -> tuple[dict[str, tuple[bool, str]], _Paths]:
    """Return the accuracy at the good corners, and the coherence of all other corners' forces below that."""
    paths = _paths(effort.car_seconds)
    errors = [paths.error(paths.estimate, output, f"{corner}.force") for corner in good]
    means = {corner: float(paths.coherence(output, f"{corner}.force").mean()) for corner in CORNERS}
    rest = [mean for corner, mean in means.items() if corner not in good]
    own = max(errors) < 2.0, f"RMS difference {', '.join(f'{e:.2g}' for e in errors)} dB"
    text = ", ".join(f"{corner} {mean:.2f}" for corner, mean in means.items())
    others = max(rest) < min(means[corner] for corner in good), f"mean coherence {text}"
    return {"own": own, "others": others}, paths


def figure_5_9(effort: Effort) -> Findings:
    """Left front shock velocity."""
    claims, paths = _own_and_others(effort, "lf.velocity", ["lf"])
    f = paths.estimate.frequency
    ideal, inside = paths.level(paths.ideal, "lf.velocity", "lf.force"), (f > 3.0) & (f < 12.0)
    values = {"resolution": 41.0 / (2.0 * 800.0), "anti": float(f[inside][np.argmin(ideal[inside])])}
    # 40 half-overlapping blocks of 800 s
    return Findings(values, claims, [_estimate_figure(paths, "lf.velocity")])


def figure_5_10(effort: Effort) -> Findings:
    """Left front tire force."""
    claims, paths = _own_and_others(effort, "lf.tire_force", ["lf"])
    return Findings(claims=claims, blocks=[_estimate_figure(paths, "lf.tire_force")])


def figure_5_11(effort: Effort) -> Findings:
    """Front ride height."""
    claims, paths = _own_and_others(effort, "front.ride_height", ["lf", "rf"])
    renamed = {"front": claims["own"], "rear": claims["others"]}
    return Findings(claims=renamed, blocks=[_estimate_figure(paths, "front.ride_height")])


def figure_5_12(effort: Effort) -> Findings:
    """A path before and after smoothing over frequency."""
    paths = _paths(effort.car_seconds)
    f, output, source = paths.estimate.frequency, "lf.velocity", "lf.force"
    modified = ZeroPhaseSmoothing().apply(f, paths.estimate.between(output, source))
    scale = si_factor("in/s") / si_factor("lbf")
    rows = {
        TRUTH: paths.level(paths.ideal, output, source),
        "estimate": paths.level(paths.estimate, output, source),
        "modified": decibels(modified, scale),
    }
    rough = {name: float(np.std(np.diff(row, 2))) for name, row in rows.items()}
    plot = Plot(
        f"{output} over {source}",
        LINEAR_FREQUENCY,
        decibel_axis("in/s/lbf"),
        [Line(name, f, row) for name, row in rows.items()],
    )
    text = (
        f"standard deviation of the second differences {rough['estimate']:.2g} dB, modified {rough['modified']:.2g} dB"
    )
    return Findings(
        {"width": SMOOTHING_WIDTH},
        {"smooth": (rough["modified"] < rough["estimate"], text)},
        [figure_of("Ideal response (truth), H1 estimate, and modified estimate.", [plot], columns=1)],
    )


def figure_5_13(effort: Effort) -> Findings:
    """Fits of the paths at the same corner."""
    paths = _paths(effort.car_seconds)
    f, plots, errors = paths.estimate.frequency, [], []
    for output in ("lf.velocity", "lf.tire_force", "front.ride_height"):
        source = "lf.force"
        errors.append(paths.error(paths.model, output, source))
        rows = {TRUTH: paths.ideal, "estimate": paths.estimate, "fit": paths.model}
        lines = [Line(name, f, paths.level(which, output, source)) for name, which in rows.items()]
        plots.append(Plot(f"{output} over {source}", LINEAR_FREQUENCY, decibel_axis(f"{_unit(output)}/lbf"), lines))
    text = f"RMS difference {', '.join(f'{e:.2g}' for e in errors)} dB"
    return Findings(
        claims={"fit": (max(errors) < 2.0, text)},
        blocks=[figure_of("Ideal response (truth), estimate and fit.", plots)],
        note=" ".join(identified(SEVEN_DOF, effort.car_seconds).notes),
    )


# ---- Figs 5.15 to 5.17: a lap with five setups ----------------------------------------------------------------------

_SIGNALS = ("lf.tire_force", "front.ride_height")
_SHOWN = {"baseline": 0, "left front changed": 1, "right front changed": 2}


@dataclass(frozen=True, slots=True, eq=False)
class _Lap:
    """Channels of five setups: ideal and identified, at 250 Hz, band-passed from 1 to 20 Hz for traces."""

    true: tuple[Channels, ...]
    found: tuple[Channels, ...]

    def pair(self, name: str, setup: int) -> tuple[Array, Array]:
        """Return a channel of the ideal and the identified car without settling time, band-passed."""
        band = butter(4, (1.0, 20.0), "bandpass", fs=RATE_OF_MODEL, output="sos")
        settled = slice(round(3.0 * RATE_OF_MODEL), None)
        true, found = self.true[setup][name][::EVERY], self.found[setup][name]
        return tuple(sosfiltfilt(band, about_mean(row))[settled] for row in (true, found))  # type: ignore[return-value]


@cache
def _lap(effort: Effort) -> _Lap:
    fit, drive, dampers = (
        identified(SEVEN_DOF, effort.car_seconds),
        lap_of(SEVEN_DOF, effort.lap_seconds),
        SEVEN_DOF.dampers,
    )
    true = true_channels(SEVEN_DOF, drive, [[dampers[k] for k in setup] for setup in FIVE_SETUPS])
    found = identified_channels(fit, drive, [linear_law(one.damping) for one in dampers], FIVE_SETUPS)
    return _Lap(true, found)


def _relative(lap: _Lap, name: str, setup: int) -> float:
    true, found = lap.pair(name, setup)
    return float(np.std(found - true) / np.std(true))


def figure_5_15(effort: Effort) -> Findings:
    """Traces of 2 s."""
    lap, plots = _lap(effort), []
    for name in _SIGNALS:
        unit = "N" if name.endswith("force") else "m"
        for title, setup in _SHOWN.items():
            true, found = lap.pair(name, setup)
            part = slice(round(2.0 * RATE_OF_MODEL), round(4.0 * RATE_OF_MODEL))
            time = np.arange(true.size)[part] / RATE_OF_MODEL
            rows = {TRUTH: true, "identified": found, "error": found - true}
            lines = [Line(key, time, row[part]) for key, row in rows.items()]
            plots.append(Plot(f"{name}, {title}", TIME, Axis("", unit), lines))
    tire, ride = _relative(lap, "lf.tire_force", 1), _relative(lap, "front.ride_height", 1)
    return Findings(
        {"worst": 100.0 * tire},
        {"ride": (ride < tire, f"with another left front shock {100.0 * ride:.2g} % and {100.0 * tire:.2g} %")},
        [figure_of("Two seconds of a lap, band-passed from 1 to 20 Hz: ideal (truth) and identified.", plots)],
    )


def figure_5_16(effort: Effort) -> Findings:
    """Spectra of the signals and of their errors."""
    lap, plots, below = _lap(effort), [], {}
    for name in _SIGNALS:
        unit = "N2/Hz" if name.endswith("force") else "m2/Hz"
        for title, setup in _SHOWN.items():
            true, found = lap.pair(name, setup)
            rows = {TRUTH: true, "identified": found, "error": found - true}
            spectra = {key: welch(row, RATE_OF_MODEL, nperseg=min(1024, row.size)) for key, row in rows.items()}
            f, power = spectra[TRUTH]
            inside = (f >= 1.0) & (f <= 20.0)
            lines = [Line(key, one[0][inside], one[1][inside]) for key, one in spectra.items()]
            plots.append(Plot(f"{name}, {title}", LINEAR_FREQUENCY, Axis("", unit, "log"), lines))
            below[name, setup] = 10.0 * np.log10(power[inside].max() / spectra["error"][1][inside].max())
    return Findings(
        {"ride": float(below["front.ride_height", 0]), "tire": float(below["lf.tire_force", 0])},
        blocks=[figure_of("Power spectral densities: ideal (truth), identified, and error.", plots)],
        note="Values: the largest density of the error below the largest of the signal, with the baseline shocks.",
    )


def figure_5_17(effort: Effort) -> Findings:
    """RMS measures of the five setups."""
    lap = _lap(effort)
    true = [measures_of(channels, RATE) for channels in lap.true]
    found = [measures_of(channels, RATE_OF_MODEL) for channels in lap.found]
    names = ("lf.velocity", "lf.tire_force", TOTAL, "front.ride_height", "lf.hub_acceleration")
    plots, errors, ranks = [], [], []
    numbers = np.arange(len(FIVE_SETUPS), dtype=np.float64)
    for name in names:
        t, y = (np.array([one[name] for one in rows]) for rows in (true, found))
        errors += list(np.abs(y / t - 1.0))
        ranks.append(float(spearmanr(t, y).statistic))
        unit = {"in/s": "m/s", "lbf": "N", "in": "m", "g_0": "m/s2"}[_unit(name) if name != TOTAL else "lbf"]
        axes = Axis("setup: baseline, other shock at lf, rf, lr, rr"), Axis("RMS", unit)
        plots.append(Plot(name, *axes, [Line(TRUTH, numbers, t, "marks"), Line("identified", numbers, y, "marks")]))
    mean, rank = 100.0 * float(np.mean(errors)), float(np.mean(ranks))
    return Findings(
        claims={
            "levels": (mean < 5.0, f"mean {mean:.2g} %, largest {100.0 * max(errors):.2g} %"),
            "trend": (rank > 0.9, f"mean Spearman {rank:.3f}, lowest {min(ranks):.3f} over {len(FIVE_NAMES)} setups"),
        },
        blocks=[figure_of("RMS measures of the five setups, ideal (truth) and identified.", plots)],
    )


COMPUTATIONS = {
    "figure-5.9": figure_5_9,
    "figure-5.10": figure_5_10,
    "figure-5.11": figure_5_11,
    "figure-5.12": figure_5_12,
    "figure-5.13": figure_5_13,
    "figure-5.15": figure_5_15,
    "figure-5.16": figure_5_16,
    "figure-5.17": figure_5_17,
}
