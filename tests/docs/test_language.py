"""The project's texts are plain technical English."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests import language
from tests.language import expressions, fragments, python_files, text_files


@pytest.mark.nightly
def test_descriptions_of_arguments_begin_with_a_noun_or_verb_phrase() -> None:
    found = [finding for path in python_files() for finding in fragments(path)]
    assert not found, "\n".join(map(str, found))


@pytest.mark.slow
def test_no_text_has_an_expression_that_no_manual_uses() -> None:
    found = [finding for path in text_files() for finding in expressions(path)]
    assert not found, "\n".join(map(str, found))


@pytest.fixture
def sample(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A path of a Python file in a project of its own."""
    monkeypatch.setattr(language, "ROOT", tmp_path)
    return tmp_path / "sample.py"


@pytest.mark.parametrize(("description", "count"), [
    ("Of the bond.", 1), ("its name", 1), ("Which.", 1), ("Names of the outputs to simulate.", 0),
    ("Whether to draw a progress bar.", 0), ("Offset of the channel [N].", 0),
])  # fmt: skip
def test_a_fragment_is_found_with_its_line(sample: Path, description: str, count: int) -> None:
    source = f'def f(name):\n    """Do.\n\n    Args:\n        name: {description}\n    """\n'
    sample.write_text(source, encoding="utf-8")
    found = list(fragments(sample))
    assert [finding.line for finding in found] == [5] * count
    assert all("the description of name" in str(finding) for finding in found)


@pytest.mark.parametrize(("text", "better"), [
    ("# Ride height hardly hangs on the rear shocks", "depends on"),
    ("# 300 setups, as was said before", "was reported"), ("# the least squares", None), ("# if x is None:", None),
])  # fmt: skip
def test_an_expression_is_found_with_what_to_write(sample: Path, text: str, better: str | None) -> None:
    sample.write_text(text + "\n", encoding="utf-8")
    found = [str(finding) for finding in expressions(sample)]
    assert bool(found) == (better is not None)
    assert better is None or any(better in finding for finding in found)
