"""Records that models are validated on, and the kinds of tests that they contain."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

from eightpost.errors import InputError
from eightpost.files import document_kind

Kind = Literal["random", "sine", "static", "bump"]
KINDS: tuple[Kind, ...] = get_args(Kind)

#: Share of the time at standstill from which a record is a static test or a bump.
STANDING = 0.5


@dataclass(frozen=True, slots=True)
class Recognition:
    """Kind of a record, with the reason for it."""

    kind: Kind  #: `random` (track records too), `sine`, `static` or `bump`.
    reason: str  #: Property of the motion or of the drive that led to this kind.
    frequency: float | None = None  #: Frequency of a sine [Hz]; None for the other kinds.


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Record:
    """A record for validation."""

    name: str  #: Display name.
    kind: Kind  #: Kind of the test.
    reason: str  #: Reason for the kind.
    frequency: float | None = None  #: Frequency of a sine [Hz], if it was recognised as one.
    digest: str  #: SHA-256 of the file, or of the samples; empty without one.


# ---- Files of models and of records ---------------------------------------------------------------------------------

#: Suffixes of the records that are read from a folder.
_RECORDS = {".csv", ".txt", ".parquet", ".mat", ".mf4", ".mdf"}


def models_and_records(paths: Iterable[Path]) -> tuple[list[Path], list[Path]]:
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
