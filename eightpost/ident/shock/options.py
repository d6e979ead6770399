"""Options of a fit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from eightpost.errors import ParameterError
from eightpost.ident.shock.gas import GasTreatment
from eightpost.ident.shock.robust import Robust
from eightpost.shock import LAWS, fit_form

#: A name in `LAWS`.
LawName = str
RecipeName = Literal["joint", "boggs"]

#: The law of a fit if none is named, by recipe.
DEFAULT_LAW = {"joint": "hysteresis", "boggs": "lpnl2"}

#: Form of a law that has a recipe of its own (hysteresis_fit.py).
_LAGGED_VELOCITY = "lagged velocity"

_NO_CHOICE = "the choice among laws, 'auto', was removed: omit the law, and hysteresis is fitted"


@dataclass(frozen=True, slots=True)
class Choices:
    """Options of a fit."""

    #: `joint` (all parameters together, a curve through knots) or `boggs` (one after the other, a curve of polynomials,
    #: as in 3.3).
    recipe: RecipeName = "joint"
    #: Treatment of the gas force F_0 + K (x - x_ref), x_ref the mean displacement: `estimate` fits it and makes it part
    #: of the shock; `included` fits it and leaves it out of the shock, because the car's static load includes it;
    #: `subtracted`: the dynamometer has already subtracted it.
    gas: GasTreatment = "estimate"
    robust: Robust = "auto"  #: Treatment of outliers: `auto`, `none`, `huber`, `tukey` (boggs: always none).

    def law(self, name: str | None) -> str:
        """Return the law to fit, if all options are known.

        Args:
            name: Name of the law; None for the default.

        Raises:
            ParameterError: An option or the law is unknown.
        """
        options = (
            ("recipe", self.recipe, get_args(RecipeName)),
            ("gas treatment", self.gas, get_args(GasTreatment)),
            ("robust", self.robust, get_args(Robust)),
            ("law", DEFAULT_LAW.get(self.recipe) if name is None else name, tuple(LAWS)),
        )
        for what, value, known in options:
            if what == "law" and value == "auto":
                raise ParameterError(_NO_CHOICE)
            if value not in known:
                raise ParameterError(f"unknown {what} {value!r}; it must be one of {', '.join(known)}")
        return str(options[-1][1])

    @property
    def is_screened(self) -> bool:
        """Whether spikes are replaced before the fit."""
        return self.recipe != "boggs" and self.robust != "none"


def has_own_recipe(law: str) -> bool:
    """Return whether a law is fitted by a recipe of its own (hysteresis_fit.py)."""
    return fit_form(LAWS[law]) == _LAGGED_VELOCITY
