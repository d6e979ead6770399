"""Plan of an identification: prepared records, their baseline, the static rating, and the experiment of all of them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from eightpost.ident.preparation import Prepared
from eightpost.ident.vehicle.experiment import Baseline, Experiment, find_baseline
from eightpost.ident.vehicle.fit_validity import with_validity
from eightpost.ident.vehicle.procedure import reasons_of_tests
from eightpost.ident.vehicle.recipes import recipe
from eightpost.ident.vehicle.springs import about_tests
from eightpost.ident.vehicle.static_rating import StaticRating, rate_tests
from eightpost.ident.vehicle.vehicle_fit import VehicleFit
from eightpost.rig.post import RigTest


@dataclass(frozen=True, slots=True, eq=False)
class IdentificationPlan:
    """Everything that a recipe needs to identify a vehicle."""

    prepared: Prepared  #: Prepared records.
    baseline: Baseline  #: Baseline test and order of the others.
    experiment: Experiment  #: Inputs, outputs and baseline damping.
    rating: StaticRating | None = None  #: Static rating; None if there are no static tests.

    def identify(self, name: str) -> VehicleFit:
        """Identify the vehicle with the recipe of this name; the vehicle carries the verdict.

        Raises:
            ParameterError: There is no recipe with this name.
            InputError: The effects of the inputs cannot be separated.
            TooShortError: The records have too few frequency bins.
        """
        records = [self.prepared.records[k] for k in self.baseline.order]
        fit = recipe(name).identify(records, self.experiment)
        loads = {load: self.experiment.means.get(load, 0.0) for load in self.experiment.loads}
        fit = replace(fit, vehicle=about_tests(fit.vehicle, loads))
        reasons = (*self.prepared.reasons, *reasons_of_tests(self.prepared, self.experiment))
        return with_validity(fit, reasons)


def plan_identification(
    prepared: Prepared,
    *,
    name: str = "vehicle",
    baseline: int | None = None,
    damping: float | None = None,
    outputs: Sequence[str] = (),
    static: Iterable[RigTest] = (),
) -> IdentificationPlan:
    """Plan an identification.

    Args:
        prepared: Prepared records of rig tests.
        name: Name of the vehicle.
        baseline: Index of the baseline test; None: found from the damping of the shocks.
        damping: Damping about which the vehicle is identified [N.s/m]; None: the slope of each baseline shock.
        outputs: Outputs of the model; empty: all possible ones.
        static: Tests with held loads.

    Raises:
        InputError: The effects of the shocks cannot be separated.
        ParameterError: The records lack a channel, or there is no such output.
    """
    reference = find_baseline(prepared.records, prepared.corners, test=baseline)
    experiment = reference.experiment(prepared, name=name, damping=damping, outputs=outputs)
    held = list(static)
    if not held:
        return IdentificationPlan(prepared, reference, experiment)
    rating = rate_tests(held, list(experiment.loads))
    known = {n: v for n, v in rating.zero.items() if n in experiment.outputs}
    return IdentificationPlan(prepared, reference, replace(experiment, static=known), rating)
