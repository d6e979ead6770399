"""Plausibility of stated parameters: no doubt about cars of any class, and the mistake of units behind a doubt."""

from dataclasses import replace
from math import sqrt
from pathlib import Path

import pytest

from builder.reference import validity_of
from eightpost.units import convert
from eightpost.vehicle import Corners, QuarterCar, SevenDof, StructuralVehicle, read_vehicle, shipped
from eightpost.vehicle.structural import MISTAKES, USUAL, doubts
from eightpost.verdict import Grade


def car(track, a, b, sprung, roll, pitch, unsprung, spring, tire, damping=0.0):
    """Return a car in m, kg, kg.m2, N/mm and N.s/m; pairs are front and rear."""
    mm = convert(1.0, "N/mm", "N/m")
    springs, tires = ([mm * rate for rate in pair] for pair in (spring, tire))
    axles = Corners.axles
    return SevenDof(track, a, b, sprung, roll, pitch, axles(*unsprung), axles(*springs), axles(*tires),
                    Corners.same(damping))  # fmt: skip


#: Cars of all classes. Kart: Lot and Dal Bianco 2016, its frame as the springs. The others: typical values.
CARS = {
    "kart": car(1.13, 0.645, 0.40, 143.0, 20.0, 15.0, (4.0, 7.0), (17.7, 60.0), (64.5, 61.3)),
    "formula student": car(1.20, 0.84, 0.72, 230.0, 30.0, 90.0, (11.0, 12.0), (28.0, 32.0), (110.0, 110.0), 1500.0),
    "formula 3": car(1.45, 1.55, 1.25, 590.0, 90.0, 500.0, (17.0, 20.0), (150.0, 170.0), (210.0, 230.0), 5000.0),
    "formula 1": car(1.60, 1.92, 1.68, 720.0, 120.0, 950.0, (20.0, 24.0), (450.0, 280.0), (260.0, 280.0), 9000.0),
    "GT3": car(1.65, 1.30, 1.20, 1150.0, 420.0, 1500.0, (42.0, 48.0), (140.0, 150.0), (280.0, 300.0), 6500.0),
    "touring car": car(1.60, 1.10, 1.55, 1050.0, 400.0, 1500.0, (38.0, 36.0), (110.0, 80.0), (260.0, 260.0), 5500.0),
    "rear engine": car(1.50, 1.42, 0.88, 1180.0, 420.0, 1700.0, (38.0, 45.0), (25.0, 38.0), (200.0, 240.0), 2500.0),
    "hatchback": car(1.50, 0.92, 1.68, 1050.0, 380.0, 1500.0, (35.0, 33.0), (18.0, 19.0), (180.0, 180.0), 1500.0),
    "sedan": car(1.55, 1.40, 1.40, 1500.0, 560.0, 2700.0, (40.0, 42.0), (24.0, 26.0), (200.0, 200.0), 1800.0),
    "off-road car": car(1.60, 1.40, 1.45, 2300.0, 1100.0, 4500.0, (70.0, 80.0), (40.0, 45.0), (280.0, 280.0), 3500.0),
}  # fmt: skip
BOGGS = read_vehicle(shipped("seven_dof")).parameters
EXAMPLES = Path(__file__).parents[2] / "examples"
LBF_IN = convert(1.0, "N/mm", "lbf/in")


def scaled(parameters, factor, *names):
    """Return the parameters with some multiplied by a factor."""
    values = {name: getattr(parameters, name) for name in names}
    return replace(parameters, **{
        n: Corners(*(factor * one for one in v)) if isinstance(v, Corners) else factor * v for n, v in values.items()
    })  # fmt: skip


@pytest.mark.parametrize("name", CARS)
def test_a_real_car_raises_no_doubt(name):
    assert doubts(CARS[name]) == ()


@pytest.mark.parametrize("path", [shipped("seven_dof"), shipped("quarter_car"), EXAMPLES / "car.toml",
                                  EXAMPLES / "corner.toml"])  # fmt: skip
def test_a_shipped_car_raises_no_doubt(path):
    assert doubts(read_vehicle(path).parameters) == ()


@pytest.mark.parametrize("parameters", [BOGGS, *CARS.values()])
@pytest.mark.parametrize("share", [0.0, 0.5])
def test_a_car_without_dampers_or_with_soft_springs_raises_no_doubt_about_them(parameters, share):
    springs = scaled(parameters, share, "spring_rate", "damping")
    assert not any("damping" in doubt.summary for doubt in doubts(springs))
    assert share or doubts(springs) == ()


@pytest.mark.parametrize(("names", "meant", "typed", "factor", "gross"), [
    (("tire_stiffness",), "lbf/in", "N/mm", LBF_IN, True),
    (("spring_rate",), "lbf/in", "N/mm", LBF_IN, False),
    (("tire_stiffness",), "N/mm", "lbf/in", 1.0 / LBF_IN, False),
    (("damping",), "lbf.s/in", "N.s/m", 1.0 / convert(1.0, "lbf.s/in", "N.s/m"), False),
    (("damping",), "lbf.s/in", "N.s/mm", 1.0 / convert(1.0, "lbf.s/in", "N.s/mm"), False),
    (("sprung_mass", "unsprung_mass"), "lbm", "kg", convert(1.0, "kg", "lbm"), False),
    (("roll_inertia", "pitch_inertia"), "lbm.in2", "kg.m2", convert(1.0, "kg.m2", "lbm.in2"), True),
    (("roll_inertia", "pitch_inertia"), "kg.m2", "lbm.in2", convert(1.0, "lbm.in2", "kg.m2"), True),
    (("track_width", "cg_to_front_axle", "cg_to_rear_axle"), "in", "cm", convert(1.0, "cm", "in"), True),
])  # fmt: skip
def test_every_mistake_of_units_is_named(names, meant, typed, factor, gross):
    (doubt,) = doubts(scaled(BOGGS, factor, *names))
    assert f"correct the unit of {' and '.join(names)}, which look" in doubt.remedy
    assert f"{meant} typed as {typed}: " in doubt.remedy
    assert doubt.is_gross is gross


def test_a_quarter_car_is_checked_by_the_name_of_its_own_spring():
    corner = read_vehicle(shipped("quarter_car")).parameters
    (doubt,) = doubts(scaled(corner, LBF_IN, "suspension_stiffness", "tire_stiffness"))
    assert "unit of suspension_stiffness and tire_stiffness, which look like lbf/in typed as N/mm: 1280" in doubt.remedy
    assert isinstance(corner, QuarterCar) and doubt.summary.startswith("wheel-hop frequency 43.8 Hz")


def test_a_damping_ratio_is_that_of_the_sprung_mass_on_its_spring():
    corner = read_vehicle(shipped("quarter_car")).parameters
    critical = 2.0 * sqrt(corner.suspension_stiffness * corner.sprung_mass)
    (doubt,) = doubts(replace(corner, damping=2.5 * critical))
    assert doubt.summary == "damping ratio 2.5 (usual: 0.03 to 2)"


def test_the_farthest_corner_and_every_unexplained_figure_are_listed():
    wrong = replace(BOGGS, cg_to_front_axle=2.4, cg_to_rear_axle=0.5,
                    unsprung_mass=Corners(91.0, 1.0, 92.0, 50.0))  # fmt: skip
    summaries = [doubt.summary for doubt in doubts(wrong)]
    assert any(text.startswith("rf unsprung mass 1 kg") for text in summaries)
    assert "front share of the sprung mass 17.2 % (usual: 30 to 70 %)" in summaries
    assert [doubt.is_gross for doubt in doubts(wrong)].count(False) < len(summaries)


@pytest.mark.parametrize(("mass", "grade", "rule"), [
    (90.0, Grade.LIMITED, "vehicle of stated parameters"),
    (91.0, Grade.LIMITED, "implausible parameters"),
    (135.1, Grade.NOT_USABLE, "impossible parameters"),
])  # fmt: skip
def test_the_verdict_of_a_car_has_a_reason_for_each_doubt(mass, grade, rule):
    doubtful = StructuralVehicle("x", replace(BOGGS, unsprung_mass=Corners.same(mass)))
    verdict = validity_of(doubtful).verdict
    assert verdict.grade is grade and verdict.reasons[0 if grade is Grade.NOT_USABLE else -1].rule == rule
    assert len(verdict.reasons) == 1 + (mass > 90.0)


def test_the_limits_of_every_range_are_usual_and_its_mistakes_go_both_ways():
    assert all(0.0 < usual.low < usual.high for usual in USUAL.values())
    for mistake in MISTAKES:
        assert mistake._replace(meant=mistake.typed, typed=mistake.meant) in MISTAKES
        assert mistake.factor == pytest.approx(convert(1.0, mistake.meant, mistake.typed))
