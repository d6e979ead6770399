"""A choice that stands up: the leading setups of a study, run again with drawn parameters."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cosim.study.choice.robust_draws import Uncertain, drawn_studies
from cosim.study.result import StudyResult
from cosim.study.running.requested import Requested
from cosim.study.running.trace import coupling_of
from cosim.study.running.workers import Workers

Integers = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Draws:
    """What is drawn, and how often.

    Attributes:
        parts: Parameters that are known with a covariance.
        count: Of the draws.
        seed: Of the random numbers.
        vehicles: FMUs that are as good as the study's own vehicle.
    """

    parts: tuple[Uncertain, ...]
    count: int = 32
    seed: int = 0
    vehicles: tuple[Path, ...] = ()

    @property
    def any(self) -> bool:
        """Whether anything is uncertain."""
        return bool(self.parts or self.vehicles)


def leading(result: StudyResult, count: int, measure: str | None = None) -> Integers:
    """Return the numbers of the best setups, by the objective or a measure, and the baseline's; in order of number."""
    rows = result.ranking(measure)[:count]
    baseline = result.baseline_row
    if baseline is not None and result.done[baseline]:
        rows = np.append(rows, baseline)
    return np.unique(result.setups[rows])


def run_draws(
    result: StudyResult, folder: str | Path, workers: Workers, draws: Draws, setups: Sequence[int]
) -> Iterator[StudyResult]:
    """Run setups of a study, draw after draw, coupled as the study was; runs that are in the folder are not done again.

    Args:
        result: Of the study.
        folder: For what is done so far.
        workers: Who runs the setups.
        draws: What is drawn.
        setups: Numbers of the setups.

    Yields:
        The setups' rows in each draw; nothing where nothing is uncertain.

    Raises:
        InputError: A part is not in the study, or an FMU has no such parameter.
    """
    if not draws.any:
        return
    coupling = coupling_of(result)
    for study in drawn_studies(result.study, draws.parts, draws=draws.count, seed=draws.seed, vehicles=draws.vehicles):
        yield Requested(study, folder).request(workers, coupling, setups)
