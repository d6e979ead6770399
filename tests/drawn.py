"""What is in a picture or in a figure of a page, as numbers and texts that `unchanged` keeps."""

from __future__ import annotations

import base64
import gzip
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
from matplotlib.collections import LineCollection, PathCollection, PolyCollection
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from tests.unchanged import lines_of


@pytest.fixture
def pictures(monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """The contents of all pictures that are saved in a test; their files are empty."""
    saved: list[list[str]] = []

    def save(figure: Figure, path: Path, **_: object) -> None:
        saved.append(drawn(figure))
        path.touch()

    monkeypatch.setattr(Figure, "savefig", save)
    return saved


def drawn(figure: Figure) -> list[str]:
    """Return size and title of a picture, and texts, limits, lines, areas, bars and images of each of its panels."""
    texts = " | ".join(text.get_text() for text in figure.texts)
    found = [f"size {figure.get_size_inches().tolist()} {texts}"]
    for axes in filter(Axes.get_visible, figure.axes):
        named = [
            *(axes.get_title(where) for where in ("left", "center", "right")),
            axes.get_xlabel(),
            axes.get_ylabel(),
        ]
        legend = axes.get_legend()
        named += [axes.get_xscale(), axes.get_yscale(), *(t.get_text() for t in (legend.get_texts() if legend else ()))]
        found += [f"panel: {' | '.join(filter(None, named))}", *(f"  {line}" for line in _artists(axes))]
        if figure.get_layout_engine() is None:
            found.append(f"  place {np.round(axes.get_position().bounds, 4).tolist()}")
    return found


def _artists(axes: Axes) -> Iterator[str]:
    yield from lines_of(np.array([*axes.get_xlim(), *axes.get_ylim()]), "limits")
    for other in axes.child_axes:
        other._set_lims()  # type: ignore[attr-defined] # as when it is drawn
        yield from lines_of(
            np.array([*other.get_xlim(), *other.get_ylim()]), f"axis {other.get_xlabel()}{other.get_ylabel()}"
        )
    yield from (f"text {one.get_text()} at {np.round(one.get_position(), 6)}" for one in axes.texts if one.get_text())
    for line in axes.lines:
        x, y = (np.asarray(data, dtype=float) for data in line.get_data())
        style = [to_hex(line.get_color()), line.get_linestyle(), line.get_linewidth(), line.get_marker()]
        yield f"line {_label(line)} {style} {line.get_markersize()}"
        yield from lines_of({"  x": x, "  y": y}) if x.size else ()
    for bar in axes.patches:
        corners = bar.get_patch_transform().transform(bar.get_path().vertices)
        yield from lines_of({f"patch {bar.get_facecolor()}": np.asarray(corners).ravel()})
    for part in axes.collections:
        yield f"collection {_label(part)}"
        if isinstance(part, LineCollection):
            yield from lines_of({"  segments": np.concatenate([np.asarray(one) for one in part.get_segments()])})
        elif isinstance(part, PolyCollection):
            yield from lines_of({"  area": np.concatenate([path.vertices for path in part.get_paths()])})
        elif isinstance(part, PathCollection):
            yield from lines_of({"  dots": np.asarray(part.get_offsets())})
    for image in axes.images:
        yield from lines_of({"image": np.asarray(image.get_array(), dtype=float), "extent": list(image.get_extent())})


def _label(artist: Any) -> str:
    """Return the label of an artist; empty if it has none of its own."""
    label: str = artist.get_label()
    return "" if label.startswith("_") else label


def figures_of(page: Path) -> dict[str, list[str]]:
    """Return the lines that are kept of each figure of a page."""
    (script,) = lxml.html.fromstring(page.read_text(encoding="utf-8")).xpath("//script[@id='figures']")
    figures = json.loads(gzip.decompress(base64.b64decode(script.text)))["figures"]
    return {f"figure {k}": plotted(figure) for k, figure in enumerate(figures, start=1)}


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
