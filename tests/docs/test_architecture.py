"""The page of the architecture is what its script writes now; it fails if folders import each other."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = ROOT / "docs" / "make" / "make_architecture.py"
PAGE = (ROOT / "docs" / "development" / "architecture.md").read_text(encoding="utf-8")
OUTDATED = "docs/development/architecture.md is out of date: run python docs/make/make_architecture.py"


@pytest.mark.nightly  # a run is traced
def test_the_page_of_the_architecture_is_that_of_the_code(tmp_path):
    subprocess.run([sys.executable, str(SCRIPT), str(tmp_path)], check=True)
    assert (tmp_path / "architecture.png").stat().st_size > 10_000
    assert (tmp_path / "architecture.md").read_text(encoding="utf-8") == PAGE, OUTDATED
