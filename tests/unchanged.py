"""The fixture `unchanged`: a result is the one that tests/results keeps, number by number.

    pytest --regen-all TEST    # keeps the present result: read its difference with git before you commit it

A text is kept without dates, folders, durations and identifiers. Of a record, a mapping or a sequence each part has a
line; of a long array, its smallest, largest, mean and root mean square value and one in between.
"""

from __future__ import annotations

import dataclasses
import json
import math
import re
from collections.abc import Callable, Iterator, Mapping
from enum import Enum
from itertools import zip_longest
from pathlib import Path
from typing import Any

import lxml.html
import numpy as np
import pytest
from pytest_datadir.plugin import LazyDataDir
from pytest_regressions.file_regression import FileRegressionFixture

from benchmarks.table import OF_THIS_RUN
from eightpost.errors import EightpostError

RESULTS = Path(__file__).parent / "results"

#: Length up to which an array is kept whole.
_SHORT = 12

#: Differences that another processor makes in a fit, relative to a number or to the largest of an array.
_RELATIVE = 1e-3
_ZERO = 1e-9  #: Smaller numbers are zeros.

_SUMMARY = " min "  #: in the line of a long array
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?")


@pytest.fixture
def unchanged(request: pytest.FixtureRequest, tmp_path: Path) -> Callable[..., None]:
    """Return a function that compares a result with the kept one; `part` names one of several results of a test."""
    folder = RESULTS / request.path.relative_to(RESULTS.parent).with_suffix("")
    kept = FileRegressionFixture(LazyDataDir(folder, tmp_path), folder, request)

    def check(result: object, part: str = "", *, relative: float = _RELATIVE) -> None:
        name = re.sub(r"[^\w.-]+", "_", request.node.name.removeprefix("test_") + (part and f"-{part}")).strip("_")
        text = "\n".join(lines_of(result)) + "\n"
        kept.check(text, encoding="utf-8", basename=name, check_fn=lambda new, old: _compare(new, old, relative))

    return check


def refusals(calls: Mapping[str, Callable[[], object]]) -> dict[str, str]:
    """Return the kind and the text of the error of each call; all of them must be refused."""
    found = {}
    for name, call in calls.items():
        try:
            call()
        except (EightpostError, ValueError) as error:
            found[name] = f"{type(error).__name__}: {error}"
        else:
            pytest.fail(f"{name}: nothing is refused")
    return found


def lines_of(result: object, name: str = "") -> Iterator[str]:
    """Yield the lines that are kept of a result: a text, a number, an array, a file, a record, or a set of these."""
    begin = f"{name}: " if name else ""
    match result:
        case Enum() | None | bool() | str() | complex():
            yield from _clean(f"{begin}{result}").splitlines()
        case int() | float() | np.generic():
            yield f"{begin}{_number(result)}"
        case Path():
            yield from lines_of(_content(result), name)
        case Mapping():
            for key, value in result.items():
                yield from lines_of(value, f"{name}.{key}".lstrip("."))
        case np.ndarray():
            yield f"{begin}{_array(result)}"
        case list() | tuple() | set() | frozenset():
            items = sorted(result) if isinstance(result, set | frozenset) else result
            for index, value in enumerate(items):
                yield from lines_of(value, f"{name}[{index}]")
        case _ if dataclasses.is_dataclass(result):
            for field in dataclasses.fields(result):
                yield from lines_of(getattr(result, field.name), f"{name}.{field.name}".lstrip("."))
        case _:
            raise TypeError(f"{name or 'the result'} is a {type(result).__name__}: give its numbers or its text")


def _clean(text: str) -> str:
    return re.sub(r"[ \t]+", " ", OF_THIS_RUN.sub("", text)).strip()


def _number(value: Any) -> str:
    return f"{value:.8g}" if isinstance(value, float | np.floating) else str(value)


def _array(values: np.ndarray[Any, Any]) -> str:
    if values.size <= _SHORT or not np.issubdtype(values.dtype, np.number):
        return " ".join(map(_number, values.ravel().tolist()))
    flat = np.abs(values.ravel()) if np.iscomplexobj(values) else values.ravel().astype(float)
    if np.isnan(flat).all():
        return f"{values.shape} nan"
    figures = {"min": np.nanmin, "max": np.nanmax, "mean": np.nanmean, "rms": lambda x: np.sqrt(np.nanmean(x**2))}
    found = " ".join(f"{name} {_number(float(figure(flat)))}" for name, figure in figures.items())
    return f"{values.shape} {found} within {_number(float(flat[values.size // 3]))}"


def _content(path: Path) -> object:
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".json":
        return json.loads(text)
    return text_of_page(text) if path.suffix == ".html" else text


def text_of_page(html: str) -> str:
    """Return the words of a page, one element a line, with its links, titles and alternative texts."""
    page = lxml.html.fromstring(html)
    for element in page.xpath("//style | //script"):
        element.drop_tree()
    said = ("href", "title", "alt", "aria-label")
    texts = (" ".join([(e.text or ""), *(f"[{e.get(key)}]" for key in said if len(e.get(key, "")) in range(1, 200)),
                       (e.tail or "")]).split() for e in page.iter() if isinstance(e.tag, str))  # fmt: skip
    return "\n".join(" ".join(words) for words in texts if words)


def _compare(new: Path, old: Path, relative: float) -> None:
    wrong = differences(*(path.read_text(encoding="utf-8") for path in (old, new)), relative)
    assert not wrong, "\n".join([f"{old}: {len(wrong)} lines differ (- kept, + now)", *wrong[:20]])


def differences(kept: str, now: str, relative: float = _RELATIVE) -> list[str]:
    """Return the lines in which a word differs, or a number by more than rounding."""
    pairs = zip_longest(kept.splitlines(), now.splitlines(), fillvalue="(nothing)")
    return [f"- {before}\n+ {after}" for before, after in pairs if not _same(before, after, relative)]


def _same(now: str, then: str, relative: float) -> bool:
    if now == then:
        return True
    if _NUMBER.sub("#", now) != _NUMBER.sub("#", then):
        return False
    given, kept = ([float(number) for number in _NUMBER.findall(line)] for line in (now, then))
    size = max(map(abs, map(float, _NUMBER.findall(then.partition(_SUMMARY)[2]))), default=0.0)
    return all(
        math.isclose(a, b, rel_tol=relative, abs_tol=max(_ZERO, relative * size))
        for a, b in zip(given, kept, strict=True)
    )
