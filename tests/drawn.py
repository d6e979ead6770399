"""What is in a picture or in a figure of a page, as numbers and texts that `unchanged` keeps."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import NoneType
from typing import Any

import lxml.html
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection, PolyCollection
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from tests.unchanged import lines_of


@pytest.fixture
def pictures(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    """The contents of all pictures that are saved in a test; their files are empty."""
    saved: list[dict[str, Any]] = []

    def save(figure: Figure, path: Path, **_: object) -> None:
        saved.append(drawn(figure))
        path.touch()

    monkeypatch.setattr(Figure, "savefig", save)
    return saved


def drawn(figure: Figure) -> dict[str, Any]:
    """Return titles, labels, scales and all lines, dots and areas of a picture."""
    return {"size": figure.get_size_inches(), "title": figure.get_suptitle(),
            "panels": [dict(_panel(axes)) for axes in figure.axes if axes.get_visible()]}  # fmt: skip


def _panel(axes: Axes) -> Iterator[tuple[str, Any]]:
    yield "title", " | ".join(filter(None, (axes.get_title(where) for where in ("left", "center", "right"))))
    yield "axes", f"{axes.get_xlabel()} | {axes.get_ylabel()} | {axes.get_xscale()} | {axes.get_yscale()}"
    yield "limits", np.array([*axes.get_xlim(), *axes.get_ylim()])
    for number, other in enumerate(axes.child_axes):
        other._set_lims()  # type: ignore[attr-defined] # as when it is drawn
        yield f"axes {number}", f"{other.get_xlabel()} | {other.get_ylabel()}"
        yield f"limits {number}", np.array([*other.get_xlim(), *other.get_ylim()])
    for number, line in enumerate(axes.lines):
        style = f"{line.get_label()} {to_hex(line.get_color())} {line.get_linestyle()} {line.get_marker()}"
        x, y = (np.asarray(row, dtype=float) for row in line.get_data())
        yield f"line {number}", {f"{style}, x {x[0]:.6g} to {x[-1]:.6g}" if x.size else style: y}
    for number, found in enumerate(axes.collections):
        rows: list[np.ndarray] = []
        if isinstance(found, PolyCollection):
            rows = [path.vertices for path in found.get_paths()]
        elif isinstance(found, PathCollection):
            rows = [np.asarray(found.get_offsets())]
        yield f"area {number}", {str(found.get_label()): rows}
    for number, patch in enumerate(axes.patches):
        yield f"patch {number}", patch.get_path().vertices
    for number, image in enumerate(axes.images):
        yield f"image {number}", np.asarray(image.get_array(), dtype=float)
    yield "texts", " | ".join(text.get_text() for text in axes.texts if text.get_text())


def plotted(content: Mapping[str, Any]) -> list[str]:
    """Return the lines that are kept of a figure of a page: one for each trace and its rows, and one for each axis."""
    lines = []
    for trace in content["data"]:
        rows = {key: value for key, value in trace.items() if isinstance(value, list) and len(value) > 2}
        lines.append(json.dumps({key: value for key, value in trace.items() if key not in rows}))
        for key, value in rows.items():
            known = [v for v in value if v is not None]
            numbers = all(isinstance(v, int | float) for v in known)
            lines += lines_of(np.array(known, dtype=float) if numbers else " ".join(map(str, value)), f"  {key}")
    return lines + [f"{key}: {json.dumps(value)}" for key, value in content["layout"].items()]


def rows_of_page(path: Path) -> str:
    """Return the words of a page: one table row, paragraph, heading or list item a line, without the glossary."""
    page = lxml.html.fromstring(path.read_text(encoding="utf-8"))
    for element in page.xpath("//style | //script | //*[@id='words'] | //*[@class='si'][../*[@class='us']]"):
        element.drop_tree()
    found = page.xpath("//tr | //h1 | //h2 | //h3 | //li[not(.//tr)] | //p[not(ancestor::tr)] | //figcaption")
    lines = (" | ".join(map(_words, row.xpath("./td | ./th"))) if row.tag == "tr" else _words(row) for row in found)
    return "\n".join(filter(None, lines))


def _words(element: Any) -> str:
    return " ".join(element.text_content().split())


def compact(content: Any) -> Any:
    """Return the content of a file with lists of numbers as arrays, and the values of an object in one line."""
    if isinstance(content, Mapping):
        found = {key: compact(value) for key, value in content.items()}
        parts = {key: value for key, value in found.items() if isinstance(value, Mapping | list | np.ndarray)}
        single = flat({key: value for key, value in found.items() if key not in parts})
        return {"": single} | parts if single and parts else parts or single
    if not isinstance(content, list | tuple):
        return content
    if len(content) > 2 and all(type(value) in (int, float) for value in content):
        return np.array(content, dtype=float)
    is_short = len(content) <= 2 and all(type(value) in (int, float, NoneType) for value in content)
    return rounded(" to ".join(map(str, content))) if is_short else [compact(value) for value in content]


def flat(values: Mapping[str, Any]) -> str:
    """Return values in one line."""
    return rounded(", ".join(f"{name} {value}" for name, value in values.items()))


def rounded(text: str) -> str:
    """Return a text with at most eight digits of its numbers, as in the representation of a record."""
    return re.sub(r"-?\d+\.\d{6,}(e[-+]?\d+)?", lambda found: f"{float(found[0]):.8g}", text)


def timed(text: str) -> str:
    """Return a text whose times in seconds and milliseconds are kept, because they are results."""
    return re.sub(r"(\d) (m?s)\b", r"\1_\2", text)
