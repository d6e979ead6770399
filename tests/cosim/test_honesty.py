"""What a run reports: local errors, energies, iterations, rejected steps, and steps that did not converge."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest

from cosim import Adaptive, Algorithm, Bond, Capabilities, GaussSeidel, Implicit, Jacobi, Result, Scenario, System, run
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


def test_local_errors_match_the_exact_ones_of_a_shock_with_a_known_force(make: Any) -> None:
    """F = sin w t, held: the error at a step's end is F(t + h) - F(t), mean square 2 sin(w h/2)^2; half on average."""
    omega, h = 2.0 * np.pi, 1e-2
    moving = make.table(make.variable("velocity", "output", "m/s"), make.variable("force", "input", "N"))
    shock = make.table(make.variable("velocity", "input", "m/s"), make.variable("force", "output", "N"))
    damper = make.component(shock, lambda t, _: {"force": np.sin(omega * t)}, lambda t, _a, _b, step: t + step)
    body = make.component(moving, lambda _t, _u: {"velocity": 0.0})
    system = System({"car": body, "shock": damper}, (Bond.between("car", "shock", displacement=False),))
    bond = run(system, Scenario(5.0), algorithm=Jacobi(), step=h).coupled["car"]
    assert bond.force_error == pytest.approx(0.5 * np.sqrt(2.0) * np.sin(omega * h / 2.0), rel=1e-6)
    assert bond.force_spread == pytest.approx(np.sqrt(0.5), rel=1e-6)
    assert bond.percent == pytest.approx(100.0 * bond.force_error / bond.force_spread)


def test_transferred_energy_is_the_integral_of_the_shocks_power(quarter_cars: Join, bumps: Drivefile) -> None:
    result = run(quarter_cars(), Scenario(1.0, bumps, ROAD), step=1e-4)
    power = np.abs(result.series["car_a.velocity"] * result.series["shock_a.force"])
    assert result.energy["car_a"].transferred == pytest.approx(np.trapezoid(power, result.series.time), rel=1e-3)


def test_iterations_rejected_steps_and_the_largest_step_are_counted(quarter_cars: Join, bumps: Drivefile) -> None:
    system, scenario = quarter_cars(), Scenario(1.0, bumps, ROAD, record_step=0.004)
    once = run(system, scenario, step=1e-3)
    assert (once.steps, once.iterations, once.rejected_steps, once.largest_step) == (1000, 0, 0, 1e-3)
    repeated = run(system, scenario, algorithm=Implicit(), step=1e-3)
    assert 2 * repeated.steps <= repeated.iterations < 10 * repeated.steps
    chosen = run(system, scenario, algorithm=Adaptive(relative=1e-3), step=4e-3)
    assert chosen.rejected_steps > 0
    assert 0.0 < chosen.step < chosen.largest_step <= 0.004
    assert 2 * 250 <= chosen.steps < 2000  # two half steps, at least one pair for each interval of the drive


def test_steps_that_did_not_converge_are_counted_and_reported(quarter_cars: Join, bumps: Drivefile) -> None:
    one_iteration = Implicit(tolerance=1e-13, iterations=1)
    result = run(quarter_cars(), Scenario(0.5, bumps, ROAD), algorithm=one_iteration, step=4e-3)
    assert not result.converged
    assert not result.acceptable
    assert not result.partial
    assert any(
        note.endswith(
            f"of {result.steps} steps did not converge: use a smaller coupling step, and do not use this result"
        )
        for note in result.notes
    )
    assert run(quarter_cars(), Scenario(0.5, bumps, ROAD), algorithm=Implicit(), step=4e-3).converged


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
