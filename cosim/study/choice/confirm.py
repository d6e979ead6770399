"""Rig runs that confirm a study: their measured levels, and the certainty that follows from them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from cosim.study.certainty.assess import Knowledge
from cosim.study.certainty.certainty import ConfirmedRun
from cosim.study.choice.compare import usable_deviation
from cosim.study.choice.rig_runs import MeasuredRun, measured_runs, read_run_list, runs_with_records, without
from cosim.study.result import StudyResult
from eightpost.errors import InputError
from eightpost.files import sha256_of
from eightpost.signals import TimeSeries


@dataclass(frozen=True, slots=True)
class _Confirmed:
    """Knowledge with new rig runs."""

    known: Knowledge  #: Knowledge with the new runs.
    new: tuple[ConfirmedRun, ...]  #: The new runs.
    notes: tuple[str, ...]  #: Sentences about records and measures that are left out.


def requested_runs(result: StudyResult, texts: Sequence[str]) -> tuple[tuple[MeasuredRun, ...], list[str]]:
    """Return the rig runs that arguments name, and notes about records that do not exist.

    Args:
        result: Result of the study.
        texts: One list of runs (a CSV file, see `read_run_list`, or a folder with a selection.csv), or one or more
            SETUP=FILE on the first drive of the study.

    Raises:
        InputError: An argument names neither, a setup was not run in the study, or no record exists.
    """
    if not any("=" in text for text in texts):
        if len(texts) != 1:
            raise InputError(f"name one list of rig runs, or each record as SETUP=FILE, not {len(texts)} files")
        path = Path(texts[0])
        path = path / "selection.csv" if path.is_dir() else path
        runs, notes = runs_with_records(read_run_list(path, result.study), path)
    else:
        runs, notes = tuple(_pair(text, result) for text in texts), []
    known = set(result.setups[result.done].tolist())
    if unknown := [run.setup for run in runs if run.setup not in known]:
        raise InputError(f"setup {unknown[0]} was measured but not run in the study; run it, or leave the record out")
    return runs, notes


def _pair(text: str, result: StudyResult) -> MeasuredRun:
    number, _, file = text.partition("=")
    if not number.strip().isdecimal() or not file:
        raise InputError(f"{text!r}: name a rig run as SETUP=FILE, such as 37=run1.csv")
    setup = result.study.space.setup(int(number)).index
    if not Path(file).is_file():
        raise InputError(f"{text!r}: there is no file {file}")
    return MeasuredRun(Path(file), setup, result.study.drives[0].name)


def with_rig_runs(
    result: StudyResult,
    known: Knowledge,
    runs: Sequence[MeasuredRun],
    read: Callable[[Path], TimeSeries],
    measures: Sequence[str] = (),
) -> _Confirmed:
    """Return what is known with rig runs; a record that is known already counts once.

    Unless a run-to-run deviation is stated, it comes from setups that were tested several times, in all runs so far.

    Args:
        result: Result of the study.
        known: Knowledge without the new runs.
        runs: Rig runs.
        read: Function that returns the channels of a record.
        measures: Measures to take into account. By default, all that do not depend on a mean, because the zero of the
            rig differs.

    Raises:
        InputError: A measure is unknown, or none can be computed from a record.
    """
    for name in measures:
        result.study.measure(name)
    digests = {run.digest for run in known.runs}
    made, notes, missing = list[ConfirmedRun](), list[str](), dict[str | Path, Mapping[str, str]]()
    for run in runs:
        digest = sha256_of(run.file)
        if digest in digests:
            notes.append(f"{run.file.name} is taken into account already")
            continue
        digests.add(digest)
        values, missing[run.file] = _values(result, run, read, measures)
        made.append(ConfirmedRun(run.file.name, run.setup, run.drive, digest, values))
    every = (*known.runs, *made)
    earlier = repeated_noise(known.runs)
    stated = {name: value for name, value in known.run_to_run.items() if value != earlier.get(name)}
    noise = {**repeated_noise(every), **stated}
    return _Confirmed(replace(known, runs=every, run_to_run=noise), tuple(made), (*notes, *without(missing)))


def _values(
    result: StudyResult, run: MeasuredRun, read: Callable[[Path], TimeSeries], measures: Sequence[str]
) -> tuple[dict[str, float], dict[str, str]]:
    """Return the wanted measures of a record, and why others cannot be computed."""
    found = measured_runs([run], result.study, read)

    def is_wanted(name: str) -> bool:
        return name in measures if measures else not result.study.measure(name).absolute

    kept = {n: float(values[0]) for n, values in found.values.items() if is_wanted(n) and np.isfinite(values[0])}
    missing = {name: reason for name, reason in found.missing.items() if is_wanted(name)}
    if not kept:
        raise InputError(
            f"{run.file}: no measure can be taken into account: {'; '.join(without({run.file: missing}))}; channels "
            "must have the names of the vehicle's, or give a channel map with --map"
        )
    return kept, missing


def repeated_noise(runs: Sequence[ConfirmedRun]) -> Mapping[str, float]:
    """Return the run-to-run deviation of each measure from setups with several runs, pooled, SI.

    It is increased for the number of repeats; see `usable_deviation`.
    """
    names = dict.fromkeys(name for run in runs for name in run.values)
    return dict(_repeated(runs, names))


def _repeated(runs: Sequence[ConfirmedRun], names: Mapping[str, None]) -> Iterator[tuple[str, float]]:
    for name in names:
        squares, freedom = 0.0, 0
        for setup in dict.fromkeys((run.setup, run.drive) for run in runs):
            values = [run.values[name] for run in runs if (run.setup, run.drive) == setup and name in run.values]
            if len(values) > 1:
                squares += float(np.sum((np.array(values) - np.mean(values)) ** 2))
                freedom += len(values) - 1
        if freedom:
            yield name, usable_deviation(float(np.sqrt(squares / freedom)), freedom)
