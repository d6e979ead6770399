"""Comparison of the response measures of runs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from cosim.results.result import Result, SavedRun
from cosim.study.choice.compare import percent_change, verdict_of_runs
from cosim.study.measures import Measure, available, channel_measures, ride_measures
from eightpost import units
from eightpost.display import Summarized, Summary, some
from eightpost.errors import InputError
from eightpost.labelled import data_frame
from eightpost.signals import TimeSeries
from eightpost.verdict import Verdict

if TYPE_CHECKING:
    import pandas as pd

    from eightpost.report.pictures import Picture


@dataclass(frozen=True, eq=False, repr=False)
class RunComparison(Summarized):
    """Response measures of runs; the first run is the baseline."""

    runs: Mapping[str, TimeSeries]  #: Recorded channels of each run without the settling time, by label.
    measures: tuple[Measure, ...]  #: Measures that all runs have.
    verdict: Verdict  #: Verdict on all runs, with the run in the origin of each reason.

    def values(self, measure: Measure) -> list[float]:
        """Return a measure of every run in its display unit."""
        return [units.convert(measure.of(one), measure.unit(one), measure.display) for one in self.runs.values()]

    def change(self, measure: Measure) -> float | None:
        """Return the change of a measure from the first run to the last [%]; None if it is 0 in the first run."""
        return percent_change(self.values(measure))

    def _summary(self) -> Summary:
        changes = {one.name: self.change(one) for one in self.measures}
        known = sorted(((name, c) for name, c in changes.items() if c is not None), key=lambda item: -abs(item[1]))
        return Summary.of(
            f"Comparison of {len(self.runs)} runs",
            ("runs", some(self.runs)),
            ("verdict", self.verdict.headline),
            ("measures", str(len(self.measures))),
            *((name, f"{change:+.2f} %") for name, change in known[:5]),
        )

    def to_pandas(self) -> pd.DataFrame:
        """Return a row for each measure: unit, value in each run, change from the first run to the last [%].

        Raises:
            MissingExtraError: pandas is not installed.
        """
        rows = [self.values(measure) for measure in self.measures]
        columns: dict[str, Any] = {"unit": [measure.display for measure in self.measures]}
        columns |= {label: [row[k] for row in rows] for k, label in enumerate(self.runs)}
        columns["change"] = [percent_change(row) for row in rows]
        return data_frame(columns, [measure.name for measure in self.measures], "measure", {"change": "%"})

    def plot(self) -> Picture:
        """Return a picture of the change of each measure from the first run to the others."""
        from cosim.study.plots import changes  # noqa: PLC0415 -- matplotlib takes long to load
        from eightpost.report.pictures import Picture  # noqa: PLC0415

        return Picture(changes(self.runs, self.measures))


def compare_runs(runs: Mapping[str, Result | SavedRun], vehicle: str = "car") -> RunComparison:
    """Compare runs by the ride measures of a vehicle, or channel by channel if they lack its channels.

    Args:
        runs: Two or more runs by label; the first is the baseline.
        vehicle: Name of the vehicle component.

    Raises:
        InputError: There are fewer than two runs, or they have no channel in common.
    """
    if len(runs) < 2:
        raise InputError("compare needs at least two runs; the first is the baseline")
    settled = {label: one.settled() if isinstance(one, Result) else one.series for label, one in runs.items()}
    series = tuple(settled.values())
    measures = available(ride_measures(vehicle), *series) or available(channel_measures(series[0]), *series)
    if not measures:
        raise InputError(f"{next(iter(runs))} and the other runs have no channel in common")
    documents = {
        label: {"verdict": one.verdict.to_json()} if isinstance(one, Result) else one.document
        for label, one in runs.items()
    }
    return RunComparison(settled, measures, verdict_of_runs(documents))
