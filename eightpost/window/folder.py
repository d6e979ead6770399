"""The folder that the window works in: records dropped onto it, and what the commands wrote."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from eightpost.errors import InputError
from eightpost.files import document_kind, json_content, write_text
from eightpost.schema import checked
from eightpost.signals.formats import SUFFIXES

#: Folders of the files that people drop, by their kind.
DROPPED = ("dyno", "rig", "tracks")

#: Characters of a file's name that are kept; the others become an underscore.
_NAME = re.compile(r"[^\w.+ -]+")


@dataclass(frozen=True)
class _Reading:
    """How a record is read."""

    flip: tuple[str, ...] = ()
    map: str = ""


@dataclass(frozen=True)
class _State:
    """Entries of window.json."""

    readings: dict[str, _Reading] = field(default_factory=dict)


@dataclass
class Folder:
    """A folder of work, which may already contain files; nothing in it is hidden from the terminal."""

    path: Path  #: The folder.
    #: Reading of each record by its path in the folder: `flip`, the channels whose sign is changed, and `map`, the
    #: channel map in the folder.
    readings: dict[str, dict[str, Any]] = field(default_factory=dict)

    @classmethod
    def opened(cls, path: Path) -> Folder:
        """Open a folder, which is made if it does not exist.

        Raises:
            InputError: It is a file, or its `window.json` is damaged.
        """
        if path.exists() and not path.is_dir():
            raise InputError(f"{path} is a file; name a folder for your files")
        for name in ("", *DROPPED):
            (path / name).mkdir(parents=True, exist_ok=True)
        state = path / "window.json"
        content = json_content(state, advice="delete it") if state.is_file() else {}
        checked(_State, content, path=state)
        return cls(path.resolve(), content.get("readings", {}))

    def place(self, kind: str, name: str) -> Path:
        """Return the path for a dropped file; an existing one with another content keeps its place."""
        clean = _NAME.sub("_", Path(name.replace("\\", "/")).name).strip(". ") or "file"
        path = self.path / kind / clean
        number = 2
        while path.exists():
            path = path.with_name(f"{Path(clean).stem} {number}{Path(clean).suffix}")
            number += 1
        return path

    def records(self, kind: str) -> list[Path]:
        """Return the records of a kind, by name."""
        files = (self.path / kind).iterdir()
        return sorted(file for file in files if file.suffix.lower() in SUFFIXES and file.is_file())

    def documents(self, kind: str) -> list[Path]:
        """Return the shock or vehicle files (`shock`, `vehicle`) of the folder and its folders, by name."""
        files = sorted([*self.path.glob("*.json"), *self.path.glob("shocks/*.json")])
        found = [file for file in files if _kind(file) == kind]
        cars = sorted(self.path.glob("*.toml")) if kind == "vehicle" else []
        return found + [file for file in cars if _table(file) == "vehicle"]

    def drives(self) -> dict[str, str]:
        """Return what can drive a car by path in the folder: drive files, and rig records with roads and loads."""
        return {self.name(path): path.name for kind in ("tracks", "rig") for path in self.records(kind)}

    def reading(self, record: Path) -> dict[str, Any]:
        """Return how a record is read: arguments of `ep.read`."""
        stated = self.readings.get(self.name(record), {})
        given = {"channel_map": self.path / stated["map"]} if stated.get("map") else {}
        return given | ({"flip": tuple(stated["flip"])} if stated.get("flip") else {})

    def read_as(self, record: Path, **changes: Any) -> None:
        """Change how a record is read, and keep it in the folder's `window.json`."""
        name = self.name(record)
        self.readings[name] = {**self.readings.get(name, {}), **changes}
        write_text(self.path / "window.json", json.dumps({"readings": self.readings}, indent=1))

    def words(self, records: list[Path]) -> list[str]:
        """Return the options with which a command reads records.

        Raises:
            InputError: They are read in different ways.
        """
        ways = {json.dumps(self.readings.get(self.name(record), {}), sort_keys=True) for record in records}
        if len(ways) > 1:
            raise InputError("these files have different channel names or signs; take them one after the other")
        given: dict[str, Any] = json.loads(ways.pop()) if ways else {}
        stated = [*(f"{channel}=-" for channel in given.get("flip", ())), given.get("map")]
        return [word for text in stated if text for word in ("--channel", text)]

    def name(self, path: Path) -> str:
        """Return a file's path in the folder, with slashes."""
        return path.resolve().relative_to(self.path).as_posix()

    def served(self, name: str) -> Path | None:
        """Return the file with a path in the folder; None if it does not exist, or is outside."""
        path = (self.path / name).resolve()
        return path if path.is_relative_to(self.path) and path.is_file() else None


def quoted(text: object) -> str:
    """Return a text in the form of a TOML file, with its quotes."""
    return json.dumps(str(text), ensure_ascii=False)


def _table(file: Path) -> str:
    from eightpost.api.reading import toml_kind

    try:
        return toml_kind(file)
    except (InputError, OSError):
        return ""


def _kind(file: Path) -> str:
    try:
        return document_kind(file) or ""
    except (InputError, OSError):
        return ""
