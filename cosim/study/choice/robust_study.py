"""Robustness of a choice: the leading setups of a study are run again with drawn parameters."""

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
    """Uncertain parameters and number of draws.

    Attributes:
        parts: Uncertain parameters with their covariance.
        count: Number of draws.
        seed: Seed of the random number generator.
        vehicles: FMUs of equivalent vehicles.
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
    """Return the numbers of the best setups by the objective or a measure, and of the baseline, in increasing order."""
    rows = result.ranking(measure)[:count]
    baseline = result.baseline_row
    if baseline is not None and result.done[baseline]:
        rows = np.append(rows, baseline)
    return np.unique(result.setups[rows])


def run_draws(
    result: StudyResult, folder: str | Path, workers: Workers, draws: Draws, setups: Sequence[int]
) -> Iterator[StudyResult]:
    """Run setups with every draw, with the coupling of the study; runs that are in the folder are not repeated.

    Args:
        result: Result of the study.
        folder: Folder of completed runs.
        workers: Workers that run the setups.
        draws: Uncertain parameters and number of draws.
        setups: Numbers of the setups.

    Yields:
        Results of the setups for each draw; nothing if nothing is uncertain.

    Raises:
        InputError: A part is not in the study, or an FMU lacks a parameter.
    """
    if not draws.any:
        return
    coupling = coupling_of(result)
    for study in drawn_studies(result.study, draws.parts, draws=draws.count, seed=draws.seed, vehicles=draws.vehicles):
        yield Requested(study, folder).request(workers, coupling, setups)
