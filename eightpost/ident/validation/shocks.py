"""Validation of several shocks on many records (3.4): each shock on each record of the same damper."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from math import isclose
from typing import Any, TypeVar

from eightpost.errors import ParameterError
from eightpost.ident.validation.bump import BumpValidation, validate_bump
from eightpost.ident.validation.dyno_record import DynoRecord
from eightpost.ident.validation.evaluation import RandomValidation, Validation, validate_random
from eightpost.ident.validation.sine import SineValidation, validate_sine
from eightpost.ident.validation.static import StaticValidation, validate_static
from eightpost.shock import Shock, law_title

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
