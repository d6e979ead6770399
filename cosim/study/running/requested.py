"""Studies of which only requested setups are run, each of them once."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cosim.study.result import StudyResult, result_table
from cosim.study.running.chunks import ChunkFolder
from cosim.study.running.evaluator import Coupling, Row
from cosim.study.running.sweep import Sweep
from cosim.study.running.workers import Chunk, Workers
from cosim.study.study import Study

Integers = NDArray[np.int64]


class Requested(Sweep):
    """A checked study that runs setups on request.

    Results of an exhaustive run in the same folder are used, and the results of requests are stored there, so that no
    setup is run again, in this session or another one. Ctrl-C loses only the batch that is running.

    Args:
        study: Study to run.
        folder: Output folder, with the completed runs.

    Raises:
        InputError: The study cannot be run; no simulation was started.
    """

    def __init__(self, study: Study, folder: str | Path) -> None:
        super().__init__(study, folder)
        self._requested = ChunkFolder(self.folder / "requested", self.digest, self._schema)
        self._batches = max(self._requested.numbers, default=-1) + 1
        self._rows = {int(row["setup"]): row for kept in (self._kept, self._requested) for row in kept.rows()}

    @property
    def tried(self) -> int:
        """Number of setups whose results are available."""
        return len(self._rows)

    def request(self, workers: Workers, coupling: Coupling, indices: Sequence[int]) -> StudyResult:
        """Return the results of setups by number; setups without a result are run.

        Args:
            workers: Workers that run the setups.
            coupling: Coupling of the setups.
            indices: Numbers of the setups.
        """
        new = [index for index in dict.fromkeys(int(i) for i in indices) if index not in self._rows]
        if new:
            alone = [Chunk(place, (index,)) for place, index in enumerate(new)]
            found = [row for _, rows in workers.rows(self.study, coupling, alone, lambda: False) for row in rows]
            self._requested.write(Chunk(self._batches, tuple(new)), sorted(found, key=lambda row: int(row["setup"])))
            self._batches += 1
            self._rows |= {int(row["setup"]): row for row in found}
        return self._table(coupling, (self._rows[int(index)] for index in set(indices)))

    def everything(self, coupling: Coupling) -> StudyResult:
        """Return all available results, including those of an exhaustive run."""
        return self._table(coupling, self._rows.values())

    def _table(self, coupling: Coupling, rows: Iterable[Row]) -> StudyResult:
        table = result_table(list(rows), self._schema)
        partial = table.num_rows < len(self.study.space)
        return StudyResult(self.study, table, self._provenance(coupling), partial)
