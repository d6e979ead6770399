"""What a run reports: local errors, energies, iterations, rejected steps, and steps that did not converge."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest

from cosim import Adaptive, Algorithm, Capabilities, GaussSeidel, Implicit, Jacobi, Result, Scenario, System, run
from eightpost.errors import WiringError
from eightpost.signals import Drivefile

Join = Callable[..., System]

ROAD = {"a": "car_a.road"}
#: Absolute tolerances that leave only the relative tolerance in effect.
NOTHING = dict.fromkeys(("car_a.velocity", "car_a.displacement", "shock_a.force"), 1e-12)
STEPS = (5e-4, 2.5e-4, 1.25e-4)


def orders(values: Sequence[float]) -> Any:
    return -np.diff(np.log2(np.abs(values)))


def refined(join: Join, bumps: Drivefile, algorithm: Algorithm) -> list[Result]:
    system, scenario = join(), Scenario(1.0, bumps, ROAD, record_step=5e-4)
    return [run(system, scenario, algorithm=algorithm, step=step, compared=False) for step in STEPS]


@pytest.mark.repeated
@pytest.mark.parametrize(("algorithm", "order"), [
    (Jacobi(), 1), (GaussSeidel(values="held"), 1), (Jacobi("interpolated"), 1), (Jacobi("extrapolated"), 2),
    (GaussSeidel(), 2),
], ids=lambda value: f"{value.name} {value.values}" if hasattr(value, "name") else "")  # fmt: skip
def test_the_local_error_of_a_bond_falls_with_the_order_of_its_coupling_values(
    quarter_cars: Join, bumps: Drivefile, algorithm: Algorithm, order: int
) -> None:
    """At the end of a step a held value has an error of h y', a linearly extrapolated one of h^2 y''."""
    coupled = [result.coupled["car_a"] for result in refined(quarter_cars, bumps, algorithm)]
    assert orders([bond.force_error for bond in coupled]) == pytest.approx(order, abs=0.15)
    assert all(bond.force_spread == pytest.approx(coupled[-1].force_spread, rel=0.02) for bond in coupled)
    if isinstance(algorithm, Jacobi):
        assert orders([bond.velocity_error for bond in coupled]) == pytest.approx(order, abs=0.15)
    else:  # the car has stepped first, so its velocity at the end is known
        assert [bond.velocity_error for bond in coupled] == [0.0] * len(STEPS)


@pytest.mark.nightly
def test_a_retried_step_is_not_counted_as_not_converged(quarter_cars: Join, bumps: Drivefile) -> None:
    """One iteration is sufficient at the steps that meet the tolerance, but not at 4 ms."""
    system, scenario = quarter_cars(), Scenario(0.4, bumps, ROAD, record_step=0.4)
    few = Implicit(tolerance=1e-8, iterations=1)
    assert not run(system, scenario, algorithm=few, step=0.004).converged
    result = run(system, scenario, algorithm=Adaptive(few, relative=1e-6, absolute=NOTHING), step=0.004)
    assert result.rejected_steps > 0
    assert result.converged
    assert result.notes == ()


def test_schemes_with_rollback_refuse_components_without_state_and_held_inputs_are_reported(make: Any) -> None:
    system = System({"a": make.integrator(capabilities=Capabilities())}, constants={"a.u": 1.0})
    for algorithm in (Implicit(), Adaptive()):
        with pytest.raises(WiringError, match="cannot save and restore its state"):
            run(system, Scenario(0.1), algorithm=algorithm, step=0.01)
    assert any("held over each step" in note for note in run(system, Scenario(0.1), step=0.01).notes)
