"""Check of a rig record against the laws of mechanics."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from eightpost.corners import channel
from eightpost.ident.preparation.plausibility.attribution import Attribution, Fault, attribute
from eightpost.ident.preparation.plausibility.comparison import Kind
from eightpost.ident.preparation.plausibility.description import findings_of
from eightpost.ident.preparation.plausibility.disconnected import disconnected
from eightpost.ident.preparation.plausibility.drive import is_broadband
from eightpost.ident.preparation.plausibility.finding import Finding
from eightpost.ident.preparation.plausibility.large_delays import large_delays, without_delays
from eightpost.ident.preparation.plausibility.laws import comparisons
from eightpost.ident.preparation.plausibility.signs import reversed_spectra, wrong_signs
from eightpost.ident.preparation.plausibility.spectra import Spectra, spectra_of
from eightpost.ident.preparation.plausibility.spikes import spikes
from eightpost.ident.preparation.plausibility.swaps import exchanged, swaps
from eightpost.signals.timeseries import TimeSeries

_AT_CORNERS = (
    "road", "road_command", "aero", "aero_command", "aero_position", "tire_force", "displacement", "velocity", "force",
    "hub_acceleration", "chassis_acceleration",
)  # fmt: skip
_ONCE = (
    "aero_force", "heave_force", "ride_height", "front.ride_height", "rear.ride_height", "driver.acceleration",
    "cg.vertical_acceleration", "cg.lateral_acceleration", "cg.longitudinal_acceleration",
)  # fmt: skip
#: Channels that are usually computed from others: they repeat the spikes of these, and so are no witnesses of a bump.
_COMPUTED = ("velocity", "ride_height")


def record_findings(series: TimeSeries, corners: Sequence[str], *, mass: float | None = None) -> tuple[Finding, ...]:
    """Return the channels of a rig record that contradict the mechanics of the car.

    Spikes are searched in every record, other faults only in those of random and track drives of at least 14 s.
    Disconnected, swapped and reversed channels are left out, exchanged or reversed before the gains and delays of the
    others are estimated.

    Args:
        series: Rig record, before any filter.
        corners: Names of its corners; one empty name for a quarter car.
        mass: Mass of the car [kg]; without it, forces that are all wrong by one factor are found only if the mass is
            that of no usual car.
    """
    record = checked_channels(series, corners)
    computed = [name for name in record.names if name.rpartition(".")[2] in _COMPUTED]
    found = spikes(record, computed=computed)
    spectra = spectra_of(record)
    if spectra is None or not is_broadband(spectra, corners):
        return found
    return (*found, *law_findings(spectra, corners, mass=mass))


def checked_channels(series: TimeSeries, corners: Sequence[str]) -> TimeSeries:
    """Return the channels of a record that are checked."""
    known = {*(channel(corner, name) for corner in corners for name in _AT_CORNERS), *_ONCE}
    return series.select([name for name in series.names if name in known])


def law_findings(spectra: Spectra, corners: Sequence[str], *, mass: float | None = None) -> tuple[Finding, ...]:
    """Return the channels that contradict the mechanics of the car, from the spectra of a broadband record."""
    noise = disconnected(spectra, corners)
    spectra = spectra.without(name for finding in noise for name in finding.channels)
    swapped = swaps(spectra, corners)
    spectra = exchanged(spectra, swapped)
    compare = partial(comparisons, corners=corners, mass=mass)
    signs = wrong_signs(spectra, compare)
    spectra = reversed_spectra(spectra, [name for finding in signs for name in finding.channels])
    late = large_delays(spectra, corners)
    spectra = without_delays(spectra, late)
    rest = attribute(spectra, compare)
    return (*noise, *swapped, *signs, *findings_of(_joined(late, rest)))


def _joined(late: Sequence[Fault], rest: Attribution) -> Attribution:
    """Return an attribution with large delays, to which the delays of the same channels that remained are added."""
    delays = {fault.name: fault for fault in late}
    others = []
    for fault in rest.faults:
        if fault.kind is Kind.DELAY and fault.name in delays:
            delays[fault.name] = fault._replace(value=delays[fault.name].value + fault.value)
        else:
            others.append(fault)
    return rest._replace(faults=(*delays.values(), *others))
