"""Options of a fit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from eightpost.errors import ParameterError
from eightpost.ident.shock.boggs import Boggs
from eightpost.ident.shock.curve import CurveKind, Shape
from eightpost.ident.shock.joint import Joint
from eightpost.ident.shock.robust import Robust
from eightpost.shock import LAWS, fit_form
from eightpost.shock.curve import INNER_ORDER

#: A name in `LAWS`; `AUTO` in its place chooses one by cross-validation.
LawName = str
AUTO = "auto"
RecipeName = Literal["joint", "boggs"]
GasTreatment = Literal["estimate", "included", "subtracted"]

#: Form of a law that has a recipe of its own (hysteresis_fit.py).
LAGGED_VELOCITY = "lagged velocity"

CurveChoice = Literal["auto", "polynomial", "knots"]


@dataclass(frozen=True, slots=True)
class Choices:
    """Options of a fit.

    Attributes:
        recipe: `joint` (all parameters together) or `boggs` (one after the other, as in 3.3).
        gas: Treatment of the gas force F_0 + K (x - x_ref), x_ref the mean displacement: `estimate` fits it and
            makes it part of the shock; `included` fits it and leaves it out of the shock, because the car's static load
            includes it; `subtracted`: the dynamometer has already subtracted it.
        shape: Constraint on the curve: `auto`, `free`, `monotone`, `passive`.
        order: Order of the inner polynomial, 1 to 15; None: by cross-validation (boggs: always 15).
        robust: Treatment of outliers: `auto`, `none`, `huber`, `tukey` (boggs: always none).
        curve: Kind of the static curve: `polynomial` (the dissertation's), `knots` (rising, through knots), or `auto`
            for a choice by cross-validation. With `boggs`, or an option that only polynomials have (a `shape` of `free`
            or `passive`, an `order`, a transition speed), `auto` is `polynomial`.
        has_transition: Whether a transition speed of the polynomials is requested.
    """

    recipe: RecipeName = "joint"
    gas: GasTreatment = "estimate"
    shape: Shape = "auto"
    order: int | None = None
    robust: Robust = "auto"
    curve: CurveChoice = "auto"
    has_transition: bool = False

    def check(self, law: str) -> None:
        """Check that all options are known.

        Raises:
            ParameterError: An option or the law is unknown, or an option does not suit the law.
        """
        options = (
            ("law", law, (*LAWS, AUTO)),
            ("recipe", self.recipe, get_args(RecipeName)),
            ("gas treatment", self.gas, get_args(GasTreatment)),
            ("shape", self.shape, get_args(Shape)),
            ("robust", self.robust, get_args(Robust)),
            ("curve", self.curve, get_args(CurveChoice)),
        )
        for what, value, choices in options:
            if value not in choices:
                raise ParameterError(f"unknown {what} {value!r}; it must be one of {', '.join(choices)}")
        if law == AUTO and self.recipe == "boggs":
            raise ParameterError("recipe 'boggs' fits one law, not 'auto': name a law, or use the recipe 'joint'")
        if self.order is not None and not 1 <= self.order <= INNER_ORDER:
            raise ParameterError(f"the order of the inner polynomial must be 1 to {INNER_ORDER}, not {self.order!r}")
        if law in LAWS and fit_form(LAWS[law]) == LAGGED_VELOCITY and "knots" not in self.curves:
            why = self._needs_polynomials or "a curve of polynomials"
            raise ParameterError(
                f"the law {law!r} needs a curve that rises through knots and cannot be fitted with {why}; omit that, "
                "or fit another law"
            )
        if self.curve == "knots" and (why := self._needs_polynomials):
            raise ParameterError(f"a curve through knots cannot be fitted with {why}; omit that, or use 'polynomial'")

    @property
    def curves(self) -> tuple[CurveKind, ...]:
        """Kinds of curve to compare, or the only one."""
        if self.curve != "auto":
            return (self.curve,)
        return ("polynomial",) if self._needs_polynomials else ("polynomial", "knots")

    @property
    def _needs_polynomials(self) -> str:
        """Name and value of a given option that only polynomials have; empty without one."""
        if self.recipe == "boggs":
            return "the recipe 'boggs'"
        if self.shape in ("free", "passive"):
            return f"the shape {self.shape!r}: it always rises"
        if self.order is not None:
            return f"an order of the inner polynomial ({self.order})"
        return "a transition speed" if self.has_transition else ""

    @property
    def ceiling(self) -> float:
        """The upper bound of the transition forces for any record [N]."""
        return Boggs.ceiling if self.recipe == "boggs" else Joint.ceiling

    @property
    def is_screened(self) -> bool:
        """Whether spikes are replaced before the fit."""
        return self.recipe != "boggs" and self.robust != "none"
