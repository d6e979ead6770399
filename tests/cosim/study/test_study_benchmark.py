"""Tables of the study benchmark, computed from given measurements."""

import math

import pytest

from benchmarks.study import efficiency
from benchmarks.study_peers import Cost, markdown


def row(workers, seconds):
    return {"workers": workers, "seconds": seconds}


def test_two_workers_in_half_the_time_are_fully_efficient():
    assert "| 2 | 50.0 | 2.00 | 100% |" in efficiency([row(1, 100.0), row(2, 50.0)])
    assert "| 2 | 80.0 | 1.25 | 62% |" in efficiency([row(1, 100.0), row(2, 80.0)])


def test_rate_and_time_of_a_first_order_scheme_are_proportional_to_its_error():
    found = Cost("fmpy", 1000.0, 4.0, 2.0).at(0.2)
    assert (found.rate, found.error, found.seconds) == pytest.approx((20_000.0, 0.2, 40.0))
    accurate = Cost("fmpy", 1000.0, 0.1, 2.0)
    assert accurate.at(0.2) == accurate


def test_the_table_reports_diverged_runs_without_a_time():
    ours, lost = Cost("eightpost", 750.0, 0.15, 0.05), Cost("fmpy", 125.0, None, math.nan)
    text = markdown([lost, Cost("libcosim", 1000.0, 4.0, 1.0)], ours, 0.2, 2401, 2)
    assert "| fmpy, held values | 125 | diverges | | |" in text and "fmpy, at that accuracy" not in text
    assert "| libcosim, held values | 1000 | 4 | 1 | 20 min |" in text
    assert "| libcosim, at that accuracy (by first order) | 20000 | 0.2 | 20 | 6.67 h |" in text
    assert "| 30 | 20 h |" in text
