"""What a page of a run or of a study contains, for kept results: its words, numbers and drawings."""

from __future__ import annotations

import json
import platform
from collections.abc import Mapping
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
    """Return the words of a page without those of the machine, five elements a line, and its drawings."""
    words = text_of_page(html.replace(versions(), "").replace(platform.machine(), "")).splitlines()
    return {"words": [" | ".join(words[k : k + 5]) for k in range(0, len(words), 5)], "drawing": "\n".join(drawn(html))}


def manifest_lines(manifest: Mapping[str, Any]) -> list[str]:
    """Return the manifest of a page, one line for each of its parts."""
    short = json.loads(json.dumps(manifest, default=str), parse_float=lambda text: float(f"{float(text):.8g}"))
    parts = {key: value if isinstance(value, list) else [value] for key, value in short.items()}
    return [f"{key} {json.dumps(one, ensure_ascii=False)}" for key, values in parts.items() for one in values]


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
