"""Table of a study in a Parquet file: its columns, and its header with the provenance of the values."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from arro3.core import DataType, Field, Schema
from pydantic import with_config

from cosim.study.definition import Setup, Study, Term
from cosim.study.measures import AboveBand, Measure
from eightpost import __version__, units
from eightpost.array_types import Array, Flags, Integers
from eightpost.completion import warn_of_earlier_results
from eightpost.display import Summarized, Summary, some
from eightpost.errors import FileFormatError, InputError
from eightpost.files import MALFORMED, check_schema, parse_json
from eightpost.labelled import data_frame, dataset
from eightpost.schema import REPORT, checked
from eightpost.signals.parquet_file import Table, joined, read_table, write_table

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from eightpost.report.pictures import Picture

# ---- Columns --------------------------------------------------------------------------------------------------------

#: Values of the column `status`.
DONE, FAILED = "done", "failed"

#: Names of the columns before and after those of corners and measures.
HEAD, TAIL = ("setup",), ("status", "message", "coupling_error_percent", "marks", "seconds")


def error_column(measure: str) -> str:
    """Return the name of the column with the coupling error of a measure, in the measure's SI unit."""
    return f"coupling error of {measure}"


def study_schema(study: Study, measure_units: Mapping[str, str]) -> Schema:
    """Return the columns of a study's table."""
    number, text = DataType.float64(), DataType.string()
    measures, errors = [], []
    for m in study.measures:
        words = {"unit": measure_units[m.name], "display": m.display or measure_units[m.name], "label": m.name}
        name = error_column(m.name)
        measures.append(Field(m.name, number, metadata=words))
        errors.append(Field(name, number, metadata=words | {"label": name}))
    tail = [Field(name, number if name in ("coupling_error_percent", "seconds") else text) for name in TAIL]
    corners = [Field(corner, text) for corner in study.corners]
    return Schema([Field("setup", DataType.int64()), *corners, *measures, *tail, *errors])


def result_table(rows: Sequence[Mapping[str, Any]], schema: Schema) -> Table:
    """Return rows, given by column name, as a table sorted by setup number.

    Raises:
        InputError: Two rows have the same setup number.
    """
    table = Table.of_rows(rows, schema)
    table = table.take(np.argsort(table["setup"]))
    if np.any(np.diff(table["setup"]) == 0):
        raise InputError("two rows have the same setup number")
    return table


# ---- Provenance of the values, and the header that states it --------------------------------------------------------

#: Version of the files that are written, and the newest version that can be read.
SCHEMA = 1

_KEY = b"eightpost"


@with_config(REPORT)
@dataclass(frozen=True, slots=True)
class Provenance:
    """Provenance of a study's values."""

    digest: str  #: SHA-256 of everything that affects the values.
    guids: Mapping[str, str]  #: GUID of every FMU, by file.
    digests: Mapping[str, str]  #: SHA-256 of every input file, by path.
    settings: Mapping[str, Any]  #: Settings of the runs: scheme, coupling step [s], its estimated error, and others.
    measure_units: Mapping[str, str]  #: SI unit of every measure.
    tool_version: str = __version__  #: Version of eightpost.
    #: Range of validity that each FMU states (Validity), by file; None if it states none.
    models: Mapping[str, Any] = field(default_factory=dict)
    #: Power of each measure above the band in which the vehicle was identified, in the run of the baseline or else of
    #: the first setup, by measure; empty if the vehicle states no band.
    above_band: Mapping[str, AboveBand] = field(default_factory=dict)


def _header_of(study: Study, provenance: Provenance, *, partial: bool) -> dict[bytes, bytes]:
    header = {
        "schema": "eightpost.study",
        "schema_version": SCHEMA,
        **asdict(provenance),
        "partial": partial,
        "study": json.loads(study.to_json()),
    }
    return {_KEY: json.dumps(header).encode()}


def _header_in(path: Path, table: Table) -> dict[str, Any]:
    """Return the header of a file.

    Raises:
        FileFormatError: The file is not a study's result, or was written by a newer version.
    """
    metadata = table.schema.metadata
    if _KEY not in metadata:
        raise FileFormatError("is not a study result: it has no eightpost header", path=path)
    header: dict[str, Any] = parse_json(metadata[_KEY], path, finite=False)
    if not isinstance(header, dict) or header.get("schema") != "eightpost.study":
        found = header.get("schema") if isinstance(header, dict) else header
        raise FileFormatError(f"is not a study result but {found!r}", path=path)
    check_schema(header, SCHEMA, path, key="schema_version")
    return header


def _with_found_files(header: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Return a header whose relative paths lead to files from the current folder.

    The paths are relative to the folder in which the study was run. A file that the current folder does not have is
    looked for from the result's folder and from those above it.
    """
    study = header["study"]
    models = [study["vehicle"], *study["bank"].values()]
    files = {model["fmu"] for model in models} | {*header["guids"], *header["digests"], *header.get("models", {})}
    for drive in study["drives"]:
        files |= {drive["file"], drive.get("channel_map") or drive["file"]}
    places, found = (folder.resolve(), *folder.resolve().parents), dict[str, str]()
    for file in (file for file in files if not Path(file).exists()):
        found |= next(({file: str(place / file)} for place in places if (place / file).exists()), {})
    renamed: dict[str, Any] = _renamed(header, found) if found else dict(header)
    return renamed


def _renamed(value: Any, names: Mapping[str, str]) -> Any:
    """Return a JSON value in which texts and keys that are among the names have their new names."""
    if isinstance(value, dict):
        return {names.get(key, key): _renamed(one, names) for key, one in value.items()}
    if isinstance(value, list):
        return [_renamed(one, names) for one in value]
    return names.get(value, value) if isinstance(value, str) else value


# ==== Result of a study: one row per setup, with the provenance of its values ========================================


@dataclass(frozen=True, eq=False, repr=False)
class StudyResult(Summarized):
    """A study and its table.

    Columns: `setup` (number), one per corner (name of the build), one per measure (SI; unit, display unit and label
    in the field's metadata), `status` (done or failed), `message`, `coupling_error_percent`, `marks` (beyond a shock's
    fitted range, a tire off the ground), `seconds` (wall time of its runs), and one `coupling error of ...` per measure
    (SI).
    """

    study: Study  #: Definition of the study.
    table: Table  #: One row per setup, by number.
    provenance: Provenance  #: Provenance of the values.
    partial: bool = False  #: Whether setups are missing because the study was interrupted.
    _cache: dict[str, Array] = field(default_factory=dict, repr=False)

    def __len__(self) -> int:
        return len(self.table)

    @property
    def measures(self) -> tuple[Measure, ...]:
        """Measures of the study, in the table's order."""
        return self.study.measures

    @property
    def setups(self) -> Integers:
        """Numbers of the setups (R,)."""
        return np.asarray(self.table["setup"], dtype=np.int64)

    @property
    def done(self) -> Flags:
        """Whether each setup ran successfully (R,)."""
        return np.asarray(self.table["status"] == DONE)

    @property
    def is_marked(self) -> Flags:
        """Whether each setup has a mark (R,)."""
        return np.asarray(self.table["marks"] != "")

    def setup(self, row: int) -> Setup:
        """Return the setup of a row."""
        return self.study.space.setup(int(self.setups[row]))

    def row(self, builds: Mapping[str, str]) -> int | None:
        """Return the row of a setup, or None if it was not run."""
        found = np.flatnonzero(self.setups == self.study.space.find(builds).index)
        return int(found[0]) if found.size else None

    @property
    def baseline_row(self) -> int | None:
        """Row of the baseline; None if the study has no baseline or did not run it."""
        return self.row(self.study.baseline) if self.study.baseline else None

    def builds(self, corner: str) -> list[str]:
        """Return the build of every row (R,) at a corner."""
        return list(self.table[corner])

    def places(self, builds: Sequence[str]) -> Integers:
        """Return the positions of the builds of every row at every corner (R, corners) among some builds."""
        place = {build: number for number, build in enumerate(builds)}
        found = [[place[build] for build in self.table[corner]] for corner in self.study.corners]
        return np.array(found, dtype=np.int64).T

    def unit(self, measure: str) -> str:
        """Return a measure's SI unit."""
        return self.provenance.measure_units[measure]

    def display(self, measure: str) -> str:
        """Return the unit in which a measure is shown to this user."""
        return units.shown_unit(self.unit(measure), self.study.measure(measure).display)

    def column(self, name: str) -> Array:
        """Return a column of numbers of the table (R,); NaN where it has none."""
        return np.asarray(self.table[name], dtype=np.float64)

    def values(self, measure: str) -> Array:
        """Return a measure of every row (R,) in SI; NaN if the setup failed.

        Raises:
            InputError: There is no such measure.
        """
        if measure not in self._cache:
            self._cache[measure] = self.column(self.study.measure(measure).name)
        return self._cache[measure]

    def cost(self, name: str = "") -> Array:
        """Return the objective (R,), or a measure by its name; without an objective, its default is the first one."""
        if not name and (objective := self.objective) is not None:
            return objective
        return self.values(name or self.measures[0].name)

    def shown(self, measure: str) -> Array:
        """Return a measure of every row (R,) in its display unit."""
        return np.asarray(units.convert(self.values(measure), self.unit(measure), self.display(measure)))

    def shown_difference(self, measure: str, difference: float) -> float:
        """Return a difference between two values of a measure, given in SI, in the measure's display unit."""
        return units.conversion(self.unit(measure), self.display(measure))[0] * difference

    def factor(self, term: Term) -> float:
        """Return the factor on a measure in SI that gives a term of the objective."""
        return term.weight * self._to_unit(term)[0]

    def constant(self, term: Term) -> float:
        """Return the constant that a term of the objective has in addition, such as that of a temperature."""
        return term.weight * self._to_unit(term)[1]

    def _to_unit(self, term: Term) -> tuple[float, float]:
        return units.conversion(self.unit(term.measure), term.unit or self.unit(term.measure))

    @property
    def objective(self) -> Array | None:
        """Objective of every row (R,) (Eq 2.6); None if the study has none."""
        if not self.study.objective:
            return None
        si = {term.measure: self.unit(term.measure) for term in self.study.objective}
        rows = [t.weight * units.convert(self.values(t.measure), si[t.measure], t.unit or si[t.measure])
                for t in self.study.objective]  # fmt: skip
        return np.asarray(np.sum(rows, axis=0))

    @property
    def feasible(self) -> Flags:
        """Whether each setup ran and meets all constraints (R,) (Eq 2.3)."""
        kept = self.done
        for constraint in self.study.constraints:
            values = self.values(constraint.measure)
            kept = kept & (values >= constraint.at_least) & (values <= constraint.at_most)
        return kept

    @property
    def infeasible(self) -> int:
        """Number of setups that ran and violate a constraint."""
        return int(np.count_nonzero(self.done & ~self.feasible))

    def ranking(self, measure: str | None = None) -> Integers:
        """Return the rows of feasible setups, best first.

        Args:
            measure: Measure to rank by, lowest first; None: the objective, or the first measure if the study has none.
        """
        rows = np.flatnonzero(self.feasible)
        return np.asarray(rows[np.argsort(self.cost(measure or "")[rows], kind="stable")], dtype=np.int64)

    def rows_of(self, setups: Integers, measure: str) -> Integers:
        """Return the rows (K,) of setups, given by their numbers (K,), sorted by a measure."""
        rows = np.searchsorted(self.setups, setups)
        return np.asarray(rows[np.argsort(self.values(measure)[rows], kind="stable")], dtype=np.int64)

    @property
    def failures(self) -> tuple[tuple[Setup, str], ...]:
        """Setups that failed, each with its message."""
        return tuple((self.setup(row), self.table["message"][row]) for row in np.flatnonzero(~self.done).tolist())

    def marked(self, kind: str) -> int:
        """Return the number of setups whose marks contain a text."""
        return sum(kind in marks for marks in self.table["marks"])

    @property
    def seconds(self) -> float:
        """Worker time of all setups [s]."""
        return float(np.sum(self.table["seconds"]))

    @property
    def worst_coupling_error(self) -> float | None:
        """Largest coupling error [%]; None if none is known."""
        errors = self.table["coupling_error_percent"]
        return float(np.nanmax(errors)) if np.isfinite(errors).any() else None

    def _summary(self) -> Summary:
        ranking, total = self.ranking(), len(self.study.space)
        error = self.worst_coupling_error
        best = "none is feasible" if not ranking.size else str(self.setup(int(ranking[0])))
        return Summary.of(
            f"Study {self.study.name}",
            ("setups", f"{np.count_nonzero(self.done)} of {total} ran, {self.infeasible} violate a constraint"),
            ("corners", ", ".join(self.study.corners)),
            ("measures", some((measure.name for measure in self.measures), 3)),
            ("best", best),
            ("coupling error", "" if error is None else f"up to {error:.2g} %"),
            ("failed", str(len(self.failures) or "")),
            ("partial", "run it again with the same folder to resume" if self.partial else ""),
        )

    def to_pandas(self) -> pd.DataFrame:
        """Return a row for each setup that ran: builds, objective (if there is one), feasibility, measures in SI.

        Raises:
            MissingExtraError: pandas is not installed.
        """
        rows = np.flatnonzero(self.done)
        columns: dict[str, Any] = {c: [self.builds(c)[row] for row in rows] for c in self.study.corners}
        if self.objective is not None:
            columns["objective"] = self.objective[rows]
        columns["feasible"] = self.feasible[rows]
        columns |= {measure.name: self.values(measure.name)[rows] for measure in self.measures}
        return data_frame(columns, self.setups[rows], "setup", dict(self.provenance.measure_units))

    def to_xarray(self) -> xr.Dataset:
        """Return the measures, in SI, of each setup that ran over `setup`; the builds are coordinates.

        Raises:
            MissingExtraError: xarray is not installed.
        """
        rows, along = np.flatnonzero(self.done), ("setup",)
        variables = {m.name: (along, self.values(m.name)[rows], self.unit(m.name)) for m in self.measures}
        if self.objective is not None:
            variables["objective"] = (along, self.objective[rows], "")
        corners = {c: (along, [self.builds(c)[row] for row in rows], "") for c in self.study.corners}
        return dataset(variables, {"setup": (along, self.setups[rows], ""), **corners}, {"study": self.study.name})

    def plot(self, across: str | None = None, up: str | None = None) -> Picture:
        """Return a picture of the setups in the plane of two measures, with the best setup and the baseline.

        Args:
            across: Measure of the horizontal axis; default: the first of the objective.
            up: Measure of the vertical axis; default: the second of the objective.

        Raises:
            InputError: There is no such measure; the message suggests a similar one.
        """
        from eightpost.report.pictures import Cloud, Mark, cloud  # noqa: PLC0415 -- matplotlib takes long to load

        named = (*self.study.named_measures, *(measure.name for measure in self.measures))
        names = across or named[0], up or next((name for name in named if name != (across or named[0])), named[0])
        values = tuple(self.shown(name) for name in names)
        best, marks = self.ranking(), []
        if best.size:
            marks.append(Mark("best", int(best[0])))
        if self.baseline_row is not None:
            marks.append(Mark("baseline", self.baseline_row))
        labels = tuple(f"{name} [{self.display(name)}]" for name in names)
        shown = Cloud((values[0], values[1]), (labels[0], labels[1]), self.feasible, tuple(marks))
        return cloud(shown, title=self.study.name)

    def save(self, path: str | Path) -> None:
        """Write a Parquet file; an existing file is replaced only after the new one is complete."""
        header = _header_of(self.study, self.provenance, partial=self.partial)
        write_table(replace(self.table, schema=self.table.schema.with_metadata(header)), Path(path))

    @classmethod
    def join(
        cls, path: Path, study: Study, tables: Iterable[Table], provenance: Provenance, *, partial: bool
    ) -> StudyResult:
        """Write tables as one Parquet file, one after the other, and return it as a result.

        Args:
            path: Path of the file; an existing file is replaced only after the new one is complete.

        Raises:
            InputError: Two rows have the same setup number, or the setups are not in order.
        """
        whole = joined(tables, study_schema(study, provenance.measure_units))
        if np.any(np.diff(whole["setup"]) <= 0):
            raise InputError(f"{path}: two rows have the same setup number, or they are not in order")
        found = cls(study, whole, provenance, partial)
        found.save(path)
        return found

    @classmethod
    def load(cls, path: str | Path) -> StudyResult:
        """Read a result that `save` wrote.

        Files of the study with relative paths are also found if the current folder is not that in which it was run
        (`_with_found_files`).

        Raises:
            FileFormatError: The file does not exist, is not a study's result, or was written by a newer version.
        """
        path = Path(path)
        warn_of_earlier_results(path.parent)
        table = read_table(path, advice="name the results.parquet of a study")
        stated = _header_in(path, table)
        try:
            header = _with_found_files(stated, path.parent)
            study = Study.from_json(json.dumps(header["study"]))
            made_by = checked(Provenance, header)
            table.select(study_schema(study, made_by.measure_units))
            if table["setup"].dtype != np.int64:
                raise ValueError("a row has no setup number")
            return cls(study, table, made_by, bool(header["partial"]))
        except MALFORMED as error:
            what = f"is not a study result that this version can read ({error})"
            raise FileFormatError(what, path=path) from error
