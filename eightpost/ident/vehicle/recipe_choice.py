"""Choice between recipes by a test that was left out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pydantic import TypeAdapter


@dataclass(frozen=True, slots=True)
class RecipeTrial:
    """Trial of a recipe on a test that it was not identified from."""

    recipe: str  #: Name of the recipe.
    #: RMS error of the simulated outputs over that of the measured ones, root mean square over the outputs [1]; None if
    #: the recipe failed.
    error: float | None
    level: float | None  #: Error of the outputs' RMS, root mean square over the outputs [1]; None if the recipe failed.
    failure: str = ""  #: Message of the failure; empty without one.

    @property
    def text(self) -> str:
        """The result as text."""
        if self.error is None or self.level is None:
            return f"{self.recipe} failed: {self.failure}"
        return f"{self.recipe} {100.0 * self.error:.2g} % (RMS {100.0 * self.level:.2g} %)"


@dataclass(frozen=True, slots=True)
class RecipeChoice:
    """Choice of a recipe, and its reason."""

    trials: tuple[RecipeTrial, ...]  #: Trials of the recipes; empty if only one was possible.
    reason: str  #: Reason for the choice.
    recipe: str = "common-poles"  #: Name of the chosen recipe.

    @property
    def figures(self) -> str:
        """The errors of all trials as text."""
        return ", ".join(trial.text for trial in self.trials) or "no trial"

    def summary(self) -> str:
        """Return the choice and the errors as a sentence."""
        if not self.trials:
            return f"{self.reason}."
        return f"{self.reason}; error of its free-running simulation: {self.figures}."

    def as_json(self) -> Any:
        """Return the content as JSON values."""
        return _ADAPTER.dump_python(self, mode="json")

    @classmethod
    def of_json(cls, content: Any) -> RecipeChoice:
        """Return the object from JSON values that `as_json` returned.

        Raises:
            ValueError: The JSON values have another form.
        """
        return _ADAPTER.validate_python(content)


_ADAPTER: TypeAdapter[RecipeChoice] = TypeAdapter(RecipeChoice)
