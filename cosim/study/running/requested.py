"""Studies of which only some setups are run, as they are asked for, and none twice."""

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
    """A study that is checked and runs the setups that it is asked for.

    What an exhaustive run of the same study has left in the folder is taken, and what is run here is kept: asked again,
    in this session or another, it is there at once. Ctrl-C loses the batch that runs, no more.

    Args:
        study: What to run.
        folder: For what is done so far.

    Raises:
        InputError: The study cannot be run; nothing was.
    """

    def __init__(self, study: Study, folder: str | Path) -> None:
        super().__init__(study, folder)
        self._asked = ChunkFolder(self.folder / "requested", self.digest, self._schema)
        self._batches = max(self._asked.numbers, default=-1) + 1
        self._rows = {int(row["setup"]): row for kept in (self._kept, self._asked) for row in kept.rows()}

    @property
    def tried(self) -> int:
        """How many setups there are rows of."""
        return len(self._rows)

    def request(self, workers: Workers, coupling: Coupling, indices: Sequence[int]) -> StudyResult:
        """Return the rows of setups by number; those that are not there yet are run.

        Args:
            workers: Who runs them.
            coupling: How they are coupled.
            indices: Numbers of the setups.
        """
        new = [index for index in dict.fromkeys(int(i) for i in indices) if index not in self._rows]
        if new:
            alone = [Chunk(place, (index,)) for place, index in enumerate(new)]
            found = [row for _, rows in workers.rows(self.study, coupling, alone, lambda: False) for row in rows]
            self._asked.write(Chunk(self._batches, tuple(new)), sorted(found, key=lambda row: int(row["setup"])))
            self._batches += 1
            self._rows |= {int(row["setup"]): row for row in found}
        return self._table(coupling, (self._rows[int(index)] for index in set(indices)))

    def everything(self, coupling: Coupling) -> StudyResult:
        """Return all rows that there are, those of an exhaustive run included."""
        return self._table(coupling, self._rows.values())

    def _table(self, coupling: Coupling, rows: Iterable[Row]) -> StudyResult:
        table = result_table(list(rows), self._schema)
        partial = table.num_rows < len(self.study.space)
        return StudyResult(self.study, table, self._provenance(coupling), partial)
