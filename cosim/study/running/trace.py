"""Time traces of setups. A study does not store them: the setups are run again."""

from __future__ import annotations

from collections.abc import Iterable

from cosim.study.result import StudyResult
from cosim.study.running.evaluator import Coupling, Evaluator
from eightpost.signals import TimeSeries


def coupling_of(result: StudyResult) -> Coupling:
    """Return the coupling of a study's runs."""
    found = dict(result.provenance.settings["coupling"])
    return Coupling.from_json(found)


def traces(result: StudyResult, setups: Iterable[int], *, evaluator: Evaluator | None = None) -> dict[int, TimeSeries]:
    """Return the time series of the measures' channels on the first drive by setup, identical to those of the study.

    Args:
        result: Result of the study; its FMUs and drive files must still exist at their paths.
        setups: Numbers of the setups.
        evaluator: Evaluator of the study; created if None.

    Raises:
        InputError: A file does not exist any more, or there is no such setup.
        StepError: An FMU failed.
    """
    evaluator = evaluator or Evaluator(result.study)
    coupling, drive = coupling_of(result), result.study.drives[0]
    space = result.study.space
    return {index: evaluator.run(space.setup(index), drive, coupling).series for index in setups}
