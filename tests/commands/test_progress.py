"""Progress in a log file: lines with the time that is left."""

import io

from rich.console import Console

from eightpost.app import show


def lines(monkeypatch, calls, total=1000):
    """Return the lines that are printed for pairs of time [s] and amount."""
    now = iter([0.0, *(time for time, _ in calls)])
    monkeypatch.setattr(show.time, "monotonic", lambda: next(now))
    stream = io.StringIO()
    with show.bar(Console(file=stream, width=200), "setups", total) as advance:
        for _, amount in calls:
            advance(amount)
    return stream.getvalue().splitlines()


def test_a_log_file_gets_a_line_each_half_minute_with_the_time_that_is_left(monkeypatch):
    calls = [(0.0, 0), (10.0, 100), (31.0, 310), (40.0, 400), (62.0, 620)]
    assert lines(monkeypatch, calls) == [
        "setups: 310 of 1000, 31%, about 0:01:09 left", "setups: 620 of 1000, 62%, about 0:00:38 left"
    ]  # fmt: skip


def test_what_an_earlier_run_completed_does_not_count_as_speed(monkeypatch):
    assert lines(monkeypatch, [(0.0, 900), (50.0, 910)]) == ["setups: 910 of 1000, 91%, about 0:07:30 left"]


def test_a_share_has_no_amount(monkeypatch):
    assert lines(monkeypatch, [(0.0, 0.0), (3600.0, 0.25)], total=1.0) == ["setups: 25%, about 3:00:00 left"]
