"""What a page of a run or of a study contains, for kept results: its words, numbers and drawings."""

from __future__ import annotations

import platform
from typing import Any

import lxml.html
import numpy as np
import pytest

from cosim.report.page import versions

from ..unchanged import text_of_page


class KeptStore:
    """A store of a page's arrays that keeps them as they are: each is found by its position in the list."""

    def __init__(self) -> None:
        self.arrays: list[np.ndarray] = []
        self.text = ""

    def add(self, values: np.ndarray) -> int:
        self.arrays.append(np.array(values))
        return len(self.arrays) - 1

    add_single = add_levels = add


def content_of(html: str) -> dict[str, Any]:
    """Return the words of a page without those of the machine, and the elements of its drawings, one a line."""
    words = text_of_page(html.replace(versions(), "").replace(platform.machine(), ""))
    return {"words": words, "drawing": "\n".join(drawn(html))}


def drawn(html: str) -> list[str]:
    """Return the elements of all drawings of a page: the tag, the attributes and the text of each."""
    elements = lxml.html.fromstring(html).xpath("//svg/descendant-or-self::*")
    return [" ".join([e.tag, *(f"{key}={value}" for key, value in e.items()), e.text or ""]).strip() for e in elements]


@pytest.fixture
def stores(monkeypatch: pytest.MonkeyPatch) -> list[KeptStore]:
    """Return the list of the stores of the pages that a test makes; their arrays are not packed."""
    made: list[KeptStore] = []

    def new() -> KeptStore:
        made.append(KeptStore())
        return made[-1]

    for page in ("cosim.report.page", "cosim.study.page"):
        monkeypatch.setattr(f"{page}.Store", new)
    return made
