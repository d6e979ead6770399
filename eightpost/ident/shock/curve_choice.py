"""Choice of the kind of static curve for a law: polynomials, or rising through knots, by cross-validation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from eightpost.ident.shock.cross_validation import CrossValidation, HeldOut
from eightpost.ident.shock.curve import CurveKind
from eightpost.ident.shock.fitted_law import FittedLaw
from eightpost.ident.shock.law_fit import fit_law
from eightpost.ident.shock.options import LAGGED_VELOCITY, Choices
from eightpost.ident.shock.runs import Runs
from eightpost.progress import parts
from eightpost.shock import LAWS, fit_form, law_title

#: Kinds in words.
KINDS: Mapping[CurveKind, str] = {"polynomial": "polynomials", "knots": "through knots"}

#: Forms of laws that are fitted without stepping them: all kinds of curve are compared for each. The curve of the other
#: laws, which take seconds, is that of LPF1, whose fit they start from.
_FAST, _STAND_IN = ("no lag", "lag", "fading lag"), "lpf1"


@dataclass(frozen=True, slots=True)
class CurveComparison:
    """Comparison of the kinds of curve for a law, and the choice.

    Attributes:
        law: Name of the law with which the kinds were compared.
        kind: Chosen kind.
        errors: Errors on left-out parts of each kind that could be fitted; empty if there was nothing to compare.
    """

    law: str
    kind: CurveKind
    errors: Mapping[CurveKind, HeldOut]

    @property
    def reason(self) -> str:
        """Reason for the choice, one sentence; empty if there was nothing to compare."""
        if len(self.errors) < 2:
            return ""
        held = {kind: f"{one.percent:.3g} +- {one.spread:.2g} %" for kind, one in self.errors.items()}
        figures = (
            f"the held-out error of {law_title(self.law)} is {held['knots']} with a curve through knots and "
            f"{held['polynomial']} with polynomials"
        )
        if self.kind == "knots":
            return f"the curve rises through knots instead of following polynomials: {figures}"
        return f"the curve follows polynomials instead of rising through knots: {figures}"


class CurveChooser:
    """Fits laws to runs, each with the kind of curve that suits it.

    Args:
        runs: Prepared runs.
        choices: Options of the fits.
    """

    def __init__(self, runs: Runs, choices: Choices) -> None:
        self._runs, self._choices = runs, choices
        self._found: dict[str, tuple[CrossValidation, CurveComparison]] = {}

    def __call__(self, law: str) -> tuple[CrossValidation, CurveComparison]:
        """Return the fit of a law, ready for cross-validation, and the comparison of its curves.

        Raises:
            ValueError: The law or the fit rejects the data, with every kind of curve.
        """
        if law not in self._found:
            self._found[law] = self._chosen(law)
        return self._found[law]

    def _chosen(self, law: str) -> tuple[CrossValidation, CurveComparison]:
        if fit_form(LAWS[law]) == LAGGED_VELOCITY:
            # The compiler takes a second to load.
            from eightpost.ident.shock.hysteresis_fit import fit_hysteresis  # noqa: PLC0415

            return fit_hysteresis(self._runs, law, self._choices), CurveComparison(law, "knots", {})
        kinds = self._choices.curves
        if len(kinds) == 1:
            return self._fit(law, kinds[0]), CurveComparison(law, kinds[0], {})
        if fit_form(LAWS[law]) not in _FAST:
            _, found = self(_STAND_IN)
            return self._fit(law, found.kind), found
        return self._better(law, kinds)

    def _better(self, law: str, kinds: tuple[CurveKind, ...]) -> tuple[CrossValidation, CurveComparison]:
        found: dict[CurveKind, CrossValidation] = {}
        trouble: ValueError | None = None
        for kind in parts(kinds):
            try:
                found[kind] = self._fit(law, kind)
            except ValueError as error:  # raised by laws and fits that reject the data
                trouble = error
        if trouble is not None and not found:
            raise trouble
        converged = {kind: one for kind, one in found.items() if one.fit.has_converged}
        kind, errors = better_curve(converged or found)
        return found[kind], CurveComparison(law, kind, errors)

    def _fit(self, law: str, kind: CurveKind) -> CrossValidation:
        return CrossValidation(fit_law(self._runs, law, self._choices, kind))


def better_curve(found: Mapping[CurveKind, CrossValidation]) -> tuple[CurveKind, dict[CurveKind, HeldOut]]:
    """Return the kind of curve to take, and the held-out errors of each.

    The kind with fewer parameters is taken if it is within one standard error of the other.
    """
    if len(found) == 1:
        return next(iter(found)), {}
    # A sample that either curve explains is no outlier.
    counted = np.max([one.fit.runs.weights for one in found.values()], axis=0)
    errors = {kind: one.decisive(counted) for kind, one in found.items()}
    simple, other = sorted(found, key=lambda kind: found[kind].fit.parameter_count)
    return (simple if errors[simple].is_as_good_as(errors[other]) else other), errors


def fit_with_best_curve(runs: Runs, law: str, choices: Choices) -> tuple[FittedLaw, CurveComparison]:
    """Return the fit of a law to runs with the curve that suits it, and the comparison of the curves."""
    found, comparison = CurveChooser(runs, choices)(law)
    return found.fit, comparison
