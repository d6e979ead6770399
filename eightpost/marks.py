"""Names of temporary files and folders that tell whether their process still runs, so that what is left is removed."""

from __future__ import annotations

import os
import re
import shutil
import socket
import sys
import time
import uuid
import zlib
from contextlib import suppress
from functools import cache
from pathlib import Path

#: A mark: the machine, the process on it, and a random number.
_MARK = r"(?P<machine>[0-9a-f]{8})-(?P<process>\d+)-[0-9a-f]{8}"


#: Trials to remove a folder, and the time between them [s].
_TRIALS, _PAUSE = 20, 0.05


def mark() -> str:
    """Return a text for the name of a temporary file or folder of this process."""
    return f"{_machine()}-{os.getpid()}-{uuid.uuid4().hex[:8]}"


def remove_left(folder: Path, before: str, after: str = "") -> None:
    """Remove the files and folders `before` + mark + `after` in a folder whose process has ended on this machine.

    Those of other machines, which may share the folder, stay; on Windows all stay.
    """
    if sys.platform == "win32":
        return
    name = re.compile(re.escape(before) + _MARK + re.escape(after))
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            found = name.fullmatch(entry.name)
            if found and found["machine"] == _machine() and not _runs(int(found["process"])):
                with suppress(OSError):  # of another user, or removed by another process at the same time
                    shutil.rmtree(entry.path) if entry.is_dir(follow_symlinks=False) else Path(entry.path).unlink()


def remove_folder(folder: Path) -> None:
    """Remove a temporary folder into which other processes write until they notice that their parent has ended."""
    with suppress(OSError):  # with another name, nothing new is created in it
        folder = folder.rename(folder.with_name(f"eightpost_{mark()}"))
    for _ in range(_TRIALS):
        shutil.rmtree(folder, ignore_errors=True)
        if not folder.exists():
            return
        time.sleep(_PAUSE)


@cache
def _machine() -> str:
    return f"{zlib.crc32(socket.gethostname().encode()):08x}"


def _runs(process: int) -> bool:
    """Return whether a process runs: it exists, and is not one that ended and waits for its parent."""
    with suppress(OSError):  # Linux alone has this file
        return Path(f"/proc/{process}/stat").read_text(encoding="ascii", errors="replace").rpartition(") ")[2][0] != "Z"
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:  # it is of another user
        return True
    return True
