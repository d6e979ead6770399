"""modelDescription.xml is complete and correct."""

import re
import tomllib
import xml.etree.ElementTree as ET
import zipfile
from pathlib import Path

import numpy as np
import pytest
from fmpy import read_model_description

from builder.build import build
from builder.interface import source_folder
from eightpost.shock import LAWS, write_shock
from eightpost.vehicle import shipped

ALL = (*LAWS, "seven_dof", "quarter_car")
GOLDEN = tomllib.loads(Path(__file__).with_name("value_references.toml").read_text())


def xml_of(path):
    with zipfile.ZipFile(path) as archive:
        return ET.fromstring(archive.read("modelDescription.xml"))


def _elements(table):
    for name, reference in table.items():
        row = re.fullmatch(r"(.*\[)1\.\.(\d+)(\].*)", name)
        yield from (
            [(f"{row[1]}{k + 1}{row[3]}", reference + k) for k in range(int(row[2]))] if row else [(name, reference)]
        )


@pytest.mark.parametrize("name", ALL)
def test_names_and_value_references_are_frozen_for_this_interface_version(fmus, name):
    root = xml_of(fmus[name])
    golden = dict(_elements((GOLDEN["shock"] if name in LAWS else {}) | GOLDEN[name]))
    interface = root.find("VendorAnnotations/Tool/Interface").attrib
    assert f"{interface['name']} {interface['version']}" == golden.pop("interface")
    assert {v.get("name"): int(v.get("valueReference")) for v in root.iter("ScalarVariable")} == golden


def depends(fmu, outputs, name, size, time):
    """Return the outputs that change with one input, over one very short step or in initialization."""
    before = np.array(fmu.get(outputs))
    start = fmu.get((name,))[0]
    fmu.set((name,), (start + size,))
    if time is not None:
        fmu.step(time, 1e-12)
    moved = np.abs(np.array(fmu.get(outputs)) - before) > 1e-7 * (1.0 + np.abs(before))
    fmu.set((name,), (start,))
    if time is not None:
        fmu.step(time, 1e-12)
    return {output for output, yes in zip(outputs, moved, strict=True) if yes}


@pytest.mark.parametrize("name", ALL)
def test_the_declared_dependencies_are_correct(fmus, component, name):
    """Check that after a step of 1e-12 s an output depends on an input exactly if feedthrough is declared."""
    description = read_model_description(str(fmus[name]))
    extra = {"seal_friction": 20.0, "gas_stiffness": 500.0} if name in LAWS else {}
    springs = [v.name for v in description.modelVariables if v.name.endswith("port_spring")]
    extra |= {spring: 1e5 * (k + 1) for k, spring in enumerate(springs)}  # they couple loads in the steady state
    inputs = [v for v in description.modelVariables if v.causality == "input"]
    outputs = tuple(v.name for v in description.modelVariables if v.causality == "output")
    for unknowns, time in ((description.initialUnknowns, None), (description.outputs, 1e-3)):
        declared = {u.variable.name: {d.name for d in u.dependencies} for u in unknowns if u.variable.name in outputs}
        moved = dict.fromkeys((v.name for v in inputs), frozenset())
        for start in ({}, {"start_at_equilibrium": False}) if name in ("seven_dof", "quarter_car") else ({},):
            fmu = component(name, **extra, **start)
            if time is not None:
                fmu.end_initialization()
                fmu.step(0.0, 1e-3)
            for variable in inputs:
                size = {"m": 0.01, "m/s": 0.1}.get(variable.unit, 1000.0)
                moved[variable.name] |= depends(fmu, outputs, variable.name, size, time)
        assert moved == {v.name: {o for o in outputs if v.name in declared[o]} for v in inputs}


@pytest.mark.repeated
@pytest.mark.parametrize("name", ALL)
def test_the_same_source_gives_the_same_bytes_and_another_source_another_guid(fmus, shocks, tmp_path, name):
    if name in shocks:
        write_shock(shocks[name], source := tmp_path / f"{name}.json")
    else:
        source = shipped(name)
    (built,) = build([source], tmp_path / "again")
    assert built.path.read_bytes() == fmus[name].read_bytes()
    guids = {xml_of(path).get("guid") for path in fmus.values()}
    assert len(guids) == len(fmus)


def test_every_fmu_source_folder_contains_interface_model_and_readme():
    folders = [
        path for path in source_folder().iterdir() if path.is_dir() and path.name not in ("common", "fmi3", "machine")
    ]
    assert {path.name for path in folders} >= {"vehicle_ss", *(f"shock_{law}" for law in LAWS)}
    for folder in folders:
        assert {p.name for p in folder.iterdir() if p.is_file()} >= {"interface.toml", "model.c", "README.md"}
