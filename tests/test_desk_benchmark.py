"""The table of what commands print: lines are counted right, and every command keeps to its lines and columns."""

import pytest

from benchmarks import desk
from benchmarks.desk import BEFORE, NOW, Output, table


def test_lines_of_progress_do_not_count_and_names_of_files_may_be_wide():
    text = f"compiling: 1 of 24, 4%\nidentifying: 9%, about 0:05:31 left\na result\nwrote {'x' * 90}\n"
    assert Output.of(1, text) == Output(1, 2, 8)
    assert Output.of(0, "") == Output(0, 0, 0)


@pytest.mark.parametrize(
    ("lines", "width", "command", "exceeds"),
    [(12, 80, "fit a.csv", False), (13, 80, "fit a.csv", True), (12, 81, "fit a.csv", True), (60, 80, "demo", False),
     (61, 80, "demo", True)],
)  # fmt: skip
def test_a_command_has_twelve_lines_of_80_columns_and_the_demo_60(lines, width, command, exceeds):
    assert Output(0, lines, width).exceeds(command) is exceeds


def test_both_versions_are_in_one_table():
    found = {BEFORE: {"fit a.csv": Output(0, 46, 248)}, NOW: {"fit a.csv": Output(0, 9, 78)}}
    assert table(found).splitlines()[0] == "| command | lines, widest line before | lines, widest line now |"
    assert table(found).splitlines()[2] == "| `fit a.csv` | 46, 248 | 9, 78 |"


def test_every_verb_is_measured():
    lines = desk.COMMANDS.strip().splitlines()
    missing = {verb for verb in desk.every_verb() if not any(f"{line} ".startswith(f"{verb} ") for line in lines)}
    assert missing <= {"app", "study run", "drivefile next"}
    assert desk.counts().startswith(f"{sum(map(len, desk.SECTIONS.values()))} verbs in the list")


@pytest.mark.nightly
def test_every_command_keeps_to_its_lines_on_the_shipped_examples(tmp_path):
    found = desk.measured(desk.ROOT, tmp_path / "desk")
    assert [command for command, output in found.items() if output.exceeds(command) or output.code == 2] == []
