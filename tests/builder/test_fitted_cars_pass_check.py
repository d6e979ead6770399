"""FMUs of fitted cars, with friction that sticks and port springs, have no findings in `eightpost check`."""

from pathlib import Path

import pytest

from builder.build import build
from builder.check import check
from builder.interface import RATES, steady_terms
from eightpost.corners import CORNERS
from eightpost.ident.grey_box.family import declared, linear_model, port_laws
from eightpost.ident.vehicle.experiment import Experiment
from eightpost.vehicle import IdentifiedVehicle, read_vehicle, shipped, write_vehicle

IDENTIFIED = Path(__file__).resolve().parents[2] / "examples" / "identified" / "car.json"

#: Parameters of a grey-box fit to five tests of 80 s of the stand-in with parameters of seed 1000, rounded.
VALUES = {
    "front.mass heave": 444, "front.mass roll": 311, "rear.mass heave": 548, "rear.mass roll": 293,
    "mass coupling heave": 74.1, "twist_stiffness": 6.35e5, "twist_damping": 444, "front.bar": 4.09e4,
    "front.mass coupling": -0.00174, "rear.mass coupling": 17.5, "front.shock_share": -4.8e-05,
    "rear.shock_share": 0.24, "rear.spring_share": 0.19, "friction_reach": 7.54e-05, "front.aero_place": 1.09,
    "front.aero_spread": 0.571, "rear.aero_place": -0.109, "rear.aero_spread": 0.571, "front.overhang": 0.409,
    "rear.overhang": 0.409,
} | {f"{c}.{name}": value for name, row in {
    "hub_mass": (53.1, 53.1, 38.4, 38.4),
    "spring_rate": (2.68e5, 2.7e5, 1.26e5, 1.31e5),
    "tire_stiffness": (3.73e5, 3.66e5, 3.49e5, 3.39e5),
    "tire_damping": (391, 400, 334, 336),
    "motion_ratio": (0.85, 0.85, 1, 1),
    "friction": (82, 85.8, 64.9, 77),
    "spring_progression": (0.459, 0.464, 0.558, 0.563),
    "tire_stiffening": (0.00768, 0.00462, -0.0113, -0.03),
}.items() for c, value in zip(CORNERS, row, strict=True)}  # fmt: skip


def grey_box_car() -> IdentifiedVehicle:
    rig = (*(f"{c}.road" for c in CORNERS), *(f"{c}.aero" for c in CORNERS))
    quantities = ("velocity", "displacement", "tire_force", "hub_acceleration")
    outputs = (*(f"{c}.{q}" for q in quantities for c in CORNERS), "front.ride_height", "rear.ride_height")
    damping = dict.fromkeys(CORNERS, 3000.0)
    experiment = Experiment("grey_box", rig, tuple(f"{c}.force" for c in CORNERS), outputs, damping)
    values = {p.name: p.start for p in declared(VALUES, rig)}
    laws = port_laws(values, experiment)
    return IdentifiedVehicle("grey_box", linear_model(values, experiment), damping, friction=laws)


@pytest.fixture(scope="module")
def sources(tmp_path_factory):
    path = tmp_path_factory.mktemp("cars") / "grey_box.json"
    write_vehicle(path, grey_box_car())
    return {"identified": IDENTIFIED, "grey-box": path}


@pytest.mark.parametrize("kind", ["identified", "grey-box"])
def test_the_car_has_sticking_friction_and_springs_at_every_port(sources, kind):
    friction = read_vehicle(sources[kind]).friction
    assert set(friction) == set(CORNERS)
    assert all(law.bristle.force > 10.0 and law.spring != 0.0 for law in friction.values())


@pytest.mark.nightly
@pytest.mark.usefixtures("all_platforms")  # a missing platform is a finding
@pytest.mark.parametrize("kind", ["identified", "grey-box"])
@pytest.mark.parametrize("fmi", ["2", "3"])
def test_the_fmu_of_a_fitted_car_has_no_findings(sources, kind, fmi, tmp_path):
    report = check(build([sources[kind]], tmp_path, fmi=fmi)[0].path)
    assert [str(finding) for finding in report.findings] == []
    assert report.acceptable and not report.skipped


def test_accelerations_at_rest_depend_on_forces_in_a_fitted_car_only():
    """A fit has no value at 0 Hz, where accelerations of a physical car are zero; velocities always are."""
    physical, fitted = read_vehicle(shipped("seven_dof")).coupled(), read_vehicle(IDENTIFIED).state_space
    for model, is_fitted in ((physical, False), (grey_box_car().state_space, False), (fitted, True)):
        steady = steady_terms(model)
        for channel, row in zip(model.outputs, steady, strict=True):
            if channel.unit in RATES:
                assert row.any() == (is_fitted and channel.unit == "m/s2"), channel.name
