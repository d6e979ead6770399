"""Systems in systems and descriptions in place of components are flattened into one system."""

import pytest

import cosim
from eightpost.archive import write_archive
from eightpost.errors import WiringError

from .corner import CAR, DAMPER, NESTED_LINKS, NESTED_PORTS, OUTER_LINKS, by_hand, corner, read, run, same
from .document import binding, bindings, component, description, parameter, system


def test_nested_systems_are_flattened_and_their_bonds_are_kept(folder):
    inner = system("axle", DAMPER, NESTED_LINKS, NESTED_PORTS)
    case = read(folder, corner(CAR + inner, OUTER_LINKS))
    assert "component names: axle.damper is axle_damper" in case.notes
    assert case.system.bonds == (cosim.Bond.between("car", "axle_damper"),)
    same(run(case), by_hand(folder), lambda name: name.replace("axle_damper", "shock"))


def test_duplicate_names_after_flattening_are_numbered(folder):
    inner = system("axle", DAMPER, NESTED_LINKS, NESTED_PORTS)
    spare = component("axle_damper", "resources/lpnl2.fmu", extra=bindings(binding(
        parameter("velocity", 0.0), parameter("displacement", 0.0), parameter("gas_stiffness", 0.0))))  # fmt: skip
    case = read(folder, corner(CAR + inner + spare, OUTER_LINKS))
    assert set(case.system.components) == {"car", "axle_damper", "axle_damper_2"}
    assert "component names: axle.damper is axle_damper_2" in case.notes


@pytest.mark.repeated(2)
@pytest.mark.parametrize("kind", ["description", "package", "package without a type", "variant"])
def test_a_component_may_be_another_system_description(folder, kind):
    top = description(system("anything", DAMPER, NESTED_LINKS, NESTED_PORTS), experiment="")
    attributes, source = {"type": "application/x-ssp-package"}, "resources/axle.ssp"
    if kind == "description":
        (folder / "axle.ssd").write_bytes(top)
        attributes, source = {"type": "application/x-ssp-definition"}, "axle.ssd"
    else:
        name = "Soft.ssd" if kind == "variant" else "SystemStructure.ssd"
        members = {name: top, "resources/lpnl2.fmu": (folder / "resources" / "lpnl2.fmu").read_bytes()}
        write_archive(folder / source, members)
        source += "#Soft.ssd" if kind == "variant" else ""
    element = component("axle", source, **({} if kind == "package without a type" else attributes))
    case = read(folder, corner(CAR + element, OUTER_LINKS))
    same(run(case), by_hand(folder), lambda name: name.replace("axle_damper", "shock"))


def test_a_component_may_be_a_system_of_the_same_document(folder):
    twin = system("twin", DAMPER, NESTED_LINKS, NESTED_PORTS, id="definition")
    idle = bindings(binding(parameter("twin.damper.gas_stiffness", 0.0)))
    case = read(folder, corner(CAR + component("axle", "#definition") + twin, OUTER_LINKS, bindings=idle))
    assert case.system.bonds == (cosim.Bond.between("car", "axle_damper"),)
    assert set(case.system.components) == {"car", "axle_damper", "twin_damper"}
    own = system("twin", component("inner", "#definition"), "", id="definition")
    with pytest.raises(WiringError, match="component 'inner': the system '#definition' contains itself"):
        read(folder, corner(CAR + own, ""))


def test_a_description_that_contains_itself_is_refused(folder):
    element = component("axle", "corner.ssd", type="application/x-ssp-definition")
    with pytest.raises(WiringError, match=r"corner\.ssd contains itself"):
        read(folder, corner(CAR + element, ""))
    (folder / "a.ssd").write_bytes(description(system("a", component("b", "b.ssd"), "")))
    (folder / "b.ssd").write_bytes(description(system("b", component("a", "a.ssd"), "")))
    with pytest.raises(WiringError, match=r"[ab]\.ssd contains itself"):
        read(folder, corner(CAR + component("a", "a.ssd"), ""))
