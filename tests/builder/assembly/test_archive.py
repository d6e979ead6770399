"""The archive of an assembly is like that of a native FMU: clean, correct and reproducible."""

import re
import shutil
import tomllib
import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from fmpy import extract, simulate_fmu
from fmpy.fmi2 import FMU2Model
from fmpy.model_description import read_model_description

from builder.assembly import assemble
from builder.check import GROUPS, Level, check
from builder.toolchain import this_platform
from cosim import FmuComponent
from eightpost.app.exchange import build as command
from eightpost.archive import read_archive
from eightpost.errors import InputError
from tests.builder.documents.members import kept_of

from .hosts import CORNERS, corner_file, difference, host, master, observed, percent, replayed

#: Groups of every day: those that an assembly does not share with its parts.
DAILY = ("static", "tools", "simulation", "state", "initial_dependencies", "dependencies", "reference")


@pytest.mark.nightly
@pytest.mark.parametrize("daily", [True, pytest.param(False, marks=pytest.mark.nightly)], ids=["daily", "all groups"])
def test_check_reports_no_error_and_no_warning_for_an_assembly(corner, daily):
    not_for_it = {"ports", "model_exchange", "version_3"} | (set() if shutil.which("cmake") else {"rebuild"})
    groups = DAILY if daily else tuple(group for group in GROUPS if group not in not_for_it)
    report = check(corner, groups=groups)
    own = {f.rule.identifier: f.rule.level for f in report.findings} | {"platforms": Level.HINT}  # one platform here
    assert own == {"terminals": Level.HINT, "platforms": Level.HINT}
    assert report.done == tuple(GROUPS[group].title for group in groups)


def test_the_reference_results_of_a_quarter_car_equal_the_fmus_output(corner):
    outputs, found, expected = replayed(corner, 200)
    assert "coupling_error" in outputs and expected[-1, outputs.index("damper.coupling_error")] > 0.0
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-9 * np.abs(expected).max())


@pytest.mark.nightly
def test_the_same_assembly_gives_the_same_bytes(case, tmp_path, car):
    again = assemble(case.wiring, tmp_path / "car_with_shocks.fmu")
    assert again.path.read_bytes() == car.read_bytes()


def test_the_paths_in_the_archive_are_those_of_a_native_fmu(car):
    members = set(read_archive(car))
    assert {"model.png", "documentation/index.html", "documentation/licenses/license.txt"} <= members
    listed = {f"sources/{f.get('name')}" for f in ET.fromstring(read_archive(car)["modelDescription.xml"]).iter("File")}
    assert listed == {m for m in members if m.endswith(".c")}
    assert Path(car).stat().st_size < 2_000_000


# ---- Coupling --------------------------------------------------------------------------------------------------------


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


def test_a_tunable_parameter_set_between_steps_takes_effect_in_the_next_step(car):
    names = ["lf.force", "car.lf.velocity"]
    at_once = host(car, 0.004, parameters={"lf.rebound_scale": 1.5}, outputs=names)
    later = host(car, 0.004, later={"lf.rebound_scale": 1.5}, outputs=names)
    assert difference(later, at_once).max() < 1e-12
    assert not np.allclose(later, host(car, 0.004, outputs=names))


@pytest.mark.nightly
def test_a_unit_conversion_on_a_connection_is_a_gain(case, made, tmp_path, car):
    wires = tuple(
        replace(wire, gain=0.25 * wire.gain, factor=4.0, offset=0.0) if wire.source == "lf.force" else wire
        for wire in case.wiring.wires
    )
    path = assemble(replace(case.wiring, wires=wires), tmp_path / "converted.fmu").path
    assert np.array_equal(host(path, 0.004), host(car, 0.004))


@pytest.fixture
def corner_fmu(corner, tmp_path):
    """An instance of the quarter car with its damper, for model exchange, and its description."""
    description = read_model_description(corner)
    fmu = FMU2Model(
        guid=description.guid, unzipDirectory=extract(corner, tmp_path), instanceName="corner",
        modelIdentifier=description.modelExchange.modelIdentifier,
    )  # fmt: skip
    fmu.instantiate()
    fmu.setupExperiment(startTime=0.0)
    fmu.enterInitializationMode()
    fmu.exitInitializationMode()
    fmu.enterContinuousTimeMode()
    yield fmu, description
    fmu.terminate()
    fmu.freeInstance()


def test_a_derivative_along_inputs_and_states_is_the_difference_of_outputs_and_rates(corner_fmu):
    fmu, description = corner_fmu
    rates = [one.variable for one in description.derivatives]
    states = [rate.derivative for rate in rates]
    inputs, outputs = (
        [v for v in description.modelVariables if v.causality == kind and "coupling_error" not in v.name]
        for kind in ("input", "output")
    )
    knowns, unknowns = (
        [v.valueReference for v in [*some, *more]] for some, more in ((inputs, states), (outputs, rates))
    )
    scales = np.array([1.0] * len(inputs) + [float(state.nominal or 1.0) for state in states])
    generator = np.random.default_rng(3)
    place, direction = (scales * generator.uniform(0.2, 1.0, scales.size) for _ in range(2))

    def at(step):
        fmu.setReal(knowns, list(place + step * direction))
        return np.array(fmu.getReal(unknowns))

    h = 1e-6
    differences = (at(h) - at(-h)) / (2.0 * h)
    rounding = 1e-8 * np.abs(at(0.0))
    found = np.array(fmu.getDirectionalDerivative(unknowns, knowns, list(direction)))
    assert (np.abs(found - differences) <= 1e-5 * np.abs(differences) + rounding).all()


def test_the_documents_and_the_wiring_of_a_car_with_shocks_are_the_same(
    car: Path, unchanged: Callable[..., None]
) -> None:
    members = read_archive(car)
    lines = members["sources/assembly_data.h"].decode().splitlines()
    kept = kept_of({name: one for name, one in members.items() if "sources/" not in name}, "car_with_shocks")
    page = [row for row in kept.pop("page") if not row.startswith(("lf.", "lr.", "rr.", "car."))]
    unchanged(kept | {"page": page, "wiring": [re.sub(r"\d{15,}", "", line) for line in lines]})


# ---- Command ---------------------------------------------------------------------------------------------------------


@pytest.mark.nightly
def test_the_command_reports_the_assembled_parts(system_file, tmp_path):
    output = tmp_path / "dist" / "car_with_shocks.fmu"
    ran = CliRunner().invoke(command, [str(system_file), "-o", str(output)], env={"COLUMNS": "200"})
    assert ran.exit_code == 0, ran.output
    for text in ("lpf1.fmu", "car.lf.velocity", "0.5 ms", "coupling_step", this_platform().name):
        assert text in ran.output
    assert output.is_file()


@pytest.mark.nightly
def test_an_assembly_of_fmi_3_breaks_no_rule_and_has_the_results_of_that_of_fmi_2(corner, fmus, tmp_path):
    path = corner_file(tmp_path / "corner.toml", fmus["quarter_car"], fmus["lpnl2"])
    output = tmp_path / "corner_with_damper.fmu"
    ran = CliRunner().invoke(command, [str(path), "--fmi", "3", "-o", str(output)])
    assert ran.exit_code == 0, ran.output
    report = check(output, groups=("static", "tools", "simulation", "version_3"))
    assert report.of(Level.ERROR) == () and report.identity["fmiVersion"] == "3.0"
    start = {"corner.aero_force": 1000.0, "corner.start_at_equilibrium": False}
    old, new = (
        simulate_fmu(str(one), stop_time=0.05, output_interval=1e-3, start_values=start) for one in (corner, output)
    )
    assert np.ptp(new["damper.force"]) > 0.1 and new.tolist() == old.tolist()


def test_the_command_takes_a_system_file_or_sources(system_file):
    for more in (["shock.json"], ["--fmi", "all"]):
        both = CliRunner().invoke(command, [str(system_file), *more])
        assert both.exit_code == 2 and "omit other SOURCES" in both.output
    neither = CliRunner().invoke(command, [])
    assert neither.exit_code == 2 and "Missing argument" in neither.output


def test_an_assembly_never_replaces_a_part_of_it_and_compiles_nothing(system_file, monkeypatch):
    monkeypatch.setattr("builder.assembly.assembled_fmu.compiled", None)
    part = Path(tomllib.loads(system_file.read_text())["components"]["car"]["fmu"])
    before = part.read_bytes()
    ran = CliRunner().invoke(command, [str(system_file), "-o", str(part)])
    assert isinstance(ran.exception, InputError) and f"{part} is an input of this command" in str(ran.exception)
    assert part.read_bytes() == before
