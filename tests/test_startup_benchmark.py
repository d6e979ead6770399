"""The table of start-up times: comparisons are right, and commands that are too slow are named."""

import pytest

from benchmarks.startup import FIRST, HELP, HELPS, LATER, Times, beyond_limits, table

pytestmark = pytest.mark.nightly

SLOW, *OTHERS = HELPS


def times(first=8.0, later=2.0, slow=0.15):
    return {
        FIRST: Times([20.0], [first]),
        LATER: Times([5.0, 4.0, 6.0], [later, 3.0, 2.5]),
        HELP: Times([0.1], [0.1]),
        SLOW: Times([3.0], [slow]),
        **{command: Times([2.0], [0.11]) for command in OTHERS},
    }


def test_the_shortest_times_are_compared_and_the_slowest_help_text_is_named():
    lines = table(times()).splitlines()
    assert lines[2] == f"| {FIRST} | 20, 20 | 8, 8 | 0.4 |"
    assert lines[3] == f"| {LATER} | 4, 5 | 2, 2.5 | 0.5 |"
    assert lines[5] == f"| {SLOW} (slowest of all commands) | 3, 3 | 0.15, 0.15 | 0.05 |"
    assert lines[-1] == f"The slowest help text takes 1.5 times as long as `{HELP}`."
    assert not beyond_limits(times())


@pytest.mark.parametrize(
    ("slower", "named"),
    [({"first": 8.1}, FIRST), ({"later": 2.1}, LATER), ({"slow": 0.21}, SLOW)],
)
def test_commands_that_exceed_their_limit_are_reported(slower, named):
    (missed,) = beyond_limits(times(**slower))
    assert missed.startswith(f"{named}: ")
