"""The table of commands: lines and files are compared right, and every command keeps to its lines and columns."""

import json
from pathlib import Path

import pytest

from benchmarks import commands
from benchmarks.commands import FIRST, SECONDS, Output, Version, measured, missed, table

FIT = next(command for command in SECONDS if command.startswith("fit "))


def test_lines_of_progress_do_not_count_and_names_of_files_may_be_wide() -> None:
    text = f"compiling: 1 of 24, 4%\nidentifying: 9%, about 0:05:31 left\na result\nwrote {'x' * 90}\n"
    assert Output.of(1, text, 2.0) == Output(1, 2, 8, 2.0)
    assert Output.of(0, "", 2.0) == Output(0, 0, 0, 2.0)


@pytest.mark.parametrize(
    ("code", "lines", "width", "command", "exceeds"),
    [(1, 12, 80, "fit a.csv", False), (0, 13, 80, "fit a.csv", True), (0, 12, 81, "fit a.csv", True),
     (2, 1, 8, "fit a.csv", True), (0, 60, 80, "demo", False), (0, 61, 80, "demo", True)],
)  # fmt: skip
def test_a_command_has_twelve_lines_of_80_columns_and_the_demo_60(
    code: int, lines: int, width: int, command: str, exceeds: bool
) -> None:
    assert Output(code, lines, width).exceeds(command) is exceeds
    assert bool(missed({command: [[Output(code, lines, width)]]})) is exceeds


def test_both_versions_are_in_one_table_with_their_smallest_times() -> None:
    found = {FIT: [[Output(0, 46, 248, 20.0), Output(0, 46, 248, 16.0)], [Output(0, 9, 78, 4.0)]]}
    lines = table(found).splitlines()
    assert lines[0] == "| command | lines, widest line, s before | lines, widest line, s now | target [s] |"
    assert lines[2] == f"| `{FIT}` | 46, 248, 16 | 9, 78, 4 | 2.0 |"
    assert table({FIT: [found[FIT][1]]}).splitlines()[2] == f"| `{FIT}` | 9, 78, 4 | 2.0 |"


@pytest.mark.parametrize("command", SECONDS)
def test_a_missed_target_of_this_version_is_named(command: str) -> None:
    before, late, good = (Output(0, 1, 8, share * SECONDS[command]) for share in (9.0, 1.01, 0.99))
    assert missed({command: [[before], [late, late]]}) == [command]
    assert missed({command: [[before], [late, good]]}) == []


def test_every_verb_is_measured_and_every_target_is_of_a_command() -> None:
    lines = commands.COMMANDS
    missing = {verb for verb in commands.every_verb() if not any(f"{line} ".startswith(f"{verb} ") for line in lines)}
    assert missing <= {"app", "study run", "drivefile next"}
    assert set(SECONDS) <= set(lines)
    assert commands.counts().startswith(f"{sum(map(len, commands.SECTIONS.values()))} verbs in the list")


def test_a_command_with_a_target_is_repeated_in_turns(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ran: list[tuple[str, str]] = []

    def run(self: Version, command: str) -> Output:
        ran.append((self.folder.name, command))
        return Output(0, 1, 8, float(len(ran)))

    monkeypatch.setattr(Version, "run", run)
    versions = [Version(commands.ROOT, tmp_path / name) for name in ("before", "now")]
    found = measured(versions, only="run examples/seven_dof.toml -", repeat=2)
    steady, *others, first = found
    assert first == FIRST + steady
    assert [len(one) for name in (steady, others[0], first) for one in found[name]] == [2, 2, 1, 1, 2, 2]
    assert ran[:4] == [("before", steady), ("now", steady)] * 2
    assert (tmp_path / "now" / "examples" / "seven_dof.toml").is_file()


def test_the_comparison_of_files_covers_numbers_but_neither_texts_nor_durations(tmp_path: Path) -> None:
    version = Version(commands.ROOT, tmp_path)

    def compared(name: str, text: str) -> list[str | bytes]:
        (tmp_path / name).write_text(text)
        return version.written()[name]

    results = ({"a": [1.0, True], "b": "one", "seconds": 1.0}, {"a": [1.0, True], "b": "two", "seconds": 2.0})
    first, again = (compared("a.json", json.dumps(result)) for result in results)
    assert first == again != compared("a.json", json.dumps(results[0] | {"a": [1.0 + 1e-15, True]}))
    assert compared("a.csv", "x [m],1\n") == compared("a.csv", "y [m],1.0\n") != compared("a.csv", "x [m],2\n")
    assert compared("a.html", "1 %, 2026-11-29 (3.1 s)") == compared("a.html", "1 %, 2026-11-30 (4.0 s)")
    assert compared("a.html", "1 %") != compared("a.html", "2 %")


@pytest.mark.nightly
def test_every_command_keeps_to_its_lines_on_the_shipped_examples(tmp_path: Path) -> None:
    found = measured([Version(commands.ROOT, tmp_path / "now")])
    assert [command for command, ((output,),) in found.items() if output.exceeds(command)] == []
