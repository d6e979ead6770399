"""What an identified vehicle may be used for: its verdict, covered ranges and uncertainty, as `build` ships them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace

from eightpost.ident.vehicle.vehicle_fit import VehicleFit
from eightpost.ident.vehicle.verdict import fit_verdict
from eightpost.model_uncertainty import ModelUncertainty
from eightpost.validity import Range, Validity, judged
from eightpost.vehicle.statespace import StateSpace
from eightpost.verdict import Reason, Verdict


def with_validity(fit: VehicleFit, further: Iterable[Reason] = ()) -> VehicleFit:
    """Return the fit with its verdict, further reasons, the covered ranges and the uncertainty added to the vehicle."""
    verdict = Verdict((*further, *fit_verdict(fit).reasons))
    stated = fit.trust.measures if fit.trust is not None else {}
    uncertainty = ModelUncertainty(measures=stated) if stated else None
    validity = Validity(verdict, tuple(_ranges(fit.ranges, fit.vehicle.coupled())), uncertainty)
    return replace(fit, vehicle=judged(fit.vehicle, validity=validity))


def _ranges(ranges: Mapping[str, tuple[float, float]], model: StateSpace) -> Iterator[Range]:
    """Yield the amplitude ranges of the model's channels, and the fitted band for every output.

    The band of a velocity has a lower end; other outputs may be static.
    """
    units = {channel.name: channel.unit for channel in (*model.inputs, *model.outputs)}
    for name, (low, high) in ranges.items():
        if name in units:
            yield Range(name, "amplitude", low, high, units[name])
    if "frequency" in ranges:
        low, high = ranges["frequency"]
        for channel in model.outputs:
            moves = channel.name.rpartition(".")[2] == "velocity"
            yield Range(channel.name, "frequency", low if moves else 0.0, high, "Hz")
