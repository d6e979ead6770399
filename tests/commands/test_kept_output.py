"""What the verbs print about shipped files, and the lines that all verbs print: no word changes unseen."""

from __future__ import annotations

import io
import logging
import shlex
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import click
import pytest
from click.testing import CliRunner
from rich.console import Console

from eightpost.__main__ import main
from eightpost.app import doctor, show
from eightpost.app.channels import Channels
from eightpost.app.doctor import Finding, State
from eightpost.report.console import console_table
from eightpost.verdict import Grade, Reason, Verdict

EXAMPLES = Path(__file__).parents[2] / "examples"

COMMANDS = (
    "inspect bank/AA_B.json -v",
    "inspect data/dyno_A.csv",
    "inspect data/dyno_A.csv -v",
    "inspect data/track.parquet",
    "inspect settings/rebound_07.csv",
    "inspect car.toml -v",
    "inspect identified/car.json -v",
    "inspect corner.toml",
    "inspect none.csv",
    "export car.toml -o {folder}/car.mat",
    "export bank/AA_B.json -o {folder}/shock.csv",
    "export bank/AA_B.json bank/B_B.json --over clicks=0,4 -o {folder}/shocks.txt",
    "report bank/AA_B.json bank/B_B.json --car car.toml --corner lf=AA_B -o {folder}/report.html",
    "reproduce none",
    "study none.toml",
    "fit data/dyno_A.csv --law none -o {folder}/x.json",
    "fit data/track.parquet --law lpnl2 -o {folder}/x.json",
    "fit data/dyno_A.csv --law polylinear -o {folder}/x.json",
    "fit data/dyno_A.csv settings/rebound_07.csv --law lpf1 -o {folder}/x.json",
    "validate bank/AA_B.json data/dyno_B.csv -o {folder}/v.html -v",
    "validate bank/AA_B.json -o {folder}/v.html",
    "report data/dyno_A.csv bank/AA_B.json -o {folder}/r.html -v",
    "report data/dyno_A.csv --limits data/dyno_B.csv --set tolerance='5 %' -o {folder}/r.html",
    "identify data/dyno_A.csv -o {folder}/car.json",
    "drivefile next none",
    "build none.json -o {folder}",
    "build bank/AA_B.json bank/AA_B.json -o {folder}",
    "check none.fmu",
    "run none.toml",
    "new {folder}/starter",
)


def _ran(words: list[str], monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    monkeypatch.chdir(EXAMPLES)
    ran = CliRunner().invoke(main, words, env={"COLUMNS": "120", "NO_COLOR": "1"})
    return {"exit code": ran.exit_code, "printed": [line.rstrip() for line in ran.output.splitlines()]}


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command.partition(" -o")[0].replace("/", " "))
def test_a_command_prints_the_same(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, unchanged: Callable[..., None]
) -> None:
    words = [word.format(folder=tmp_path) for word in shlex.split(command)]
    unchanged(_ran(words, monkeypatch))


@pytest.mark.parametrize("name", ["seven_dof", "hysteresis"])
def test_inspect_prints_the_same_about_an_fmu(
    name: str, fmus: Mapping[str, Path], monkeypatch: pytest.MonkeyPatch, unchanged: Callable[..., None]
) -> None:
    shown = _ran(["inspect", str(fmus[name]), "-v"], monkeypatch)
    unchanged([line for line in shown["printed"] if "platforms" not in line])


LONG = "words of a sentence that goes on and on over several lines of a terminal " * 5


def _printed(call: Callable[[Console], object], *, detailed: bool, width: int = 100) -> list[str]:
    """Return the lines that a function prints, with or without -v."""
    console = Console(file=io.StringIO(), width=width)
    with click.Context(click.Command("verb")) as context:
        context.params["verbose"] = detailed
        call(console)
    text = console.file.getvalue()  # type: ignore[attr-defined]
    return [line.rstrip() for line in text.splitlines()]


def _reason(about: str, grade: Grade, remedy: str, statement: str = "it is so") -> Reason:
    return Reason(
        f"rule of {about}", about, grade, f"{about}: {statement}", f"{len(about)} N; limit 4 N", "a.csv", remedy
    )


VERDICTS = {
    "nothing": Verdict(),
    "usable": Verdict([_reason("shock", Grade.USABLE, "nothing")]),
    "one": Verdict([_reason("shock", Grade.LIMITED, "fit it again")]),
    "without advice": Verdict([_reason("shock", Grade.UNKNOWN, "nothing")]),
    "several": Verdict([_reason(about, grade, LONG, LONG) for about in ("car", "shock") for grade in Grade]),
}


@pytest.mark.parametrize("detailed", [False, True], ids=["short", "detailed"])
def test_what_verbs_say_is_the_same(detailed: bool, unchanged: Callable[..., None]) -> None:
    calls: dict[str, Callable[..., object]] = {
        name: partial(show.show_verdict, verdict=verdict) for name, verdict in VERDICTS.items()
    }
    calls |= {f"{k} notes": partial(show.show_notes, notes=[LONG] * k) for k in (2, 3)}
    calls |= {"warnings": lambda console: show.show_notes(console, iter(["[not markup] :smile:"]), "warning")}
    calls |= {f"a text of {k}": partial(show.show_text, text=LONG, lines=k) for k in (1, 2)}
    path = f"page {'/long_folder' * 12}/page.html {LONG}"
    calls |= {f"a path in {k}": partial(show.show_text, text=path, lines=k) for k in (1, 2)}
    calls |= {f"{k} rows": partial(show.show_table, table=console_table("ab", [("1", "x")] * k)) for k in (4, 5)}
    findings = [Finding("group", f"name {k}", state, "it is so", "do that" * (k % 2)) for k, state in enumerate(State)]
    calls |= {f"works: {works}": partial(doctor._show, found=findings, works=works) for works in (True, False)}
    found = {name: _printed(call, detailed=detailed) for name, call in calls.items()}
    rows = partial(show.show_summary, title="Title", rows=[("a", "short"), ("long label", LONG), ("none", "")])
    unchanged(found | {f"{width} wide": _printed(rows, detailed=detailed, width=width) for width in (60, 200)})


def test_progress_in_a_log_has_a_line_every_half_minute_with_the_time_that_is_left(
    monkeypatch: pytest.MonkeyPatch, unchanged: Callable[..., None]
) -> None:
    clock = [100.0]
    monkeypatch.setattr(show.time, "monotonic", lambda: clock[0])
    console, found = Console(file=io.StringIO(), width=100), {}
    for name, total, start in (("setups", 2401, 0), ("later", 100, 40), ("share", 1.0, 0.0), ("unknown", None, 0)):
        with show.bar(console, name, total) as advance:
            for k in range(24):
                clock[0] += 9.0
                advance(start + k * (total or 50) / 100.0, None if total or k < 9 else 77)
    found["lines"] = console.file.getvalue().splitlines()  # type: ignore[attr-defined]
    found["items"] = [*show.each(console, "abc", "items", 3)]
    unchanged({"lines": [line.replace(" left", " to go") for line in found["lines"]], "items": found["items"]})


# ==== Words, signs and what -v shows =================================================================================


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
