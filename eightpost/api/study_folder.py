"""A study and its folder: what is asked, the table, how sure the choice is, and the page; one method for each verb."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from builder.build import build
from cosim.components.fmu_file import SharedFmu
from cosim.study.choice.assess import Knowledge, certainty_of
from cosim.study.choice.certainty import Certainty, read_certainty, write_certainty
from cosim.study.choice.rig_day import (
    POOL,
    TOTAL,
    TWICE,
    Selection,
    compare_with_rig,
    read_selection,
    requested_runs,
    select,
    with_rig_runs,
    write_selection,
)
from cosim.study.choice.sources import effects_of, stated_parameters
from cosim.study.definition import Study
from cosim.study.running.evaluator import Coupling, Evaluator, traces
from cosim.study.running.sweep import Sweep
from cosim.study.running.workers import PATIENCE, ProcessWorkers, Workers
from cosim.study.study_file import bank_sources, read_study, source_files
from cosim.study.table import StudyResult
from cosim.study.verdict import study_verdict
from eightpost.api.reading import existing_toml
from eightpost.display import some
from eightpost.errors import FileFormatError, InputError
from eightpost.files import atomic_path
from eightpost.outputs import replacing
from eightpost.progress import Listener, advance, portion
from eightpost.signals import ChannelMap, TimeSeries, write_series
from eightpost.units import stated_by
from eightpost.verdict import Verdict
from eightpost.workers.process import usable_processors

if TYPE_CHECKING:
    from builder.build import Built
    from cosim.study.choice.compare import Comparison
    from cosim.study.choice.optimise import Optimum, Search
    from cosim.study.choice.robust import LinearityCheck, Uncertain
    from cosim.study.choice.sensitivity import MeasureChange, Sensitivity
    from eightpost.api.shapes import Aim, Request

#: Names of the files in the folder of a study.
RESULTS, SELECTION, SPREADS = "results.parquet", "selection.csv", "robust.parquet"

#: Certainty of the study, the one before the last `study confirm`, and one of another study that was replaced.
CERTAINTY, PREVIOUS, REPLACED = "certainty.parquet", "certainty.previous.parquet", "certainty.replaced.parquet"


@dataclass(frozen=True, eq=False, repr=False)
class AssessedStudy(StudyResult):
    """Result of a study, and how sure the choice of the best setup is."""

    certainty: Certainty | None = None  #: Certainty of the choice; None if it was not computed.

    @property
    def verdict(self) -> Verdict:
        """Verdict on the study."""
        return study_verdict(self, self.certainty)


class StudyFolder:
    """A study and the folder of its results.

    Args:
        path: Folder of the results and of completed runs, which are not repeated.
        definition: Study, or its file, whose FMUs are built first; None: the study of the results in the folder.
        workers: Number of processes; None: one per processor.
        scheduler: Address of a Dask cluster that runs the setups in place of processes; empty: none.
        patience: Time after which a worker that does not respond is ended [s].
        listener: Receiver of notes and of the progress.
        build: Function that builds FMUs of files in a folder.

    Raises:
        InputError: The file cannot be read, or names a file that does not exist.
    """

    def __init__(
        self,
        path: str | Path,
        definition: Study | str | Path | None = None,
        *,
        workers: int | None = None,
        scheduler: str | None = None,
        patience: float = PATIENCE,
        listener: Listener | None = None,
        build: Callable[[Sequence[Path], Path], list[Built]] = lambda sources, to: build(sources, to, progress=advance),
    ) -> None:
        self.path, self.listener = Path(path), listener or Listener()
        self._workers, self._scheduler, self._patience = workers, scheduler, patience
        self.file = None if definition is None or isinstance(definition, Study) else existing_toml(definition, "study")
        if isinstance(definition, Study):
            self.study = definition
        elif self.file is None:
            self.result = StudyResult.load(self.path / RESULTS)
            self.study = self.result.study
        else:
            self.study = self._read(self.file, build)

    def _read(self, file: Path, build: Callable[[Sequence[Path], Path], list[Built]]) -> Study:
        """Read a study; FMUs of its shock and vehicle files are built first."""
        sources, folder = source_files(file), self.path / "fmus"
        if missing := [source for source in sources if not source.is_file()]:
            raise InputError(f"{file}: the file {missing[0]} does not exist; correct its name there, or make it first")
        built = build(sources, folder) if sources else []
        fmus = {Path(item.source): item.path for item in built}
        self._unpacked = [SharedFmu.of(path) for path in fmus.values()]
        study = read_study(file, lambda source: fmus.get(source, source))
        if built:
            self.listener.say(f"built {len(built)} FMUs in {folder}/")
        return study

    # ---- What an open study holds -----------------------------------------------------------------------------------

    @cached_property
    def evaluator(self) -> Evaluator:
        """Evaluator of the study in this process.

        Raises:
            FmuError: An FMU cannot be used.
        """
        files = dict.fromkeys(one.function.rpartition(":")[0] for one in self.study.measures if one.function)
        if files:
            self.listener.say(f"running the Python code of this study's measures: {', '.join(files)}")
        return Evaluator(self.study)

    @cached_property
    def sweep(self) -> Sweep:
        """The checked study.

        Raises:
            InputError: The study cannot be run; no simulation was started.
        """
        return Sweep(self.study, self.path, self.evaluator)

    @cached_property
    def result(self) -> StudyResult:
        """Table of the study.

        Raises:
            FileFormatError: The folder has none.
        """
        return StudyResult.load(self.path / RESULTS)

    @contextmanager
    def workers(self, count: int | None = None) -> Iterator[Workers]:
        """Yield the workers, and close them afterwards."""
        if self._scheduler is not None:
            from cosim.study.running.dask_workers import DaskWorkers

            pool: Workers = DaskWorkers(self._scheduler, waiting=self._patience, report=self.listener.report)
        else:
            number = self._workers or count or usable_processors()
            built = (self.path / "fmus", self.path / "shapes" / "fmus")
            pool = ProcessWorkers(number, patience=self._patience, evaluator=self.evaluator, built=built)
        with closing(pool):
            yield pool

    def certainty(self) -> Certainty | None:
        """Return the certainty in the folder; None if it does not exist or belongs to another study.

        Raises:
            FileFormatError: The file is damaged.
        """
        path = self.path / CERTAINTY
        if not path.is_file():
            return None
        try:
            found = read_certainty(path)
        except FileFormatError as error:
            previous = f"take {PREVIOUS} instead, or " if (self.path / PREVIOUS).is_file() else ""
            advice = f"{previous}run `eightpost study` again and confirm the rig runs again"
            raise FileFormatError(f"{error}; or {advice}") from error
        return found if found.digest == self.result.provenance.digest else None

    @property
    def selection(self) -> Selection | None:
        """Setups that were selected for the rig; None without a selection.

        Raises:
            FileFormatError: The selection belongs to another study.
        """
        path = self.path / SELECTION
        return read_selection(path, self.result) if path.is_file() else None

    # ---- All setups, or the best of many ----------------------------------------------------------------------------

    def run(self, *, criterion: str | None = None, certainty: bool = True) -> AssessedStudy:
        """Run every setup that is not completed; Ctrl-C lets running setups finish, and the result is then partial.

        Args:
            criterion: Measure by which setups are ranked; None: the objective.
            certainty: Whether it is computed how sure the choice is, from some runs with changed shocks.

        Raises:
            StepError: No setup could be run.
        """
        found = None
        with self.workers() as pool:
            with portion(0.0, 0.8):
                coupling = self._coupling(pool, self.sweep.coupling_of_all)
                with self.listener.work("setups", len(self.study.space)) as progress:
                    self.result = self.sweep.run(pool, coupling, progress)
            if certainty and self.result.done.any() and not self.result.partial:
                try:
                    with portion(0.8, 1.0):
                        found = self.assess(pool, criterion)
                except KeyboardInterrupt:
                    what = "stopped: the table is complete; run the command again for how sure the choice is"
                    self.listener.note(what)
        return AssessedStudy(**vars(self.result), certainty=found)

    def optimise(self, search: Search) -> tuple[StudyResult, Optimum]:
        """Search for the best setups of a bank that is too large to run them all; write all setups that ran.

        Returns:
            Results of the evaluated setups, and the best of them.

        Raises:
            InputError: An objective is not a measure, or the extra `optimise` is not installed.
        """
        with self.workers() as pool:
            coupling, found = self._searched(pool, search)
            compared = self.sweep.compare_best(self.sweep.everything(coupling), coupling)
            if compared.machine is None and coupling.machine is not None:
                _, found = self._searched(pool, search)
            self.result = self.sweep.everything(compared)
        self.result.save(self.path / RESULTS)
        return replace(found[0], partial=False), found[1]

    def _searched(self, pool: Workers, search: Search) -> tuple[Coupling, tuple[StudyResult, Optimum]]:
        from cosim.study.choice.optimise import search_study

        coupling = self._coupling(pool)
        with self.listener.work("setups", search.evaluations) as progress:
            return coupling, search_study(self.sweep, pool, coupling, search, progress)

    def _coupling(self, pool: Workers, choose: Callable[[Workers], Coupling] | None = None) -> Coupling:
        with self.listener.work("choosing the coupling step"):
            coupling = (choose or self.sweep.coupling)(pool)
        for note in coupling.notes:
            self.listener.say(note)
        if coupling.stated_error > self.study.accuracy:
            error, wanted = f"{coupling.stated_error:.2g} %", f"{self.study.accuracy:g} %"
            self.listener.note(f"the coupling error of {error} exceeds the requested accuracy of {wanted}")
        return coupling

    def shapes(self, request: Request) -> Aim:
        """Find the shock curves to aim at, also ones that nobody has built; write them, their page, and the table.

        Raises:
            InputError: A corner, number or limit is wrong, or the bank has no shock file.
        """
        from eightpost.api.shape_page import write_aim
        from eightpost.api.shapes import aim

        files = bank_sources(self.file) if self.file else {}
        sources = {name: path for name, path in files.items() if path.suffix == ".json"}
        with self.workers() as pool:
            coupling = self._coupling(pool)
            with self.listener.work("trials") as progress:
                certainty = self._readable(lambda: self._certainty_of(self.sweep.digest))
                found = aim(self.sweep, sources, pool, coupling, request, certainty, lambda runs: progress(runs, runs))
            self.result = self.sweep.everything(coupling)
        self.result.save(self.path / RESULTS)
        write_aim(found, self.path)
        return found

    # ---- How sure the choice is -------------------------------------------------------------------------------------

    def assess(self, pool: Workers, criterion: str | None = None) -> Certainty:
        """Compute the certainty from what the models state, and write it; rig runs of an earlier one stay in it."""
        parameters, unstated, notes = stated_parameters(self.result)
        with self.listener.work("uncertain parameters", 1) as progress:
            effects = effects_of(self.result, parameters, self.sweep, pool, progress)
        known = Knowledge(effects, unstated, self._measured_noise(), notes=notes)
        with self.listener.work("computing how sure the choice is"):
            found = certainty_of(self.result, self._with_runs(known), criterion=criterion)
        return self._written(found)

    def robust(
        self, uncertain: Path, *, top: int = 20, criterion: str | None = None, draws: int = 32, seed: int = 0
    ) -> tuple[Certainty, LinearityCheck | None]:
        """Compute the certainty with an uncertainty file, whose entries replace what the models state.

        Args:
            uncertain: Uncertainty file (docs/how_to/study_choice.md).
            top: Number of leading setups that are simulated with drawn parameters.
            criterion: Measure by which setups are ranked; None: the objective.
            draws: Number of draws; below 2 none.
            seed: Seed of the draws.

        Returns:
            The certainty, and the largest difference of simulated draws from the linear effects; None without draws.

        Raises:
            InputError: Nothing is uncertain.
        """
        from cosim.study.choice import robust

        result, stated = self.result, robust.read_uncertainty(uncertain, self.result)
        stated = replace(stated, parts=(*stated.parts, *self._fits(stated.fits)))
        for part in stated.parts:
            rows = zip(part.names, part.values, part.deviations, strict=True)
            numbers = ", ".join(f"{name} {value:.4g} ± {sigma:.2g}" for name, value, sigma in rows)
            self.listener.say(f"{part.part}: {numbers}")
        for vehicle in stated.vehicles:
            self.listener.say(f"alternative vehicle: {vehicle}")
        if not stated.any and not any(stated.run_to_run.values()):
            raise InputError(f"{uncertain}: no uncertainty is stated; add fits, uncertain, vehicles or run_to_run")
        setups, drawn = robust.leading(result, top, criterion).tolist(), list[StudyResult]()
        with self.workers() as pool:
            with self.listener.work("uncertain parameters", 1) as progress:
                noise = {**self._measured_noise(), **stated.run_to_run}
                known = robust.knowledge_of(result, stated, noise, self.sweep, pool, progress)
            if stated.any and draws >= 2:
                with self.listener.work("draws", draws) as progress:
                    for one in robust.run_draws(result, self.sweep, pool, stated, setups, draws, seed):
                        drawn.append(one)
                        progress(len(drawn), draws)
        known = self._with_runs(known)
        found = self._written(certainty_of(result, known, criterion=criterion))
        spreads = robust.spreads_of(result, drawn, setups)
        robust.write_spreads(spreads, self.path / SPREADS, result, stated)
        return found, robust.linearity_check(result, known, spreads)

    def _fits(self, fits: Mapping[str, Path]) -> Iterator[Uncertain]:
        """Yield the uncertainty of fitted shocks."""
        from cosim.study.choice.robust import Uncertain
        from eightpost.shock import read_shock
        from eightpost.shock.file import fitted_parameters

        for name, path in fits.items():
            fit = fitted_parameters(read_shock(path))
            if fit is None:
                what = "states no uncertainty of the shock, or was edited after the fit; fit it with `eightpost fit`"
                raise FileFormatError(what, path=path)
            for note in fit.held:
                self.listener.note(f"{name}: {note}")
            yield Uncertain(name, fit.names, fit.values, fit.covariance, fit.lowest, fit.highest, fit.left_out)

    def _measured_noise(self) -> Mapping[str, float]:
        """Return the run-to-run deviations [SI] that `compare` found; empty without a comparison."""
        path = self.path / "compared" / "comparison.json"
        if not path.is_file():
            return {}
        from cosim.study.choice.compare import read_run_to_run

        try:
            return read_run_to_run(path)
        except FileFormatError:  # no setup was run twice, or the file was edited
            return {}

    def _with_runs(self, known: Knowledge) -> Knowledge:
        """Return what is known with the rig runs of the certainty in the folder, if it is of this study.

        A certainty that is damaged or of another study is about to be replaced, so a copy is kept and named.
        """
        try:
            earlier, why = self.certainty(), f"{self.path / CERTAINTY} belongs to another study or to other FMUs"
        except FileFormatError as error:
            earlier, why = None, str(error)
        if earlier is None and (self.path / CERTAINTY).is_file():
            shutil.copyfile(self.path / CERTAINTY, self.path / REPLACED)
            self.listener.note(f"{why}; its rig runs are not taken over: confirm them again. It is kept as {REPLACED}")
        if earlier is None or not earlier.runs:
            return known
        return replace(known, runs=earlier.runs, run_to_run={**Knowledge.of(earlier).run_to_run, **known.run_to_run})

    def _written(self, found: Certainty) -> Certainty:
        with replacing(self.path / CERTAINTY):
            write_certainty(found, self.path / CERTAINTY)
        return found

    # ---- From the table to the rig and back -------------------------------------------------------------------------

    def sensitivity(self, output: Path | None = None) -> tuple[Sensitivity, ...]:
        """Return which corner matters for which measure, and write a table of all terms."""
        from cosim.study.choice.sensitivity import sensitivities_of, write_terms

        found = sensitivities_of(self.result)
        write_terms(found, self.result.provenance.measure_units, output or self.path / "sensitivity.parquet")
        return found

    def what_if(
        self,
        corners: Sequence[str],
        clicks: Mapping[str, float],
        *,
        share: float = 0.05,
        speeds: str = "low",
        setup: int | None = None,
    ) -> tuple[MeasureChange, ...]:
        """Return what clicks more or less at some corners would do to every measure.

        Args:
            corners: Corners whose shocks change.
            clicks: Clicks by side, `rebound` and `compression`; + is stiffer for shocks without a fitted adjuster.
            share: Change of the slope that counts as a click, for shocks without a fitted adjuster [1].
            speeds: Speeds at which that slope changes: `low`, `high` or `all`.
            setup: Number of the setup; None: the baseline, or else the best.

        Raises:
            InputError: Nothing changes, an adjuster is at its stop, or there is no such corner or setup.
        """
        from cosim.study.choice.sensitivity import shock_at, what_if
        from eightpost.api.shapes import change_of

        if not any(clicks.values()):
            raise InputError("nothing changes; give --rebound or --compression, e.g. --rebound +1")
        before, after = dict[str, Any](), dict[str, Any]()
        for corner in corners:
            made, variables = shock_at(self.result, self.evaluator, corner, setup)
            before[corner], after[corner], words = change_of(made, variables, clicks, share=share, speeds=speeds)
            self.listener.say(f"{corner}: {words}")
        with self.workers(1) as pool:
            return what_if(self.result, pool, after, setup=setup, before=before)

    def select(
        self,
        measures: Sequence[str] = (),
        *,
        total: int = TOTAL,
        share: Mapping[str, int] | None = None,
        pool: float = POOL,
        twice: int = TWICE,
    ) -> Selection:
        """Select setups to confirm on the rig, and write their list; see `cosim.study.choice.rig_day.select`."""
        found = select(self.result, measures, total=total, share=share, pool=pool, certainty=self.certainty())
        write_selection(found, self.result, self.path / SELECTION, twice=twice)
        return found

    def confirm(
        self,
        records: Sequence[str],
        *,
        measures: Sequence[str] = (),
        channel_map: ChannelMap | None = None,
        units: Mapping[str, str] | None = None,
        flip: Mapping[str, Iterable[str]] | None = None,
    ) -> tuple[Certainty, Certainty]:
        """Update the certainty with rig runs, and keep the previous one.

        Args:
            records: List of rig runs, or one or more SETUP=FILE.
            measures: Measures to take into account; empty: all that do not depend on a mean.
            channel_map: Channel map of the records.
            units: Units by channel, for columns without a unit in the header.
            flip: Channels whose sign is changed, by name of a record; those of an empty name are of all records.

        Returns:
            The certainty before and after.

        Raises:
            InputError: The study has no certainty, or a record does not fit it.
        """
        result, before = self.result, self.certainty()
        if before is None:
            again = "run `eightpost study` again with the same folder (completed runs are not repeated)"
            what = "the study has no certainty, or that of another study"
            raise InputError(f"{self.path / CERTAINTY}: {what}; {again}")
        runs, notes = requested_runs(result, records)
        known = Knowledge.of(before)
        known = replace(known, run_to_run={**self._measured_noise(), **known.run_to_run})
        reader = self._record_reader(channel_map, units, flip or {})
        known, others = with_rig_runs(result, known, runs, reader, measures=measures)
        for note in (*notes, *others):
            self.listener.note(note)
        after = certainty_of(result, known, criterion=before.criterion, top=before.top)
        with atomic_path(self.path / PREVIOUS) as temporary:
            shutil.copyfile(self.path / CERTAINTY, temporary)
        return before, self._written(after)

    def compare(
        self,
        measured: Path,
        output: Path | None = None,
        *,
        measures: Sequence[str] = (),
        channel_map: ChannelMap | None = None,
        units: Mapping[str, str] | None = None,
        flip: Mapping[str, Iterable[str]] | None = None,
        rank: float = 0.8,
        level: float | None = None,
    ) -> tuple[tuple[Comparison, ...], Verdict, Path]:
        """Compare the prediction with rig runs, and write the comparison and its picture.

        Args:
            measured: List of rig runs, or its folder.
            output: Folder of the comparison; None: compared/ in the folder of the study.
            measures: Measures to compare; empty: all that do not depend on a mean.
            channel_map: Channel map of the records; see `confirm` for this, `units` and `flip`.
            units: Units by channel.
            flip: Channels whose sign is changed.
            rank: Minimum acceptable rank correlation (Spearman).
            level: Maximum acceptable RMS error of the levels [%]; None: no limit.

        Returns:
            Comparison of each measure, the verdict, and the picture.
        """
        from cosim.study.choice.compare import comparison_verdict, write_and_plot

        path = measured / SELECTION if measured.is_dir() else measured
        reader, certainty = self._record_reader(channel_map, units, flip or {}), self.certainty()
        runs, found, notes = compare_with_rig(self.result, path, reader, measures=measures, certainty=certainty)
        for note in notes:
            self.listener.note(note)
        self.listener.say(f"{runs} runs of {found[0].setups.size} setups")
        verdict, selection = comparison_verdict(found, rank=rank, level=level), self.selection
        folder, chosen = output or self.path / "compared", selection.setups if selection else {}
        return found, verdict, write_and_plot(found, self.result, folder, verdict, chosen)

    def _record_reader(
        self, channel_map: ChannelMap | None, units: Mapping[str, str] | None, flip: Mapping[str, Iterable[str]]
    ) -> Callable[[Path], TimeSeries]:
        """Return a function that reads and checks the channels of a rig record, whichever it has."""
        from eightpost.rig.columns import flips_of
        from eightpost.rig.rig_test import read_rig_test

        noted = set[tuple[str, ...]]()

        def read(file: Path) -> TimeSeries:
            test = read_rig_test(file, channel_map=channel_map, units=units, flip=flips_of(file, flip), needs=())
            if test.unchecked and test.unchecked not in noted:
                noted.add(test.unchecked)
                what = f"sign and corner of {some(test.unchecked)} were not checked"
                self.listener.note(f"{file.name}: {what}, because records like it lack the channels that show them")
            return test.series

        return read

    # ---- Traces and the page ----------------------------------------------------------------------------------------

    def write_traces(self, setups: Sequence[int]) -> Iterator[tuple[int, Path]]:
        """Run setups again and write their time traces; yield each with its file."""
        for index, series in traces(self.result, setups, self.evaluator).items():
            path = self.path / "traces" / f"{index}.parquet"
            write_series(series, path)
            yield index, path

    def write_page(self, *, trace_command: str = "") -> Path:
        """Write the page of the study with its selection, certainty and curves to aim at so far; return its path.

        It has traces of the best, the worst, the baseline and the selected setups, which are run again for them.

        Args:
            trace_command: Command that computes the traces of a setup, with `{setup}` in place of its number.
        """
        from cosim.study.choice.sensitivity import available_sensitivities
        from cosim.study.page import write_study_report
        from cosim.study.sheet import AimPage, Extras, copy_shock_pages, sheet_of, shock_curves

        result, study = self.result, self.study
        selection = self._readable(lambda: self.selection)
        certainty = self._readable(lambda: self._certainty_of(result.provenance.digest))
        ranked, baseline = result.setups[result.ranking()].tolist(), study.baseline_setup
        traced = [*ranked[:1], *ranked[-1:], *([] if baseline is None else [baseline.index])]
        traced += [selected.setup.index for selected in selection.chosen] if selection else []
        done = set(result.setups[result.done].tolist())
        with stated_by(study.units):
            sheet = sheet_of(result, certainty=certainty, trace_command=trace_command)
            extras = Extras(
                traces(result, dict.fromkeys(index for index in traced if index in done), self.evaluator),
                available_sensitivities(result),
                selection.chosen if selection else (),
                shock_curves(study),
                copy_shock_pages(study, self.path),
                AimPage.of(self.path, result.provenance.digest),
            )
            return write_study_report(sheet, extras, self.path)

    def _certainty_of(self, digest: str) -> Certainty | None:
        path = self.path / CERTAINTY
        if not path.is_file():
            return None
        known = read_certainty(path, digest=digest)
        if not set(known.ties) <= set(self.result.setups.tolist()):
            raise FileFormatError(f"its best setups are not in {RESULTS}; run `eightpost study` again", path=path)
        return known

    def _readable(self, read: Callable[[], Any]) -> Any:
        """Return what is read; None, and a note, if the file is damaged or belongs to another study."""
        try:
            return read()
        except FileFormatError as error:
            self.listener.note(f"left out of the page: {error}")
            return None
