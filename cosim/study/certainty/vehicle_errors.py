"""Uncertainty that the vehicle of a study states, for each measure of the study."""

from __future__ import annotations

from collections.abc import Mapping
from math import hypot

from cosim.study.above_band import AboveBand
from cosim.study.measures import Measure
from cosim.study.result import StudyResult
from eightpost.errors import InputError
from eightpost.measure_uncertainty import TOTAL, MeasureUncertainty
from eightpost.model_uncertainty import ModelUncertainty
from eightpost.validity import Validity

#: Statistics whose relative error is approximately that of the RMS of their channels.
_LIKE_RMS = ("rms", "joint_rms", "peak", "range", "variation")

#: Quantity whose sum over all wheels the vehicle states.
_SUMMED = "tire_force"

#: Origin of an uncertainty: stated for this measure, that of its outputs, a file's, or not known (Levels.basis).
STATED, OUTPUT, FILE, UNKNOWN = "stated", "output", "file", "unknown"


def stated_uncertainty(result: StudyResult, fmu: object) -> ModelUncertainty | None:
    """Return the uncertainty that an FMU of a study states; None if it states none, or it cannot be read."""
    document = result.provenance.models.get(str(fmu))
    try:
        return None if document is None else Validity.from_json(document).uncertainty
    except InputError:
        return None


def vehicle_uncertainties(result: StudyResult) -> dict[str, tuple[MeasureUncertainty | None, str]]:
    """Return the uncertainty of each measure due to the vehicle, and its origin: stated, output or unknown.

    The vehicle states the uncertainty of the RMS of its outputs and of the total tire force. That of a measure in a
    band, in a section or of another statistic of the same size (peak, range) is approximated by that of its output, and
    that of several outputs by the largest one. Means, shares, percentiles, work and user-defined measures are unknown.
    """
    found = stated_uncertainty(result, result.study.vehicle.fmu)
    stated = {} if found is None else found.measures
    spectra = result.provenance.above_band
    return {one.name: _of(one, stated, result.study.vehicle.name, spectra.get(one.name)) for one in result.measures}


def plain_output(measure: Measure, vehicle: str, outputs: Mapping[str, MeasureUncertainty]) -> str | None:
    """Return the output whose RMS a measure is, or the total tire force; None if it is neither."""
    names = [channel.removeprefix(f"{vehicle}.") for channel in measure.channels]
    whole = measure.statistic == "rms" and not measure.function and measure.band is None and measure.section is None
    if not whole or len(set(measure.weights)) > 1 or any(weight == 0.0 for weight in measure.weights):
        return None
    if len(names) == 1:
        return names[0] if names[0] in outputs else None
    wheels = {name for name in outputs if name.rpartition(".")[2] == _SUMMED}
    return TOTAL if set(names) == wheels and TOTAL in outputs else None


def _of(
    measure: Measure, stated: Mapping[str, MeasureUncertainty], vehicle: str, spectrum: AboveBand | None
) -> tuple[MeasureUncertainty | None, str]:
    shares = () if spectrum is None else spectrum.bands
    name = plain_output(measure, vehicle, stated)
    if name is not None:
        return stated[name].on_drive(shares), STATED
    names = [channel.removeprefix(f"{vehicle}.") for channel in measure.channels]
    if measure.function or measure.statistic not in _LIKE_RMS or not all(name in stated for name in names):
        return None, UNKNOWN
    if len(names) > 1 and TOTAL in stated and all(name.rpartition(".")[2] == _SUMMED for name in names):
        names.append(TOTAL)
    parts = [stated[name].on_drive(shares) for name in names]
    return MeasureUncertainty(max(hypot(p.common, p.bias) for p in parts), max(p.own for p in parts)), OUTPUT
