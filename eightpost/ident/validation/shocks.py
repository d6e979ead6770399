"""Validation of several shocks on many records (3.4): each shock on each record of the same damper; the verdict."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import isclose
from pathlib import Path
from typing import Any, TypeVar

from eightpost.errors import ParameterError
from eightpost.ident.shock.verdict import POOR
from eightpost.ident.validation.records import DynoRecord, RandomValidation, Validation, validate_random
from eightpost.ident.validation.shock_tests import (
    SETTLING,
    BumpValidation,
    SineValidation,
    StaticValidation,
    validate_bump,
    validate_sine,
    validate_static,
)
from eightpost.outputs import replacing
from eightpost.report.tables import ResultTable
from eightpost.shock import Shock, law_title, write_shock
from eightpost.units import convert
from eightpost.validity import Validity, judged
from eightpost.verdict import Grade, Reason, Rule, Rules, Verdict, listed

# ==== Comparison =====================================================================================================

Outcome = RandomValidation | SineValidation | StaticValidation | BumpValidation

_Kind = TypeVar("_Kind", RandomValidation, SineValidation, StaticValidation, BumpValidation)

#: If more than this share of a record is outside the fitted velocities, its error says little about the fit.
MOST_BEYOND = 0.2


@dataclass(frozen=True, slots=True, eq=False)
class ShockCase:
    """The result of a shock on a record."""

    label: str  #: Label of the shock: its name and its law.
    shock: Shock  #: Fitted shock.
    record: DynoRecord  #: Record to predict.
    outcome: Outcome  #: Errors, of the type for the record's kind.
    is_fit_record: bool  #: Whether the shock was fitted to this record, so that it validates nothing.

    @property
    def is_mostly_beyond(self) -> bool:
        """Whether more than a fifth of the record is outside the fitted velocities."""
        return self.outcome.beyond > MOST_BEYOND

    def outcome_as(self, kind: type[_Kind]) -> _Kind:
        """Return the outcome, which must be of the given type."""
        assert isinstance(self.outcome, kind)
        return self.outcome

    @property
    def sine(self) -> SineValidation:
        """The outcome, which must be that of a sine record."""
        return self.outcome_as(SineValidation)

    @property
    def prediction(self) -> Validation | None:
        """The prediction over time; None for a static record."""
        return None if isinstance(self.outcome, StaticValidation) else self.outcome.prediction


@dataclass(frozen=True, slots=True, eq=False)
class ShockValidation:
    """The results of shocks on records."""

    shocks: dict[str, Shock]  #: Shocks by label, in the given order.
    records: tuple[DynoRecord, ...]  #: Records in the given order.
    cases: tuple[ShockCase, ...]  #: All pairs with matching conditions, record by record.
    unpaired: tuple[str, ...]  #: Reasons why other pairs were left out, one sentence each.

    def of_kind(self, kind: str) -> tuple[tuple[DynoRecord, tuple[ShockCase, ...]], ...]:
        """Return the records of a kind that have cases, with these cases."""
        found = [(record, self.of_record(record)) for record in self.records if record.kind == kind]
        return tuple((record, cases) for record, cases in found if cases)

    def of_shock(self, label: str) -> ShockValidation:
        """Return the part of the study that concerns one shock, with the records that it was compared with."""
        cases = tuple(case for case in self.cases if case.label == label)
        return replace(self, shocks={label: self.shocks[label]}, records=tuple(c.record for c in cases), cases=cases)

    def of_record(self, record: DynoRecord) -> tuple[ShockCase, ...]:
        """Return the cases of a record."""
        return tuple(case for case in self.cases if case.record is record)


def validate_shocks(
    shocks: Sequence[Shock],
    records: Sequence[DynoRecord],
    *,
    cutoff: float | None = None,
    segment: tuple[float, float] | None = None,
) -> ShockValidation:
    """Validate shocks on records (3.4).

    A shock is compared with a record unless both state a condition (build, clicks, gas pressure) and the values
    differ.

    Args:
        shocks: Shocks of one damper with several laws, or of several dampers.
        records: Records of any kinds.
        cutoff: Cutoff frequency of the low-pass [Hz]; default 50, for bumps 200, at most 0.4 of the sampling rate.
        segment: Start and end [s] of the part of every record to judge: of a sine its whole periods, of a bump its
            events, of a static record its holds. Default: of random records 1 to 10, of the others all.

    Raises:
        ParameterError: No shock or no record is given, a record does not suit its kind, or the segment is not within a
            record.
        TooShortError: A record has too few samples.
    """
    if not shocks or not records:
        raise ParameterError(f"a validation needs a shock and a record; got {len(shocks)} and {len(records)}")
    if segment is not None:
        for record in records:
            _check_segment(segment, record)
    labelled = _labelled(shocks)
    cases: list[ShockCase] = []
    unpaired: list[str] = []
    for record in records:
        for label, shock in labelled.items():
            if why := _mismatch(shock, record):
                unpaired.append(f"{label} was not compared with {record.name}: {why}")
                continue
            outcome = _outcome(shock, record, cutoff, segment)
            fitted = {entry.get("sha256") for entry in shock.inputs}
            cases.append(ShockCase(label, shock, record, outcome, record.digest in fitted))
    return ShockValidation(labelled, tuple(records), tuple(cases), tuple(unpaired))


def _check_segment(segment: tuple[float, float], record: DynoRecord) -> None:
    start, stop, duration = *segment, record.test.series.duration
    if not 0.0 <= start < stop <= duration * (1.0 + 1e-9):
        raise ParameterError(
            f"{record.name} lasts {duration:.4g} s, and the segment from {start:g} to {stop:g} s is not within it; "
            f"give a start below the stop, both from 0 to {duration:.4g} s"
        )


def _outcome(shock: Shock, record: DynoRecord, cutoff: float | None, segment: tuple[float, float] | None) -> Outcome:
    match record.kind:
        case "random":
            return validate_random(shock, record, segment=segment, cutoff=cutoff)
        case "sine":
            return validate_sine(shock, record, segment=segment, cutoff=cutoff)
        case "bump":
            return validate_bump(shock, record, segment=segment, cutoff=cutoff)
        case "static":  # the holds are averaged, so there is no low-pass
            return validate_static(shock, record, segment=segment)


def _mismatch(shock: Shock, record: DynoRecord) -> str | None:
    """Return the condition that differs between a shock and a record, or None; both must state it to differ."""
    mine, other = shock.conditions, record.conditions
    for name in ("build", "clicks", "gas_pressure [Pa]"):
        if mine.get(name) is not None and other.get(name) is not None and not _alike(mine[name], other[name]):
            return f"{name} {mine[name]!r} is not {other[name]!r}"
    return None


def names_of(cases: Sequence[ShockCase]) -> tuple[str, ...]:
    """Return a name for the shock of each case: its law if the laws differ, else the whole label."""
    laws = tuple(law_title(case.shock.law_name) for case in cases)
    return laws if len(set(laws)) == len(laws) else tuple(case.label for case in cases)


def _alike(first: Any, second: Any) -> bool:
    try:
        return isclose(float(first), float(second), rel_tol=0.01)
    except (TypeError, ValueError):
        return str(first).strip().lower() == str(second).strip().lower()


def _labelled(shocks: Iterable[Shock]) -> dict[str, Shock]:
    """Return shocks by name and law, numbered if these are not unique."""
    found: dict[str, Shock] = {}
    for shock in shocks:
        title = f"{shock.name} {law_title(shock.law_name)}"
        label, k = title, 2
        while label in found:
            label, k = f"{title} ({k})", k + 1
        found[label] = shock
    return found


# ==== Verdict, and notes on the records ==============================================================================

ABOUT = "validation of the shock"

#: Limits of the error of a prediction, in percent of the force's standard deviation, if no other limit is given.
GOOD_ERROR, LARGEST_ERROR = 5.0, POOR

#: Share of the samples outside the fitted velocities from which it is reported.
SOME_BEYOND = 0.01

#: Share of a residual that is coherent with the velocity from which dynamics are reported as missing in the law.
COHERENT = 0.5

#: Share of the mean square error from which it is reported as mostly an offset.
OFFSET = 0.5

RULES = Rules()

LARGE_ERROR = RULES.add("large error of a prediction", ABOUT, Grade.NOT_USABLE,
    condition=f"RMS error on a record above the limit (--limit; {LARGEST_ERROR:g} % of the force's standard deviation)",
    why="as for a fit: shocks would be ranked by chance",
    remedy="check that the record is of this shock and these conditions; fit another law, or a record like this one",
)  # fmt: skip
NOTABLE_ERROR = RULES.add("notable error of a prediction", ABOUT, Grade.LIMITED,
    condition=f"if no limit is given: RMS error on a record above {GOOD_ERROR:g} %",
    why="shocks of one bank differ by some tens of percent; smaller differences cannot be distinguished then",
    remedy="use the law with the smallest error; examine the residual for missing dynamics",
)  # fmt: skip
SMALL_ERROR = RULES.add("small error of all predictions", ABOUT, Grade.USABLE,
    condition="RMS error within the limit on every record that the shock was not fitted to",
    why="the shock predicts records that it was not fitted to",
)  # fmt: skip
MOSTLY_BEYOND = RULES.add("record mostly outside the fitted velocities", ABOUT, Grade.NOT_USABLE,
    condition=f"more than {100 * MOST_BEYOND:g} % of a record's samples outside the fitted velocities",
    why="the error is that of the extrapolation",
    remedy="fit a record that is as fast",
)  # fmt: skip
BEYOND = RULES.add("record outside the fitted velocities", ABOUT, Grade.LIMITED,
    condition=f"more than {100 * SOME_BEYOND:g} % of a record's samples outside the fitted velocities",
    why="peaks depend on the extrapolation",
    remedy="fit a record that is as fast",
)  # fmt: skip
UNPAIRED = RULES.add("record without a shock", ABOUT, Grade.NOT_USABLE,
    condition="no shock was fitted under the conditions of a record",
    why="the record validates nothing",
    remedy="give the shock of this record, or leave out the record",
)  # fmt: skip
NOT_VALIDATED = RULES.add("not validated", ABOUT, Grade.UNKNOWN,
    condition="every record is one that its shock was fitted to",
    why="the error of a fit says nothing about other records",
    remedy="measure another record, and validate on it",
)  # fmt: skip
OWN_RECORD = RULES.add("partly the fit's own records", ABOUT, Grade.LIMITED,
    condition="a record is one that its shock was fitted to",
    why="the error there is that of the fit and validates nothing",
    remedy="leave out this record",
)  # fmt: skip
OFFSET_ERROR = RULES.add("offset of a prediction", ABOUT, Grade.LIMITED,
    condition="more than half of the mean square error is an offset, and the error is above 1 %",
    why="another gas pressure, another zero of the load cell or another position",
    remedy="compare the conditions of both records",
)  # fmt: skip
MISSING_DYNAMICS = RULES.add("dynamics missing in the law", ABOUT, Grade.LIMITED,
    condition=f"more than {100 * COHERENT:g} % of the residual is coherent with the velocity",
    why="a linear filter would predict it: the law misses dynamics, or the slope of its curve is wrong",
    remedy="fit a law with a lag; if it has one, fit it to a record like this one too",
)  # fmt: skip


def shock_verdict(study: ShockValidation, limit: float | None = None) -> Verdict:
    """Return the verdict on a study with a limit [percent of standard deviation]; None: the default limits."""
    edits = [reason for shock in study.shocks.values() if shock.validity for reason in shock.validity.edits]
    return Verdict((*edits, *_errors(study, limit), *_pairing(study), *_beyond(study), *_doubts(study)))


def _errors(study: ShockValidation, limit: float | None) -> Iterator[Reason]:
    largest, good = (LARGEST_ERROR, GOOD_ERROR) if limit is None else (limit, limit)
    judged = [(case.outcome.percent, case) for case in study.cases if case.outcome.percent is not None]
    others = [(error, case) for error, case in judged if not case.is_fit_record]
    limits = f"limit {largest:g} %" if largest == good else f"limits {good:g} and {largest:g} %"
    over = [(error, case) for error, case in judged if error > largest]
    notable = [(error, case) for error, case in judged if good < error <= largest]
    if over:
        yield _worst(LARGE_ERROR, "the shock does not predict a record", over, "error {:.3g} %", limits)
    if notable:
        yield _worst(NOTABLE_ERROR, "the shock does not predict a record well", notable, "error {:.3g} %", limits)
    if others and not over and not notable:
        yield _worst(SMALL_ERROR, "the shock predicts its records", others, "error at most {:.3g} %", limits)


def _pairing(study: ShockValidation) -> Iterator[Reason]:
    if alone := [record.name for record in study.records if not study.of_record(record)]:
        yield UNPAIRED.reason(
            "no shock predicts a record",
            figure=f"{len(alone)} of {len(study.records)} records",
            origin=listed(alone),
        )
    if own := [case for case in study.cases if case.is_fit_record]:
        rule = NOT_VALIDATED if len(own) == len(study.cases) else OWN_RECORD
        yield rule.reason(
            "the shock was fitted to this record: it validates nothing",
            figure=f"{len(own)} of {len(study.cases)} predictions",
            origin=listed(map(_place, own)),
        )


def _beyond(study: ShockValidation) -> Iterator[Reason]:
    limits = f"limits {100 * SOME_BEYOND:g} and {100 * MOST_BEYOND:g} %"
    text = "a record is outside the fitted velocities: its error is that of the extrapolation"
    mostly = [(100.0 * c.outcome.beyond, c) for c in study.cases if c.is_mostly_beyond]
    some = [(100.0 * c.outcome.beyond, c) for c in study.cases if SOME_BEYOND < c.outcome.beyond <= MOST_BEYOND]
    for rule, found in ((MOSTLY_BEYOND, mostly), (BEYOND, some)):
        if found:
            yield _worst(rule, text, found, "{:.2g} % of the samples", limits)


def _doubts(study: ShockValidation) -> Iterator[Reason]:
    offsets: list[tuple[float, ShockCase]] = []
    coherent: list[tuple[float, ShockCase]] = []
    for case in study.cases:
        prediction = case.prediction
        if prediction and prediction.offset**2 > OFFSET * prediction.rms**2 and prediction.percent > 1.0:
            offsets.append((convert(prediction.offset, "N", "lbf"), case))
        if isinstance(case.outcome, RandomValidation) and case.outcome.residual:
            share = case.outcome.residual.share
            coherent += [(100.0 * share, case)] if share > COHERENT else []
    if offsets:
        yield _worst(OFFSET_ERROR, "most of an error is an offset", offsets, "{:.3g} lbf", "measured minus predicted")
    if coherent:
        limits = f"limit {100 * COHERENT:g} %"
        yield _worst(MISSING_DYNAMICS, "a residual is coherent with the velocity", coherent, "{:.0f} % of it", limits)


def _worst(rule: Rule, text: str, found: Sequence[tuple[float, ShockCase]], figure: str, limits: str) -> Reason:
    """Return one reason for all cases of a kind: the figure of the worst, the origins of all, the worst first."""
    ordered = sorted(found, key=lambda pair: -abs(pair[0]))
    places = listed(_place(case) for _, case in ordered)
    return rule.reason(text, figure=f"{figure.format(ordered[0][0])}; {limits}", origin=places)


def _place(case: ShockCase) -> str:
    return f"{case.label} on {case.record.name}"


def keep_verdicts(study: ShockValidation, paths: Sequence[Path], limit: float | None = None) -> Iterator[Path]:
    """Write the verdict into each shock file; a shock that was compared with no record keeps its file.

    Args:
        study: Validation.
        paths: Files of the shocks, in the order of the study.
        limit: Limit of the error [percent of standard deviation].

    Yields:
        Each file that was written.
    """
    for (label, shock), path in zip(study.shocks.items(), paths, strict=True):
        part = study.of_shock(label)
        if part.cases:
            validity = Validity.with_verdict(shock.validity, shock_verdict(part, limit))
            with replacing(path):
                write_shock(judged(shock, validity=validity), path)
            yield path


# ---- Notes on a validation that a reader should know, one sentence each ---------------------------------------------


def notes_on(study: ShockValidation) -> tuple[str, ...]:
    """Return how records were treated and which shocks were compared with no record; the verdict has the rest."""
    treated = dict.fromkeys(note for case in study.cases for note in _changes(case))
    return (*treated, *study.unpaired)


def _changes(case: ShockCase) -> list[str]:
    """Return departures from the dissertation's treatment of a record."""
    outcome = case.outcome
    if isinstance(outcome, StaticValidation):
        if outcome.settling < SETTLING:
            return [
                f"{case.record.name}: its holds are short; they are averaged from {outcome.settling:.2g} s on, not "
                f"from {SETTLING:g} s on"
            ]
        return []
    prediction = case.prediction
    changes = prediction.changes if prediction else ()
    # The segment of a sine or a bump follows from its kind, as does a bump's low-pass.
    by_kind = {"random": (), "sine": ("seconds",), "bump": ("seconds", "cutoff")}[case.record.kind]
    return [
        f"{case.record.name}: {change.replace(' fitted', ' evaluated')}"
        for change in changes
        if not change.startswith(by_kind)
    ]


# ==== Tables for the terminal and the page ===========================================================================

_Outcome = TypeVar("_Outcome", RandomValidation, StaticValidation, BumpValidation)


def random_table(study: ShockValidation) -> ResultTable:
    """Return the errors on the random records (Table 3.5, with percentages as in Table 3.4)."""
    columns = ("record", "shock", "RMS error [N]", "% of std", "% less than static", "offset [N] .2",
               "beyond fit, % .2", "coherent, % .2")  # fmt: skip
    rows = (
        (case.record.name, case.label, found.rms, found.percent, _reduction(case, study.of_record(case.record)),
         found.prediction.offset, 100.0 * found.beyond, 100.0 * found.residual.share if found.residual else None)
        for case, found in _outcomes(study, RandomValidation)
    )  # fmt: skip
    return ResultTable.of("Random records", columns, rows)


def terminal_tables(study: ShockValidation) -> tuple[ResultTable, ...]:
    """Return the tables for a terminal; tables of kinds that have no record are empty."""
    sines = (sine_table(rows) for rows in sine_groups(study))
    return random_table(study), *sines, static_table(study), bump_table(study)


def sine_groups(study: ShockValidation) -> tuple[list[tuple[ShockCase, ...]], ...]:
    """Return the cases of each sine record by its shocks; the largest first, then the slowest."""
    groups: dict[tuple[str, ...], list[tuple[ShockCase, ...]]] = {}
    for _, cases in study.of_kind("sine"):
        groups.setdefault(tuple(case.label for case in cases), []).append(cases)
    for rows in groups.values():
        rows.sort(key=lambda cases: (-round(cases[0].sine.amplitude, 4), cases[0].sine.speed))
    return tuple(groups.values())


def sine_table(rows: list[tuple[ShockCase, ...]]) -> ResultTable:
    """Return the error at each amplitude and velocity (Table 3.3, Fig 3.20), for each shock."""
    columns = ["record", "amplitude [m] .2", "peak speed [m/s]", "frequency, Hz"]
    columns += [head for name in names_of(rows[0]) for head in (f"{name}: RMS [N]", "% of std")]
    body = (
        (cases[0].record.name, first.amplitude, first.speed, first.frequency,
         *(figure for case in cases for figure in (case.outcome.rms, case.outcome.percent)))
        for cases in rows for first in [cases[0].sine]
    )  # fmt: skip
    return ResultTable.of(f"Sines of {_dampers(rows)}: error", columns, body)


def loop_tables(rows: list[tuple[ShockCase, ...]]) -> Iterator[ResultTable]:
    """Yield hysteresis and energy of each loop, and its peak forces, measured and by each shock."""
    hysteresis = {"hysteresis": ("hysteresis", "N"), "energy": ("energy per period", "J")}
    peaks = {"compression_peak": ("peak in compression", "N"), "rebound_peak": ("peak in rebound", "N")}
    for title, figures in (("hysteresis and energy", hysteresis), ("peak forces", peaks)):
        columns = ["record"]
        for name, unit in figures.values():
            columns += [f"{name}: measured [{unit}]", *(f"{law} [{unit}]" for law in names_of(rows[0]))]
        body = []
        for cases in rows:
            loops = [cases[0].sine.measured, *(case.sine.predicted for case in cases)]
            body.append((cases[0].record.name, *(getattr(loop, figure) for figure in figures for loop in loops)))
        yield ResultTable.of(f"Sines of {_dampers(rows)}: {title}", columns, body)


def static_table(study: ShockValidation) -> ResultTable:
    """Return rates and drag of the static records (3.4.3)."""
    columns = ("record", "holds .1", "rate in compression [N/m]", "in rebound [N/m]", "gas rate [N/m]",
               "hysteresis [N]", "seal drag [N]", "shock", "predicted gas rate [N/m]", "RMS error [N]")  # fmt: skip
    rows = (
        (case.record.name, len(found.holds), found.compression_rate, found.rebound_rate, found.gas_rate,
         found.hysteresis, found.seal_drag, case.label, found.predicted_rate, found.rms)
        for case, found in _outcomes(study, StaticValidation)
    )  # fmt: skip
    return ResultTable.of("Static records", columns, rows)


def bump_table(study: ShockValidation) -> ResultTable:
    """Return peak forces and errors of the bumps (3.4.4)."""
    columns = ("record", "at, s", "speed [m/s]", "measured peak [N]", "shock", "predicted peak [N]",
               "peak error, % .2", "RMS error [N]", "all events: % of std")  # fmt: skip
    rows = (
        (case.record.name, event.start, event.speed, event.measured_peak, case.label, event.predicted_peak,
         event.peak_error, event.rms, found.percent)
        for case, found in _outcomes(study, BumpValidation) for event in found.events
    )  # fmt: skip
    return ResultTable.of("Bump records", columns, rows)


def _outcomes(study: ShockValidation, kind: type[_Outcome]) -> Iterator[tuple[ShockCase, _Outcome]]:
    return ((case, case.outcome) for case in study.cases if isinstance(case.outcome, kind))


def _dampers(rows: list[tuple[ShockCase, ...]]) -> str:
    return ", ".join(dict.fromkeys(case.shock.name for case in rows[0]))


def _reduction(case: ShockCase, cases: tuple[ShockCase, ...]) -> float | None:
    """Return the reduction of a case's error from that of the static curve of the same shock [percent]."""
    static = [c for c in cases if c.shock.law_name == "polylinear" and c.shock.name == case.shock.name]
    if not static or case.shock.law_name == "polylinear":
        return None
    return 100.0 * (1.0 - case.outcome.rms / static[0].outcome.rms)
