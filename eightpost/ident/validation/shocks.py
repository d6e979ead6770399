"""Validation of several shocks on many records (3.4): each shock on each record of the same damper; the verdict."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import isclose
from pathlib import Path
from typing import Any, TypeVar

from eightpost.errors import ParameterError
from eightpost.ident.shock.verdict import POOR
from eightpost.ident.validation.records import DynoRecord
from eightpost.ident.validation.shock_tests import (
    SETTLING,
    BumpValidation,
    Outcome,
    RandomValidation,
    SineValidation,
    StaticValidation,
    validate_bump,
    validate_random,
    validate_sine,
    validate_static,
)
from eightpost.outputs import replacing
from eightpost.report.tables import ResultTable
from eightpost.shock import Shock, law_title, write_shock
from eightpost.units import convert, shown
from eightpost.validity import Validity, judged
from eightpost.verdict import Reason, Rules, Verdict, listed

# ==== Comparison =====================================================================================================

_Kind = TypeVar("_Kind")

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


@dataclass(frozen=True, slots=True, eq=False)
class ShockValidation:
    """The results of shocks on records."""

    shocks: dict[str, Shock]  #: Shocks by label, in the given order.
    records: tuple[DynoRecord, ...]  #: Records in the given order.
    cases: tuple[ShockCase, ...]  #: All pairs with matching conditions, record by record.
    unpaired: tuple[str, ...]  #: Reasons why other pairs were left out, one sentence each.

    def of_kind(self, kind: str) -> tuple[tuple[DynoRecord, tuple[ShockCase, ...]], ...]:
        """Return the records of a kind that have cases, with these cases."""
        of_kind = (record for record in self.records if record.kind == kind)
        return tuple((record, cases) for record in of_kind if (cases := self.of_record(record)))

    def of_shock(self, label: str) -> ShockValidation:
        """Return the part of the study that concerns one shock, with the records that it was compared with."""
        cases = tuple(case for case in self.cases if case.label == label)
        return replace(self, shocks={label: self.shocks[label]}, records=tuple(c.record for c in cases), cases=cases)

    def of_record(self, record: DynoRecord) -> tuple[ShockCase, ...]:
        """Return the cases of a record."""
        return tuple(case for case in self.cases if case.record is record)

    def outcomes(self, kind: type[_Kind]) -> Iterator[tuple[ShockCase, _Kind]]:
        """Return the cases whose outcome is of a type, with these outcomes."""
        return ((case, case.outcome) for case in self.cases if isinstance(case.outcome, kind))


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


_DYNAMIC: dict[str, Callable[..., Outcome]] = {"random": validate_random, "sine": validate_sine, "bump": validate_bump}


def _outcome(shock: Shock, record: DynoRecord, cutoff: float | None, segment: tuple[float, float] | None) -> Outcome:
    if record.kind == "static":  # the holds are averaged, so there is no low-pass
        return validate_static(shock, record, segment=segment)
    return _DYNAMIC[record.kind](shock, record, segment=segment, cutoff=cutoff)


def _mismatch(shock: Shock, record: DynoRecord) -> str | None:
    """Return the condition that differs between a shock and a record, or None; both must state it to differ."""
    mine, other = shock.conditions, record.conditions
    for name in ("build", "clicks", "gas_pressure [Pa]"):
        if mine.get(name) is not None and other.get(name) is not None and not _alike(mine[name], other[name]):
            what, unit = (name.removesuffix(" [Pa]").replace("_", " "), "Pa" if name.endswith("[Pa]") else "")
            first, second = (_stated(condition[name], unit) for condition in (mine, other))
            return f"the {what} of the fit is {first}, that of the record {second}"
    return None


def names_of(cases: Sequence[ShockCase]) -> tuple[str, ...]:
    """Return a name for the shock of each case: its law if the laws differ, else the whole label."""
    laws = tuple(law_title(case.shock.law_name) for case in cases)
    return laws if len(set(laws)) == len(laws) else tuple(case.label for case in cases)


def _stated(value: Any, unit: str) -> str:
    """Return a condition as text, a pressure in the unit that is shown."""
    return "{:.4g} {}".format(*shown(float(value), unit)) if unit else repr(value)


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

#: Limits of the error of a prediction, in percent of the force's standard deviation, if no other limit is given.
GOOD_ERROR, LARGEST_ERROR = 5.0, POOR

#: Share of the samples outside the fitted velocities from which it is reported.
SOME_BEYOND = 0.01

#: Share of a residual that is coherent with the velocity from which dynamics are reported as missing in the law.
COHERENT = 0.5

#: Share of the mean square error from which it is reported as mostly an offset.
OFFSET = 0.5

RULES = Rules.read(
    Path(__file__).with_name("shock_rules.txt"),
    "validation of the shock",
    good=GOOD_ERROR,
    largest=LARGEST_ERROR,
    mostly_beyond=100.0 * MOST_BEYOND,
    some_beyond=100.0 * SOME_BEYOND,
    coherent=100.0 * COHERENT,
)


def shock_verdict(study: ShockValidation, limit: float | None = None) -> Verdict:
    """Return the verdict on a study with a limit [percent of standard deviation]; None: the default limits."""
    edits = [reason for shock in study.shocks.values() if shock.validity for reason in shock.validity.edits]
    return Verdict((*edits, *_errors(study, limit), *_pairing(study), *_doubts(study)))


def _worst(
    rule: str, text: str, found: Sequence[tuple[float, ShockCase]], figure: str, limits: str
) -> Iterator[Reason]:
    """Yield one reason for all cases of a kind, if any: the figure of the worst, the origins of all, worst first."""
    if ordered := sorted(found, key=lambda pair: -abs(pair[0])):
        places = listed(_place(case) for _, case in ordered)
        yield RULES.reason(rule, text, f"{figure.format(ordered[0][0])}; {limits}", places)


def _errors(study: ShockValidation, limit: float | None) -> Iterator[Reason]:
    largest, good = (LARGEST_ERROR, GOOD_ERROR) if limit is None else (limit, limit)
    errors = [(case.outcome.percent, case) for case in study.cases if case.outcome.percent is not None]
    limits = f"limit {largest:g} %" if largest == good else f"limits {good:g} and {largest:g} %"
    over = [pair for pair in errors if pair[0] > largest]
    notable = [pair for pair in errors if good < pair[0] <= largest]
    text = "the shock does not predict a record"
    yield from _worst("large error of a prediction", text, over, "error {:.3g} %", limits)
    yield from _worst("notable error of a prediction", f"{text} well", notable, "error {:.3g} %", limits)
    if not over and not notable:
        others = [pair for pair in errors if not pair[1].is_fit_record]
        text = "the shock predicts its records"
        yield from _worst("small error of all predictions", text, others, "error at most {:.3g} %", limits)


def _pairing(study: ShockValidation) -> Iterator[Reason]:
    if alone := [record.name for record in study.records if not study.of_record(record)]:
        figure = f"{len(alone)} of {len(study.records)} records"
        text = "no shock was fitted under the conditions of a record"
        why = next(entry for entry in study.unpaired if f" with {alone[0]}: " in entry)
        yield RULES.reason("record without a shock", text, f"{figure}; {why}", listed(alone))
    if own := [case for case in study.cases if case.is_fit_record]:
        rule = "not validated" if len(own) == len(study.cases) else "partly the fit's own records"
        figure = f"{len(own)} of {len(study.cases)} predictions"
        text = "the shock was fitted to this record: it validates nothing"
        yield RULES.reason(rule, text, figure, listed(map(_place, own)))


def _doubts(study: ShockValidation) -> Iterator[Reason]:
    limits = f"limits {100 * SOME_BEYOND:g} and {100 * MOST_BEYOND:g} %"
    text = "a record is outside the fitted velocities: its error is that of the extrapolation"
    beyond = [(100.0 * case.outcome.beyond, case) for case in study.cases if case.outcome.beyond > SOME_BEYOND]
    mostly, some = ([pair for pair in beyond if pair[1].is_mostly_beyond is is_most] for is_most in (True, False))
    yield from _worst("record mostly outside the fitted velocities", text, mostly, "{:.2g} % of the samples", limits)
    yield from _worst("record outside the fitted velocities", text, some, "{:.2g} % of the samples", limits)
    offsets = [
        (convert(found.offset, "N", "lbf"), case)
        for case in study.cases
        if (found := case.outcome.prediction) and found.offset**2 > OFFSET * found.rms**2 and found.percent > 1.0
    ]
    text = "most of an error is an offset"
    yield from _worst("offset of a prediction", text, offsets, "{:.3g} lbf", "measured minus predicted")
    coherent = [
        (100.0 * found.residual.share, case)
        for case, found in study.outcomes(RandomValidation)
        if found.residual and found.residual.share > COHERENT
    ]
    text, limits = "a residual is coherent with the velocity", f"limit {100 * COHERENT:g} %"
    yield from _worst("dynamics missing in the law", text, coherent, "{:.0f} % of it", limits)


def _place(case: ShockCase) -> str:
    return f"{case.label} on {case.record.name}"


def keep_verdicts(study: ShockValidation, paths: Sequence[Path], limit: float | None = None) -> Iterator[Path]:
    """Write the verdict into each shock file; a shock that was compared with no record keeps its file.

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
    name, outcome = case.record.name, case.outcome
    if isinstance(outcome, StaticValidation):
        text = f"they are averaged from {outcome.settling:.2g} s on, not from {SETTLING:g} s on"
        return [f"{name}: its holds are short; {text}"] if outcome.settling < SETTLING else []
    changes = outcome.prediction.changes if outcome.prediction else ()
    # The segment of a sine or a bump follows from its kind, as does a bump's low-pass.
    by_kind = {"random": (), "sine": ("seconds",), "bump": ("seconds", "cutoff")}[case.record.kind]
    usual = [change.replace(" fitted", " evaluated") for change in changes if not change.startswith(by_kind)]
    return [f"{name}: {change}" for change in usual]


# ==== Tables for the terminal and the page ===========================================================================


def random_table(study: ShockValidation) -> ResultTable:
    """Return the errors on the random records (Table 3.5, with percentages as in Table 3.4)."""
    columns = ("record", "shock", "RMS error [N]", "% of std", "% less than static", "offset [N] .2",
               "beyond fit, % .2", "coherent, % .2")  # fmt: skip
    rows = (
        (case.record.name, case.label, found.rms, found.percent, _reduction(case, study.of_record(case.record)),
         found.prediction.offset, 100.0 * found.beyond, 100.0 * found.residual.share if found.residual else None)
        for case, found in study.outcomes(RandomValidation)
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
        for case, found in study.outcomes(StaticValidation)
    )  # fmt: skip
    return ResultTable.of("Static records", columns, rows)


def bump_table(study: ShockValidation) -> ResultTable:
    """Return peak forces and errors of the bumps (3.4.4)."""
    columns = ("record", "at, s", "speed [m/s]", "measured peak [N]", "shock", "predicted peak [N]",
               "peak error, % .2", "RMS error [N]", "all events: % of std")  # fmt: skip
    rows = (
        (case.record.name, event.start, event.speed, event.measured_peak, case.label, event.predicted_peak,
         event.peak_error, event.rms, found.percent)
        for case, found in study.outcomes(BumpValidation) for event in found.events
    )  # fmt: skip
    return ResultTable.of("Bump records", columns, rows)


def _dampers(rows: list[tuple[ShockCase, ...]]) -> str:
    return ", ".join(dict.fromkeys(case.shock.name for case in rows[0]))


def _reduction(case: ShockCase, cases: tuple[ShockCase, ...]) -> float | None:
    """Return the reduction of a case's error from that of the static curve of the same shock [percent]."""
    static = [c for c in cases if c.shock.law_name == "polylinear" and c.shock.name == case.shock.name]
    if not static or case.shock.law_name == "polylinear":
        return None
    return 100.0 * (1.0 - case.outcome.rms / static[0].outcome.rms)
