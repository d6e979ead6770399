"""The recipe of the dissertation with raw and with preconditioned responses."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from eightpost.ident.response.frequency_response import Preconditioning
from eightpost.ident.vehicle.recipes.boggs import Boggs, chapter_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eightpost.ident.vehicle.experiment import Experiment
    from eightpost.ident.vehicle.vehicle_fit import VehicleFit
    from eightpost.signals import TimeSeries


@dataclass(frozen=True, slots=True)
class Preconditioned:
    """The recipe of the dissertation with another preconditioning."""

    preconditioning: Preconditioning | None

    def identify(self, tests: Sequence[TimeSeries], experiment: Experiment) -> VehicleFit:
        """Identify a vehicle with the recipe."""
        chapter = replace(chapter_of(experiment), preconditioning=self.preconditioning)
        return Boggs(chapter).identify(tests, experiment)


METHODS = {
    "boggs, raw": Preconditioned(Preconditioning(width=0.0)),
    "boggs, smoothed": Preconditioned(Preconditioning()),
}
