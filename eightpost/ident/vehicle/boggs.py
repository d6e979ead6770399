"""Recipe boggs, the method of the dissertation: preconditioned H1 responses and one transfer function per path."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from time import process_time

import numpy as np

from eightpost.array_types import Array
from eightpost.errors import InputError
from eightpost.ident.vehicle.estimators import H1, Recipe, SameDrive, input_noise, input_power
from eightpost.ident.vehicle.experiment import Blocks, Experiment, Records, gather
from eightpost.ident.vehicle.frequency_response import (
    FrequencyResponse,
    Preconditioning,
    contribution_error,
    response_of,
)
from eightpost.ident.vehicle.siso_models import (
    AEROLOADERS,
    QUARTER_CAR,
    SEVEN_DOF,
    WHEELLOADERS,
    BandWeights,
    SisoFits,
    SisoModels,
    balance,
    has_direct_term,
    may_have_direct_term,
)
from eightpost.ident.vehicle.stability import closed_loop_stability
from eightpost.ident.vehicle.trust import NOT_SIMULATED, UNUSABLE, MeasuredLevels, Trust
from eightpost.ident.vehicle.vehicle_fit import VehicleFit
from eightpost.progress import beats, portion
from eightpost.signals import TimeSeries
from eightpost.vehicle import IdentifiedVehicle, StateSpace

#: Blocks of a record are not shorter than this [s] as long as there are `_FEWEST_BLOCKS` of them.
_SHORTEST_BLOCK, _FEWEST_BLOCKS = 10.0, 20
#: Candidate numbers of states of a reduced model.
_STATES = (10, 14, 20, 30, 40, 60, 80, 100, 150, 200, 300)
#: Part of each test that is simulated [s]: models have up to a thousand states, which take long.
_SIMULATED = 30.0
#: Misfit of an output above which its model is reported as doubtful [1].
_DOUBTFUL = 0.1
#: A path is reported if its misfit and its share of the output both exceed these limits [1].
_BAD_PATH, _CARRIES = 0.3, 0.05


@dataclass(frozen=True, slots=True)
class Chapter:
    """Settings of a chapter of the dissertation for its kind of car."""

    blocks: int  #: Number of half-overlapping blocks of a record.
    orders: tuple[int, ...]  #: Denominator degrees to try.
    roads: BandWeights  #: Weights of wheelloaders and shock forces.
    loads: BandWeights  #: Weights of aeroloaders and of forces and moments on the chassis.
    #: Function that returns whether a path (output, input) has a direct term.
    direct: Callable[[str, str], bool] = has_direct_term
    same_drive: bool = False  #: Whether two tests with the same drive use the two-experiment method of Eq 4.24 to 4.26.
    #: Preconditioning of the responses; None skips it.
    preconditioning: Preconditioning | None = field(default_factory=Preconditioning)


#: 4.4.1: the quarter car, with fourth-order fits and without smoothing.
CHAPTER_4 = Chapter(20, (4,), QUARTER_CAR, AEROLOADERS, same_drive=True, preconditioning=Preconditioning(width=0.0))
#: 5.3: the seven-DOF car. Loads have the weights of Eq 6.9, as the rig's loads of Table 6.3 end at 5 Hz.
CHAPTER_5 = Chapter(40, (4, 6, 8), SEVEN_DOF, AEROLOADERS)
#: 6.3: the car on the 8-post rig. Solid axles and damped tires cause more direct terms than Eq 5.20 to 5.23.
CHAPTER_6 = Chapter(50, (4, 6, 8, 10), WHEELLOADERS, AEROLOADERS, direct=may_have_direct_term)


@dataclass(frozen=True, slots=True)
class Boggs:
    """Recipe that combines tests with any shocks (Eq 6.3 to 6.7) and fits one transfer function per path (6.3.3).

    Chapters 5 and 6 use discrete models (Tustin, invfreqz). Here models are continuous, because an FMU may be stepped
    by any length.
    """

    chapter: Chapter | None = None  #: Settings; None uses those for the kind of car.
    #: Accepted error of a path [1]; higher denominator degrees are tried while the error is larger.
    tolerance: float = 0.005
    #: Maximum error of any output by the reduction of the number of states [1]; None keeps the poles of every path.
    reduction: float | None = 0.003

    def identify(self, tests: Sequence[TimeSeries], experiment: Experiment) -> VehicleFit:
        """Identify a vehicle; see `VehicleRecipe`.

        Raises:
            InputError: Tests and experiment do not match, or the effects of the shock forces cannot be separated
                because no test has other shocks.
        """
        started = process_time()
        chapter = self.chapter or chapter_of(experiment)
        records = gather(tests, experiment.inputs, experiment.outputs, experiment.baseline_damping)
        with portion(0.0, 0.2):
            estimate, notes = _estimated(records, experiment, chapter)
            if chapter.preconditioning is not None:
                estimate, more = chapter.preconditioning.apply(estimate)
                notes = (*notes, *more)
                # Of a response that was smoothed over a width, six frequencies per width are enough.
                spacing = float(np.mean(np.diff(estimate.frequency)))
                estimate = estimate.at(slice(None, None, max(1, int(chapter.preconditioning.width / 6.0 / spacing))))
        bands = {name: chapter.loads if name in experiment.loads else chapter.roads for name in experiment.inputs}
        with portion(0.2, 0.6):
            fits = SisoFits(chapter.orders, self.tolerance, weights=bands, direct=chapter.direct).fit(estimate)
        with portion(0.6, 0.7):
            inside = np.stack([bands[name].at(estimate.frequency) > 0.0 for name in estimate.input_names])
            weight = np.asarray(input_power(records, estimate.frequency) * inside)
            model, size = self._model(fits, estimate, weight)
        vehicle = IdentifiedVehicle(
            experiment.name, model, experiment.baseline_damping, experiment.static, experiment.sources
        )
        with portion(0.7, 0.8):
            residual = contribution_error(response_of(model, estimate.frequency), estimate, weight)
        far = [n for n, error in zip(estimate.output_names, residual, strict=True) if error > _DOUBTFUL]
        about = f"the model differs by more than {100.0 * _DOUBTFUL:.0f} % from the estimate at {', '.join(far)}"
        doubtful = (about,) if far else ()
        with portion(0.8, 0.9):
            stability = closed_loop_stability(vehicle)
        with portion(0.9, 1.0):
            measures = MeasuredLevels(_SIMULATED).uncertainty(vehicle, tests, experiment)
        return VehicleFit(
            vehicle,
            "boggs",
            estimate,
            dict(zip(estimate.output_names, residual.tolist(), strict=True)),
            (*notes, *_doubts(fits, estimate, weight), size, *doubtful, stability.summary()),
            process_time() - started,
            stability.stable,
            trust=Trust({}, flags={} if measures else {UNUSABLE: NOT_SIMULATED}, measures=measures),
        )

    def _model(self, fits: SisoModels, estimate: FrequencyResponse, weight: Array) -> tuple[StateSpace, str]:
        """Return the model of all paths, reduced if possible, and a note on its size."""
        whole, size = fits.model, f"{len(fits.paths)} paths with {len(fits.model.A)} states"
        if self.reduction is None:
            return whole, size
        exact = fits.response(estimate.frequency)
        outputs = np.sqrt(np.mean(np.sum(np.abs(estimate.H) ** 2 * weight, axis=1), axis=1))
        ordered = balance(whole, np.sqrt(weight.max(axis=1)), np.where(outputs > 0.0, outputs, 1.0))
        for states in beats(_STATES):
            model = ordered.truncated(states)
            error = float(contribution_error(response_of(model, estimate.frequency), exact, weight).max())
            if error <= self.reduction:
                return model, f"{size}, reduced to {states} with an error of {100.0 * error:.2g} % at the worst output"
        return whole, f"{size}, not reduced: {_STATES[-1]} states have an error above {100.0 * self.reduction:.2g} %"


RECIPE = Boggs()


def chapter_of(experiment: Experiment) -> Chapter:
    """Return the settings for the kind of car of an experiment."""
    if len(experiment.ports) == 1:
        return CHAPTER_4
    return CHAPTER_6 if any(name.endswith(".aero") for name in experiment.rig) else CHAPTER_5


def _estimated(records: Records, experiment: Experiment, chapter: Chapter) -> tuple[FrequencyResponse, tuple[str, ...]]:
    """Return an estimate with notes on its method and on the bias by noise of the inputs."""
    shortest = min(test.u.shape[1] for test in records.tests) / records.rate
    requested, longest = (2.0 * shortest / (count + 1) for count in (chapter.blocks, _FEWEST_BLOCKS))
    blocks = Blocks(float(max(requested, min(_SHORTEST_BLOCK, longest))), "hamming", 0.5)
    method: Recipe = H1(blocks)
    note, found = f"{len(records.tests)} tests together (Eq 6.7)", None
    if chapter.same_drive and len(records.tests) == 2:
        try:
            of_same_drive = SameDrive(H1(blocks), experiment.forces)
            found = of_same_drive.estimate(records)
            method, note = of_same_drive, "two experiments with one drive (Eq 4.24 to 4.26)"
        except InputError:
            pass  # the drives differ or no shock is linear: estimating from all tests together requires neither
    response = found or method.estimate(records)
    noise = input_noise(records, (float(response.frequency[0]), float(response.frequency[-1])))
    return response, (f"{note}, Hamming blocks of {blocks.length:.3g} s", noise.summary(method))


def _doubts(fits: SisoModels, estimate: FrequencyResponse, weight: Array) -> tuple[str, ...]:
    """Return a note on poor fits of paths that contribute to their outputs."""
    shares = np.sum(np.abs(estimate.H) ** 2 * weight, axis=2)
    shares = shares / np.maximum(shares.sum(axis=1, keepdims=True), 1e-300)
    bad = []
    for (output, source), fit in fits.paths.items():
        share = shares[estimate.output_names.index(output), estimate.input_names.index(source)]
        if fit.error > _BAD_PATH and share > _CARRIES**2:
            bad.append(f"{output} / {source} ({100.0 * fit.error:.0f} %)")
    return (f"poor fits of paths that contribute to their outputs: {', '.join(bad)}",) if bad else ()
