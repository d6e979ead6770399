"""The variables of an assembly are those of its parts, with the same dependencies."""

import xml.etree.ElementTree as ET
from dataclasses import replace

import pytest

from builder.assembly.plan import Assembly, assembly_interface
from cosim import FmuComponent
from eightpost.archive import read_archive

from .hosts import ROADS


def test_the_interface_consists_of_the_parts_variables_by_component(car, case):
    variables = FmuComponent(car, "car").variables
    inputs = {n for n, v in variables.items() if v.causality == "input"}
    assert inputs == {*ROADS, "car.heave_force", "car.roll_moment", "car.pitch_moment", "car.lr.force"}
    for name, component in case.system.components.items():
        for own, variable in component.variables.items():
            if variable.causality != "input":
                there = f"der({name}.{own[4:]}" if own.startswith("der(") else f"{name}.{own}"
                assert replace(variables[there], name=own, direct=variable.direct, start=None) == replace(
                    variable, start=None
                )
    assert float(variables["lf.compression_scale"].start) == 1.2
    assert float(variables["lf.gas_stiffness"].start) == pytest.approx(10 * 4.4482216 / 0.0254)
    assert float(variables["car.heave_force"].start) == pytest.approx(-444.82216)
    assert float(variables["car.lr.force"].start) == 25.0


def test_value_references_are_those_of_the_parts_plus_multiples_of_a_thousand(car, fmus):
    def references(path):
        root = ET.fromstring(read_archive(path)["modelDescription.xml"])
        return {v.get("name"): int(v.get("valueReference")) for v in root.iter("ScalarVariable")}

    found = references(car)
    assert found["coupling_step"] == 0 and found["coupling_error"] == 1
    for number, (name, model) in enumerate((("car", "seven_dof"), ("lf", "lpnl2"), ("rf", "lpf1")), start=1):
        for own, reference in references(fmus[model]).items():
            there = f"der({name}.{own[4:]}" if own.startswith("der(") else f"{name}.{own}"
            assert found.get(there, 1000 * number + reference) == 1000 * number + reference


def test_a_shock_force_has_feedthrough_to_its_own_output_only(car):
    variables = FmuComponent(car, "car").variables
    assert variables["lf.force"].direct == frozenset()
    assert variables["car.lf.velocity"].direct == frozenset()
    assert variables["car.lf.tire_force"].direct == {"car.lf.road"}
    assert variables["car.lr.hub_acceleration"].direct == {"car.lr.road", "car.lr.force"}


def test_dependencies_at_the_start_include_the_springs_but_not_the_curves(case):
    known = assembly_interface(Assembly.of(case.wiring, "car")).initial["lf.force"]
    assert {"lf.gas_preload", "lf.gas_stiffness", "rr.gas_preload", "car.lf.road", "car.start_at_equilibrium"} <= set(
        known
    )
    assert not [name for name in known if "curve" in name or "time_constant" in name]
    assert assembly_interface(Assembly.of(case.wiring, "car")).initial["car.lf.velocity"] == ()
