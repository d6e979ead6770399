"""The benchmark of coupling schemes: its errors are those of the signals, and a run is closer at a higher rate."""

from pathlib import Path

import numpy as np
import pytest

import cosim
from benchmarks import orders
from benchmarks.orders import CAR, CORNERS, Case, Pair, errors, make_case, measure
from benchmarks.table import number

pytestmark = pytest.mark.nightly


def error_of(factor: float) -> Pair:
    """Return the errors [%] of sines of 5 Hz that are multiplied by a factor."""
    time = np.arange(0.0, 2.0, 0.008)
    signal = np.sin(2.0 * np.pi * 5.0 * time) * np.ones((4, 1))
    case = Case(None, time, signal, 1e3 * signal)
    static = orders.read_vehicle(CAR).static
    totals = factor * case.tire_force + np.array([[static[f"{c}.tire_force"]] for c in CORNERS])
    return errors(case, time, factor * case.velocity, totals)


@pytest.mark.parametrize(("factor", "expected"), [(1.0, 0.0), (1.1, 10.0), (0.5, 50.0)])
def test_errors_are_in_percent_of_the_signals_standard_deviation(factor: float, expected: float) -> None:
    assert error_of(factor) == pytest.approx((expected, expected), rel=1e-2, abs=1e-9)


def test_a_run_with_an_error_of_ten_standard_deviations_counts_as_diverged() -> None:
    assert error_of(12.0) == (None, None)


def test_a_run_is_closer_to_the_reference_at_a_higher_rate_and_diverges_at_a_low_one(tmp_path: Path) -> None:
    case = make_case(tmp_path, 1.5)
    coarse, fine = (measure(case, tmp_path, cosim.Jacobi(), step) for step in (1e-3, 2.5e-4))
    assert all(0.0 < 3.0 * better < worse < 100.0 for better, worse in zip(fine, coarse, strict=True))
    assert measure(case, tmp_path, cosim.Jacobi(), 8e-3) == (None, None)


def test_numbers_have_a_few_significant_digits() -> None:
    assert [number(value) for value in (None, 0.012345, 12345.6)] == ["-", "0.0123", "12346"]
