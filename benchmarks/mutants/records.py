"""Records of tried mutants, one JSON line each, with which a campaign resumes where it stopped."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from pathlib import Path

from benchmarks.mutants.areas import Area
from benchmarks.mutants.mutant import Mutant
from benchmarks.mutants.trial import Outcome


@dataclass(frozen=True)
class Record:
    """A mutant that was tried."""

    key: str  #: Key of the mutant.
    area: str  #: Name of the area.
    file: str  #: Path relative to the root of the checkout.
    line: int  #: Line number of the change, from 1.
    outcome: Outcome  #: Result for the mutant.
    seconds: float  #: Duration of the trial [s].
    tests: str  #: Digest of the tests that were run.
    diff: str  #: The change as a patch.
    note: str = ""  #: Reason why a mutant is equivalent, or the first test that detected it.

    @classmethod
    def of(cls, mutant: Mutant, outcome: Outcome, *, seconds: float = 0.0, tests: str = "", note: str = "") -> Record:
        """Return the record of a mutant."""
        place = (mutant.key, mutant.area, mutant.file, mutant.line)
        return cls(*place, outcome, round(seconds, 1), tests, mutant.diff, note)


def digest_of_tests(area: Area, root: Path) -> str:
    """Return a digest of the tests of an area and their fixtures in a checkout."""
    digest = hashlib.sha256("\0".join(area.tests).encode())
    paths = {root / test.partition("::")[0] for test in area.tests}
    for path in sorted(path for path in paths if path.exists()):
        for file in sorted(path.rglob("*.py")) if path.is_dir() else [path, *path.parent.glob("conftest.py")]:
            digest.update(file.read_bytes())
    return digest.hexdigest()[:16]


def read_records(path: Path) -> dict[str, Record]:
    """Return the last record of each mutant by its key."""
    if not path.exists():
        return {}
    lines = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    return {line["key"]: Record(**line | {"outcome": Outcome(line["outcome"])}) for line in lines}


def append_record(path: Path, record: Record) -> None:
    """Add a record to a file."""
    with path.open("a", encoding="utf-8") as file:
        file.write(json.dumps(asdict(record)) + "\n")
