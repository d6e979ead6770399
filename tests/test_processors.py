"""Number of processors that a process may use, also on systems that do not report it."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from eightpost.workers.process import usable_processors


def test_only_the_processors_that_this_process_may_use_count(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {3, 5, 7}, raising=False)
    assert usable_processors() == 3


@pytest.mark.parametrize(("counted", "usable"), [(4, 4), (None, 1)])
def test_all_processors_count_if_the_system_does_not_report_usable_ones(
    monkeypatch: pytest.MonkeyPatch, counted: int | None, usable: int
) -> None:
    monkeypatch.delattr(os, "sched_getaffinity", raising=False)
    monkeypatch.setattr(os, "cpu_count", lambda: counted)
    assert usable_processors() == usable


def test_no_other_file_asks_the_system() -> None:
    root = Path(__file__).parents[1]
    asking = [
        path.name
        for package in ("eightpost", "builder", "cosim", "benchmarks")
        for path in (root / package).rglob("*.py")
        if any(word in path.read_text(encoding="utf-8") for word in ("sched_getaffinity", "cpu_count"))
    ]
    assert asking == ["process.py"]
