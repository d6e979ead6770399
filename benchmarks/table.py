"""What the benchmarks share: numbers in the tables that they print, and other versions of this checkout."""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def number(value: float | None, digits: int = 3) -> str:
    """Return a number as text with a few significant digits."""
    if value is None:
        return "-"
    return f"{value:.0f}" if abs(value) >= 10**digits else f"{value:.{digits}g}"


@contextmanager
def checked_out(commit: str) -> Iterator[Path | None]:
    """Provide a commit of this repository in a temporary worktree; None without a commit."""
    with tempfile.TemporaryDirectory() as name:
        git = ["git", "-C", str(ROOT), "worktree"]
        place = f"{name}/checkout"
        if not commit:
            yield None
            return
        subprocess.run([*git, "add", "--detach", place, commit], check=True, capture_output=True)
        try:
            yield Path(place)
        finally:
            subprocess.run([*git, "remove", "--force", place], check=True, capture_output=True)
