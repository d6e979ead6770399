"""Validation of an identified vehicle on rig records that it was not fitted to (6.5)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from eightpost.array_types import Array
from eightpost.corners import channel
from eightpost.errors import ParameterError
from eightpost.ident.validation.comparison import (
    Comparison,
    Judging,
    SineOutput,
    StaticOutput,
    Trend,
    compare,
    sine_output,
    static_outputs,
    trends_of,
    with_total,
)
from eightpost.ident.validation.responses import Response, VehicleMode, main_paths, modes_of
from eightpost.ident.validation.rig_record import RigRecord
from eightpost.ident.validation.spectrum import ErrorSpectrum
from eightpost.ident.vehicle import VehicleFit
from eightpost.ident.vehicle.experiment import quantity
from eightpost.ident.vehicle.many_setups import closed_at_ports
from eightpost.ident.vehicle.ranges import Ranges, lifted_tires
from eightpost.ident.vehicle.simulation import open_at_ports, ports_of
from eightpost.shock import ShockLaw
from eightpost.signals import TimeSeries
from eightpost.vehicle import IdentifiedVehicle, StateSpace, Vehicle, add_port_damping


@dataclass(frozen=True, slots=True, eq=False)
class VehicleCase:
    """Prediction of one record by the vehicle, compared with the measurement."""

    record: RigRecord  #: Record that was predicted.
    shocks: str  #: Source of the port forces, as text: measured forces or shock laws.
    time: Array  #: Times of the judged part (N,) [s]; of static records the whole.
    outputs: tuple[Comparison, ...] = ()  #: All measured outputs; empty for static records.
    #: Outputs predicted without the friction at the ports; None if the vehicle has no friction.
    without_friction: tuple[Comparison, ...] | None = None
    sines: tuple[SineOutput, ...] = ()  #: Results of a sine record.
    holds: tuple[StaticOutput, ...] = ()  #: Results of a static record.
    #: Error spectra of a random record, by judged output.
    spectra: Mapping[str, ErrorSpectrum] = field(default_factory=dict)
    extrapolations: tuple[str, ...] = ()  #: Sentences on where the record leaves the range of the fit's tests.
    notes: tuple[str, ...] = ()  #: Other notes on the record.
    #: Whether the vehicle was fitted to this record, so that it does not validate the vehicle.
    is_fit_record: bool = False
    #: Whether the shocks barely move compared with the fit's tests: friction holds them, and no criterion applies.
    is_gentle: bool = False
    lifted: tuple[str, ...] = ()  #: Names of the tires that leave the road.

    @property
    def judged(self) -> tuple[Comparison, ...]:
        """Outputs that the criteria apply to."""
        return tuple(found for found in self.outputs if found.is_judged)


@dataclass(frozen=True, slots=True, eq=False)
class VehicleValidation:
    """Predictions of all records by a vehicle, compared with the measurements."""

    fit: VehicleFit  #: Vehicle, with the data that it was fitted to and its self-assessment.
    band: tuple[float, float]  #: Frequency range of the fit [Hz]; outputs are compared up to its upper end.
    cases: tuple[VehicleCase, ...]  #: Predictions of the records, in the order of the records.
    trends: tuple[Trend, ...]  #: Trends over the held-out random records.
    paths: tuple[Response, ...]  #: Main responses of the model and of the fit's estimate.
    modes: tuple[VehicleMode, ...]  #: Modes around the baseline damping.
    compared_with: str  #: Name of the car whose modes are shown for comparison; empty without one.
    judging: Judging  #: Band and time span that the criteria apply to.

    def of_kind(self, kind: str) -> tuple[VehicleCase, ...]:
        """Return the cases of a kind of record."""
        return tuple(case for case in self.cases if case.record.kind == kind)

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks on the records, a sentence each."""
        return tuple(note for case in self.cases for note in case.extrapolations + case.notes)

    @property
    def independent(self) -> tuple[VehicleCase, ...]:
        """Cases that the criteria apply to: held-out records that are neither static nor too gentle."""
        return tuple(case for case in self.cases if case.outputs and not (case.is_fit_record or case.is_gentle))


def validate_vehicle(
    fit: VehicleFit,
    records: Sequence[RigRecord],
    *,
    shocks: Mapping[str, ShockLaw] | None = None,
    against: Vehicle | None = None,
    settling: float = 4.0,
) -> VehicleValidation:
    """Compare an identified vehicle with rig records.

    Args:
        fit: Identified vehicle.
        records: Records of any kinds, made by `record_of`.
        shocks: Laws by corner, or by the name that a record's conditions give a corner's shock. A record with a
            law for every port is predicted with its ports closed, any other with its measured shock forces.
        against: True car or another fit, whose modes are shown for comparison.
        settling: Time omitted at the start of every record [s], at most a quarter of it.

    Raises:
        ParameterError: No record was given, or a shock has the name of no corner and of no shock of a record.
        TooShortError: A record is too short.
    """
    if not records:
        raise ParameterError("a validation needs at least one record")
    model, laws = fit.vehicle.state_space, dict(shocks or {})
    _check_shocks(laws, ports_of(model), records)
    band = fit.ranges.get("frequency", (float(fit.response.frequency[0]), float(fit.response.frequency[-1])))
    judging = Judging(band[1], settling)
    cases = tuple(_Judge(fit, judging, laws).case(record) for record in records)
    random = [c.outputs for c in cases if c.record.kind == "random" and not c.is_fit_record]
    return VehicleValidation(
        fit,
        band,
        cases,
        trends_of(random),
        main_paths(fit.response, model, band),
        modes_of(model, None if against is None else _around(against, fit.vehicle)),
        "" if against is None else against.name,
        judging,
    )


@dataclass(frozen=True, slots=True)
class _Judge:
    """Vehicle, shock laws and the part of records that is compared."""

    fit: VehicleFit
    judging: Judging
    shocks: Mapping[str, ShockLaw]

    def case(self, record: RigRecord) -> VehicleCase:
        """Predict one record and compare it with the measurement."""
        vehicle, laws = self.fit.vehicle, self._laws(record)
        predicted = _predict(vehicle, record.series, laws)
        found = VehicleCase(
            record,
            "shock laws, ports closed" if laws else "measured shock forces",
            record.series.time,
            notes=(*record.notes, *self._unknown(record, laws)),
            lifted=lifted_tires([record.series], record.means),
            is_fit_record=bool(record.digest) and record.digest in set(self.fit.sources.values()),
        )
        if record.kind == "static":
            return replace(found, holds=static_outputs(record.series, predicted, self._loads))
        measured = self._inside(record.series)
        outputs = compare(measured, self._inside(predicted))
        ranges = Ranges.of_mapping(self.fit.ranges)
        return replace(
            found,
            time=measured.time,
            outputs=outputs,
            without_friction=self._without_friction(record, laws, measured),
            sines=self._sines(record, outputs),
            spectra=self._spectra(record, outputs),
            extrapolations=tuple(f"{record.name}: {text}" for text in ranges.beyond(record.series)),
            is_gentle=ranges.is_gentle(record.series),
        )

    def _inside(self, series: TimeSeries) -> TimeSeries:
        return self.judging.inside(with_total(series))

    @property
    def _loads(self) -> list[str]:
        names = self.fit.vehicle.state_space.input_names
        return [name for name in names if quantity(name) not in ("road", "force")]

    def _laws(self, record: RigRecord) -> dict[str, ShockLaw] | None:
        """Return the law of every port, by corner or by the record's name of the shock; None if one is missing."""
        laws = {}
        for port, name in zip(self._ports, _shock_names(record, len(self._ports)), strict=True):
            law = self.shocks.get(port) or self.shocks.get(name)
            if law is None:
                return None
            laws[port] = law
        return laws

    @property
    def _ports(self) -> tuple[str, ...]:
        return ports_of(self.fit.vehicle.state_space)

    def _unknown(self, record: RigRecord, laws: object) -> tuple[str, ...]:
        if not self.shocks or laws:
            return ()
        names = ", ".join(dict.fromkeys(name for name in _shock_names(record, len(self._ports)) if name))
        shocks = f"the record's shocks are {names}" if names else "the record does not name its shocks"
        return (f"{record.name}: not every port has a law ({shocks}), so its measured shock forces were used",)

    def _without_friction(
        self, record: RigRecord, laws: Mapping[str, ShockLaw] | None, measured: TimeSeries
    ) -> tuple[Comparison, ...] | None:
        if not any(law.acts for law in self.fit.vehicle.friction.values()):
            return None
        smooth = replace(self.fit.vehicle, friction={})
        return compare(measured, self._inside(_predict(smooth, record.series, laws)))

    def _sines(self, record: RigRecord, outputs: Sequence[Comparison]) -> tuple[SineOutput, ...]:
        if record.frequency is None or record.kind != "sine":
            return ()
        rate = record.series.sample_rate
        return tuple(sine_output(found, record.frequency, rate) for found in outputs if found.is_judged)

    def _spectra(self, record: RigRecord, outputs: Sequence[Comparison]) -> dict[str, ErrorSpectrum]:
        if record.kind != "random":
            return {}
        rate, band = record.series.sample_rate, self.judging.band
        return {o.name: found for o in outputs if o.is_judged and (found := o.spectrum(rate, band))}


def _predict(vehicle: IdentifiedVehicle, series: TimeSeries, laws: Mapping[str, ShockLaw] | None) -> TimeSeries:
    return open_at_ports(vehicle, series) if laws is None else closed_at_ports(vehicle, series, laws)


def _shock_names(record: RigRecord, ports: int) -> tuple[str, ...]:
    """Return a record's name of the shock at each port; empty if it does not name them."""
    names = record.conditions.shocks
    return names if len(names) == ports else ("",) * ports


def _check_shocks(laws: Mapping[str, ShockLaw], ports: Sequence[str], records: Sequence[RigRecord]) -> None:
    known = {*ports, *(word for record in records for word in record.conditions.shocks)}
    for name in laws:
        if name not in known:
            listed = ", ".join(sorted(word for word in known if word)) or "the whole car"
            raise ParameterError(f"no corner and no record's shock is named {name!r}; the names are {listed}")


def _around(other: Vehicle, vehicle: IdentifiedVehicle) -> StateSpace:
    """Return another car with the baseline dampers of the vehicle at its ports."""
    coupled = other.coupled()
    damping = {p: c for p, c in vehicle.baseline_damping.items() if channel(p, "force") in coupled.input_names}
    return add_port_damping(coupled, damping)
