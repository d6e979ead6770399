"""Whether a vehicle can be trusted: limits, what is over them, what is doubtful, and the sentence that comes first."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from eightpost.errors import ParameterError

if TYPE_CHECKING:
    from eightpost.ident.vehicle_validation.comparison import Comparison
    from eightpost.ident.vehicle_validation.study import Case, VehicleValidation

#: Share of an error's power that is linear in the prediction from which the model lacks a linear part, and the error
#: [1] from which that matters.
_LINEAR, _MATTERS = 0.5, 0.1

#: Records of trends from which a wrong order is more than one swap.
_RANKED = 4

#: What a fit may flag and its model has not, in words.
_FLAGS = {
    "springs": "springs that are not straight",
    "lift-off": "tires that leave the ground",
    "misfit": "a misfit beyond noise",
}

#: Records that a sentence names.
_LISTED = 4


@dataclass(frozen=True, slots=True)
class Limits:
    """From where on a vehicle is not acceptable.

    Attributes:
        level: Error of the RMS of an output that setups are judged by, on random records [1].
        error: RMS of the difference over that of the measured output, on random, sine and bump records [1].
        rank: Lowest rank correlation of RMS over four random records or more [1].
    """

    level: float = 0.05
    error: float = 0.25
    rank: float = 0.9

    def __post_init__(self) -> None:
        """Check the ranges."""
        if not (self.level > 0.0 and self.error > 0.0 and -1.0 <= self.rank <= 1.0):
            raise ParameterError(f"{self}: level and error must be above 0, rank between -1 and 1")

    def said(self) -> str:
        """Return the limits as a sentence."""
        return (
            f"Acceptable: RMS within {100 * self.level:g} % on random records, errors within {100 * self.error:g} % of "
            f"the measured RMS, rank correlation over {_RANKED} records or more at least {self.rank:g}."
        )


@dataclass(frozen=True, slots=True)
class Verdict:
    """What comes first.

    Attributes:
        kind: `good`, `open` or `bad`.
        answer: In a few words.
        reasons: A sentence each, the gravest first.
    """

    kind: Literal["good", "open", "bad"]
    answer: str
    reasons: tuple[str, ...]

    @property
    def is_acceptable(self) -> bool:
        """Whether nothing is over a limit."""
        return self.kind != "bad"


def verdict(study: VehicleValidation, limits: Limits | None = None) -> Verdict:
    """Return whether a vehicle can be trusted.

    `bad`: something is over a limit, or nothing was validated. `open`: nothing is, but a reason to doubt is there.
    """
    limits = limits or Limits()
    found, doubtful = faults(study, limits), doubts(study)
    best = _best(study)
    if found:
        return Verdict("bad", "Do not trust this car.", (*found, *best))
    if doubtful:
        return Verdict("open", "Trust this car within what is said here.", (*best, *doubtful))
    return Verdict("good", "This car can be trusted.", best)


def faults(study: VehicleValidation, limits: Limits) -> tuple[str, ...]:
    """Return what makes a vehicle not acceptable, a sentence each."""
    if not study.independent:
        return ("No record validates it: all are the fit's own, static or too gentle.", *_unstable(study))
    return (*_unstable(study), *_levels(study, limits), *_errors(study, limits), *_ranks(study, limits))


def doubts(study: VehicleValidation) -> tuple[str, ...]:
    """Return what else a person must know, a sentence each."""
    cases = study.cases
    own = [case.record.name for case in cases if case.is_fit_record]
    said = [f"The vehicle was fitted to {', '.join(own)}: errors there validate nothing."] if own else []
    said += [*_gentle(study), *_lifted(study), *_linear(study)]
    said += _beyond(study)
    said += [note for case in cases for note in case.notes]
    said += _flagged(study)
    if not study.of_kind("random"):
        said.append("No random or track record: levels of setups were not validated.")
    return tuple(dict.fromkeys(said))


def _unstable(study: VehicleValidation) -> tuple[str, ...]:
    return () if study.fit.stable else ("The fit says that it does not settle with every damper that was tried.",)


def _levels(study: VehicleValidation, limits: Limits) -> tuple[str, ...]:
    over = [(c, o) for c, o in _judged(study) if c.record.kind == "random" and abs(o.level) > limits.level]
    if not over:
        return ()
    case, worst = max(over, key=lambda pair: abs(pair[1].level))
    return (
        f"RMS is wrong by more than {100 * limits.level:g} % for {_counted(over)}; worst {worst.name} on "
        f"{case.record.name}, {100 * worst.level:+.1f} %.",
    )


def _errors(study: VehicleValidation, limits: Limits) -> tuple[str, ...]:
    over = [(c, o) for c, o in _judged(study) if o.error > limits.error]
    if not over:
        return ()
    case, worst = max(over, key=lambda pair: pair[1].error)
    return (
        f"The error is over {100 * limits.error:g} % of the measured RMS for {_counted(over)}; worst {worst.name} on "
        f"{case.record.name}, {100 * worst.error:.0f} %.",
    )


def _ranks(study: VehicleValidation, limits: Limits) -> tuple[str, ...]:
    wrong = [t for t in study.trends if len(t.measured) >= _RANKED and not t.is_flat and t.rank < limits.rank]
    listed = ", ".join(f"{trend.name} {trend.rank:.2f}" for trend in wrong)
    said = f"It ranks setups otherwise than the rig (rank correlation below {limits.rank:g}): {listed}."
    return (said,) if wrong else ()


def _gentle(study: VehicleValidation) -> list[str]:
    names = [case.record.name for case in study.cases if case.is_gentle]
    return [f"The shocks hardly move on {', '.join(names)}: friction holds them; shown, not judged."] if names else []


def _lifted(study: VehicleValidation) -> list[str]:
    names = [f"{case.record.name} ({', '.join(case.lifted)})" for case in study.cases if case.lifted]
    return [f"Tires leave the road on {'; '.join(names)}: no linear car does."] if names else []


def _beyond(study: VehicleValidation) -> list[str]:
    """Return one sentence on all records that leave what the fit's tests covered; the notes name the channels."""
    names = [case.record.name for case in study.cases if case.beyond]
    if not names:
        return []
    listed = ", ".join(names[:_LISTED]) + (f" and {len(names) - _LISTED} more" if len(names) > _LISTED else "")
    return [f"Amplitudes or frequencies on {listed} are beyond what it was fitted to; the notes say which."]


def _flagged(study: VehicleValidation) -> list[str]:
    """Return one sentence on what the fit found in the car and its model has not."""
    flags = {} if study.fit.trust is None else study.fit.trust.flags
    found = [_FLAGS[name] for name in flags if name in _FLAGS]
    return [f"The fit itself flags {', '.join(found)}; see what it says of itself."] if found else []


def _linear(study: VehicleValidation) -> list[str]:
    """Say where the errors are of a kind that a linear model could have had right."""
    found: dict[str, float] = {}
    for case in study.independent:
        for output in case.judged:
            spectrum = case.spectra.get(output.name)
            if spectrum is not None and spectrum.linear > _LINEAR and output.error > _MATTERS:
                found[output.name] = max(found.get(output.name, 0.0), spectrum.linear)
    if not found:
        return []
    listed = ", ".join(f"{name} {100 * share:.0f} %" for name, share in found.items())
    return [
        f"Much of the error is linear in the prediction ({listed} of its power): gain or phase of the model is off."
    ]


def _best(study: VehicleValidation) -> tuple[str, ...]:
    """Return the figures that sum the validation up, as a sentence."""
    random = [o for c, o in _judged(study) if c.record.kind == "random"]
    judged = [o for _, o in _judged(study)]
    if not judged:
        return ()
    said = [f"errors up to {100 * max(o.error for o in judged):.3g} % of the measured RMS"]
    if random:
        said.insert(0, f"RMS within {100 * max(abs(o.level) for o in random):.3g} %")
    ranked = [trend.rank for trend in study.trends if not trend.is_flat]
    if ranked:
        count = len(study.trends[0].measured)
        said.append(f"rank correlation of setups at least {min(ranked):.2f} over {count} records")
    return (f"On {len(study.independent)} records that it was not fitted to: {', '.join(said)}.",)


def _judged(study: VehicleValidation) -> Iterator[tuple[Case, Comparison]]:
    for case in study.independent:
        for found in case.judged:
            yield case, found


def _counted(over: list[tuple[Case, Comparison]]) -> str:
    records = len({id(case) for case, _ in over})
    return f"{len({found.name for _, found in over})} outputs on {records} record{'s' * (records > 1)}"
