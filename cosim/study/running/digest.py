"""Digest of a study: it covers everything that affects the results, and nothing else."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

from cosim.study.study import Study
from eightpost import __version__
from eightpost.files import sha256_of

#: Entries that do not affect the results: they are applied to the table afterwards.
_AFTER = ("name", "objective", "constraints")


def file_digests(study: Study) -> dict[str, str]:
    """Return SHA-256 of every file that a study reads, by its path."""
    return {str(path): sha256_of(path) for path in file_paths(study)}


def file_paths(study: Study) -> list[Path]:
    """Return every file that a study reads: FMUs, drive files, channel maps, user-defined measures."""
    files = [study.vehicle.fmu, *(build.fmu for build in study.bank.values())]
    for drive in study.drives:
        files += [drive.file, *([drive.channel_map] if drive.channel_map else [])]
    own = [Path(measure.function.rpartition(":")[0]) for measure in study.measures if measure.function]
    return list(dict.fromkeys([*files, *own]))


def study_digest(study: Study, digests: dict[str, str]) -> str:
    """Return the digest of a study; it depends on the contents of files, not on their paths."""
    document = json.loads(study.to_json())
    for name in _AFTER:
        del document[name]
    document = _without_paths(document, digests)
    text = json.dumps({"study": document, "tool": __version__}, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def _without_paths(value: Any, digests: dict[str, str]) -> Any:
    """Return a value with the digest in place of every path, also in the functions of user-defined measures."""
    if isinstance(value, dict):
        return {key: _without_paths(one, digests) for key, one in value.items()}
    if isinstance(value, list):
        return [_without_paths(one, digests) for one in value]
    if isinstance(value, str):
        file, colon, name = value.rpartition(":")
        return digests.get(value) or (f"{digests[file]}{colon}{name}" if file in digests else value)
    return value
