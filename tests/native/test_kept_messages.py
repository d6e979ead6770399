"""Messages of FMUs: each number is written with enough digits, and each function refuses what it cannot do."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from .host import ERROR, Host

NUMBERS = (
    *(0.0, -0.0, 1.0, -1.0, 0.5, 7.0, 10.0, 99.0, 123.0, 1000.0, 99999.0, 123456.0, 999999.0, 999999.4, 999999.6, 1e6),
    *(1234567.0, 1e7, 1e15, 123456789012345680.0, 1e16, 1e21, 1e100, 1.7976931348623157e308, 9.999995, 9.9999949, 0.1),
    *(0.01, 1e-3, 1e-4, 1.5e-4, 9.9999999e-5, 1e-5, 1.25e-7, 1e-9, 1e-10, 5e-324, 2.2e-308, 1 / 3, 2 / 3, 1e-300),
    *(math.nan, math.inf, -math.inf, 3.141592653589793, 271828.18284, 100.5, 12345.678, 0.001234567, 4096.0),
)


def test_a_number_is_written_as_the_same_text(host: Callable[..., Host], unchanged: Callable[..., None]) -> None:
    fmu = host("lpnl2").start()
    for number in NUMBERS:
        assert fmu.step(number, -1.0) == ERROR
    unchanged([text.rpartition("from ")[2].removesuffix(" s") for *_, text in fmu.messages])


@pytest.mark.parametrize("seed", range(3))
def test_a_number_is_written_with_six_digits(seed: int, host: Callable[..., Host]) -> None:
    fmu, draw = host("lpnl2").start(), np.random.default_rng(seed)
    for number in (draw.choice([-1.0, 1.0], 200) * 10.0 ** draw.uniform(-300.0, 300.0, 200)).tolist():
        assert fmu.step(number, -1.0) == ERROR
        written = float(fmu.messages[-1][2].rpartition("from ")[2].removesuffix(" s"))
        assert written == pytest.approx(number, rel=5.1e-6)
