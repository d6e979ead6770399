"""Integer, Boolean and enumeration variables are coupled, held over coupling steps, driven and recorded."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from cosim import (
    Adaptive,
    Connection,
    FmuComponent,
    GaussSeidel,
    Implicit,
    IsolatedComponent,
    Jacobi,
    Scenario,
    System,
    run,
)
from cosim.ssp import Given, read_ssp
from cosim.system_file import read_case
from eightpost.__main__ import main
from eightpost.archive import write_archive
from eightpost.errors import WiringError
from eightpost.signals import Drivefile, TimeSeries, read_series
from tests.unchanged import refusals

from . import version_2

SOURCE = Path(__file__).with_name("discrete_fmu.c")
STEP, STOP = 1e-3, 0.05
DISCRETE = '{}" variability="discrete'
VARIABLES = (
    ("count", 1, DISCRETE.format("output"), "Integer"),
    ("mode", 2, DISCRETE.format("output"), 'Enumeration declaredType="Mode"'),
    ("is_odd", 1, DISCRETE.format("output"), "Boolean"),
    ("wave", 1, "output", "Real"),
    ("seen", 2, "output", "Real"),
    ("integer", 10, DISCRETE.format("input"), 'Integer start="0"'),
    ("item", 11, DISCRETE.format("input"), 'Enumeration declaredType="Mode" start="1"'),
    ("boolean", 10, DISCRETE.format("input"), 'Boolean start="false"'),
    ("real", 10, "input", 'Real start="0"'),
)
SAME = {"count": "integer", "mode": "item", "is_odd": "boolean"}


@pytest.fixture(scope="module")
def fmu(foreign_compiler, tmp_path_factory):
    folder = tmp_path_factory.mktemp("discrete")
    items = "".join(f'<Item name="{name}" value="{k + 1}"/>' for k, name in enumerate(("soft", "normal", "hard")))
    types = f'<SimpleType name="Mode"><Enumeration>{items}</Enumeration></SimpleType>'
    declared = {
        "flags": 'canHandleVariableCommunicationStepSize="true" canGetAndSetFMUstate="true"',
        "more": f"<TypeDefinitions>{types}</TypeDefinitions>",
    }
    library = foreign_compiler(folder / "discrete.so", source=SOURCE)
    return version_2.write(folder / "discrete.fmu", library, "discrete", VARIABLES, **declared)


@pytest.fixture(params=[FmuComponent, pytest.param(IsolatedComponent, marks=pytest.mark.nightly)])
def kind(request):
    """Component class; that values of every type reach an isolated FMU is tested in test_traits.py and test_fmi3.py."""
    return request.param


@pytest.fixture
def pair(fmu, kind):
    """Return a function that builds a system of a source and a sink with the given connections."""

    def build(connections, **options):
        constants = {"source.real": 0.0, "sink.real": 0.0} | options.pop("constants", {})
        fed = {connection.target for connection in connections} | set(options.pop("driven", ()))
        return System(
            {name: kind(fmu, name) for name in ("sink", "source")},
            connections=connections,
            constants={name: value for name, value in constants.items() if name not in fed},
            **options,
        )

    return build


def links(**changed):
    return tuple(Connection(f"source.{output}", f"sink.{into}", **changed) for output, into in SAME.items())


def counts(times):
    return np.floor(250.0 * times + 1e-6)


def seen_by_a_step(times):
    """Return the sink's output at the end of each step: the source's outputs at the step's start."""
    count = counts(times[:-1])
    return count + 10.0 * (count % 2) + 100.0 * (1.0 + count % 3)


@pytest.mark.parametrize(
    "algorithm", [Jacobi(), GaussSeidel(), GaussSeidel(values="parabolic"), Implicit()], ids=["j", "gs", "gs3", "im"]
)
def test_values_at_a_communication_point_are_held_over_the_next_coupling_step(algorithm, pair):
    """This does not depend on the algorithm or on the order of the components."""
    result = run(pair(links()), Scenario(stop=STOP), algorithm=algorithm, step=STEP, engine="python")
    series = result.series
    np.testing.assert_allclose(series["sink.seen"][1:], seen_by_a_step(series.time), atol=1e-9)
    np.testing.assert_array_equal(series["source.count"], counts(series.time))
    np.testing.assert_array_equal(series["source.is_odd"], counts(series.time) % 2)
    np.testing.assert_array_equal(series["source.mode"], 1.0 + counts(series.time) % 3)
    assert {"sink.count", "sink.is_odd", "sink.mode", "sink.wave"} < set(series.names)


@pytest.mark.parametrize("kind", [FmuComponent])
def test_an_adaptive_run_and_the_compiled_loop_hold_discrete_values(pair):
    recorded = Scenario(stop=STOP, record_step=STEP)
    for algorithm, engine in ((Adaptive(largest=STEP, least=STEP), "compiled"), (GaussSeidel(), "compiled")):
        series = run(pair(links()), recorded, algorithm=algorithm, step=STEP, engine=engine).series
        np.testing.assert_allclose(series["sink.seen"][1:], seen_by_a_step(series.time), atol=1e-9)
        np.testing.assert_array_equal(series["source.count"], counts(series.time))


@pytest.mark.parametrize("kind", [FmuComponent])
def test_values_of_another_type_are_refused_with_how_to_convert_them(pair, unchanged):
    crossed = (("wave", "integer"), ("count", "real"), ("count", "boolean"), ("mode", "integer"))
    calls = {f"{a} to {b}": partial(pair, (Connection(f"source.{a}", f"sink.{b}"),)) for a, b in crossed}
    unchanged(refusals(calls | {
        "a gain": lambda: pair((Connection("source.count", "sink.integer", 2.0),)),
        "a sum": lambda: pair((*links()[:1], Connection("sink.count", "sink.integer"))),
        "an unknown item": lambda: pair(()).with_parameters({"sink.item": "herd"}),
        **{f"{value} for {name}": partial(pair, (), constants={f"sink.{name}": value})
           for name, value in (("integer", 1.5), ("boolean", 1), ("item", True))},
    }))  # fmt: skip


def test_converted_values_are_rounded_and_held(pair):
    """count -> real with a gain; wave -> integer, to the nearest; count -> boolean, true unless 0."""
    converted = (
        Connection("source.count", "sink.real", 0.5, 1.0, convert=True),
        Connection("source.wave", "sink.integer", 9.0, convert=True),
        Connection("source.count", "sink.boolean", convert=True),
    )
    series = run(pair(converted), Scenario(stop=STOP), step=STEP, engine="python").series
    before = series.time[:-1]
    expected = 1000.0 * (1.0 + 0.5 * counts(before)) + np.round(9.0 * np.sin(20.0 * before)) + 100.0
    np.testing.assert_allclose(series["sink.seen"][1:], expected + 10.0 * (counts(before) != 0.0), atol=1e-9)


def test_discrete_variables_are_set_by_constants_parameters_and_a_drive(pair):
    """The drive's latest sample is used: integers are not interpolated."""
    time = np.array([0.0, 0.0204, 0.0396, 0.06])
    drive = Drivefile(TimeSeries.from_channels(time, {"gear": ("1", np.array([1.0, 4.0, 2.0, 7.0]))}))
    system = pair((), driven=["sink.integer"], constants={"sink.boolean": True}, parameters={"sink": {"item": 3}})
    scenario = Scenario(stop=STOP, drive=drive, targets={"gear": "sink.integer"}, record=("sink.seen",))
    series = run(system, scenario, step=STEP, engine="python").series
    gear = np.array([1.0, 4.0, 2.0])[np.searchsorted(time, series.time[:-1] + 1e-9, "right") - 1]
    np.testing.assert_allclose(series["sink.seen"][1:], 310.0 + gear, atol=1e-9)


@pytest.mark.parametrize("kind", [FmuComponent])
def test_an_enumeration_takes_the_name_of_an_item(pair):
    system = pair(()).with_parameters({"sink.item": "hard"})
    assert system.parameters["sink"] == {"item": 3}


@pytest.mark.parametrize("kind", [FmuComponent])
def test_recorded_discrete_values_are_written_and_read_back(pair, tmp_path):
    result = run(pair(links()), Scenario(stop=STOP, record_step=5e-3), step=STEP, engine="python")
    parquet, table, _ = result.write(tmp_path)
    for path in (parquet, table):
        np.testing.assert_array_equal(read_series(path)["source.mode"], 1.0 + counts(result.series.time) % 3)


CASE = """
schema = 1
[components.source]
fmu = "{fmu}"
inputs = {{ real = 0.0 }}
[components.sink]
fmu = "{fmu}"
inputs = {{ integer = 3, boolean = true }}
parameters = {{ item = 2 }}
[[connection]]
from = "source.count"
to = "sink.real"
gain = 2.0
convert = true
[scenario]
stop = 0.05
coupling_step = "1 ms"
"""


def test_a_system_file_connects_and_converts_discrete_variables(fmu, tmp_path):
    (tmp_path / "case.toml").write_text(CASE.format(fmu=fmu))
    case = read_case(tmp_path / "case.toml")
    series = run(case.system, case.scenario, algorithm=case.algorithm, step=case.step, engine="python").series
    np.testing.assert_allclose(series["sink.seen"][1:], 213.0 + 2000.0 * counts(series.time[:-1]), atol=1e-9)


def test_a_package_that_we_write_contains_discrete_values_and_conversions(fmu, tmp_path):
    """Values and conversions; an enumeration's connector would need its items, so a value of one is refused."""
    text = CASE.replace("parameters = {{ item = 2 }}\n", "").format(fmu=fmu)
    (tmp_path / "case.toml").write_text(text)
    words = ["export", str(tmp_path / "case.toml"), "-o", str(tmp_path / "c.ssp")]
    assert CliRunner().invoke(main, words).exit_code == 0
    case = read_case(tmp_path / "c.ssp")
    series = run(case.system, case.scenario, algorithm=case.algorithm, step=case.step, engine="python").series
    np.testing.assert_allclose(series["sink.seen"][1:], 113.0 + 2000.0 * counts(series.time[:-1]), atol=1e-9)


SSD = """<?xml version="1.0"?>
<ssd:SystemStructureDescription name="d" version="1.0"
 xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription"
 xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon">
 <ssd:System name="s"><ssd:Elements>
  <ssd:Component name="source" source="discrete.fmu"/><ssd:Component name="sink" source="discrete.fmu"/>
 </ssd:Elements><ssd:Connections>{links}</ssd:Connections></ssd:System>
 <ssd:DefaultExperiment startTime="0" stopTime="0.05"/>
</ssd:SystemStructureDescription>"""


def package(folder, fmu, *links):
    rows = (
        f'<ssd:Connection startElement="source" startConnector="{a}" endElement="sink" endConnector="{b}">{inner}'
        "</ssd:Connection>"
        for a, b, inner in links
    )
    write_archive(
        folder / "d.ssp",
        {"SystemStructure.ssd": SSD.format(links="".join(rows)).encode(), "discrete.fmu": fmu.read_bytes()},
    )
    return folder / "d.ssp"


def test_a_package_connects_discrete_variables_and_its_open_inputs_take_values(fmu, tmp_path):
    linear = '<ssc:LinearTransformation factor="2"/>'
    path = package(tmp_path, fmu, ("mode", "item", ""), ("count", "real", linear))
    case = read_ssp(path, given=Given(inputs={"sink.integer": "3", "sink.boolean": "true"}))
    series = run(case.system, case.scenario, step=STEP, engine="python").series
    count = counts(series.time[:-1])
    np.testing.assert_allclose(series["sink.seen"][1:], 13.0 + 100.0 * (1.0 + count % 3) + 2000.0 * count, atol=1e-9)
    with pytest.raises(WiringError, match=r"an Integer to a Real"):
        read_ssp(package(tmp_path, fmu, ("count", "real", "")))
    with pytest.raises(WiringError, match=r"sink.boolean.*'2.5'"):
        read_ssp(path, given=Given(inputs={"sink.boolean": "2.5"}))
