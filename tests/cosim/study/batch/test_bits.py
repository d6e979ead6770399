"""Setups in lanes have the bits of the FMUs, with every law, port parameter and friction, at any place in any batch."""

import numpy as np
import pytest

from cosim.components.fmu_component import FmuComponent
from cosim.study import Build, Vehicle
from cosim.study.batch.library import instruction_set

from .batched import CHANNELS, COUPLING, LAWS, differing, in_lanes, knots_of, random_builds, random_setups, study_of

FRICTION = {
    "friction that creeps": {"friction_force": 90.0, "friction_velocity": 0.004},
    "friction that sticks": {"bristle_force": 120.0, "bristle_static_ratio": 1.3},
    "friction that sticks evenly": {"bristle_force": 60.0},
    "port springs": {"port_spring": 2e5},
    "all of them": {"friction_force": 40.0, "bristle_force": 70.0, "bristle_static_ratio": 1.2, "port_spring": -1e5},
}


def at_corners(values, corners=("lf", "rf", "lr", "rr")):
    """Return parameters at every corner, none of them twice the same."""
    return {f"{corner}.{n}": v * (1.0 + 0.1 * k) for k, corner in enumerate(corners) for n, v in values.items()}


@pytest.mark.parametrize("law", LAWS)
def test_every_law_has_the_bits_of_its_fmu(fmus, law):
    study = study_of(fmus, random_builds(fmus, [law], 8, seed=LAWS.index(law)))
    assert differing(study, random_setups(study, 8)) == []


def test_laws_can_be_mixed_in_a_batch(fmus):
    study = study_of(fmus, random_builds(fmus, LAWS, 10, seed=11))
    assert differing(study, random_setups(study, 8)) == []


def test_curves_through_knots_and_polynomials_can_be_mixed(fmus):
    knots = knots_of(FmuComponent(fmus["hysteresis"], "shock"))
    builds = random_builds(fmus, ["lpnl2", "polylinear"], 6, seed=21)
    through = {f"{name} knots": Build(b.fmu, {**b.parameters, **knots}) for name, b in builds.items()}
    study = study_of(fmus, {**builds, **through})
    assert differing(study, random_setups(study, 8)) == []
    study = study_of(fmus, through)
    assert differing(study, random_setups(study, 8)) == []


@pytest.mark.parametrize("kind", FRICTION)
def test_every_friction_has_the_bits_of_the_vehicle(fmus, kind):
    vehicle = Vehicle(fmus["seven_dof"], parameters=at_corners(FRICTION[kind]))
    study = study_of(fmus, random_builds(fmus, ["lpnl2", "lpf1"], 6, seed=31), vehicle)
    assert differing(study, random_setups(study, 8)) == []
