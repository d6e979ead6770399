"""Tests of the measurement of a command's memory and time."""

from __future__ import annotations

import sys

import pytest

from benchmarks.identification_memory import cost_of


@pytest.mark.nightly
@pytest.mark.skipif(sys.platform == "win32", reason="os.wait4 is not available")
def test_cost_and_exit_code_are_those_of_the_child_process():
    cost = cost_of(["identify", "nowhere.parquet", "-o", "car.json"])
    assert cost.exit_code == 2
    assert 0.01 < cost.peak_gigabytes < 2.0
    assert 0.01 < cost.processor_seconds < 60.0
