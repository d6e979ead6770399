"""`check` passes clean FMUs of FMI 3.0, of ours and of others, and never fails because of a damaged description."""

import json
import xml.etree.ElementTree as ET
import zipfile
from random import Random

import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.fuzz.damage import change_xml
from builder.check import GROUPS, Level, check
from builder.check.archive import read_subject
from builder.check.description import static_findings
from builder.check.probes.bench import Bench
from builder.check.probes.version3 import _steps
from builder.check.rules import finding_in_version_3, text_in_version_3
from eightpost.app.exchange import check as command
from eightpost.archive import read_archive, write_archive
from eightpost.fmi import read_description
from eightpost.shock import LAWS

from . import check_defects as defects
from .check_defects import XML


def rules(report):
    return {finding.rule.identifier for finding in report.findings}


@pytest.mark.nightly
@pytest.mark.parametrize("name", [*LAWS, "quarter_car", "seven_dof"])
def test_our_fmus_of_fmi_3_break_no_rule_on_this_platform(name, fmus3):
    report = check(fmus3[name])
    assert rules(report) == {"platforms"}
    assert report.skipped == () and report.groups == tuple(GROUPS)
    assert report.identity["fmiVersion"] == "3.0" and report.identity["instantiationToken"].startswith("{")
    assert "guid" not in report.identity


def test_inputs_with_slopes_change_in_the_updates_of_a_step_and_the_steps_break_no_rule(fmus3, tmp_path):
    with zipfile.ZipFile(fmus3["lpnl2"]) as archive:
        archive.extractall(tmp_path)
    (tmp_path / "progress").touch()
    bench = Bench(tmp_path, tmp_path / "progress")
    with bench.running() as instance:
        bench.drive(instance, [0.1, 0.0])
        assert instance.set_derivatives(bench.inputs, [2.0, -1.0]) == 0
        for time, expected in ((0.0, [0.102, -0.001]), (0.001, [0.102, -0.001])):
            assert instance.step(time, 0.001) == 0
            assert instance.reals(bench.inputs) == pytest.approx(expected, rel=1e-12)
        assert instance.set_derivatives(bench.inputs[:1], [1.0]) == 0
        assert instance.step(0.002, 0.001) == 0
        assert instance.reals(bench.inputs) == pytest.approx([0.103, -0.001], rel=1e-12)
    assert [fault for _, fault in _steps(bench, bench.library) if fault] == []


# ---- Correct FMUs of others -----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def bank(tmp_path_factory):
    """The foreign FMU of FMI 3.0, which has arrays and clocks."""
    return defects.foreign_fmu("filter_bank", tmp_path_factory.mktemp("bank"))


@pytest.mark.nightly
def test_a_foreign_fmu_with_arrays_and_clocks_passes_the_standard(bank):
    shown = CliRunner().invoke(command, ["--standard", "--json", str(bank)])
    (report,) = json.loads(shown.stdout)["reports"]
    assert (shown.exit_code, report["findings"]) == (0, [])
    assert set(GROUPS) - set(report["groups"]) == {
        "first_outputs", "state", "corrupt_state", "initial_dependencies", "dependencies", "steps", "ports",
        "reference", "rebuild",
    }  # fmt: skip


@pytest.mark.nightly
def test_an_fmu_of_fmi_3_that_ends_the_simulation_breaks_no_rule(tmp_path):
    report = check(defects.foreign_fmu("filter_bank", tmp_path, "-DENDS_AT=0.1"), groups=("simulation", "version_3"))
    assert (report.of(Level.ERROR), report.groups) == ((), ("simulation", "version_3"))


def changed(fmu, folder, old, new):
    members = read_archive(fmu)
    assert old in members[XML]
    members[XML] = members[XML].replace(old, new)
    write_archive(folder / fmu.name, members)
    return folder / fmu.name


WITHOUT_STEPS = b'  <CoSimulation modelIdentifier="filter_bank" hasEventMode="true" fixedInternalStepSize="0.01"/>\n'


@pytest.mark.nightly
def test_an_fmu_for_model_exchange_alone_is_checked_for_what_fmi_3_adds(bank, tmp_path):
    report = check(changed(bank, tmp_path, WITHOUT_STEPS, b""), groups=("version_3", "model_exchange"))
    assert [(f.rule.identifier, f.message) for f in report.findings] == [
        ("undeclared-type", "an instance for co-simulation was created")
    ]
    assert report.groups == ("model_exchange", "version_3")
    wrong = defects.foreign_fmu("filter_bank", tmp_path, "-DSTATES=3")
    report = check(changed(wrong, tmp_path, WITHOUT_STEPS, b""), groups=("version_3",))
    assert "number-of-states" in rules(report)


def test_fmi_2_fmus_skip_the_group_of_fmi_3(fmus):
    report = check(fmus["polylinear"], groups=("version_3",))
    assert (report.groups, report.skipped, report.findings) == ((), (), ())


DESCRIPTION = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="Small" instantiationToken="{{small}}">
  <CoSimulation modelIdentifier="small" {flags}/>
  <UnitDefinitions><Unit name="N"><BaseUnit kg="1" m="1" s="-2"/><DisplayUnit name="kN" factor="0.001"/></Unit>
  </UnitDefinitions>
  <TypeDefinitions>{types}</TypeDefinitions>
  <DefaultExperiment startTime="0" stopTime="1"/>
  <ModelVariables>
    <Float64 name="time" valueReference="0" causality="independent" variability="continuous"/>
    {variables}
  </ModelVariables>
  <ModelStructure>{structure}</ModelStructure>
</fmiModelDescription>"""

STATE = (
    '<Float64 name="x" valueReference="1" causality="output" {}/><Float64 name="v" valueReference="2" derivative="1"/>'
)
STATE_STRUCTURE = '<Output valueReference="1" dependencies="1"/><ContinuousStateDerivative valueReference="2"/>'
CLOCK = '<Clock name="c" valueReference="1" causality="input" intervalVariability="{}" {}/>'

#: Correct descriptions: variables, structure, flags of CoSimulation, types.
CORRECT = {
    "an output that is a state with a start value": (
        STATE.format('initial="exact" start="1"'), f'{STATE_STRUCTURE}<InitialUnknown valueReference="2"/>', "", ""
    ),
    "an output that is a calculated state": (
        STATE.format(""),
        f'{STATE_STRUCTURE}<InitialUnknown valueReference="1"/><InitialUnknown valueReference="2"/>', "", "",
    ),
    "an input with initial": (
        '<Float64 name="u" valueReference="1" causality="input" initial="exact" start="0"/>', "", "", ""
    ),
    "a discrete input of a small type": (
        '<UInt8 name="u" valueReference="1" causality="input" start="255" min="0" max="255"/>', "", "", ""
    ),
    "clocked outputs": (
        f'{CLOCK.format("triggered", "")}<Int32 name="n" valueReference="2" causality="output" clocks="1"/>'
        '<Clock name="d" valueReference="3" causality="output" intervalVariability="triggered" clocks="1"/>',
        '<Output valueReference="2" dependencies="1"/><Output valueReference="3"/>', 'hasEventMode="true"', "",
    ),
    "an output clock without event mode": (
        '<Clock name="d" valueReference="1" causality="output" intervalVariability="triggered"/>',
        '<Output valueReference="1"/>', "", "",
    ),
    "clocks with intervals": (
        CLOCK.format("constant", 'intervalCounter="1" resolution="100"')
        + CLOCK.replace('"c"', '"d"').replace('"1"', '"2"').format("fixed", 'intervalDecimal="0.5"')
        + CLOCK.replace('"c"', '"e"').replace('"1"', '"3"').format("countdown", 'clocks="1"')
        + CLOCK.replace('"c"', '"f"').replace('"1"', '"4"').format("tunable", ""),
        "", 'hasEventMode="true"', "",
    ),
    "a clocked state": (
        f'{CLOCK.format("triggered", "")}<Float64 name="s" valueReference="2" clocks="1" previous="3" '
        'variability="discrete"/><Float64 name="p" valueReference="3" clocks="1" variability="discrete"/>',
        '<ClockedState valueReference="2"/>', 'hasEventMode="true"', "",
    ),
    "arrays with structural parameters": (
        '<UInt64 name="n" valueReference="1" causality="structuralParameter" variability="tunable" start="2" min="0"/>'
        '<Float64 name="a" valueReference="2" causality="parameter" variability="tunable" start="1 2 3 4 5 6">'
        '<Dimension valueReference="1"/><Dimension start="3"/></Float64>'
        '<Boolean name="b" valueReference="3" causality="parameter" variability="fixed" start="true">'
        '<Dimension valueReference="1"/></Boolean>', "", "", "",
    ),
    "parameters without variability": (
        '<UInt64 name="n" valueReference="1" causality="structuralParameter" start="2"/>'
        '<Float64 name="k" valueReference="2" causality="parameter" start="2"/>', "", "", "",
    ),
    "an array of no elements": (
        '<UInt64 name="n" valueReference="1" causality="structuralParameter" variability="fixed" start="0"/>'
        '<Float64 name="u" valueReference="2" causality="input" start="1 2"><Dimension valueReference="1"/></Float64>',
        "", "", "",
    ),
    "arrays of strings and bytes": (
        '<String name="s" valueReference="1" causality="parameter" variability="fixed"><Dimension start="2"/>'
        '<Start value="a b"/><Start value="c d"/></String>'
        '<Binary name="b" valueReference="2" causality="input"/>'
        '<Binary name="d" valueReference="3" causality="parameter" variability="fixed"><Start value="00ff"/></Binary>',
        "", "", "",
    ),
    "an alias with a display unit": (
        '<Float64 name="f" valueReference="1" causality="input" unit="N" start="0"><Alias name="g" displayUnit="kN"/>'
        '<Alias name="h" displayUnit="N"/><Alias name="i"/></Float64>', "", "", "",
    ),
    "an enumeration of 64 bits": (
        '<Enumeration name="e" valueReference="1" causality="parameter" variability="fixed" declaredType="Big" '
        'start="-9223372036854775808"/>', "", "",
        '<EnumerationType name="Big"><Item name="low" value="-9223372036854775808"/></EnumerationType>',
    ),
    "a declared type with a unit": (
        '<Float32 name="u" valueReference="1" causality="input" declaredType="Force" start="0.1"/>', "", "",
        '<Float32Type name="Force" unit="N" displayUnit="kN" min="-1" max="1"/>',
    ),
    "an internal step without a step size": ("", "", 'fixedInternalStepSize="0.01" hasEventMode="true"', ""),
    "updates in which nothing is set": (
        "", "", 'providesIntermediateUpdate="true" canReturnEarlyAfterIntermediateUpdate="true"', ""
    ),
    "an output that depends on a structural parameter": (
        '<UInt64 name="n" valueReference="1" causality="structuralParameter" variability="fixed" start="2"/>'
        '<Float64 name="y" valueReference="2" causality="output"/>',
        '<Output valueReference="2" dependencies="1"/><InitialUnknown valueReference="2" dependencies="1"/>', "", "",
    ),
}  # fmt: skip


def described(folder, variables, structure, flags, types):
    xml = DESCRIPTION.format(variables=variables, structure=structure, flags=flags, types=types)
    write_archive(folder / "small.fmu", {XML: xml.encode()})
    return folder / "small.fmu"


@pytest.mark.parametrize("name", CORRECT)
def test_a_correct_description_breaks_no_static_rule_of_the_standard(name, tmp_path):
    report = check(described(tmp_path, *CORRECT[name]), groups=("static",))
    assert [f.message for f in report.of(Level.ERROR) if f.rule.identifier != "binary-present"] == []
    # FMI 3.0 demands the variable time, but nothing is connected to it, so it needs no unit.
    assert [f.message for f in report.findings if f.rule.identifier == "unit-missing" and "time" in f.message] == []
    assert rules(report).isdisjoint({"event-mode", "dependency-known"})


def test_event_indicators_count_with_the_elements_of_their_arrays_and_sources_by_identifier():
    variables = (
        '<Float64 name="z" valueReference="1"><Dimension start="3"/></Float64><Float64 name="w" valueReference="2"/>'
    )
    structure = '<EventIndicator valueReference="1"/><EventIndicator valueReference="2"/>'
    xml = DESCRIPTION.format(variables=variables, structure=structure, flags="", types="")
    configurations = "".join(
        f'<BuildConfiguration modelIdentifier="{name}"><SourceFileSet><SourceFile name="{name}.c"/></SourceFileSet>'
        "</BuildConfiguration>"
        for name in ("other", "small")
    )
    found = read_description(ET.fromstring(xml.encode()), ET.fromstring(f"<a>{configurations}</a>"))
    assert found.event_indicators == "4"
    assert (found.sources.files, found.exchange_sources.files) == (("small.c",), ())


# ---- Damaged descriptions -------------------------------------------------------------------------------------------

PARTS = (XML, "sources/buildDescription.xml", "terminalsAndIcons/terminalsAndIcons.xml")


@pytest.fixture(scope="module")
def documents(bank, fmus3):
    """XML files of one of our FMUs and of a foreign one."""
    return [{n: c for n, c in read_archive(path).items() if n in PARTS} for path in (fmus3["lpnl2"], bank)]


@pytest.mark.nightly
@settings(max_examples=30)
@given(seed=st.integers(0, 2**32), part=st.sampled_from((XML, XML, *PARTS)), fmu=st.sampled_from((0, 1, 1)))
def test_a_damaged_description_gives_findings_and_no_traceback(documents, tmp_path_factory, seed, part, fmu):
    members = dict(documents[fmu])
    members[part] = change_xml(Random(seed), members.get(part, b'<a fmiVersion="3.0"/>'))
    path = tmp_path_factory.getbasetemp() / "damaged.fmu"
    write_archive(path, members)
    subject = read_subject(path)
    findings = [finding_in_version_3(finding) for finding in static_findings(subject)]
    assert findings or subject.description is not None, "a description that cannot be read is a finding"
    for finding in findings:
        assert finding.message and finding.rule.advice and "fmi2" not in f"{finding.message} {finding.rule.advice}"


def test_an_entry_named_by_a_dot_alone_is_a_finding_and_no_traceback(bank, tmp_path):
    write_archive(tmp_path / "dot.fmu", {**read_archive(bank), ".": b""})
    found = [
        (finding.rule.identifier, finding.message) for finding in static_findings(read_subject(tmp_path / "dot.fmu"))
    ]
    assert ("archive-path", "the entry '.' has no name or a NUL character in its name") in found


HUGE = "9" * 5000


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b'valueReference="2" causality', f'valueReference="{HUGE}" causality'.encode()),
        (b'<Dimension start="2"/>', f'<Dimension start="{HUGE}"/>'.encode()),
        (b'<Dimension start="2"/>', b'<Dimension start="999999999999"/>'),
        (b'name="n" valueReference="1"', b'name="n" valueReference="one"'),
        (b'start="1 2 4"', b'start="1 2 x"'),
        (b'start="1 2 4"', b'start="1 2"'),
        (b'start="18446744073709551615"', f'start="{HUGE}"'.encode()),
        (b'start="8589934592"', b'start="on"'),
    ],
)
def test_numbers_that_are_none_crash_no_probe(bank, tmp_path, old, new):
    path = changed(bank, tmp_path, old, new)
    report = check(path, groups=("static", "version_3", "model_exchange"))
    assert rules(report).isdisjoint({"crash", "crash-misuse"})
    assert "version_3" in report.groups


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("fmi2SetReal of v", "fmi3SetFloat64 of v"),
        ("fmi2DeSerializeFMUstate", "fmi3DeserializeFMUState"),
        ("there are no Real inputs", "there are no Float64 inputs"),
        ("canInterpolateInputs is not true", "providesIntermediateUpdate is not true"),
        ("derivatives: input derivatives", "derivatives: intermediate updates of inputs"),
        ("InitialUnknowns: x", "InitialUnknown: x"),
        ("There is a GUID", "There is an instantiationToken"),
    ],
)
def test_texts_about_fmi_3_use_its_names(text, expected):
    assert text_in_version_3(text) == expected
