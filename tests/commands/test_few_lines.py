"""What commands print: a few lines of 80 columns, and all of it with -v."""

from __future__ import annotations

import io
import logging
from pathlib import Path

import click
from click.testing import CliRunner
from rich.console import Console

from eightpost.__main__ import main
from eightpost.app.channels import Channels
from eightpost.app.show import show_notes, show_summary, show_table, show_text, show_verdict
from eightpost.report.console import console_table
from eightpost.verdict import Grade, Reason, Verdict

ROWS = [(f"row {k}", str(k)) for k in range(10)]


def printed(show, *arguments, verbose: bool = False, **options) -> list[str]:
    console = Console(file=io.StringIO(), width=200)
    with click.Context(click.Command("eightpost")) as context:
        context.params["verbose"] = verbose
        show(console, *arguments, **options)
    return console.file.getvalue().splitlines()


def test_a_text_has_two_lines_of_at_most_80_columns_and_all_of_them_with_v():
    text = "word " * 60
    lines = printed(show_text, text)
    assert len(lines) == 2 and max(map(len, lines)) <= 80 and lines[1].endswith(" ...")
    assert " ".join(printed(show_text, text, verbose=True)) == text.strip()
    assert len(printed(show_text, text, lines=1)) == 1


def test_a_table_has_its_heading_and_its_first_rows_without_lines_and_all_rows_with_v():
    table = console_table(["name", "value"], ROWS)
    lines = [line.rstrip() for line in printed(show_table, table, most=3)]
    assert lines == ["name  value", "row 0 0", "row 1 1", "row 2 2", "  3 of 10 rows; -v shows all"]
    whole = printed(show_table, table, verbose=True)
    assert len(whole) == 14 and whole[1].startswith("┃")
    assert len(printed(show_table, console_table(["name", "value"], ROWS[:3]), most=3)) == 4


def test_notes_are_the_first_ones_and_the_number_of_the_others():
    texts = ["one", "two", "three"]
    assert printed(show_notes, iter(texts)) == ["note one", "note two", "  and 1 more; -v shows all"]
    assert printed(show_notes, texts[:2], "warning") == ["warning one", "warning two"]
    assert printed(show_notes, texts, verbose=True) == ["note one", "note two", "note three"]
    assert printed(show_notes, ["[not markup] :smile:"]) == ["note [not markup] :smile:"]


def test_a_summary_leaves_out_what_is_empty():
    assert printed(show_summary, "", [("law", "LPF1"), ("notes", "")]) == ["  law  LPF1"]
    assert printed(show_summary, "a title", [("notes", "")]) == ["a title"]


def _reason(grade: Grade, statement: str, remedy: str) -> Reason:
    return Reason(rule=statement, grade=grade, about="model", statement=statement, figure=f"figure of {statement}",
                  remedy=remedy, origin="test")  # fmt: skip


def test_a_verdict_has_one_line_if_nothing_must_be_done_and_at_most_four_otherwise():
    fine = _reason(Grade.USABLE, "all is well", "nothing to do")
    bad, worse = (_reason(Grade.NOT_USABLE, text, "measure again " * 20) for text in ("noise", "a gap"))
    assert printed(show_verdict, Verdict([fine])) == ["Usable: all is well."]
    lines = printed(show_verdict, Verdict([fine, bad, worse]))
    assert lines[:2] == ["Not usable: noise.", "  1 of 2 reasons (-v): figure of noise"]
    assert lines[2].startswith("  to do: measure again") and len(lines) == 4
    assert printed(show_verdict, Verdict([bad]))[:2] == ["Not usable: noise.", "  figure of noise"]
    assert len(printed(show_verdict, Verdict([fine, bad, worse]), verbose=True)) == 4
    assert printed(show_verdict, Verdict([])) == ["Unknown: nothing was examined."]


def test_the_signs_of_a_file_are_those_of_all_files_and_its_own():
    channels = Channels(None, {"force": "N"}, ("velocity",), {"a.csv": ("force",), "b": ("velocity", "displacement")})
    assert channels.record_options == {
        "channel_map": None, "units": {"force": "N"},
        "flip": {"a.csv": ("force",), "b": ("velocity", "displacement"), "": ("velocity",)},
    }  # fmt: skip
    for name, expected in (
        ("a.csv", ("velocity", "force")),
        ("b.csv", ("velocity", "displacement")),
        ("c", ("velocity",)),
    ):
        assert channels.of(Path("data") / name) == {"channel_map": None, "units": {"force": "N"}, "flip": expected}
    assert Channels().record_options["flip"] == {}


def test_the_words_of_the_screen_are_in_the_glossary():
    page = (Path(__file__).parents[2] / "docs" / "reference" / "glossary.md").read_text(encoding="utf-8")
    words = " ".join(line.split("*")[1] for line in page.splitlines() if line.startswith("- *"))
    names = ("law", "error", "held out", "range", "misfit", "damping", "steps", "coupling error", "energy residual",
             "search", "model", "usable", "limited", "not usable", "test next", "LPNL2", "gauss-seidel", "Spearman",
             "mark", "setup", "baseline")  # fmt: skip
    assert [name for name in names if name not in words] == []


def test_v_shows_what_the_product_logs_and_nothing_of_other_libraries(monkeypatch):
    monkeypatch.setattr(logging.root, "handlers", [])
    level, names, found = logging.root.level, ("eightpost.cache", "cosim.fmu.lf", "matplotlib.font_manager"), []
    for words in (["-v", "units"], ["units"]):
        CliRunner().invoke(main, words)
        found.append([name for name in names if logging.getLogger(name).isEnabledFor(logging.DEBUG)])
    logging.root.setLevel(level)
    assert found == [["eightpost.cache", "cosim.fmu.lf"], []]
