"""The page of the architecture is what its script writes now; it fails if folders import each other."""

import importlib
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = ROOT / "docs" / "make" / "make_architecture.py"
PAGE = (ROOT / "docs" / "development" / "architecture.md").read_text(encoding="utf-8")
OUTDATED = "docs/development/architecture.md is out of date: run python docs/make/make_architecture.py"


@pytest.fixture
def script(monkeypatch):
    """The script as a module."""
    monkeypatch.setattr(sys, "path", list(sys.path))
    return importlib.import_module("docs.make.make_architecture")


@pytest.mark.nightly
def test_folders_recipes_and_picture_of_the_page_are_those_of_the_code(script, tmp_path):
    files = script.sources(ROOT)
    script.draw(script.folders(files), tmp_path / "architecture.png")
    assert (tmp_path / "architecture.png").stat().st_size > 10_000
    start, title, rest = script.page(script.Trace()).partition("## One run")
    recipes = rest[rest.index("## ") :]
    assert "coupling scheme" in recipes
    assert PAGE.startswith(start + title) and PAGE.endswith(recipes), OUTDATED


@pytest.mark.nightly  # a run is traced; the other sections are compared above
def test_the_page_of_the_architecture_is_that_of_the_code(tmp_path):
    subprocess.run([sys.executable, str(SCRIPT), str(tmp_path)], check=True)
    assert (tmp_path / "architecture.png").stat().st_size > 10_000
    assert (tmp_path / "architecture.md").read_text(encoding="utf-8") == PAGE, OUTDATED
