"""Files of frequency responses: arrays in one .npz file, with a JSON header that describes them."""

from __future__ import annotations

import io
import json
import math
import tokenize
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from eightpost import __version__
from eightpost.archive import read_archive
from eightpost.errors import FileFormatError, FmuError
from eightpost.files import MALFORMED, atomic_path, parse_json
from eightpost.ident.response.frequency_response import FrequencyResponse
from eightpost.vehicle.statespace import Channel

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

#: Newest schema of these files that can be read; it is also the one that is written.
SCHEMA = 1

_ARRAYS = ("frequency", "H", "coherence", "partial_coherence", "variance")


def write_response(path: str | Path, response: FrequencyResponse, *, sources: Mapping[str, str] | None = None) -> None:
    """Write a frequency response; an existing file is replaced only when the new one is complete.

    Args:
        path: Path of the .npz file.
        response: Frequency response to write.
        sources: SHA-256 digest by name of each file that the response was estimated from.
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
    """Read a frequency response; it is bitwise equal to the one that was written.

    Raises:
        FileFormatError: The file does not exist, is not a frequency response, or has a newer schema.
    """
    path = Path(path)
    _check_suffix(path)
    members = _arrays(path)
    if "header" not in members:
        raise FileFormatError("is not a frequency response of eightpost: it has no header", path=path)
    header = parse_json(str(members["header"]), path)
    _check_header(path, header)
    try:
        return _response(header, members)
    except MALFORMED as error:
        raise FileFormatError(
            f"does not contain a frequency response in the format of this version ({error})", path=path
        ) from error


def _arrays(path: Path) -> dict[str, NDArray[Any]]:
    """Return the arrays of a .npz file by name."""
    try:
        contents = read_archive(path)
    except FmuError as error:
        what = f"is not a frequency response of eightpost ({error.__cause__ or error})"
        raise FileFormatError(what, path=path) from error
    try:
        return {name.removesuffix(".npy"): _array(content) for name, content in contents.items()}
    except _DAMAGE as error:
        raise FileFormatError(f"is not a frequency response of eightpost ({error})", path=path) from error


#: Exceptions that numpy raises for damaged arrays.
_DAMAGE = (ValueError, TypeError, EOFError, SyntaxError, LookupError, OverflowError, MemoryError, RecursionError,
           tokenize.TokenError)  # fmt: skip


def _array(content: bytes) -> NDArray[Any]:
    """Return an array after a check of the size in its header, because numpy allocates memory before it reads."""
    stream = io.BytesIO(content)
    version = np.lib.format.read_magic(stream)
    head = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}[version]
    shape, _, kind = head(stream)
    if kind.hasobject or math.prod(shape) * kind.itemsize != len(content) - stream.tell():
        raise ValueError("an array does not have the size in its header, or contains objects")
    stream.seek(0)
    return np.lib.format.read_array(stream, allow_pickle=False)


def _response(header: dict[str, Any], members: dict[str, NDArray[Any]]) -> FrequencyResponse:
    inputs, outputs = (
        tuple(Channel(channel["name"], channel["unit"]) for channel in header[side]) for side in ("inputs", "outputs")
    )
    optional = [members.get(name) for name in _ARRAYS[2:]]
    return FrequencyResponse(members["frequency"], members["H"], inputs, outputs, *optional)


def _check_suffix(path: Path) -> None:
    if path.suffix.lower() != ".npz":
        raise FileFormatError("the name of a frequency response file must end in .npz", path=path)


def _check_header(path: Path, header: Any) -> None:
    if not isinstance(header, dict) or header.get("kind") != "frequency_response":
        raise FileFormatError("is not a frequency response of eightpost: its header has another kind", path=path)
    schema = header.get("schema")
    if not isinstance(schema, int) or schema > SCHEMA:
        raise FileFormatError(
            f"it has schema {schema} (written by {header.get('tool', '?')}), but this eightpost {__version__} reads "
            f"up to {SCHEMA}; update eightpost",
            path=path,
        )
