"""`eightpost reproduce` prints a line per item, writes one offline page, and its exit code says what it found."""

import re

import pytest
from click.testing import CliRunner

import eightpost
from dissertation import Findings, reproduction
from eightpost.__main__ import main


def run(*words):
    return CliRunner().invoke(main, ["reproduce", *words])


def test_an_item_is_a_line_and_an_anchor_on_the_page(tmp_path):
    result = run("table-7.1", "eq4.2", "figure-3.9", "-o", str(tmp_path))
    assert result.exit_code == 0, result.output
    assert "Table 7.1 reproduced: 20 of 20 values within tolerance" in result.output
    assert "Figure 3.9 nothing to compute: a photograph" in result.output
    page = (tmp_path / "reproduce.html").read_text(encoding="utf-8")
    for name in ("table-7.1", "equation-4.2", "figure-3.9"):
        assert f'href="#{name}"' in page
        assert f'id="{name}"' in page
    assert not re.search(r"(src|href)=\"https?:", page), "the page must not load anything"


def test_a_difference_beyond_its_tolerance_is_exit_code_1(tmp_path, monkeypatch):
    values = {f"{row}/{n}": n**4 for row in ("setups", "hours") for n in range(1, 11)}
    monkeypatch.setattr(reproduction, "computations", lambda chapter: {"table-7.1": lambda effort: Findings(values)})
    result = run("table-7.1", "-o", str(tmp_path))
    assert result.exit_code == 1
    assert "Table 7.1 differs" in result.output
    assert "BEYOND" in (tmp_path / "reproduce.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(("words", "text"), [(["8.1"], "the nearest are"), ([], "--list")])
def test_an_unknown_or_missing_number_is_exit_code_2(words, text):
    result = run(*words)
    assert result.exit_code == 2
    assert text in result.output


def test_the_list_computes_nothing(monkeypatch):
    monkeypatch.setattr(reproduction, "computations", lambda chapter: pytest.fail("nothing must be computed"))
    result = run("7", "--list")
    assert result.exit_code == 0
    assert "Table 7.5" in result.output
    assert "Table 3.5" not in result.output


def test_without_a_checkout_the_verb_says_where_the_dissertation_is(monkeypatch, tmp_path):
    monkeypatch.setattr(eightpost, "__file__", str(tmp_path / "site-packages" / "eightpost" / "__init__.py"))
    result = run("7.2", "-o", str(tmp_path))
    assert result.exit_code == 2
    assert "dissertation/ of the source distribution and the repository of eightpost, not in its wheel" in " ".join(
        result.output.split()
    )
    assert run("--help").exit_code == 0
