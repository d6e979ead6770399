"""A vehicle and its shocks as one FMU: equal to the master, of second order, and in hosts that hold their inputs."""

import shutil
import xml.etree.ElementTree as ET
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Slave

import cosim
from builder.assembly import Link, assemble, read_parts
from builder.assembly.interface import assembly_interface
from builder.build import build
from builder.check import GROUPS, Level, check
from builder.documents import Disclosure
from builder.native.platforms import this_platform
from builder.native.toolchain import SystemCompiler, find_toolchain
from cosim import FmuComponent, GaussSeidel, Scenario
from cosim.system_file import read_case
from eightpost.archive import read_archive, write_archive
from eightpost.commands.assemble import assembly_of
from eightpost.commands.build import build as command
from eightpost.errors import FmuError
from eightpost.shock import write_shock
from eightpost.signals import Drivefile, TimeSeries

CORNERS = ("lf", "rf", "lr", "rr")
ROADS = tuple(f"car.{corner}.road" for corner in CORNERS)
STOP = 1.0

#: All laws on one car, gas springs, and a damper that is positive in extension at rr.
SYSTEM = """
schema = 1
name = "a car with four dampers"
sums = ["car.lr.force"]

[components.car]
fmu = "{folder}/seven_dof.fmu"
inputs = {{ heave_force = "-100 lbf", roll_moment = 20.0, "lr.force" = 25.0 }}
parameters = {{ "lf.static_tire_force" = 3000.0, "rr.friction_force" = 30.0 }}

[components.lf]
fmu = "{folder}/lpnl2.fmu"
parameters = {{ gas_stiffness = "10 lbf/in", compression_scale = 1.2 }}

[components.rf]
fmu = "{folder}/lpf1.fmu"

[components.lr]
fmu = "{folder}/polylinear.fmu"
parameters = {{ seal_friction = 20.0 }}

[components.rr]
fmu = "{folder}/lpnl2.fmu"

[[bond]]
between = ["car.lf", "lf"]

[[bond]]
between = ["car.rf", "rf"]
displacement = false

[[connection]]
from = "car.rf.displacement"
to = "rf.displacement"
gain = 0.5

[[bond]]
between = ["car.lr", "lr"]

[[bond]]
between = ["car.rr", "rr"]
gain = -1.0

[scenario]
stop = 1.0
"""


@pytest.fixture(scope="session")
def toolchain():
    """For this platform alone where there is a compiler: a build for all takes a minute."""
    found = next((path for name in ("cc", "gcc", "clang") if (path := shutil.which(name))), None)
    return SystemCompiler(found) if found else find_toolchain()


@pytest.fixture
def build_here(toolchain, monkeypatch):
    """Build FMUs with that compiler."""
    monkeypatch.setattr("builder.build.find_toolchain", lambda: toolchain)
    return build


@pytest.fixture(scope="session")
def system_file(fmus, tmp_path_factory):
    path = tmp_path_factory.mktemp("system") / "system.toml"
    path.write_text(SYSTEM.format(folder=fmus["lpnl2"].parent.as_posix()))
    return path


@pytest.fixture(scope="session")
def made(toolchain, tmp_path_factory):
    """Assemble a case: made(case, name) -> path."""
    folder = tmp_path_factory.mktemp("assembled")

    def make(case, name):
        return assemble(assembly_of(case, name), folder / f"{name}.fmu", toolchain=toolchain).path

    return make


@pytest.fixture(scope="session")
def case(system_file):
    return read_case(system_file)


@pytest.fixture(scope="session")
def car(made, case):
    return made(case, "car_with_shocks")


def road(time):
    """Four roads (4, K), none like another."""
    phases = np.arange(4)[:, None]
    slow, fast = 2.0 * np.pi * (1.1 + 0.3 * phases) * time, 2.0 * np.pi * (9.0 + 1.7 * phases) * time
    return 0.008 * np.sin(slow) + 0.002 * np.sin(fast + phases)


def grid(step):
    return np.arange(round(STOP / step) + 1) * step


def host(path, step, *, ramped=True, parameters=None, later=None, outputs=None):
    """Run an assembly in a loop of its own; return outputs (P, K+1)."""
    fmu = FmuComponent(path, "car")
    time = grid(step)
    u = road(time)
    outputs = outputs or observed(fmu)
    try:
        fmu.begin(0.0, STOP, parameters or {})
        fmu.set(ROADS, u[:, 0].tolist())
        fmu.end_initialization()
        fmu.set(list(later or ()), list((later or {}).values()))
        rows = [fmu.get(outputs)]
        for k in range(time.size - 1):
            fmu.set(ROADS, u[:, k].tolist())
            if ramped:
                fmu.set_derivatives(ROADS, ((u[:, k + 1] - u[:, k]) / step).tolist())
            fmu.step(k * step, step)
            rows.append(fmu.get(outputs))
        return np.array(rows).T
    finally:
        fmu.finish()


def observed(fmu):
    """Every output of the parts; the assembly's own estimates are no variables of theirs."""
    return [n for n, v in fmu.variables.items() if v.causality == "output" and not n.endswith("coupling_error")]


def master(case, step, *, drive_step, outputs, algorithm=None):
    """Run the separate FMUs in the master; return outputs (P, K+1) at the drive's steps, and the result."""
    time = grid(drive_step)
    rows = dict(zip(ROADS, road(time), strict=True))
    drive = Drivefile(TimeSeries.from_channels(time, {n.removeprefix("car."): ("m", v) for n, v in rows.items()}))
    scenario = Scenario(
        stop=STOP,
        drive=drive,
        targets={n.removeprefix("car."): n for n in ROADS},
        record=tuple(outputs),
        record_step=drive_step,
    )
    free = {f"car.{n}": 0.0 for n in ("heave_force", "roll_moment", "pitch_moment")}
    system = replace(case.system, constants=free | dict(case.system.constants))
    result = cosim.run(system, scenario, algorithm=algorithm or GaussSeidel(), step=step)
    return np.array([result.series[name] for name in outputs]), result


def difference(one, other):
    """Largest difference of each output, of its largest value."""
    return np.abs(one - other).max(axis=1) / (np.abs(other).max(axis=1) + 1e-12)


def percent(rows, reference):
    """RMS error of each row in percent of the reference's standard deviation, after the first 0.2 s."""
    start = rows.shape[1] // 5
    error = np.sqrt(np.mean((rows - reference)[:, start:] ** 2, axis=1))
    return 100.0 * error / reference[:, start:].std(axis=1)


@pytest.mark.parametrize("step", [0.0005, 0.001, 0.004, 0.02])
def test_it_equals_the_masters_result_at_communication_steps_of_whole_micro_steps(car, case, step):
    outputs = observed(FmuComponent(car, "car"))
    expected, _ = master(case, 0.0005, drive_step=step, outputs=outputs)
    assert difference(host(car, step), expected).max() < 1e-9


def test_its_error_estimates_are_those_of_the_masters_result(car, case):
    names = [f"{corner}.coupling_error" for corner in CORNERS]
    found = host(car, 0.001, outputs=[*names, "coupling_error"])[:, -1]
    _, result = master(case, 0.0005, drive_step=0.001, outputs=["lf.force"])
    expected = [result.coupled[f"car.{corner}"].force_error for corner in CORNERS]
    assert found[:4] == pytest.approx(expected, rel=1e-6)
    assert found[4] == pytest.approx(max(c.percent for c in result.coupled.values()), rel=1e-6)


def test_a_communication_step_that_is_no_whole_number_of_micro_steps_is_cut_into_equal_ones(car, case):
    outputs = observed(FmuComponent(car, "car"))
    expected, _ = master(case, 0.0004, drive_step=0.002, outputs=outputs)
    assert difference(host(car, 0.002, parameters={"coupling_step": 0.00045}), expected).max() < 1e-9


@pytest.fixture(scope="session")
def measured(car, case):
    """Outputs of the car and the exact answer at 125 Hz: (names, exact)."""
    names = [f"car.{corner}.{name}" for name in ("velocity", "tire_force") for corner in CORNERS]
    return names, host(car, 0.008, parameters={"coupling_step": 1e-5}, outputs=names)


def test_the_error_is_of_second_order_in_the_coupling_step(car, measured):
    names, exact = measured
    steps = (0.002, 0.001, 0.0005)
    errors = [percent(host(car, 0.008, parameters={"coupling_step": h}, outputs=names), exact) for h in steps]
    ratios = [(coarse / fine).mean() for coarse, fine in pairwise(errors)]
    assert all(3.4 < ratio < 4.8 for ratio in ratios), ratios
    assert errors[-1].max() < 0.2


def held_separately(fmus, case, step, names):
    """A plain host of separate FMUs: everything held, all stepped at once; (P, K+1)."""
    parts = {name: FmuComponent(path, name) for name, path in case.fmus.items()}
    links = [(*c.source.split(".", 1), *c.target.split(".", 1), c.gain) for c in case.system.all_connections]
    time = grid(step)
    u = road(time)

    def exchange():
        fed = {}
        for source, output, target, name, gain in links:
            constant = case.system.constants.get(f"{target}.{name}", 0.0)
            fed.setdefault(target, {})[name] = gain * parts[source].get([output])[0] + constant
        for target, values in fed.items():
            parts[target].set(list(values), list(values.values()))
        return [parts[part].get([variable])[0] for part, _, variable in (n.partition(".") for n in names)]

    try:
        for name, part in parts.items():
            part.begin(0.0, STOP, case.system.parameters.get(name, {}))
        constants = {n: v for n, v in case.system.constants.items() if n not in case.system.sums}
        parts["car"].set([n.removeprefix("car.") for n in constants], list(constants.values()))
        parts["car"].set([n.removeprefix("car.") for n in ROADS], u[:, 0].tolist())
        for _ in range(20):
            exchange()
        for part in parts.values():
            part.end_initialization()
        rows = [exchange()]
        for k in range(time.size - 1):
            parts["car"].set([n.removeprefix("car.") for n in ROADS], u[:, k].tolist())
            for part in parts.values():
                part.step(k * step, step)
            rows.append(exchange())
        return np.array(rows).T
    finally:
        for part in parts.values():
            part.finish()


def test_in_a_host_that_holds_inputs_at_125_hz_it_is_a_hundred_times_nearer_than_separate_fmus(
    car, case, fmus, measured
):
    """The exact answer to the held roads: what is left is the coupling's error alone."""
    names, _ = measured
    exact = host(car, 0.008, ramped=False, parameters={"coupling_step": 1e-5}, outputs=names)
    inside = percent(host(car, 0.008, ramped=False, outputs=names), exact).max()
    with np.errstate(over="ignore", invalid="ignore"):
        separate = percent(held_separately(fmus, case, 0.008, names), exact).max()
    assert inside < 0.5
    assert not separate < 100.0 * inside


def test_setting_the_parameters_of_one_corner_is_the_same_as_another_fmu_there(
    car, made, system_file, shocks, build_here, tmp_path
):
    law = shocks["lpnl2"].law
    other = replace(law, time_constant=0.004, curve=replace(law.curve, compression=(1490.0, 500.0, 80.0, 5.0)))
    write_shock(replace(shocks["lpnl2"], law=other), tmp_path / "other.json")
    (swapped,) = build_here([tmp_path / "other.json"], tmp_path)
    swapped_case = read_case(system_file, fmus={"rr": swapped.path})
    path = made(swapped_case, "swapped")
    starts = {n: v.start for n, v in FmuComponent(path, "car").variables.items() if n.startswith("rr.")}
    parameters = {n: v for n, v in starts.items() if v is not None and not n.endswith("coupling_error")}
    parameters = {n: float(v) for n, v in parameters.items()}
    found = host(car, 0.004, parameters=parameters)
    assert np.array_equal(found, host(path, 0.004))
    assert not np.allclose(found, host(car, 0.004))
    expected, _ = master(swapped_case, 0.0005, drive_step=0.004, outputs=observed(FmuComponent(path, "car")))
    assert difference(found, expected).max() < 1e-9


def test_a_tunable_parameter_set_between_steps_counts_from_there(car):
    names = ["lf.force", "car.lf.velocity"]
    at_once = host(car, 0.004, parameters={"lf.rebound_scale": 1.5}, outputs=names)
    later = host(car, 0.004, later={"lf.rebound_scale": 1.5}, outputs=names)
    assert difference(later, at_once).max() < 1e-12
    assert not np.allclose(later, host(car, 0.004, outputs=names))


def test_a_restored_state_goes_on_bit_for_bit(car):
    folder = extract(str(car))
    description = read_model_description(folder)
    references = {v.name: v.valueReference for v in description.modelVariables}
    outputs = [v.valueReference for v in description.modelVariables if v.causality == "output"]
    fmu = FMU2Slave(guid=description.guid, unzipDirectory=folder, modelIdentifier="car_with_shocks", instanceName="a")
    fmu.instantiate()
    fmu.setupExperiment(startTime=0.0)
    fmu.enterInitializationMode()
    fmu.exitInitializationMode()

    def run(begin):
        rows = []
        for k in range(20):
            fmu.setReal([references["car.lf.road"]], [0.01 * np.sin(0.3 * k)])
            fmu.doStep(begin + k * 0.003, 0.003)
            rows.append(fmu.getReal(outputs))
        return rows

    run(0.0)
    state = fmu.getFMUstate()
    packed = fmu.serializeFMUstate(state)
    first = run(0.06)
    fmu.setFMUstate(state)
    assert run(0.06) == first
    fmu.setFMUstate(fmu.deSerializeFMUstate(packed))
    assert run(0.06) == first
    fmu.freeFMUstate(state)
    fmu.terminate()
    fmu.freeInstance()
    shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture(scope="session")
def corner_file(fmus, tmp_path_factory):
    """A quarter car, whose gas spring shows in every start."""
    path = tmp_path_factory.mktemp("corner") / "corner.toml"
    path.write_text(
        f"""
schema = 1
[components.corner]
fmu = "{fmus["quarter_car"].as_posix()}"
[components.damper]
fmu = "{fmus["lpnl2"].as_posix()}"
[[bond]]
between = ["corner", "damper"]
[scenario]
stop = 1.0
"""
    )
    return path


@pytest.fixture(scope="session")
def corner(corner_file, made):
    return made(read_case(corner_file), "corner_with_damper")


def test_check_finds_no_error_and_nothing_that_breaks_an_import(corner):
    groups = tuple(g for g in GROUPS if g != "ports" and (g != "rebuild" or shutil.which("cmake")))  # it has no port
    report = check(corner, groups=groups)
    own = {f.rule.identifier: f.rule.level for f in report.findings} | {"platforms": Level.HINT}  # one platform here
    assert own == {"terminals": Level.HINT, "platforms": Level.HINT}
    assert report.done == tuple(GROUPS[group].title for group in groups)


def test_the_reference_results_are_what_the_fmu_gives(car):
    """Of the whole car: the check of the quarter car compares its own."""
    report = check(car, groups=("reference",))
    assert report.findings == ()
    members = read_archive(car)
    head = members["extra/eightpost/car_with_shocks_ref.csv"].splitlines()[0].decode()
    assert '"coupling_error"' in head and '"car.rf.hub_acceleration"' in head and '"rr.force"' in head


def test_its_interface_is_that_of_its_parts_by_component(car, case):
    variables = FmuComponent(car, "car").variables
    inputs = {n for n, v in variables.items() if v.causality == "input"}
    assert inputs == {*ROADS, "car.heave_force", "car.roll_moment", "car.pitch_moment", "car.lr.force"}
    for name, component in case.system.components.items():
        for own, variable in component.variables.items():
            if variable.causality != "input":
                assert replace(variables[f"{name}.{own}"], name=own, direct=variable.direct, start=None) == replace(
                    variable, start=None
                )
    assert float(variables["lf.compression_scale"].start) == 1.2
    assert float(variables["lf.gas_stiffness"].start) == pytest.approx(10 * 4.4482216 / 0.0254)
    assert float(variables["car.heave_force"].start) == pytest.approx(-444.82216)
    assert float(variables["car.lr.force"].start) == 25.0


def test_the_same_assembly_gives_the_same_bytes(case, toolchain, tmp_path, car):
    again = assemble(assembly_of(case, "car_with_shocks"), tmp_path / "car_with_shocks.fmu", toolchain=toolchain)
    assert again.path.read_bytes() == car.read_bytes()


def test_value_references_are_those_of_the_parts_in_thousands(car, fmus):
    def references(path):
        root = ET.fromstring(read_archive(path)["modelDescription.xml"])
        return {v.get("name"): int(v.get("valueReference")) for v in root.iter("ScalarVariable")}

    found = references(car)
    assert found["coupling_step"] == 0 and found["coupling_error"] == 1
    for number, (name, model) in enumerate((("car", "seven_dof"), ("lf", "lpnl2"), ("rf", "lpf1")), start=1):
        for own, reference in references(fmus[model]).items():
            assert found.get(f"{name}.{own}", 1000 * number + reference) == 1000 * number + reference


def test_a_shock_force_without_delay_comes_to_no_output_but_its_own(car):
    variables = FmuComponent(car, "car").variables
    assert variables["lf.force"].direct == frozenset()
    assert variables["car.lf.velocity"].direct == frozenset()
    assert variables["car.lf.tire_force"].direct == {"car.lf.road"}
    assert variables["car.lr.hub_acceleration"].direct == {"car.lr.road", "car.lr.force"}


def test_every_component_that_cannot_be_a_part_is_named_with_what_to_do(
    fmus, python_fmus, model_files, build_here, tmp_path
):
    shock = next(path for path in model_files if path.stem == "lpnl2")
    (closed,) = build_here([shock], tmp_path, disclosure=Disclosure.CONFIDENTIAL)
    members = read_archive(fmus["lpf1"])
    for name, old, new in (("foreign", b'name="eightpost"', b'name="other"'), ("old", b"h / tau", b"h/tau")):
        changed = {
            n: c.replace(old, new) if n in ("modelDescription.xml", "sources/lag.h") else c for n, c in members.items()
        }
        write_archive(tmp_path / f"{name}.fmu", changed)
    files = {"a": python_fmus["lpnl2"], "b": closed.path, "c": tmp_path / "foreign.fmu", "d": tmp_path / "old.fmu"}
    with pytest.raises(FmuError) as refused:
        read_parts({"car": fmus["seven_dof"], **files})
    message = str(refused.value)
    for said in ("a (", "--target native", "b (", "confidential", "c (", "eightpost run", "d (", "build it again"):
        assert said in message
    assert "car (" not in message


def _plan(case, **changes):
    return replace(assembly_of(case, "car"), **changes)


def test_systems_that_are_no_vehicle_with_its_shocks_are_refused_with_the_reason(case, fmus):
    plan = assembly_of(case, "car")
    vehicle = plan.vehicle
    with pytest.raises(FmuError, match="there are 2 vehicles"):
        _plan(case, parts=(*plan.parts, replace(vehicle, name="second")))
    with pytest.raises(FmuError, match="there is no shock"):
        _plan(case, parts=(vehicle,), links=())
    with pytest.raises(FmuError, match=r"lf\.force -> rf\.displacement does not go between"):
        _plan(case, links=(*plan.links, Link("lf.force", "rf.displacement")))
    with pytest.raises(FmuError, match="is no output"):
        _plan(case, links=(*plan.links, Link("lf.lagged_force", "car.heave_force")))
    with pytest.raises(FmuError, match="makes a loop without a delay"):
        _plan(case, links=(*plan.links, Link("car.lf.hub_acceleration", "lf.displacement")))
    with pytest.raises(FmuError, match="feeds no other component"):
        _plan(case, links=tuple(link for link in plan.links if not link.source.startswith("lf.")))
    with pytest.raises(FmuError, match="cannot begin the names"):
        _plan(case, parts=(replace(vehicle, name="race-car"), *plan.shocks), links=())


def test_a_unit_conversion_on_a_connection_is_a_gain(case, made, toolchain, tmp_path, car):
    plan = assembly_of(case, "car_with_shocks")
    links = tuple(
        replace(link, gain=0.25 * link.gain, factor=4.0, offset=0.0) if link.source == "lf.force" else link
        for link in plan.links
    )
    path = assemble(replace(plan, links=links), tmp_path / "converted.fmu", toolchain=toolchain).path
    assert np.array_equal(host(path, 0.004), host(car, 0.004))


def test_the_command_says_what_was_put_together(system_file, tmp_path, toolchain, monkeypatch):
    monkeypatch.setattr("builder.assembly.assembled.find_toolchain", lambda: toolchain)
    output = tmp_path / "dist" / "car_with_shocks.fmu"
    ran = CliRunner().invoke(command, ["--assemble", str(system_file), "-o", str(output)], env={"COLUMNS": "200"})
    assert ran.exit_code == 0, ran.output
    for said in ("lpf1.fmu", "car.lf.velocity", "0.5 ms", "coupling_step", this_platform().name):
        assert said in ran.output
    assert output.is_file()


def test_the_command_takes_a_system_file_or_sources(system_file):
    both = CliRunner().invoke(command, ["--assemble", str(system_file), "shock.json"])
    assert both.exit_code == 2 and "nothing else" in both.output
    neither = CliRunner().invoke(command, [])
    assert neither.exit_code == 2 and "Missing argument" in neither.output


def test_dependencies_at_the_start_name_the_springs_but_no_curve(case):
    known = assembly_interface(assembly_of(case, "car")).initial["lf.force"]
    assert {"lf.gas_preload", "lf.gas_stiffness", "rr.gas_preload", "car.lf.road", "car.start_at_equilibrium"} <= set(
        known
    )
    assert not [name for name in known if "curve" in name or "time_constant" in name]
    assert assembly_interface(assembly_of(case, "car")).initial["car.lf.velocity"] == ()


def test_paths_of_archives_stay_those_of_a_native_fmu(car):
    members = set(read_archive(car))
    assert {"model.png", "documentation/index.html", "documentation/licenses/license.txt"} <= members
    listed = {f"sources/{f.get('name')}" for f in ET.fromstring(read_archive(car)["modelDescription.xml"]).iter("File")}
    assert listed == {m for m in members if m.endswith(".c")}
    assert Path(car).stat().st_size < 2_000_000
