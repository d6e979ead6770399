"""An assembly equals the master and is of second order, also in hosts that hold their inputs."""

from itertools import pairwise

import numpy as np
import pytest

from cosim import FmuComponent

from .hosts import CORNERS, difference, held_separately, host, master, observed, percent


@pytest.mark.repeated
@pytest.mark.parametrize("step", [0.0005, 0.001, 0.004, 0.02])
def test_an_assembly_equals_the_master_for_communication_steps_of_whole_micro_steps(car, case, step):
    outputs = observed(FmuComponent(car, "car"))
    expected, _ = master(case, 0.0005, drive_step=step, outputs=outputs)
    assert difference(host(car, step), expected).max() < 1e-9


def test_an_assemblys_error_estimates_equal_those_of_the_master(car, case):
    names = [f"{corner}.coupling_error" for corner in CORNERS]
    found = host(car, 0.001, outputs=[*names, "coupling_error"])[:, -1]
    _, result = master(case, 0.0005, drive_step=0.001, outputs=["lf.force"])
    expected = [result.coupled[f"car.{corner}"].force_error for corner in CORNERS]
    assert found[:4] == pytest.approx(expected, rel=1e-6)
    assert found[4] == pytest.approx(max(c.percent for c in result.coupled.values()), rel=1e-6)


@pytest.mark.nightly
def test_a_communication_step_is_divided_into_equal_micro_steps_if_it_is_not_a_multiple(car, case):
    outputs = observed(FmuComponent(car, "car"))
    expected, _ = master(case, 0.0004, drive_step=0.002, outputs=outputs)
    assert difference(host(car, 0.002, parameters={"coupling_step": 0.00045}), expected).max() < 1e-9


def test_the_error_is_of_second_order_in_the_coupling_step(car, measured):
    names, exact = measured
    steps = (0.002, 0.001, 0.0005)
    errors = [percent(host(car, 0.008, parameters={"coupling_step": h}, outputs=names), exact) for h in steps]
    ratios = [(coarse / fine).mean() for coarse, fine in pairwise(errors)]
    assert all(3.4 < ratio < 4.8 for ratio in ratios), ratios
    assert errors[-1].max() < 0.2


def test_hub_accelerations_follow_the_forces_at_the_end_and_are_about_as_accurate_as_velocities(car):
    names = [f"car.{corner}.{name}" for name in ("velocity", "hub_acceleration") for corner in CORNERS]
    exact, found = (host(car, 0.008, parameters={"coupling_step": h}, outputs=names) for h in (1e-5, 0.002))
    velocity, hub = percent(found, exact).reshape(2, 4)
    assert hub.max() < 2.5 * velocity.max()


@pytest.mark.nightly
def test_an_assembly_is_a_hundred_times_more_accurate_than_separate_fmus_with_held_inputs(car, case, fmus, measured):
    """Compare with the exact response to the held roads, so that only the error of the coupling remains."""
    names, _ = measured
    exact = host(car, 0.008, ramped=False, parameters={"coupling_step": 1e-5}, outputs=names)
    inside = percent(host(car, 0.008, ramped=False, outputs=names), exact).max()
    with np.errstate(over="ignore", invalid="ignore"):
        separate = percent(held_separately(fmus, case, 0.008, names), exact).max()
    assert inside < 0.5
    assert not separate < 100.0 * inside
