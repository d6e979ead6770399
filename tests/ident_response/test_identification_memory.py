"""What a command costs is that of its own process."""

from __future__ import annotations

import sys

import pytest

from benchmarks.identification_memory import cost_of


@pytest.mark.skipif(sys.platform == "win32", reason="os.wait4 is not there")
def test_cost_is_of_the_child_and_its_exit_code_is_kept():
    cost = cost_of(["identify", "nowhere.parquet", "-o", "car.json"])
    assert cost.exit_code == 2
    assert 0.01 < cost.peak_gigabytes < 2.0
    assert 0.01 < cost.processor_seconds < 60.0
