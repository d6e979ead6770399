"""What a worker process does: everything comes as plain values, so that it may run on another machine."""

from __future__ import annotations

import signal
from collections.abc import Sequence
from functools import lru_cache

from cosim.study.choose_coupling import choose_coupling
from cosim.study.evaluator import Coupling, Evaluator, Row
from cosim.study.study import Study


@lru_cache(maxsize=2)
def evaluator_for(study: str) -> Evaluator:
    """Return this process's evaluator of a study, by its JSON."""
    return Evaluator(Study.from_json(study))


def choose(study: str) -> Coupling:
    """Choose the coupling of a study, by its JSON."""
    return choose_coupling(evaluator_for(study))


def rows(study: str, coupling: Coupling, indices: Sequence[int]) -> list[Row]:
    """Run setups by number."""
    evaluator = evaluator_for(study)
    return [evaluator.row(evaluator.study.space.setup(index), coupling) for index in indices]


def begin_worker() -> None:
    """Leave Ctrl-C to the process that gives the work: it lets what runs come to its end."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
