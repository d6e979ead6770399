"""Time traces of a setup, which a study does not keep: the setup is run once more."""

from __future__ import annotations

from collections.abc import Iterable

from cosim.study.result import StudyResult
from cosim.study.running.evaluator import Coupling, Evaluator
from eightpost.signals import TimeSeries


def coupling_of(result: StudyResult) -> Coupling:
    """Return the coupling that a study was run with."""
    found = dict(result.provenance.settings["coupling"])
    return Coupling.from_json(found)


def traces(result: StudyResult, setups: Iterable[int], *, evaluator: Evaluator | None = None) -> dict[int, TimeSeries]:
    """Return, by setup, what the measures look at over time on the first drive: to the bit what was measured.

    Args:
        result: Of the study; its FMUs and drivefiles must still be where they were.
        setups: Numbers.
        evaluator: Of the study, where there is one already.

    Raises:
        InputError: A file is gone, or there is no such setup.
        StepError: An FMU failed.
    """
    evaluator = evaluator or Evaluator(result.study)
    coupling, drive = coupling_of(result), result.study.drives[0]
    space = result.study.space
    return {index: evaluator.run(space.setup(index), drive, coupling).series for index in setups}
