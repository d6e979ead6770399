"""Choice of the law for a shock: every law is fitted, cross-validated, and compared.

The choice is the simplest law whose held-out error is within one standard error of the best. All runs of a build are
left out once if every run has another one of its speed in another build; else each run if every run has another one of
its speed; else each quarter of the runs.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from threadpoolctl import threadpool_limits

from eightpost.array_types import Array
from eightpost.errors import ParameterError
from eightpost.ident.shock.cross_validation import CrossValidation, HeldOut
from eightpost.ident.shock.curve_choice import CurveChooser, CurveComparison
from eightpost.ident.shock.fitted_law import FittedLaw
from eightpost.ident.shock.options import AUTO, Choices
from eightpost.ident.shock.robust import screened_runs
from eightpost.ident.shock.runs import Runs, prepare_runs
from eightpost.progress import parts, portion
from eightpost.rig.dyno_test import DynoTest
from eightpost.shock import LAWS, law_title, own_parameters, step_cost

#: A law is the same as a simpler one if its residual is at most this share below or above that of the simpler law: its
#: own parameters are without effect then, and it cannot be better on other records.
_SAME_FIT = (3e-3, 2e-2)


#: Parts of the records that are left out.
LeftOutParts = Literal["builds", "runs", "quarters"]

#: A fitted law with the comparison of its curves.
_Fitted = tuple[CrossValidation, CurveComparison]


@dataclass(frozen=True, slots=True)
class LawScore:
    """A law in the comparison.

    Attributes:
        law: Name of the law.
        blocks: Errors on quarters of the records that were left out; None if the law was not cross-validated.
        runs: Errors on whole runs that were left out; None if there is only one run.
        fit_percent: RMS of the residual of the fit to everything, in percent of the force's standard deviation.
        own_parameters: Number of the law's own parameters.
        parameters: Number of all fitted parameters, with curve and gas force.
        step_cost: Cost of a step of the native FMU relative to Polylinear [1], measured once; None if not stated.
        trouble: Cause that excludes the law; empty for a law that can be chosen.
        curve: Comparison of the kinds of static curve for the law; None if the law was not fitted.
        decides: Parts whose errors decide: `builds`, `runs` (quarters if there is only one), or `quarters` if a run has
            a speed that no other has. Leaving that run out would be an extrapolation, which the fit to all runs is not.
        builds: Errors on all runs of a build that were left out; None if there is only one build.
    """

    law: str
    blocks: HeldOut | None
    runs: HeldOut | None
    fit_percent: float
    own_parameters: int
    parameters: int
    step_cost: float | None
    trouble: str = ""
    curve: CurveComparison | None = None
    decides: LeftOutParts = "runs"
    builds: HeldOut | None = None

    @property
    def held_out(self) -> HeldOut:
        """Errors that decide."""
        whole = {"builds": self.builds, "runs": self.runs, "quarters": None}
        found = whole[self.decides] or self.blocks
        assert found is not None, "a law that was not cross-validated has no errors"
        return found


@dataclass(frozen=True, slots=True)
class LawChoice:
    """Comparison of laws, and the choice.

    Attributes:
        scores: All laws, simple ones first.
        law: Name of the chosen law.
        best: Name of the law with the lowest held-out error.
        reason: Reason for the choice, one sentence.
    """

    scores: tuple[LawScore, ...]
    law: str
    best: str
    reason: str

    @property
    def chosen(self) -> LawScore:
        """Score of the chosen law."""
        return self[self.law]

    @property
    def left_out(self) -> LeftOutParts:
        """Parts that were left out for the errors that decide: `builds`, `runs`, or `quarters` of them."""
        return self.chosen.decides if self.chosen.runs is not None else "quarters"

    def __getitem__(self, law: str) -> LawScore:
        return next(score for score in self.scores if score.law == law)

    def regret(self, errors: Mapping[str, float]) -> float:
        """Return the relative excess [1] of the chosen law's error over the lowest, given errors on other records."""
        return errors[self.law] / min(errors.values()) - 1.0

    def to_json(self) -> dict[str, Any]:
        """Return the comparison as JSON values; errors in percent of the force's standard deviation."""
        return {
            "law": self.law,
            "best": self.best,
            "reason": self.reason,
            "left_out": self.left_out,
            "laws": {score.law: _json_of(score) for score in self.scores},
        }


def _json_of(score: LawScore) -> dict[str, Any]:
    if score.blocks is None:
        return {"trouble": score.trouble}
    held = score.held_out
    return {
        **_curve_json(score),
        "held_out_percent": held.percent,
        "standard_error_percent": held.spread,
        "held_out_with_level_percent": held.raw_percent,
        "held_out_quarters_percent": None if score.blocks is None else score.blocks.percent,
        **({} if score.builds is None or score.runs is None else {"held_out_runs_percent": score.runs.percent}),
        "fit_percent": score.fit_percent,
        "parameters": score.parameters,
        "step_cost": score.step_cost,
    }


def _curve_json(score: LawScore) -> dict[str, Any]:
    if score.curve is None:
        return {}
    compared = {kind: held.percent for kind, held in score.curve.errors.items()}
    return {"curve": score.curve.kind} | ({"held_out_by_curve_percent": compared} if compared else {})


def choose_law(
    tests: DynoTest | Sequence[DynoTest],
    laws: Iterable[str] = tuple(LAWS),
    *,
    choices: Choices | None = None,
    segment: tuple[float, float] | None = None,
    cutoff: float | None = None,
    transition_speed: float | None = None,
) -> LawChoice:
    """Compare laws on the records of a shock by cross-validation, and choose one.

    `fit_shock(tests, "auto")` does the same and returns the chosen fit.

    Args:
        tests: Records of one shock.
        laws: Names of the laws to compare.
        choices: Options of the fits.
        segment: Start and end [s] of each record; see `fit_shock`.
        cutoff: Cutoff frequency of the low-pass [Hz]; see `fit_shock`.
        transition_speed: Transition speed of the curve [m/s]; see `fit_shock`.

    Raises:
        ParameterError: A law is unknown, or no law could be fitted.
        TooShortError: A record has too few samples.
    """
    choices = replace(choices or Choices(), has_transition=transition_speed is not None)
    given = [tests] if isinstance(tests, DynoTest) else list(tests)
    laws = _checked(laws, choices)

    def prepared(records: Sequence[DynoTest]) -> Runs:
        return prepare_runs(records, segment=segment, cutoff=cutoff, transition_speed=transition_speed)

    with threadpool_limits(1, "blas"):
        runs = screened_runs(given, prepared)[0] if choices.is_screened else prepared(given)
        return best_law(runs, choices, laws)[0]


def _checked(laws: Iterable[str], choices: Choices) -> tuple[str, ...]:
    """Return the laws to compare, if they and the options are known."""
    compared = tuple(laws)
    choices.check(AUTO)
    if not compared or not set(compared) <= set(LAWS):
        known = ", ".join(LAWS)
        raise ParameterError(f"laws to compare must be among {known}, not {', '.join(compared) or 'none'}")
    return compared


def best_law(
    runs: Runs, choices: Choices, laws: Iterable[str] = tuple(LAWS)
) -> tuple[LawChoice, FittedLaw, CurveComparison]:
    """Return the comparison of laws over prepared runs, the fit of the chosen law, and the comparison of its curves.

    Raises:
        ParameterError: No law could be fitted.
    """
    with portion(0.0, 0.6):
        fits, troubles = _fits(runs, choices, laws)
    if not fits:
        whys = "; ".join(f"{law_title(law)}: {why}" for law, why in troubles.items())
        raise ParameterError(f"no law could be fitted to this record ({whys}); check the record (eightpost inspect)")
    # A sample that any law explains is no outlier; such a sample must not count in favour of the others.
    counted = np.max([found.fit.runs.weights for found, _ in fits.values()], axis=0)
    with portion(0.6, 1.0):
        scores = list(_scores(fits.values(), counted))
    scores += [_excluded(law, why) for law, why in troubles.items()]
    choice = chosen_law(scores)
    found, curve = fits[choice.law]
    return choice, found.fit, curve


def _fits(runs: Runs, choices: Choices, laws: Iterable[str]) -> tuple[dict[str, _Fitted], dict[str, str]]:
    """Return the fits by law, and the cause of trouble of each law that rejects the record."""
    fits: dict[str, _Fitted] = {}
    troubles: dict[str, str] = {}
    fit_with_curve = CurveChooser(runs, choices)
    for law in parts(laws):
        try:
            fits[law] = fit_with_curve(law)
        except ValueError as error:  # raised by laws and fits that reject the data
            troubles[law] = str(error)
    return fits, troubles


def _scores(fits: Iterable[_Fitted], counted: Array) -> Iterator[LawScore]:
    """Yield the score of each law; one with the same fit as a simpler law is not cross-validated."""
    known: list[LawScore] = []
    for found, curve in parts(sorted(fits, key=lambda one: len(own_parameters(LAWS[one[0].fit.law])))):
        plain = replace(_without_errors(found.fit, counted), curve=curve)
        simpler = [one for one in known if one.own_parameters < plain.own_parameters]
        equal = [one for one in simpler if _is_same_fit(plain.fit_percent, one.fit_percent)]
        known.append(plain)
        if equal:
            yield replace(plain, trouble=f"same fit as {law_title(equal[0].law)}: not cross-validated")
        else:
            yield _cross_validated(found, plain, counted)


def _is_same_fit(percent: float, simpler: float) -> bool:
    below, above = _SAME_FIT
    return (1.0 - below) * simpler <= percent <= (1.0 + above) * simpler


def _without_errors(fit: FittedLaw, counted: Array) -> LawScore:
    residual, kind = fit.error, LAWS[fit.law]
    return LawScore(
        law=fit.law,
        blocks=None,
        runs=None,
        fit_percent=100.0 * float(np.sqrt(np.average(residual**2, weights=counted))) / fit.runs.deviation,
        own_parameters=len(own_parameters(kind)),
        parameters=fit.parameter_count,
        step_cost=step_cost(kind),
        trouble="" if fit.has_converged else "the fit did not converge",
    )


def _cross_validated(found: CrossValidation, score: LawScore, counted: Array) -> LawScore:
    try:
        blocks, runs, builds = found.blocks(counted), found.runs(counted), found.builds(counted)
    except ValueError as error:  # raised by laws and fits that reject a part of the data
        return replace(score, trouble=f"a part of the record cannot be fitted: {error}")
    by: LeftOutParts = "runs" if found.fit.runs.has_repeated_speeds else "quarters"
    by = "builds" if found.fit.runs.has_repeated_builds else by
    return replace(score, blocks=blocks, runs=runs, builds=builds, decides=by)


def _excluded(law: str, trouble: str) -> LawScore:
    kind = LAWS[law]
    return LawScore(law, None, None, np.nan, len(own_parameters(kind)), 0, step_cost(kind), trouble)


def chosen_law(scores: Sequence[LawScore]) -> LawChoice:
    """Return the simplest law within one standard error of the best.

    A law is simpler than another if it has fewer parameters of its own; among equally simple laws the one with the
    lower error counts. A law whose fit did not converge is chosen only if there is no other.

    Raises:
        ParameterError: No law has an error.
    """
    scored = [score for score in scores if score.blocks is not None]
    if not scored:
        raise ParameterError("no law could be fitted to parts of this record; fit a law by its name")
    eligible = [score for score in scored if not score.trouble] or scored
    best = min(eligible, key=lambda score: score.held_out.percent)
    equal = [score for score in eligible if score.held_out.is_as_good_as(best.held_out)]
    chosen = min(equal, key=lambda score: (score.own_parameters, score.held_out.percent))
    ordered = sorted(scores, key=lambda score: (score.own_parameters, score.law))
    return LawChoice(tuple(ordered), chosen.law, best.law, _reason(chosen, best))


def _reason(chosen: LawScore, best: LawScore) -> str:
    title, figure = law_title(chosen.law), _figure(chosen.held_out)
    if chosen is best:
        return f"{title} has the lowest held-out error, {figure}, and no simpler law is within one standard error of it"
    return (
        f"{title} is the simplest law within one standard error of the best: its held-out error is {figure}, that of "
        f"{law_title(best.law)} {_figure(best.held_out)}"
    )


def _figure(held: HeldOut) -> str:
    return f"{held.percent:.3g} +- {held.spread:.2g} %"
