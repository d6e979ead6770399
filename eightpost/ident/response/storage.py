"""Frequency responses from and to files: arrays in one .npz file, with a JSON header that says what they are."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from eightpost import __version__
from eightpost.errors import FileFormatError
from eightpost.files import atomic_path
from eightpost.ident.response.frequency_response import FrequencyResponse
from eightpost.vehicle.statespace import Channel

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

#: The newest layout of these files that is understood, and the one written.
SCHEMA = 1

_ARRAYS = ("frequency", "H", "coherence", "partial_coherence", "variance")


def write_response(path: str | Path, response: FrequencyResponse, *, sources: Mapping[str, str] | None = None) -> None:
    """Write a frequency response; what was at `path` is replaced only once the new file is whole.

    Args:
        path: A .npz file.
        response: What to write.
        sources: SHA-256 digest by name of each file that it was estimated from.
    """
    _check_suffix(Path(path))
    header = {
        "kind": "frequency_response",
        "schema": SCHEMA,
        "tool": f"eightpost {__version__}",
        "inputs": [{"name": channel.name, "unit": channel.unit} for channel in response.inputs],
        "outputs": [{"name": channel.name, "unit": channel.unit} for channel in response.outputs],
        "sources": dict(sources or {}),
    }
    arrays: dict[str, NDArray[Any]] = {name: getattr(response, name) for name in _ARRAYS}
    with atomic_path(path) as temporary:
        given: dict[str, Any] = {name: values for name, values in arrays.items() if values is not None}
        np.savez_compressed(temporary, header=np.array(json.dumps(header)), **given)


def read_response(path: str | Path) -> FrequencyResponse:
    """Read a frequency response; it equals what was written to the last bit.

    Raises:
        FileFormatError: No such file, no frequency response, or one of a newer schema.
    """
    path = Path(path)
    _check_suffix(path)
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as content:
            members = {name: content[name] for name in content.files}
        header = json.loads(str(members["header"]))
    except FileNotFoundError:
        raise FileFormatError("there is no such file", path=path) from None
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise FileFormatError(f"is no frequency response of ours ({error})", path=path) from error
    _check_header(path, header)
    try:
        return _response(header, members)
    except (KeyError, TypeError, ValueError) as error:
        raise FileFormatError(
            f"does not hold a frequency response as this version writes it ({error})", path=path
        ) from error


def _response(header: dict[str, Any], members: dict[str, NDArray[Any]]) -> FrequencyResponse:
    inputs, outputs = (
        tuple(Channel(channel["name"], channel["unit"]) for channel in header[side]) for side in ("inputs", "outputs")
    )
    optional = [members.get(name) for name in _ARRAYS[2:]]
    return FrequencyResponse(members["frequency"], members["H"], inputs, outputs, *optional)


def _check_suffix(path: Path) -> None:
    if path.suffix.lower() != ".npz":
        raise FileFormatError("a frequency response is a .npz file; name it so", path=path)


def _check_header(path: Path, header: Any) -> None:
    if not isinstance(header, dict) or header.get("kind") != "frequency_response":
        raise FileFormatError("is no frequency response of ours: its header says something else", path=path)
    schema = header.get("schema")
    if not isinstance(schema, int) or schema > SCHEMA:
        raise FileFormatError(
            f"it has schema {schema} (written by {header.get('tool', '?')}), this eightpost {__version__} reads up "
            f"to {SCHEMA}; update eightpost",
            path=path,
        )
