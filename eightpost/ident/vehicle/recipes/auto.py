"""Recipe auto: identifies with common-poles and grey-box, and takes the one that predicts a left-out test better."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from time import process_time

from eightpost.corners import CORNERS
from eightpost.errors import EightpostError
from eightpost.ident.output_error import OutputErrorFit
from eightpost.ident.vehicle.experiment import Experiment
from eightpost.ident.vehicle.held_out import held_out_error
from eightpost.ident.vehicle.recipe_choice import RecipeChoice, RecipeTrial
from eightpost.ident.vehicle.recipes.common_poles import CommonPoles
from eightpost.ident.vehicle.recipes.grey_box import GreyBox
from eightpost.ident.vehicle.vehicle_fit import VehicleFit
from eightpost.signals import TimeSeries
from eightpost.vehicle import IdentifiedVehicle

#: Smallest number of tests of a trial: without the left-out one, every port still needs two shocks.
_FEWEST = 3

#: Band in which the left-out test is judged [Hz].
_JUDGED = (0.3, 20.0)


@dataclass(frozen=True, slots=True)
class Auto:
    """Recipe that chooses between two recipes by a test that it leaves out.

    The left-out test is the baseline, as every other test has the only other shock of a corner. It is simulated from
    rest with its shocks. The recipe with the smaller error identifies the vehicle from all tests.
    """

    common_poles: CommonPoles = field(default_factory=CommonPoles)  #: Recipe common-poles.
    grey_box: GreyBox = field(default_factory=GreyBox)  #: Recipe grey-box.
    seconds: float = 200.0  #: Duration of each test that common-poles uses in the trial [s].
    judged: float = 60.0  #: Duration of the left-out test that is simulated [s].
    #: Error of grey-box over that of common-poles below which grey-box is taken [1]: common-poles states the
    #: uncertainty of every output.
    gain: float = 0.95

    def identify(self, tests: Sequence[TimeSeries], experiment: Experiment) -> VehicleFit:
        """Identify a vehicle; see `VehicleRecipe`.

        Raises:
            InputError: Tests and experiment do not match, or the effects of the inputs cannot be separated.
            TooShortError: The records have too few frequency bins.
        """
        started = process_time()
        impossible = _impossible(tests, experiment)
        if impossible is not None:
            return _chosen(self.common_poles.identify(tests, experiment), RecipeChoice((), impossible), started)
        trials, grey = self._trials(tests, experiment)
        choice = self._choice(trials)
        if choice.recipe == "grey-box" and grey is not None:
            begun = process_time()
            whole = self.grey_box.explain(tests, experiment, start=grey.values)
            fit = self.grey_box.vehicle_fit(whole, tests, experiment, begun, without_first=grey)
        else:
            fit = self.common_poles.identify(tests, experiment)
        return _chosen(fit, choice, started)

    def _trials(
        self, tests: Sequence[TimeSeries], experiment: Experiment
    ) -> tuple[tuple[RecipeTrial, ...], OutputErrorFit | None]:
        """Return the errors of both recipes on the left-out test, and the fit of the grey box if there is one."""
        left, rest = _first(tests[0], self.judged), tests[1:]
        grey: OutputErrorFit | None = None
        quick = replace(self.common_poles, samples=0)
        brief = [_first(test, self.seconds) for test in rest]

        def grey_vehicle() -> IdentifiedVehicle:
            nonlocal grey
            grey = self.grey_box.explain(rest, experiment)
            return self.grey_box.vehicle(grey, experiment)

        made = {"common-poles": lambda: quick.vehicle(brief, experiment), "grey-box": grey_vehicle}
        return tuple(_trial(name, make, left, experiment) for name, make in made.items()), grey

    def _choice(self, trials: tuple[RecipeTrial, ...]) -> RecipeChoice:
        poles, grey = trials
        if grey.error is None:
            return RecipeChoice(trials, f"common-poles was chosen: grey-box failed ({grey.failure})")
        if poles.error is not None and grey.error > self.gain * poles.error:
            return RecipeChoice(trials, "common-poles was chosen: grey-box does not predict the left-out test better")
        return RecipeChoice(trials, "grey-box was chosen: it predicts the left-out test better", "grey-box")


def _impossible(tests: Sequence[TimeSeries], experiment: Experiment) -> str | None:
    """Return why there cannot be a trial, None if there can."""
    if experiment.ports != CORNERS:
        return f"common-poles was chosen: grey-box needs the corners {', '.join(CORNERS)}"
    if len(tests) < _FEWEST:
        return f"common-poles was chosen: {len(tests)} tests are too few to leave one out"
    return None


def _trial(name: str, make: Callable[[], IdentifiedVehicle], left: TimeSeries, experiment: Experiment) -> RecipeTrial:
    try:
        found = held_out_error(make(), [left], experiment, _JUDGED)
    except EightpostError as error:
        return RecipeTrial(name, None, None, str(error))
    return RecipeTrial(name, found.mean_error, found.mean_level)


def _first(series: TimeSeries, seconds: float) -> TimeSeries:
    samples = round(seconds * series.sample_rate)
    return series if len(series) <= samples else series.window(float(series.time[0]), float(series.time[samples - 1]))


def _chosen(fit: VehicleFit, choice: RecipeChoice, started: float) -> VehicleFit:
    return replace(fit, choice=choice, notes=(choice.summary(), *fit.notes), seconds=process_time() - started)


RECIPE = Auto()
