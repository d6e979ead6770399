"""Table of a study in a Parquet file: its columns, its header with the provenance of the values, its row groups."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pyarrow.compute
import pyarrow.parquet
from pydantic import with_config

from cosim.study.definition import Setup, Study, Term
from cosim.study.measures import AboveBand, Measure
from eightpost import __version__, units
from eightpost.array_types import Array, Flags, Integers
from eightpost.completion import warn_of_earlier_results
from eightpost.display import Summarized, Summary, some
from eightpost.errors import FileFormatError, InputError
from eightpost.files import MALFORMED, atomic_path, check_schema, parse_json
from eightpost.labelled import data_frame, dataset
from eightpost.schema import REPORT, checked
from eightpost.signals.parquet_file import parquet_size, read_columns, read_table

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from eightpost.report.pictures import Picture

# ---- The file: written row group by row group, read column by column ------------------------------------------------

#: Largest size of a table that is read into memory as a whole [bytes]; larger ones are read column by column.
IN_MEMORY = 32 * 2**20

#: Size of a cell of a table in memory [bytes].
_CELL = 8


@dataclass(frozen=True, slots=True)
class StoredTable:
    """Table in a Parquet file, of which each column is read when it is asked for.

    It has those attributes of a pyarrow.Table that the study uses.
    """

    path: Path  #: Path of the file.
    schema: pa.Schema  #: Columns, and metadata of the file.
    num_rows: int  #: Number of rows.
    #: Size of the file [bytes] and time of its last change [ns], by which a replaced file is noticed.
    size: tuple[int, int]

    @property
    def column_names(self) -> list[str]:
        """Names of the columns."""
        names: list[str] = self.schema.names
        return names

    def __getitem__(self, name: str) -> pa.ChunkedArray:
        """Read a column.

        Raises:
            FileFormatError: The file was replaced or removed since it was opened, or is damaged.
            KeyError: There is no such column.
        """
        if name not in self.schema.names:
            raise KeyError(name)
        return self._read([name])[name]

    def take(self, rows: object) -> pa.Table:
        """Return some rows of all columns."""
        return self.read().take(rows)

    def read(self) -> pa.Table:
        """Return the whole table."""
        return self._read(None)

    def _read(self, names: list[str] | None) -> pa.Table:
        if not self.path.is_file() or _identity(self.path) != self.size:
            raise FileFormatError("was replaced or removed while it was used; run the command again", path=self.path)
        return read_columns(self.path, names)


def open_table(path: Path, *, advice: str = "name the results.parquet of a study") -> pa.Table | StoredTable:
    """Return a table with its metadata: in memory if it is small, else column by column.

    Raises:
        FileFormatError: The file does not exist, or is not a Parquet file.
    """
    size = _identity(path) if path.is_file() else (0, 0)
    schema, rows = parquet_size(path, advice=advice)
    if rows * len(schema) * _CELL <= IN_MEMORY:
        return read_table(path, advice=advice)
    return StoredTable(path, schema, rows, size)


def _write_tables(path: Path, schema: pa.Schema, tables: Iterable[pa.Table]) -> None:
    """Write tables as row groups of one file, one after the other; an existing file is replaced when it is complete.

    Raises:
        InputError: Two rows have the same setup number, or the setups are not in order.
    """
    last = -1
    with atomic_path(path) as temporary, pyarrow.parquet.ParquetWriter(temporary, schema, compression="zstd") as writer:
        for table in tables:
            numbers = np.concatenate([[last], table["setup"].to_numpy()])
            if np.any(np.diff(numbers) <= 0):
                raise InputError(f"{path}: two rows have the same setup number, or they are not in order")
            last = int(numbers[-1])
            writer.write_table(table.replace_schema_metadata(schema.metadata))


def _identity(path: Path) -> tuple[int, int]:
    found = path.stat()
    return found.st_size, found.st_mtime_ns


# ---- Columns --------------------------------------------------------------------------------------------------------

#: Values of the column `status`.
DONE, FAILED = "done", "failed"

#: Names of the columns before and after those of corners and measures.
HEAD, TAIL = ("setup",), ("status", "message", "coupling_error_percent", "marks", "seconds")


def error_column(measure: str) -> str:
    """Return the name of the column with the coupling error of a measure, in the measure's SI unit."""
    return f"coupling error of {measure}"


def study_schema(study: Study, measure_units: Mapping[str, str]) -> pa.Schema:
    """Return the columns of a study's table."""
    tail = {"coupling_error_percent": pa.float64(), "seconds": pa.float64()}
    measures, errors = [], []
    for m in study.measures:
        words = {"unit": measure_units[m.name], "display": m.display or measure_units[m.name], "label": m.name}
        name = error_column(m.name)
        measures.append(pa.field(m.name, pa.float64(), metadata=words))
        errors.append(pa.field(name, pa.float64(), metadata=words | {"label": name}))
    fields = [pa.field("setup", pa.int64()), *(pa.field(corner, pa.string()) for corner in study.corners), *measures]
    return pa.schema([*fields, *(pa.field(name, tail.get(name, pa.string())) for name in TAIL), *errors])


def result_table(rows: Sequence[Mapping[str, Any]], schema: pa.Schema) -> pa.Table:
    """Return rows, given by column name, as a table sorted by setup number.

    Raises:
        InputError: Two rows have the same setup number.
    """
    table = pa.Table.from_pylist(list(rows), schema=schema).sort_by("setup")
    numbers = table["setup"].to_numpy()
    if np.unique(numbers).size < numbers.size:
        raise InputError("two rows have the same setup number")
    return table


def _check_columns(table: pa.Table | StoredTable, schema: pa.Schema) -> None:
    """Check that a table has the columns of a schema, and that every row has a setup number.

    Raises:
        ValueError: A column is missing or has another type, or a row has no setup number.
    """
    for column in schema:
        if column.name not in table.column_names:
            raise ValueError(f"the column {column.name!r} is missing")
        if not table.schema.field(column.name).type.equals(column.type):
            raise ValueError(f"the column {column.name!r} does not have the type {column.type}")
    if table["setup"].null_count:
        raise ValueError("a row has no setup number")


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


def _header_of(study: Study, provenance: Provenance, *, partial: bool) -> dict[bytes, str]:
    header = {
        "schema": "eightpost.study",
        "schema_version": SCHEMA,
        **asdict(provenance),
        "partial": partial,
        "study": json.loads(study.to_json()),
    }
    return {_KEY: json.dumps(header)}


def _header_in(path: Path, table: pa.Table | StoredTable) -> dict[str, Any]:
    """Return the header of a file.

    Raises:
        FileFormatError: The file is not a study's result, or was written by a newer version.
    """
    metadata = table.schema.metadata or {}
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
    #: One row per setup, by number; a large table is read from its file column by column.
    table: pa.Table | StoredTable
    provenance: Provenance  #: Provenance of the values.
    partial: bool = False  #: Whether setups are missing because the study was interrupted.
    _cache: dict[str, Array] = field(default_factory=dict, repr=False)

    def __len__(self) -> int:
        return int(self.table.num_rows)

    @property
    def measures(self) -> tuple[Measure, ...]:
        """Measures of the study, in the table's order."""
        return self.study.measures

    @property
    def setups(self) -> Integers:
        """Numbers of the setups (R,)."""
        return np.asarray(self.table["setup"].to_numpy(), dtype=np.int64)

    @property
    def done(self) -> Flags:
        """Whether each setup ran successfully (R,)."""
        return self._flags(pa.compute.equal(self.table["status"], DONE))

    @property
    def is_marked(self) -> Flags:
        """Whether each setup has a mark (R,)."""
        return self._flags(pa.compute.not_equal(self.table["marks"], ""))

    @staticmethod
    def _flags(column: pa.ChunkedArray) -> Flags:
        return np.asarray(column.fill_null(False).to_numpy(), dtype=np.bool_)

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
        names, places = self._coded(corner)
        return [names[place] for place in places.tolist()]

    def places(self, builds: Sequence[str]) -> Integers:
        """Return the positions of the builds of every row at every corner (R, corners) among some builds."""
        found = np.empty((len(self), len(self.study.corners)), dtype=np.int64)
        for column, corner in enumerate(self.study.corners):
            names, places = self._coded(corner)
            found[:, column] = np.array([builds.index(name) for name in names], dtype=np.int64)[places]
        return found

    def _coded(self, corner: str) -> tuple[list[str], Integers]:
        """Return the different builds at a corner, and the position of each row's build among them (R,)."""
        column = self.table[corner].combine_chunks().dictionary_encode()
        return column.dictionary.to_pylist(), np.asarray(column.indices.to_numpy(), dtype=np.int64)

    def unit(self, measure: str) -> str:
        """Return a measure's SI unit."""
        return self.provenance.measure_units[measure]

    def display(self, measure: str) -> str:
        """Return the unit in which a measure is shown to this user."""
        return units.shown_unit(self.unit(measure), self.study.measure(measure).display)

    def column(self, name: str) -> Array:
        """Return a column of numbers of the table (R,); NaN where it has none."""
        return np.asarray(self.table[name].to_numpy(zero_copy_only=False), dtype=np.float64)

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
        messages = self.table["message"]
        return tuple((self.setup(row), messages[row].as_py()) for row in np.flatnonzero(~self.done).tolist())

    def marked(self, kind: str) -> int:
        """Return the number of setups whose marks contain a text."""
        found = pa.compute.match_substring(self.table["marks"], kind)
        return int(np.count_nonzero(self._flags(found)))

    @property
    def seconds(self) -> float:
        """Worker time of all setups [s]."""
        return float(np.sum(self.table["seconds"].to_numpy()))

    @property
    def worst_coupling_error(self) -> float | None:
        """Largest coupling error [%]; None if none is known."""
        errors = self.table["coupling_error_percent"].drop_null().to_numpy()
        return float(errors.max()) if errors.size else None

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
        whole = self.table.read() if isinstance(self.table, StoredTable) else self.table
        table = whole.replace_schema_metadata(_header_of(self.study, self.provenance, partial=self.partial))
        with atomic_path(path) as temporary:
            pyarrow.parquet.write_table(table, temporary, compression="zstd")

    @classmethod
    def join(
        cls, path: Path, study: Study, tables: Iterable[pa.Table], provenance: Provenance, *, partial: bool
    ) -> StudyResult:
        """Write tables as one Parquet file, one after the other, and return it as a result.

        Args:
            path: Path of the file; an existing file is replaced only after the new one is complete.

        Raises:
            InputError: Two rows have the same setup number.
        """
        schema = study_schema(study, provenance.measure_units)
        _write_tables(path, schema.with_metadata(_header_of(study, provenance, partial=partial)), tables)
        return cls(study, open_table(path), provenance, partial)

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
        table = open_table(path)
        stated = _header_in(path, table)
        try:
            header = _with_found_files(stated, path.parent)
            study = Study.from_json(json.dumps(header["study"]))
            made_by = checked(Provenance, header)
            _check_columns(table, study_schema(study, made_by.measure_units))
            return cls(study, table, made_by, bool(header["partial"]))
        except (pa.ArrowException, *MALFORMED) as error:
            what = f"is not a study result that this version can read ({error})"
            raise FileFormatError(what, path=path) from error
