"""What a worker process does: everything comes as plain values, so that it may run on another machine."""

from __future__ import annotations

import signal
import threading
from collections.abc import Sequence
from importlib import import_module
from typing import Any

from cosim.study.running.choose_coupling import choose_coupling
from cosim.study.running.evaluator import Coupling, Evaluator, Row
from cosim.study.running.signs import sign, take_place, working
from cosim.study.study import Study
from eightpost.parent_process import end_with

#: Each thread has an evaluator of its own: an FMU's instance is stepped by one at a time.
_own = threading.local()


def evaluator_for(study: str) -> Evaluator:
    """Return this thread's evaluator of a study, by its JSON."""
    if getattr(_own, "study", None) != study:
        _own.evaluator, _own.study = Evaluator(Study.from_json(study)), study
    evaluator: Evaluator = _own.evaluator
    return evaluator


def open_study(study: str) -> None:
    """Open a study, by its JSON, and load what measures filter with, so that its first setup need not wait for them."""
    evaluator_for(study)
    import_module("scipy.signal")


def choose(study: str) -> Coupling:
    """Choose the coupling of a study, by its JSON."""
    with working():
        return choose_coupling(evaluator_for(study))


def rows(study: str, coupling: Coupling, indices: Sequence[int]) -> list[Row]:
    """Run setups by number."""
    with working():
        evaluator, found = evaluator_for(study), list[Row]()
        for index in indices:
            sign()
            found.append(evaluator.row(evaluator.study.space.setup(index), coupling))
        return found


def begin_worker(parent: int, *signs: Any) -> None:
    """Take a place among `signs`; leave Ctrl-C to the parent process, which lets what runs end, and end with it."""
    end_with(parent)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    take_place(*signs)
