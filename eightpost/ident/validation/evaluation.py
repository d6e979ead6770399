"""Evaluation of a shock on a record: predicted force, error, and the error's spectra on random records."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np

from eightpost.array_types import Array
from eightpost.ident.shock.runs import prepare
from eightpost.ident.shock.simulation import simulate
from eightpost.ident.validation.records import DynoRecord
from eightpost.rig.dyno_test import DynoTest
from eightpost.shock import Shock, ShockLaw
from eightpost.signals import TimeSeries

# ==== Spectra of a prediction's error, and the part of the error that is linear in another signal ====================


@dataclass(frozen=True, slots=True, eq=False)
class ErrorSpectrum:
    """Spectra of an error e = measured minus predicted, and its coherence with a signal v.

        coherence(f) = |S_ev|^2 / (S_ee S_vv)

    Where the coherence is near 1, a linear filter of the signal would predict the error. A coherence below `threshold`
    is not significant.
    """

    frequency: Array  #: Frequencies (K,) [Hz].
    coherence: Array  #: Coherence (K,) [1].
    error: Array  #: One-sided power spectral density of the error (K,) [unit^2/Hz].
    measured: Array  #: One-sided power spectral density of the measured signal (K,) [unit^2/Hz].
    threshold: float  #: Value that the coherence of unrelated signals exceeds at 5 % of the frequencies [1].
    share: float  #: Share of the error's power that is coherent, corrected for the bias of the estimate [1].


def error_spectrum(
    measured: Array, predicted: Array, signal: Array, *, rate: float, band: float, block: float, fewest: int,
    overlap: float = 0.0,
) -> ErrorSpectrum | None:  # fmt: skip
    """Return the spectra of an error by Welch's method; None if the record is too short for them.

    Args:
        measured: Measured values (N,).
        predicted: Predicted values (N,).
        signal: Signal (N,) that the error may be coherent with.
        rate: Sample rate [Hz].
        band: Highest frequency [Hz].
        block: Length of the blocks [s], which overlap by half.
        fewest: Minimum number of blocks for a meaningful coherence.
        overlap: Correlation of the periodograms of overlapping blocks [1].
    """
    from scipy.signal import coherence, welch  # noqa: PLC0415 -- takes half a second to load, which no fit needs

    size = round(block * rate)
    count = 2 * measured.size // size - 1
    if count < fewest:
        return None
    error = measured - predicted
    frequency, coherent = coherence(error, signal, fs=rate, nperseg=size)
    _, density = welch(error, fs=rate, nperseg=size)
    _, whole = welch(measured, fs=rate, nperseg=size)
    kept = (frequency > 0.0) & (frequency <= band)
    averages = count / (1.0 + 2.0 * overlap * (count - 1) / count)
    # For n averages, unrelated signals have a coherence of 1 / n.
    unbiased = np.clip((averages * coherent[kept] - 1.0) / (averages - 1.0), 0.0, 1.0)
    total = float(density[kept].sum())
    return ErrorSpectrum(
        frequency=frequency[kept],
        coherence=coherent[kept],
        error=density[kept],
        measured=whole[kept],
        threshold=1.0 - 0.05 ** (1.0 / (averages - 1.0)),
        share=float(unbiased @ density[kept]) / total if total > 0.0 else 0.0,
    )


# ==== Evaluation =====================================================================================================

# ---- The error of a fitted shock on a record that it was not fitted to (3.4) ----------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class Validation:
    """The error of a prediction, with prediction and measurement through the same low-pass."""

    rms: float  #: RMS of the error [N].
    offset: float  #: Mean of the error, measured minus predicted [N]; part of `rms`.
    deviation: float  #: Standard deviation of the low-passed measured force [N].
    beyond: float  #: Share of the samples whose velocity is outside the fitted range [1].
    #: Velocity [m/s], force [N] and, if known, displacement [m] from the shock's reference; low-passed.
    measured: TimeSeries
    predicted: TimeSeries  #: Predicted force [N].
    changes: tuple[str, ...]  #: Departures from the dissertation's treatment of the record (3.3), one sentence each.
    cutoff: float  #: Cutoff frequency of the low-pass [Hz].
    seconds: float  #: Computing time of the law's evaluation [s].

    @property
    def percent(self) -> float:
        """The RMS error in percent of the standard deviation, as in Tables 3.4 and 3.5."""
        return 100.0 * self.rms / self.deviation

    @property
    def error(self) -> Array:
        """Measured minus predicted force (N,) [N]."""
        return np.asarray(self.measured["force"] - self.predicted["force"])


def evaluate(
    shock: Shock, test: DynoTest, *, segment: tuple[float, float] | None = None, cutoff: float | None = None
) -> Validation:
    """Return the error of a shock's prediction on a dynamometer test.

    The displacement is relative to the shock's own reference. A gas force that the fit estimated but left to the car
    (`included`) is added, because the record contains it. The motion ratio is ignored, because a dynamometer moves the
    damper itself.

    Args:
        shock: Fitted shock.
        test: Another record of the same shock; on the fit's own record the result is the fit's error.
        segment: Start and end [s] from the record's start; default 1 to 10.
        cutoff: Cutoff frequency of the low-pass [Hz]; default 50, at most 0.4 of the sampling rate.
    """
    prepared = prepare(test, segment=segment, cutoff=cutoff)
    record, law = prepared.record, as_measured(shock)
    if "displacement" in record:
        shifted = record["displacement"] + prepared.reference - reference_of(shock, prepared.reference)
        record = record.with_channel("displacement", "m", shifted)
    started = time.perf_counter()
    simulated = simulate(law, record)
    seconds = time.perf_counter() - started
    force = prepared.filtered(simulated)
    predicted = TimeSeries.from_channels(record.time, {"force": ("N", force)})
    start, stop = record.time[prepared.inside][[0, -1]]
    measured, predicted = record.window(start, stop), predicted.window(start, stop)
    error = measured["force"] - predicted["force"]
    beyond = [law.curve.is_beyond_fit(velocity) for velocity in measured["velocity"].tolist()]
    return Validation(
        rms=float(np.sqrt(np.mean(error**2))),
        offset=float(np.mean(error)),
        deviation=prepared.deviation,
        beyond=float(np.mean(beyond)),
        measured=measured,
        predicted=predicted,
        changes=prepared.changes,
        cutoff=prepared.cutoff,
        seconds=seconds,
    )


def reference_of(shock: Shock, otherwise: float) -> float:
    """Return the reference displacement of a shock's gas force [m], or `otherwise` if the file does not state it."""
    return float(shock.conditions.get("displacement_reference [m]", otherwise))


def as_measured(shock: Shock) -> ShockLaw:
    """Return the law as measured on a dynamometer: the damper itself, with its gas force."""
    port = replace(shock.law.port, motion_ratio=1.0)
    if shock.conditions.get("gas_treatment") == "included":
        port = replace(
            port,
            gas_preload=shock.conditions["gas_preload_estimate [N]"],
            gas_stiffness=shock.conditions["gas_stiffness_estimate [N/m]"],
        )
    return replace(shock.law, port=port)


class Predicted:
    """A result with a `prediction` over a whole record."""

    __slots__ = ()
    prediction: Validation

    @property
    def rms(self) -> float:
        """The RMS of the error [N]."""
        return self.prediction.rms

    @property
    def percent(self) -> float:
        """The error in percent of this record's standard deviation of force."""
        return self.prediction.percent

    @property
    def beyond(self) -> float:
        """Share of the samples outside the fitted velocities [1]."""
        return self.prediction.beyond


# ---- Validation on random tests -------------------------------------------------------------------------------------

#: Length of Welch's blocks [s]: 1 Hz of resolution, and 17 half-overlapping blocks in 9 s; at least 4 blocks.
_BLOCK, _FEWEST = 1.0, 4

#: Correlation of half-overlapping Hann blocks' periodograms (Welch 1967): 1 / 36.
_OVERLAP = 1.0 / 36.0


@dataclass(frozen=True, slots=True, eq=False)
class RandomValidation(Predicted):
    """Error of a shock on a random or track record."""

    prediction: Validation  #: Prediction over seconds 1 to 10, or over the segment that `evaluate` chooses.
    #: Spectra of the error and its coherence with the velocity; None for a record shorter than 2.5 s.
    residual: ErrorSpectrum | None


def validate_random(
    shock: Shock, record: DynoRecord, *, segment: tuple[float, float] | None = None, cutoff: float | None = None
) -> RandomValidation:
    """Return a shock's error on a random record (Table 3.5).

    Args:
        shock: Fitted shock.
        record: Record that moves at many frequencies.
        segment: Start and end [s] from the record's start; default 1 to 10.
        cutoff: Cutoff frequency of the low-pass [Hz]; default 50, at most 0.4 of the sampling rate.
    """
    prediction = evaluate(shock, record.test, segment=segment, cutoff=cutoff)
    return RandomValidation(prediction, residual_of(prediction))


def residual_of(validation: Validation) -> ErrorSpectrum | None:
    """Return the spectra of an error and its coherence with the velocity: near 1, the law misses dynamics, say a lag.

    Args:
        validation: Validation on a record that moves at many frequencies.
    """
    measured = validation.measured
    return error_spectrum(
        measured["force"], validation.predicted["force"], measured["velocity"], rate=measured.sample_rate,
        band=validation.cutoff, block=_BLOCK, fewest=_FEWEST, overlap=_OVERLAP,
    )  # fmt: skip
