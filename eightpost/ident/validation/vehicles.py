"""Validation of an identified vehicle on rig records that it was not fitted to (6.5), and the verdict."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from eightpost.array_types import Array
from eightpost.corners import channel
from eightpost.errors import ParameterError
from eightpost.ident.validation.comparison import (
    Comparison,
    Judging,
    Response,
    RigRecord,
    SineOutput,
    StaticOutput,
    Trend,
    VehicleMode,
    compare,
    main_paths,
    modes_of,
    sine_output,
    static_outputs,
    trends_of,
    with_total,
)
from eightpost.ident.validation.records import ErrorSpectrum
from eightpost.ident.vehicle.experiment import Ranges, lifted_tires, quantity
from eightpost.ident.vehicle.simulation import closed_at_ports, open_at_ports, ports_of
from eightpost.ident.vehicle.trust import MeasuredLevels
from eightpost.ident.vehicle.vehicle_fit import VehicleFit, fit_files, write_fit
from eightpost.outputs import replacing
from eightpost.shock import ShockLaw
from eightpost.signals import TimeSeries
from eightpost.validity import ModelUncertainty, Validity, judged
from eightpost.vehicle import IdentifiedVehicle, StateSpace, Vehicle, add_port_damping
from eightpost.verdict import Grade, Reason, Rules, Verdict, listed

# ---- Validation -----------------------------------------------------------------------------------------------------


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


# ---- Verdict: exceeded limits and doubtful results ------------------------------------------------------------------

ABOUT = "validation of the vehicle"

#: Fraction of an error's power that is linear in the prediction above which the model lacks a linear part, and the
#: error above which that is reported [1].
_LINEAR, _MATTERS = 0.5, 0.1

#: Number of records from which a wrong order is more than one swap.
_RANKED = 4

#: Largest level error that may be common to all records, in units of the level limit, and largest part of it by which
#: records may differ from each other [1].
_COMMON, _ALIKE = 3.0, 0.5


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits beyond which a vehicle is not usable.

    Raises:
        ParameterError: A limit is outside its range.
    """

    level: float = 0.05  #: Largest relative error of the RMS of a judged output on random records [1].
    #: Largest RMS of measured minus predicted, over the measured RMS, on random, sine and bump records [1].
    error: float = 0.25
    rank: float = 0.9  #: Lowest rank correlation of RMS over four or more random records [1].

    def __post_init__(self) -> None:
        """Check the ranges."""
        if not (self.level > 0.0 and self.error > 0.0 and -1.0 <= self.rank <= 1.0):
            raise ParameterError(f"{self}: level and error must be above 0, and rank must be between -1 and 1")

    @classmethod
    def of_percent(cls, level: float | None, error: float | None) -> Limits:
        """Return the limits from percentages; None keeps the default."""
        given = {"level": level, "error": error}
        return cls(**{name: percent / 100.0 for name, percent in given.items() if percent is not None})

    def summary(self) -> str:
        """Return the limits as a sentence."""
        return (
            f"Limits: RMS within {100 * self.level:g} % on random records, errors within {100 * self.error:g} % of "
            f"the measured RMS, rank correlation over {_RANKED} or more records at least {self.rank:g}."
        )


RULES = Rules.read(
    Path(__file__).with_name("vehicle_rules.txt"),
    ABOUT,
    ranked=_RANKED,
    common=_COMMON,
    alike=100.0 * _ALIKE,
    linear=100.0 * _LINEAR,
    matters=100.0 * _MATTERS,
)


def vehicle_verdict(study: VehicleValidation, limits: Limits | None = None) -> Verdict:
    """Return the verdict on a vehicle that was compared with records."""
    limits, known = limits or Limits(), study.fit.vehicle.validity
    edits = known.edits if known else ()
    reasons = [*edits, *_faults(study, limits), *_common_levels(study, limits), *_doubts(study)]
    if study.independent and not any(reason.grade is Grade.NOT_USABLE for reason in reasons):
        places = listed(case.record.name for case in study.independent)
        reasons.append(
            RULES.reason("the vehicle predicts its records", "the car predicts its records", _best(study), places)
        )
    return Verdict(reasons)


def keep_verdict(path: Path, study: VehicleValidation, verdict: Verdict) -> None:
    """Write a verdict, and the level errors of independent random records, into the file of a vehicle.

    The verdict replaces an earlier one.
    """
    fit, validity = study.fit, Validity.with_verdict(study.fit.vehicle.validity, verdict)
    if fit.trust is not None and fit.trust.measures:
        records = [case.record.series for case in study.independent if case.record.kind == "random"]
        measures = MeasuredLevels().with_records(fit.trust.measures, fit.vehicle, records)
        fit = replace(fit, trust=replace(fit.trust, measures=measures))
        validity = replace(validity, uncertainty=ModelUncertainty(measures=measures))
    with replacing(*fit_files(path)):
        write_fit(path, replace(fit, vehicle=judged(fit.vehicle, validity=validity)))


def _faults(study: VehicleValidation, limits: Limits) -> Iterator[Reason]:
    if not study.fit.stable:
        figure = "with 1 or more dampers"
        yield RULES.reason("validated vehicle not stable", "the car does not settle", figure, study.fit.vehicle.name)
    if not study.independent:
        statement = "no record validates the car: all are the fit's own, static or too gentle"
        names = listed(case.record.name for case in study.cases)
        yield RULES.reason("vehicle not validated", statement, f"0 of {len(study.cases)} records are judged", names)
        return
    yield from _levels(study, limits)
    yield from _errors(study, limits)
    wrong = [t for t in study.trends if len(t.measured) >= _RANKED and _ranks_wrong(t, limits)]
    if wrong:
        figure = f"rank correlation {min(t.rank for t in wrong):.2f}; limit {limits.rank:g}"
        statement = "the car ranks setups differently from the rig"
        yield RULES.reason(
            "setups ranked otherwise than by the rig", statement, figure, listed(trend.name for trend in wrong)
        )


def _ranks_wrong(trend: Trend, limits: Limits) -> bool:
    """Return whether records are ranked wrong that differ enough to be ranked."""
    return not trend.is_flat and trend.rank < limits.rank and trend.is_reversed


def _levels(study: VehicleValidation, limits: Limits) -> Iterator[Reason]:
    over = [(c, o) for c, o in _judged(study) if c.record.kind == "random" and abs(o.level) > limits.level]
    common = {t.name: t for t in study.trends if _is_common(t, limits)}
    over = [(case, output) for case, output in over if output.name not in common]
    if over:
        case, worst = max(over, key=lambda pair: abs(pair[1].level))
        figure = f"{100 * worst.level:+.1f} %; limit {100 * limits.level:g} %; {_counted(over)}"
        origin = f"{worst.name} on {case.record.name}"
        yield RULES.reason("level of an output wrong", "the RMS of an output is wrong", figure, origin)


def _is_common(trend: Trend, limits: Limits) -> bool:
    """Return whether the level of an output is wrong by nearly the same factor on all records, and ranks them right."""
    levels = np.abs(trend.predicted / trend.measured - 1.0)
    return bool(
        len(levels) >= _RANKED
        and limits.level < levels.max() <= _COMMON * limits.level
        and not trend.is_flat
        and not _ranks_wrong(trend, limits)
        and trend.remaining_error <= _ALIKE * abs(trend.bias)
    )


def _common_levels(study: VehicleValidation, limits: Limits) -> Iterator[Reason]:
    """Yield a reason if levels are wrong by a factor that all records share."""
    common = [trend for trend in study.trends if _is_common(trend, limits)]
    if common:
        worst = max(common, key=lambda trend: abs(trend.bias))
        figure = (
            f"{worst.name}: {100 * worst.bias:+.1f} % on {len(worst.measured)} records, "
            f"{100 * worst.remaining_error:.1f} % without the common factor; rank correlation "
            f"{min(trend.rank for trend in common):.2f}; limit {100 * limits.level:g} %"
        )
        statement = "the RMS of an output is wrong by the same factor on all records, which are ranked right"
        yield RULES.reason(
            "level of an output wrong by the same factor on all records",
            statement,
            figure,
            listed(trend.name for trend in common),
        )


def _errors(study: VehicleValidation, limits: Limits) -> Iterator[Reason]:
    over = [(c, o) for c, o in _judged(study) if o.error > limits.error]
    if over:
        case, worst = max(over, key=lambda pair: pair[1].error)
        figure = f"{100 * worst.error:.0f} % of the measured RMS; limit {100 * limits.error:g} %; {_counted(over)}"
        origin = f"{worst.name} on {case.record.name}"
        yield RULES.reason("large error of an output", "the error of an output is too large", figure, origin)


def _doubts(study: VehicleValidation) -> Iterator[Reason]:
    """Yield the reasons that limit the use of the car."""
    cases = study.cases
    own = "the car was fitted to a record, so errors on it do not validate the car"
    beyond = "a record exceeds the amplitudes or frequencies of the fit's tests"
    groups = (
        ("the fit's own records among them", own, [c for c in cases if c.is_fit_record]),
        ("shocks hardly move", "the shocks barely move: friction holds them", [c for c in cases if c.is_gentle]),
        ("tires leave the road", "tires leave the road", [c for c in cases if c.lifted]),
        ("records beyond the fit's tests", beyond, [c for c in cases if c.extrapolations]),
    )
    for rule, statement, found in groups:
        if found:
            figure, origin = f"{len(found)} of {len(cases)} records", listed(case.record.name for case in found)
            yield RULES.reason(rule, statement, figure, origin)
    yield from _linear(study)
    for case in cases:
        for note in case.notes:
            yield RULES.reason("doubt of a record", "a record is doubtful", note.rstrip("."), case.record.name)
    if not study.of_kind("random"):
        figure = f"0 of {len(cases)} records are random"
        yield RULES.reason("levels not validated", "levels of setups were not validated", figure, "the records")


def _linear(study: VehicleValidation) -> Iterator[Reason]:
    """Yield a reason if errors are linear in the prediction, so that a better linear model would avoid them."""
    found: dict[str, float] = {}
    for case, output in _judged(study):
        spectrum = case.spectra.get(output.name)
        if spectrum is not None and spectrum.share > _LINEAR and output.error > _MATTERS:
            found[output.name] = max(found.get(output.name, 0.0), spectrum.share)
    if found:
        figure = f"{100 * max(found.values()):.0f} % of its power; limit {100 * _LINEAR:g} %"
        yield RULES.reason(
            "error linear in the prediction", "an error is linear in the prediction", figure, listed(found)
        )


def _best(study: VehicleValidation) -> str:
    """Return the main figures of a successful validation."""
    random = [o for c, o in _judged(study) if c.record.kind == "random"]
    judged = [o for _, o in _judged(study)]
    parts = [f"RMS within {100 * max(abs(o.level) for o in random):.3g} %"] if random else []
    parts += [f"errors up to {100 * max(o.error for o in judged):.3g} % of the measured RMS"] if judged else []
    ranked = [trend.rank for trend in study.trends if not trend.is_flat]
    if ranked:
        count = len(study.trends[0].measured)
        parts.append(f"rank correlation of setups at least {min(ranked):.2f} over {count} records")
    return f"{len(study.independent)} records that it was not fitted to: {', '.join(parts)}"


def _judged(study: VehicleValidation) -> Iterator[tuple[VehicleCase, Comparison]]:
    for case in study.independent:
        for found in case.judged:
            yield case, found


def _counted(over: list[tuple[VehicleCase, Comparison]]) -> str:
    records = len({id(case) for case, _ in over})
    return f"{len({found.name for _, found in over})} outputs on {records} record{'s' * (records > 1)}"
