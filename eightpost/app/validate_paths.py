"""Common parts of `eightpost validate` for shocks and vehicles: kinds of files, options by file, tables."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from eightpost.errors import InputError
from eightpost.files import document_kind
from eightpost.report.console import result_table
from eightpost.report.tables import ResultTable

if TYPE_CHECKING:
    from collections.abc import Iterable

    from rich.console import Console

#: Suffixes of the records that are read from a folder.
_RECORDS = {".csv", ".txt", ".parquet", ".mat", ".mf4", ".mdf"}


@dataclass(frozen=True, slots=True)
class RecordChoices:
    """Records that an option may address one by one or all together.

    Attributes:
        records: Files of the records.
    """

    records: list[Path]

    def of(self, words: Iterable[str], option: str) -> dict[Path, str]:
        """Return a value for each record from `VALUE` (for all) and `FILE=VALUE`; the value of a file has priority."""
        chosen: dict[Path, str] = {}
        for word in sorted(words, key=lambda word: "=" in word):
            name, equals, value = word.rpartition("=")
            matching = [path for path in self.records if not equals or name in (str(path), path.name, path.stem)]
            if not matching:
                known = ", ".join(path.name for path in self.records)
                raise click.BadParameter(f"{name!r} is not one of the records: {known}", param_hint=option)
            chosen |= dict.fromkeys(matching, value)
        return chosen


def sorted_paths(paths: Iterable[Path]) -> tuple[list[Path], list[Path]]:
    """Return the models (.json) and the records among paths, with the records of folders.

    Raises:
        InputError: There is no model, or no record.
    """
    models: list[Path] = []
    records: list[Path] = []
    for path in paths:
        if path.is_dir():
            records += sorted(file for file in path.iterdir() if file.suffix.lower() in _RECORDS)
        elif path.suffix.lower() == ".json":
            models.append(path)
        else:
            records.append(path)
    if not models:
        raise InputError(
            "no shock file and no vehicle among the arguments; create one with `eightpost fit DYNO -o shock.json` or "
            "`eightpost identify RIG -o vehicle.json`"
        )
    if not records:
        raise InputError("no record among the arguments; name dynamometer or rig files, or a folder of them")
    return models, records


def is_vehicle(models: list[Path]) -> bool:
    """Return whether the models are vehicles, by the kind that the files state.

    Raises:
        InputError: There are both shocks and vehicles, or several vehicles.
    """
    vehicles = [path for path in models if document_kind(path) == "vehicle"]
    if vehicles and len(models) > 1:
        raise InputError(
            f"{vehicles[0]} is a vehicle: validate it alone; give shocks at its ports as --shock lf=SHOCK.json, and "
            "another car to compare modes with as --against CAR.json"
        )
    return bool(vehicles)


def show_table(console: Console, table: ResultTable) -> None:
    """Print a table in the units of the field (in/s, lbf); an empty table is not printed."""
    if table.rows:
        console.print(result_table(table))
