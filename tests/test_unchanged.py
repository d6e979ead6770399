"""Kept results: what tests/unchanged.py notices."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from tests.unchanged import differences, lines_of, text_of_page


@dataclass
class _Record:
    name: str
    values: np.ndarray


def test_a_record_is_kept_by_its_parts(unchanged: Callable[..., None]) -> None:
    unchanged({"record": _Record("A", np.linspace(0.0, 1.0, 101)), "short": np.array([1.0, -2.5]), "none": None})


@pytest.mark.parametrize(
    ("kept", "now", "equal"),
    [
        ("force 12.5 N", "force 12.51 N", True),
        ("force 12.5 N", "force 12.52 N", False),
        ("(20,) min -4 max 2 mean 1e-5", "(20,) min -4 max 2 mean 3e-3", True),
        ("(20,) min -4 max 2 mean 1e-5", "(20,) min -4 max 2 mean 5e-3", False),
        ("force 4 N and 1e-5 N", "force 4 N and 3e-3 N", False),
        ("offset 1e-12", "offset -3e-11", True),
        ("2 of 3 runs", "2 of 3 sweeps", False),
        ("one\ntwo", "one", False),
        ("one", "one\ntwo", False),
    ],
)
def test_a_word_and_a_number_are_noticed_and_rounding_is_not(kept: str, now: str, equal: bool) -> None:
    assert (differences(kept, now) == []) == equal


def test_dates_folders_and_durations_are_not_kept() -> None:
    texts = ("written 2026-11-29 12:00 to /tmp/a/x.json (3.2 s)", "written 2026-11-30 09:31 to /b/x.json (8.0 s)")
    assert len({line for text in texts for line in lines_of(text)}) == 1


def test_a_page_is_kept_as_its_words_without_style_and_script() -> None:
    page = '<h1 title="of the car">Forces</h1><style>p {x}</style><script>var a</script><p>front <a href="#b">left</a>'
    assert text_of_page(page).splitlines() == ["Forces [of the car]", "front", "left [#b]"]


def test_a_result_of_another_kind_is_refused_with_its_name() -> None:
    with pytest.raises(TypeError, match=r"model\.function is a "):
        list(lines_of({"model": {"function": len}}))
