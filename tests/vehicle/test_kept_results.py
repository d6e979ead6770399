"""Matrices, motions with friction and judgements of cars are those in tests/results."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from eightpost.vehicle import (
    Bristle,
    Corners,
    Friction,
    IdentifiedVehicle,
    LinearStepper,
    QuarterCar,
    StateSpace,
    add_port_damping,
    add_port_stiffness,
    discretise,
    read_vehicle,
    shipped,
    write_vehicle,
)
from eightpost.vehicle.compiled import deflections
from eightpost.vehicle.friction import Bristles, PortFriction, advance, equilibrium, named_ports, output
from eightpost.vehicle.modal import modal_form
from eightpost.vehicle.structural import USUAL, Parameters, doubts

from .test_seven_dof import UNEVEN

Unchanged = Callable[..., None]

CORNER = QuarterCar(250.0, 35.0, 40e3, 210e3, damping=1800.0)
CARS: dict[str, Parameters] = {"quarter_car": CORNER, "seven_dof": UNEVEN}
PORTS = {"quarter_car": ("",), "seven_dof": ("lf.", "rf.", "lr.", "rr.")}


def matrices(model: StateSpace) -> dict[str, object]:
    """Return the rows of a model by the names of its outputs and states."""
    rows = {f"A{k}": row for k, row in enumerate(model.A)} | {f"B{k}": row for k, row in enumerate(model.B)}
    of_outputs = zip(model.outputs, model.C, model.D, strict=True)
    return rows | {f"{one.name} [{one.unit}]": np.concatenate([c, d]) for one, c, d in of_outputs}


def identified() -> IdentifiedVehicle:
    """Return a car about its baseline damper and mean load, with every kind of friction at its port."""
    law = Friction(80.0, 0.004, Bristle(120.0, 2e-4, 1.2, 0.02), 3e5, 0.012)
    model = add_port_damping(CORNER.coupled(), {"": 2000.0})
    return IdentifiedVehicle("car", model, {"": 2000.0}, {}, {"a.csv": "0" * 64}, {"": law})


@pytest.mark.parametrize("name", CARS)
def test_the_matrices_of_a_car(name: str, unchanged: Unchanged) -> None:
    model = CARS[name].with_damper()
    unchanged(matrices(model) | {"poles": np.sort_complex(model.poles()), "modes": np.array(model.modes())})


@pytest.mark.parametrize("hold", ["zero", "first"])
def test_the_matrices_of_a_sampled_car(hold: str, unchanged: Unchanged) -> None:
    model = discretise(CORNER.with_damper(), 2e-3, hold)  # type: ignore[arg-type]
    rigid = add_port_stiffness(CORNER.with_damper(), {"": 2.5e4})
    kept = {
        "sampled": matrices(model),
        "gain": model.dc_gain(),
        "direct": model.direct_terms(),
        "modes": np.array(model.modes()),
    }
    unchanged({**kept, "stiffer": matrices(rigid), "response": model.frequency_response([0.0, 1.5, 12.0, 240.0])})


def test_the_modal_form_of_a_car(unchanged: Unchanged) -> None:
    form = modal_form(UNEVEN.with_damper())
    unchanged({"form": form, "eigenvalues": form.eigenvalues, "rest": np.abs(form.at_rest())}, relative=1e-4)


@pytest.mark.parametrize("name", CARS)
def test_the_motion_of_a_car_with_friction_and_port_springs(name: str, unchanged: Unchanged) -> None:
    model, prefixes = CARS[name].with_damper(), PORTS[name]
    stepper, one = LinearStepper(model.A, model.B, model.C, model.D), np.linspace(1.0, 1.3, len(prefixes))
    ports = named_ports(stepper, (model.input_names, model.output_names), prefixes, prefixes)
    bristles = Bristles(150.0 * one, 1e-4 * one, 1.2 * one, 0.02 * one)
    rubbing = PortFriction(ports, 60.0 * one, 0.01 * one, bristles, 2e5 * one)
    time, sizes = np.arange(0.0, 0.4, 2e-3), np.where([c.unit == "m" for c in model.inputs], 0.02, 300.0)
    u = sizes * np.sin(np.outer(time, 15.0 + 5.0 * np.arange(sizes.size)) + 0.4)
    x, rows = equilibrium(stepper, rubbing, u[0]), []
    start = output(stepper, rubbing, x, u[0])
    for before, after in pairwise(u):
        x = advance(stepper, rubbing, x, before, after, 2e-3)
        rows.append(np.concatenate([output(stepper, rubbing, x, after), x[-rubbing.states :]]))
    names = (*model.output_names, *(f"state {k}" for k in range(rubbing.states)))
    figures = {"rate": rubbing.rate, "squared": rubbing.squared_frequency, "sub-steps": rubbing.sub_steps(2e-3)}
    unchanged({"start": start, **figures, **dict(zip(names, np.array(rows).T, strict=True))})


def test_the_deflections_of_a_bristle(unchanged: Unchanged) -> None:
    law = Bristle(120.0, 2e-4, 1.3, 0.02)
    velocity = 0.1 * np.sin(np.linspace(0.0, 30.0, 600)) ** 3
    found = deflections(velocity, 1e-3, law)
    one = law.deflection_after(1e-4, np.array([-0.3, 0.0, 1e-3, 0.3]), 2e-3)
    unchanged({"compiled": found, "force": law.force_at(found), "one step": one, "stiffness": law.stiffness})


def test_the_file_and_the_summary_of_an_identified_car(unchanged: Unchanged, tmp_path: Path) -> None:
    car = identified()
    write_vehicle(tmp_path / "car.json", car)
    assert read_vehicle(tmp_path / "car.json") == car
    text = (tmp_path / "car.json").read_text(encoding="utf-8")
    head = {"lines": text.count("\n"), "start": text[:400], "unloaded": matrices(car.unloaded().state_space)}
    unchanged({"summary": str(car), **head, "coupled": matrices(car.coupled())})


@pytest.mark.parametrize("name", CARS)
def test_the_file_and_the_summary_of_a_car(name: str, unchanged: Unchanged, tmp_path: Path) -> None:
    car = read_vehicle(shipped(name))  # type: ignore[arg-type]
    outputs = [name for name in car.coupled().output_names if name.endswith(("tire_force", "ride_height"))]
    car = replace(car, static={name: 100.0 * k + 0.25 for k, name in enumerate(outputs)})
    write_vehicle(tmp_path / "car.toml", car)
    unchanged({"summary": str(car), "file": (tmp_path / "car.toml").read_text(encoding="utf-8")})


@pytest.mark.parametrize(
    ("growth", "damping", "stated"),
    [
        (99.9, {}, None),
        (100.0, {}, None),
        (100.1, {}, "without dampers, a motion of 4.77 Hz grows at a rate of 100 1/s"),
        (0.0069, {"": 1.0}, None),
        (0.0071, {"": 1.0}, "with its baseline dampers, a motion of 4.77 Hz grows at a rate of 0.0071 1/s"),
        (-1.0, {"": 1.0}, None),
    ],
)
def test_a_car_that_grows_is_refused_from_the_stated_rate(
    growth: float, damping: dict[str, float], stated: str | None
) -> None:
    ports = CORNER.coupled().select(inputs=["force"], outputs=["velocity"])
    A = np.array([[growth, 30.0], [-30.0, growth]])
    model = StateSpace(A, np.zeros((2, 1)), np.zeros((1, 2)), np.zeros((1, 1)), ports.inputs, ports.outputs)
    assert IdentifiedVehicle("car", model, damping).instability() == stated


def turned(figure: str, value: float) -> Parameters:
    """Return the uneven car with one figure of plausibility at a value, in the unit of its range."""
    car = replace(UNEVEN, damping=Corners.same(0.0), front_anti_roll_rate=0.0, rear_anti_roll_rate=0.0)
    base, pi2 = car.wheelbase, 2.0 * np.pi
    spring, tire = car.spring_rate.lf, car.tire_stiffness.lf
    return replace(car, **{
        "tire stiffness": {"tire_stiffness": car.tire_stiffness._replace(lf=1e3 * value)},
        "unsprung mass": {"unsprung_mass": car.unsprung_mass._replace(lf=value)},
        # Of the lightest corner for the low end, of the heaviest for the high one.
        "sprung mass": {"sprung_mass": 2.0 * value * base / (
            car.cg_to_rear_axle if value < 100.0 else car.cg_to_front_axle)},
        "wheel-hop frequency": {"unsprung_mass": car.unsprung_mass._replace(lf=(spring + tire) / (pi2 * value) ** 2)},
        "spring over tire stiffness": {"spring_rate": car.spring_rate._replace(lf=value * tire)},
        "damping ratio": {"damping": Corners(2.0 * value * np.sqrt(
            spring * 0.5 * car.sprung_mass * car.cg_to_rear_axle / base), 0.0, 0.0, 0.0)},
        "wheelbase over track": {"track_width": base / value},
        "radius of gyration in roll over track": {"roll_inertia": car.sprung_mass * (value * car.track_width) ** 2},
        "radius of gyration in pitch over wheelbase": {"pitch_inertia": car.sprung_mass * (value * base) ** 2},
        "front share of the sprung mass": {"cg_to_rear_axle": 0.01 * value * base,
                                           "cg_to_front_axle": (1.0 - 0.01 * value) * base},
    }[figure])  # type: ignore[arg-type]  # fmt: skip


TURNED = [name for name in USUAL if name not in ("ride frequency", "wheelbase")]


@pytest.mark.parametrize("figure", TURNED)
@pytest.mark.parametrize("side", ["low", "high"])
def test_a_figure_is_doubted_from_the_end_of_its_usual_range(figure: str, side: str) -> None:
    limit, out = getattr(USUAL[figure], side), {"low": 0.98, "high": 1.02}[side]
    inside, outside = (doubts(turned(figure, factor * limit)) for factor in (1.0 / out, out))
    named = re.compile(rf"(^|, |[lr][fr] ){figure} \d")
    assert not any(named.search(doubt.summary) for doubt in inside)
    assert any(named.search(doubt.summary) for doubt in outside)


def test_the_usual_ranges(unchanged: Unchanged) -> None:
    unchanged(USUAL)


def test_the_doubts_about_cars_in_wrong_units(unchanged: Unchanged) -> None:
    cars: dict[str, Parameters] = {
        "corner of a lorry": replace(CORNER, sprung_mass=2500.0, unsprung_mass=300.0),
        "soft tires": replace(CORNER, tire_stiffness=30e3),
        "pounds": replace(UNEVEN, sprung_mass=2.2 * UNEVEN.sprung_mass, unsprung_mass=Corners.same(110.0)),
        "inches": replace(UNEVEN, track_width=0.63, cg_to_front_axle=0.55, cg_to_rear_axle=0.47),
        "one side": replace(UNEVEN, spring_rate=Corners(1.9e5, 1.0, 0.9e5, 1.1e5)),
        "inertias": replace(UNEVEN, roll_inertia=4.2, pitch_inertia=17.0),
    }
    unchanged({name: doubts(car) for name, car in cars.items()})
