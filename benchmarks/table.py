"""What the benchmarks share: command lines, draws, tables and their numbers, other versions, what differs in runs."""

from __future__ import annotations

import argparse
import re
import subprocess
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]

#: What differs between two runs of the same code: dates, versions, folders, identifiers and digests, durations.
OF_THIS_RUN = re.compile(
    r"\d{4}-\d\d-\d\d([T ][\d:.]+(Z|[+-]\d\d:\d\d)?)?|\b\d+\.\d+\.\d+\b"
    r"|\{?[0-9a-f]{8}(-?[0-9a-f]{4}){3}-?[0-9a-f]{12}\}?|\b(?=\d*[a-f])[0-9a-f]{12,64}\b"
    r"|\b\d+(\.\d+)? s (?=of processor time)|(?<=\()\d+\.\d+ s(?=\))|\b\d+:\d\d:\d\d\b"
    r"|(?<![<\w])/([\w.+-]+/)+"
)


def parser_of(page: str | None) -> argparse.ArgumentParser:
    """Return the parser of a command line whose help is a module's docstring."""
    return argparse.ArgumentParser(description=page, formatter_class=argparse.RawDescriptionHelpFormatter)


def log_uniform(random: np.random.Generator, low: float, high: float) -> float:
    """Return a number whose logarithm is uniform between two bounds."""
    return float(np.exp(random.uniform(np.log(low), np.log(high))))


def markdown(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table."""
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (heads, ["---"] * len(heads), *rows))


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
