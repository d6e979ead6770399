"""The coupling of a case file can be overridden."""

from __future__ import annotations

import pytest

import cosim
from cosim.session.run import Case
from eightpost.errors import InputError


def case(algorithm: str = "gauss-seidel", step: float | None = 1e-3) -> Case:
    return Case("empty", cosim.System({}), cosim.Scenario(stop=1.0), cosim.SCHEMES[algorithm], step)


def test_without_options_the_coupling_of_the_file_is_used() -> None:
    assert case().with_coupling() == case()
    assert case().with_coupling("gauss-seidel").step == 1e-3


def test_an_algorithm_that_chooses_its_own_step_ignores_the_step_of_the_file() -> None:
    chosen = case().with_coupling("default")
    assert chosen.algorithm == cosim.SCHEMES["default"] and chosen.step is None
    assert case().with_coupling("default", step=2e-3).step == 2e-3
    assert case().with_coupling("jacobi").step == 1e-3


def test_a_tolerance_is_in_percent() -> None:
    default = case().with_coupling("default", tolerance=0.5).algorithm
    adaptive = case().with_coupling("adaptive", tolerance=0.5).algorithm
    assert isinstance(default, cosim.Automatic) and default.tolerance == 0.5
    assert isinstance(adaptive, cosim.Adaptive) and adaptive.relative == pytest.approx(0.005)
    with pytest.raises(InputError, match="gauss-seidel has no tolerance"):
        case().with_coupling(tolerance=0.5)
