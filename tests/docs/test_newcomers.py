"""Each start page leads a newcomer from a fresh clone to its result within fifteen minutes."""

import shutil
import sys
from pathlib import Path

import pytest

from tests.docs import newcomer
from tests.docs.page_blocks import ROOT, Block, blocks

PROGRAMS = Path(sys.executable).parent


def test_the_results_are_those_of_all_start_pages():
    pages = {path.stem for path in (ROOT / "docs" / "start").glob("*.md")} - {"index"}
    assert set(newcomer.RESULTS) == pages
    for page in pages:
        assert any(block.kind == "run" for block in blocks(ROOT / "docs" / "start" / f"{page}.md"))


def test_python_blocks_in_succession_are_one_script():
    def block(language: str, text: str) -> Block:
        return Block("page.md", 1, language, text, "")

    found = [block("sh", "a\n"), block("sh", "b\n"), block("python", "c\n"), block("python", "d\n"), block("sh", "e\n")]
    assert list(newcomer._scripts(found)) == [("sh", "a\n"), ("sh", "b\n"), ("python", "c\nd\n"), ("sh", "e\n")]


def test_a_page_without_its_result_is_an_error(tmp_path, monkeypatch):
    monkeypatch.setattr(newcomer, "blocks", lambda page: [Block("page.md", 1, "sh", "true\n", "")])
    with pytest.raises(AssertionError, match=r"researcher did not write out/reproduce\.html"):
        newcomer.follow("researcher", tmp_path, PROGRAMS)
    monkeypatch.setattr(newcomer, "blocks", lambda page: [Block("page.md", 1, "sh", "false\ntrue\n", "")])
    with pytest.raises(AssertionError, match=r"researcher: false"):
        newcomer.follow("researcher", tmp_path, PROGRAMS)


@pytest.mark.nightly
@pytest.mark.parametrize("page", newcomer.RESULTS)
def test_a_newcomer_gets_the_result_of_a_start_page_in_a_fresh_clone(page, tmp_path):
    if shutil.which("git") is None or not (ROOT / ".git").exists():
        pytest.skip("not a git checkout")
    newcomer.clone(tmp_path / page)
    walk = newcomer.follow(page, tmp_path / page, PROGRAMS)
    assert walk.minutes < 15.0
