"""Reading of files in a separate process with time and memory limits, for libraries that a damaged file can crash.

A crash of the process becomes an error that names the file. The process starts with the first such file and reads the
later ones too, so that the libraries are loaded only once; after a crash a new one starts.
"""

from __future__ import annotations

import os
import subprocess
import threading
from pathlib import Path
from typing import Any

from eightpost.errors import FileFormatError
from eightpost.files import reading
from eightpost.workers.process import Child, EndedError

#: Memory that the child may use in addition to its libraries [bytes]: a minimum, and a multiple of the file size.
MEMORY, _MEMORY_PER_BYTE = 2 * 2**30, 8
#: Time limit for one file [s], and additional time for each byte [s].
_TIME, _TIME_PER_BYTE = 60.0, 1e-6

_lock = threading.Lock()
_children: list[Child] = []


def read_confined(function: str, path: str | Path, *options: Any, kind: str) -> Any:
    """Call a function with a file in the child process, and return its result.

    Args:
        function: Module and function, `package.module:name`, called with the path and the options.
        path: Path of the file.
        options: Further arguments; they and the result must be picklable.
        kind: Expected type of file, for messages: "a MATLAB file".

    Raises:
        FileFormatError: The library cannot read the file, crashed, or exceeded the memory or time limit.
        EightpostError: An error that the function raised itself.
    """
    path = Path(path)
    with reading(path):
        size = path.stat().st_size
        path.open("rb").close()
    question = (function, str(path.absolute()), options, max(MEMORY, _MEMORY_PER_BYTE * size))
    seconds = _TIME + _TIME_PER_BYTE * size
    try:
        outcome, answer = _answer(question, seconds)
    except EndedError as error:
        how = f"took longer than {seconds:.0f} s" if error.hung else _how(error)
        what = f"not {kind}: the process that read it {how}; the file is damaged, export or copy it again"
        raise FileFormatError(what, path=path) from None
    if outcome == "refused":
        raise answer
    if outcome == "failed":
        raise FileFormatError(f"not {kind}: {answer}", path=path)
    return answer


def _answer(question: tuple[Any, ...], seconds: float) -> Any:
    """Send a request to the child. If it crashes, retry with a new child, because an earlier file may be the cause."""
    with _lock:
        used = bool(_children) and _children[0].owner == os.getpid()
        if used:
            try:
                return _children[0].ask(question, seconds)
            except EndedError as error:
                _children.clear()
                if error.hung:
                    raise
        _children[:] = [_start()]
        try:
            return _children[0].ask(question, seconds)
        except EndedError:
            _children.clear()
            raise


def _start() -> Child:
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    return Child("eightpost.confined.readers", env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def _how(error: EndedError) -> str:
    return f"ended with code {error.code}" if error.code is not None and error.code >= 0 else error.how
