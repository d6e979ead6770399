"""Trials: setups of shocks that are not in the bank, run as the setups of a study are.

This is the only place from which the continuous search runs setups, so that a faster evaluation replaces it here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace

import numpy as np

from cosim.study.result import StudyResult
from cosim.study.running.evaluator import Coupling, Evaluator, Row
from cosim.study.running.workers import Chunk, Workers
from cosim.study.study import Build, Study
from cosim.study.table import Provenance, result_table, study_schema
from eightpost.errors import InputError

#: Number of chunks of a batch for each worker.
_CHUNKS = 2


class Trials:
    """Runs of one study's vehicle and drives with any shocks.

    Args:
        study: Study with vehicle, drives and measures; its bank plays no part.
        workers: Workers that run the trials.
        coupling: Coupling of all runs.
    """

    def __init__(self, study: Study, workers: Workers, coupling: Coupling) -> None:
        self.study, self._workers, self._coupling = study, workers, coupling
        self._units = dict(Evaluator(study).measure_units)
        self.count = 0

    def run(self, trials: Sequence[Mapping[str, Build]]) -> StudyResult:
        """Run trials (K,), each a shock by corner; row k of the result is trial k. Failures are reported in the rows.

        Raises:
            InputError: A trial does not have a shock at each corner of the study.
        """
        study, indices = self._described(trials)
        size = max(1, -(-len(trials) // (_CHUNKS * self._workers.count)))
        chunks = [Chunk(n, tuple(indices[first:first + size]))
                  for n, first in enumerate(range(0, len(indices), size))]  # fmt: skip
        rows: list[Row] = []
        for _, found in self._workers.rows(study, self._coupling, chunks, lambda: False):
            rows += found
        self.count += len(rows)
        settings = {"coupling": asdict(self._coupling), "settling": study.settling, "accuracy": study.accuracy}
        made_by = Provenance("", {}, {}, settings, self._units)
        return StudyResult(study, result_table(rows, study_schema(study, self._units)), made_by)

    def _described(self, trials: Sequence[Mapping[str, Build]]) -> tuple[Study, list[int]]:
        """Return a study that contains the trials, and their numbers in it."""
        corners = tuple(self.study.corners)
        for trial in trials:
            if set(trial) != set(corners):
                raise InputError(f"a trial needs shocks at {', '.join(corners)}, not at {', '.join(trial) or 'none'}")
        bank = {f"trial {k} {corner}": trial[corner] for k, trial in enumerate(trials) for corner in corners}
        allowed = {corner: tuple(f"trial {k} {corner}" for k in range(len(trials))) for corner in corners}
        study = replace(self.study, bank=bank, corners=allowed, alike=(), baseline={})
        places = tuple(np.arange(len(trials)) for _ in corners)
        numbers = np.ravel_multi_index(places, study.space.radices)
        return study, [int(number) for number in numbers]
