"""An identified vehicle held against rig records that it was not fitted to (6.5)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from eightpost.errors import ParameterError
from eightpost.ident.vehicle.experiment import channel
from eightpost.ident.vehicle_validation.comparison import Comparison, Judging, compare, with_total
from eightpost.ident.vehicle_validation.coverage import beyond, is_gentle
from eightpost.ident.vehicle_validation.modes import VehicleMode, modes_of
from eightpost.ident.vehicle_validation.prediction import closed_at_ports, open_at_ports, ports_of
from eightpost.ident.vehicle_validation.residual import ErrorSpectrum, error_spectrum
from eightpost.ident.vehicle_validation.responses import Path, main_paths
from eightpost.ident.vehicle_validation.sine import SineOutput, sine_output
from eightpost.ident.vehicle_validation.static import StaticOutput, static_outputs
from eightpost.ident.vehicle_validation.trends import Trend, trends_of
from eightpost.vehicle import IdentifiedVehicle, add_port_damping

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from eightpost.ident.vehicle import VehicleFit
    from eightpost.ident.vehicle_validation.record import RigRecord
    from eightpost.shock import ShockLaw
    from eightpost.signals import TimeSeries
    from eightpost.vehicle import StateSpace, Vehicle

#: A tire at this part of its mean load or less has lifted.
_LIFTED = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """A vehicle on a record.

    Attributes:
        record: What it was to predict.
        shocks: What was at the ports, in words: the measured forces, or laws.
        time: Of the part that is judged (N,) [s]; of static records the whole.
        outputs: All outputs that were measured; none of static records.
        without_friction: The same with the friction of the ports left out; None where there is none.
        sines: Of sine records.
        holds: Of static records.
        spectra: Of random records, by output that setups are judged by.
        beyond: Where the record leaves what the fit's tests covered, a sentence each.
        notes: What else a person must know of it.
        is_fit_record: Whether the vehicle was fitted to this very record, so that it validates nothing.
        is_gentle: Whether the shocks hardly move beside the fit's tests: friction holds them, errors are not judged.
        lifted: Tires that leave the road.
    """

    record: RigRecord
    shocks: str
    time: np.ndarray[tuple[int, ...], np.dtype[np.float64]]
    outputs: tuple[Comparison, ...] = ()
    without_friction: tuple[Comparison, ...] | None = None
    sines: tuple[SineOutput, ...] = ()
    holds: tuple[StaticOutput, ...] = ()
    spectra: Mapping[str, ErrorSpectrum] = field(default_factory=dict)
    beyond: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    is_fit_record: bool = False
    is_gentle: bool = False
    lifted: tuple[str, ...] = ()

    @property
    def judged(self) -> tuple[Comparison, ...]:
        """The outputs that setups are judged by."""
        return tuple(found for found in self.outputs if found.is_judged)


@dataclass(frozen=True, slots=True, eq=False)
class VehicleValidation:
    """A vehicle on records.

    Attributes:
        fit: The vehicle, what it was fitted to and what was said of it.
        band: Of the fit [Hz]: what is judged ends at its upper end.
        cases: In the order of the records.
        trends: Over the random records that it was not fitted to.
        paths: The model's main responses beside the fit's estimate.
        modes: Around the baseline damping.
        compared_with: The name of the car whose modes stand beside; empty without one.
        judging: What part of the records was judged.
    """

    fit: VehicleFit
    band: tuple[float, float]
    cases: tuple[Case, ...]
    trends: tuple[Trend, ...]
    paths: tuple[Path, ...]
    modes: tuple[VehicleMode, ...]
    compared_with: str
    judging: Judging

    def of_kind(self, kind: str) -> tuple[Case, ...]:
        """Return the cases of a kind of record."""
        return tuple(case for case in self.cases if case.record.kind == kind)

    @property
    def independent(self) -> tuple[Case, ...]:
        """The cases that are judged: records the vehicle was not fitted to, static and too gentle ones left out."""
        return tuple(case for case in self.cases if case.outputs and not (case.is_fit_record or case.is_gentle))


def validate_vehicle(
    fit: VehicleFit,
    records: Sequence[RigRecord],
    *,
    shocks: Mapping[str, ShockLaw] | None = None,
    against: Vehicle | None = None,
    settling: float = 4.0,
) -> VehicleValidation:
    """Hold an identified vehicle against rig records.

    Args:
        fit: The vehicle.
        records: Of any kinds, as `record_of` makes them.
        shocks: Laws by corner, or by the word with which a record's conditions name a corner's shock. A record with a
            law for every port is predicted with its ports closed, any other with its measured shock forces.
        against: The truth or another fit, whose modes stand beside.
        settling: Left out at the start of every record [s], at most a quarter of it.

    Raises:
        ParameterError: There is no record, or a shock is of no corner and no record.
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
    """A vehicle and how it is judged."""

    fit: VehicleFit
    judging: Judging
    shocks: Mapping[str, ShockLaw]

    def case(self, record: RigRecord) -> Case:
        """Predict one record and compare."""
        vehicle, laws = self.fit.vehicle, self._laws(record)
        predicted = _predict(vehicle, record.series, laws)
        found = Case(
            record,
            "shock laws, ports closed" if laws else "measured shock forces",
            record.series.time,
            notes=(*record.notes, *self._unknown(record, laws)),
            lifted=_lifted(record),
            is_fit_record=bool(record.digest) and record.digest in set(self.fit.sources.values()),
        )
        if record.kind == "static":
            return replace(found, holds=static_outputs(record.series, predicted, self._loads))
        measured = self._inside(record.series)
        outputs = compare(measured, self._inside(predicted))
        return replace(
            found,
            time=measured.time,
            outputs=outputs,
            without_friction=self._without_friction(record, laws, measured),
            sines=self._sines(record, outputs),
            spectra=self._spectra(record, outputs),
            beyond=tuple(f"{record.name}: {said}" for said in beyond(record.series, self.fit.ranges)),
            is_gentle=is_gentle(record.series, self.fit.ranges),
        )

    def _inside(self, series: TimeSeries) -> TimeSeries:
        return self.judging.inside(with_total(series))

    @property
    def _loads(self) -> list[str]:
        names = self.fit.vehicle.state_space.input_names
        return [name for name in names if name.rpartition(".")[2] not in ("road", "force")]

    def _laws(self, record: RigRecord) -> dict[str, ShockLaw] | None:
        """Return the law of every port, by corner or by what the record calls it; None where one lacks."""
        found = {}
        for port, word in zip(self._ports, _words(record, len(self._ports)), strict=True):
            law = self.shocks.get(port) or self.shocks.get(word)
            if law is None:
                return None
            found[port] = law
        return found

    @property
    def _ports(self) -> tuple[str, ...]:
        return ports_of(self.fit.vehicle.state_space)

    def _unknown(self, record: RigRecord, laws: object) -> tuple[str, ...]:
        if not self.shocks or laws:
            return ()
        words = ", ".join(dict.fromkeys(word for word in _words(record, len(self._ports)) if word))
        called = f"it names {words}" if words else "it names none"
        return (f"{record.name}: not every port has a law ({called}), so its measured shock forces were taken",)

    def _without_friction(
        self, record: RigRecord, laws: Mapping[str, ShockLaw] | None, measured: TimeSeries
    ) -> tuple[Comparison, ...] | None:
        if not any(law.force for law in self.fit.vehicle.friction.values()):
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
        spectra = {o.name: error_spectrum(o, rate, band) for o in outputs if o.is_judged}
        return {name: found for name, found in spectra.items() if found is not None}


def _predict(vehicle: IdentifiedVehicle, series: TimeSeries, laws: Mapping[str, ShockLaw] | None) -> TimeSeries:
    return open_at_ports(vehicle, series) if laws is None else closed_at_ports(vehicle, series, laws)


def _words(record: RigRecord, ports: int) -> tuple[str, ...]:
    """Return how a record calls the shock of each port; empty words where it does not say."""
    words = record.conditions.shocks
    return words if len(words) == ports else ("",) * ports


def _check_shocks(laws: Mapping[str, ShockLaw], ports: Sequence[str], records: Sequence[RigRecord]) -> None:
    known = {*ports, *(word for record in records for word in record.conditions.shocks)}
    for name in laws:
        if name not in known:
            listed = ", ".join(sorted(word for word in known if word)) or "the whole car"
            raise ParameterError(f"the shock {name!r} is of no corner and named by no record; there are {listed}")


def _around(other: Vehicle, vehicle: IdentifiedVehicle) -> StateSpace:
    """Return another car with the baseline dampers of the vehicle at its ports."""
    coupled = other.coupled()
    damping = {p: c for p, c in vehicle.baseline_damping.items() if channel(p, "force") in coupled.input_names}
    return add_port_damping(coupled, damping)


def _lifted(record: RigRecord) -> tuple[str, ...]:
    """Return the tires that leave the road; records whose tire forces are changes from rest cannot say it."""
    forces = [name for name in record.series.names if name.rpartition(".")[2] == "tire_force"]
    return tuple(
        name
        for name in forces
        if (mean := record.means.get(name, 0.0)) > record.series[name].std()
        and mean + float(record.series[name].min()) <= _LIFTED * mean
    )
