"""Verdict on fitted shocks that were compared with records, and notes on the records."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from eightpost.ident.validation.evaluation import RandomValidation
from eightpost.ident.validation.shocks import MOST_BEYOND, ShockCase, ShockValidation
from eightpost.ident.validation.static import SETTLING, StaticValidation
from eightpost.outputs import replacing
from eightpost.shock import write_shock
from eightpost.units import convert
from eightpost.validity import Validity, judged
from eightpost.verdict import Grade, Reason, Rule, Rules, Verdict, listed

ABOUT = "validation of the shock"

#: Limits of the error of a prediction, in percent of the force's standard deviation, if no other limit is given.
GOOD_ERROR, LARGEST_ERROR = 10.0, 30.0

#: Share of the samples outside the fitted velocities from which it is reported.
SOME_BEYOND = 0.01

#: Share of a residual that is coherent with the velocity from which dynamics are reported as missing in the law.
COHERENT = 0.5

#: Share of the mean square error from which it is reported as mostly an offset.
OFFSET = 0.5

RULES = Rules()

LARGE_ERROR = RULES.add("large error of a prediction", ABOUT, Grade.NOT_USABLE,
    condition=f"RMS error on a record above the limit (--limit; {LARGEST_ERROR:g} % of the force's standard deviation)",
    why="as for a fit: a third of the force is not in the model",
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
