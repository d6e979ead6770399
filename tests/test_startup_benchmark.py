"""The table of start-up: the smallest figures are compared, and missed targets are named."""

import pytest

from benchmarks.startup import COMMANDS, FIRST, INSTALLED, TARGETS, Figures, measured, missed, table

ROWS = (FIRST, *COMMANDS, *INSTALLED)


def figures(**now):
    return {row: Figures([2.0 * TARGETS[row]], [TARGETS[row]]) for row in ROWS} | now


def test_the_smallest_figures_are_compared_with_the_target():
    found = figures() | {FIRST: Figures([20.0, 16.0], [9.0, 4.0, 5.0])}
    lines = table(found).splitlines()
    assert lines[2] == f"| {FIRST} | 16 | 4 | 0.25 | 6 |"
    assert [line.split(" | ")[0] for line in lines[2:]] == [f"| {row}" for row in ROWS]
    assert not missed(found)


@pytest.mark.parametrize("row", ROWS)
def test_a_missed_target_is_named(row):
    assert missed(figures() | {row: Figures([1.0], [1.01 * TARGETS[row]])}) == [row]


class Stopwatch:
    """A version whose commands take no time."""

    def __init__(self, folder):
        self.folder, self.ran = folder, []
        (folder / "cache").mkdir(parents=True)

    def seconds(self, words):
        self.ran.append((words[0], (self.folder / "cache").exists()))
        return 1.0

    def megabytes(self, extras):
        return 100.0 + len(extras)


def test_a_first_run_alone_finds_no_cache_and_every_command_is_repeated(tmp_path):
    versions = {name: Stopwatch(tmp_path / name) for name in ("before", "now")}
    found = measured(versions, 2, INSTALLED)
    names = [words[0] for words in COMMANDS.values()]
    for version in versions.values():
        assert version.ran == [(name, True) for name in names for _ in range(2)] + [("run", False)]
    assert [len(one.now) for one in found.values()] == [1, *[2] * len(COMMANDS), 1, 1]
    assert [one.before for one in found.values()][-2:] == [[100.0], [105.0]]
