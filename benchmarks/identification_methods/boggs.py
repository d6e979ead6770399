"""The dissertation's chain: responses as they are estimated, and preconditioned."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from eightpost.ident.response.preconditioning import Preconditioning
from eightpost.ident.vehicle.recipes.boggs import Boggs, chapter_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eightpost.ident.vehicle.experiment import Experiment
    from eightpost.ident.vehicle.vehicle_fit import VehicleFit
    from eightpost.signals import TimeSeries


@dataclass(frozen=True, slots=True)
class Preconditioned:
    """The chain of the car's chapter with another preconditioning."""

    preconditioning: Preconditioning | None

    def identify(self, tests: Sequence[TimeSeries], experiment: Experiment) -> VehicleFit:
        """Identify as the recipe does."""
        chapter = replace(chapter_of(experiment), preconditioning=self.preconditioning)
        return Boggs(chapter).identify(tests, experiment)


METHODS = {
    "boggs, raw": Preconditioned(Preconditioning(width=0.0)),
    "boggs, smoothed": Preconditioned(Preconditioning()),
}
