"""Functions that run in worker processes; all arguments are plain values, so that they can run on other machines."""

from __future__ import annotations

import signal
import threading
from collections.abc import Sequence
from importlib import import_module
from typing import Any

from cosim.study.running.choose_coupling import choose_coupling
from cosim.study.running.evaluator import Coupling, Evaluator, Row
from cosim.study.running.signs import heartbeat, register_worker, working
from cosim.study.study import Study
from eightpost.parent_process import end_with

#: Evaluator of each thread: the instance of an FMU may be stepped by one thread only.
_own = threading.local()


def evaluator_for(study: str) -> Evaluator:
    """Return this thread's evaluator of a study, given as JSON."""
    if getattr(_own, "study", None) != study:
        _own.evaluator, _own.study = Evaluator(Study.from_json(study)), study
    evaluator: Evaluator = _own.evaluator
    return evaluator


def open_study(study: str) -> None:
    """Load a study, given as JSON, and the modules for filtering measures, so that its first setup starts sooner."""
    evaluator_for(study)
    import_module("scipy.signal")


def choose(study: str) -> Coupling:
    """Choose the coupling of a study, given as JSON."""
    with working():
        return choose_coupling(evaluator_for(study))


def rows(study: str, coupling: Coupling, indices: Sequence[int]) -> list[Row]:
    """Run setups by number."""
    with working():
        evaluator, found = evaluator_for(study), list[Row]()
        for index in indices:
            heartbeat()
            found.append(evaluator.row(evaluator.study.space.setup(index), coupling))
        return found


def start_worker(parent: int, *heartbeats: Any) -> None:
    """Initialise a worker: register its heartbeat, end it with its parent, and leave Ctrl-C to the parent."""
    end_with(parent)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    register_worker(*heartbeats)
