"""The error of a fitted shock on a record that it was not fitted to (3.4)."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from eightpost.ident.shock.laws.simulation import simulate
from eightpost.ident.shock.record.preparation import prepare
from eightpost.signals import TimeSeries

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.ident.shock.record.preparation import Prepared
    from eightpost.rig.dyno_test import DynoTest
    from eightpost.shock import Shock, ShockLaw

    Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Validation:
    """The error of a prediction, with prediction and measurement through the same low-pass.

    Attributes:
        rms: RMS of the error [N].
        offset: Mean of the error, measured minus predicted [N]; part of `rms`.
        deviation: Standard deviation of the low-passed measured force [N].
        beyond: Share of the samples whose velocity is outside the fitted range [1].
        measured: Velocity [m/s], force [N] and, if known, displacement [m] from the shock's reference; low-passed.
        predicted: Predicted force [N].
        changes: Departures from the dissertation's treatment of the record (3.3), one sentence each.
        cutoff: Cutoff frequency of the low-pass [Hz].
        seconds: Computing time of the law's evaluation [s].
    """

    rms: float
    offset: float
    deviation: float
    beyond: float
    measured: TimeSeries
    predicted: TimeSeries
    changes: tuple[str, ...]
    cutoff: float
    seconds: float

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
    record = _about(prepared, reference_of(shock, prepared.reference))
    law = as_measured(shock)
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


def _about(prepared: Prepared, reference: float) -> TimeSeries:
    """Return the record with its displacement relative to a reference [m]."""
    record = prepared.record
    if "displacement" not in record:
        return record
    return record.with_channel("displacement", "m", record["displacement"] + prepared.reference - reference)
