"""`check` passes clean FMUs, reports the defects of others, and never fails because of an FMU's behaviour."""

import json
import re
import resource
import sys
import zipfile
from pathlib import Path
from types import SimpleNamespace

import pytest
from click.testing import CliRunner
from fmpy.validation import _validate_variable_names as validate_names
from fmpy.validation import validate_fmu
from hypothesis import given, settings
from hypothesis import strategies as st

from builder.check import CATALOGUE, GROUPS, Level, Scope, check, run
from builder.check.archive import read_subject
from builder.check.description import _integers, units_of
from builder.check.rules import findings
from builder.toolchain import this_platform
from eightpost.app.exchange import check as command
from eightpost.archive import read_archive, write_archive
from eightpost.errors import EightpostError, FmuError
from eightpost.shock import LAWS
from eightpost.units import SI_UNITS, si_exponents

from .check_defects import foreign_fmu

QUICK = tuple(group for group in GROUPS if group not in ("rebuild", "version_3"))

OURS = (*LAWS, "seven_dof", "quarter_car")

#: FMUs that test_check_defects.py checks, recompiled and without a defect; and the groups that it leaves out.
CHECKED_ELSEWHERE = ("polylinear", "lpnl2", "quarter_car")
LEFT_OUT = ("static", "tools", "initial_dependencies", "dependencies", "reference")

#: A Python FMU needs a minute of calls to perturb each of a hundred parameters.
SLOW_IN_PYTHON = ("initial_dependencies",)

#: Rules of the standard that PythonFMU breaks: FMI 2.0.4, 2.1.6, 2.1.5 and 2.1.8.
PYTHON_ERRORS = {"stop-time", "guid-checked", "state-freed"}


def rules(report):
    return {finding.rule.identifier for finding in report.findings}


def altered(source, target, alter):
    members = read_archive(source)
    alter(members)
    write_archive(target, members)
    return target


def in_slave(old, new):
    def alter(members):
        (name,) = [n for n, content in members.items() if b"class ShockSlave(" in content]
        assert old in members[name]
        members[name] = members[name].replace(old, new)

    return alter


@pytest.mark.repeated("lpnl2-5 groups", "quarter_car-5 groups")
@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "groups"),
    [
        *((name, QUICK) for name in OURS if name not in CHECKED_ELSEWHERE),
        *((name, LEFT_OUT) for name in CHECKED_ELSEWHERE),
        *(pytest.param(name, QUICK, marks=pytest.mark.nightly) for name in CHECKED_ELSEWHERE),
    ],
    ids=lambda value: value if isinstance(value, str) else f"{len(value)} groups",
)
def test_our_native_fmus_have_no_findings_and_no_hints(universal_fmus, name, groups):
    report = check(universal_fmus[name], groups=groups)
    assert report.findings == ()
    assert report.skipped == ()
    assert report.done == tuple(GROUPS[group].title for group in groups)


@pytest.mark.nightly
@pytest.mark.parametrize(
    "left_out", [SLOW_IN_PYTHON, pytest.param((), marks=pytest.mark.nightly)], ids=["quick groups", "all groups"]
)
def test_a_python_fmu_breaks_three_rules_of_the_standard_and_declares_that_it_needs_a_tool(python_fmus, left_out):
    report = check(python_fmus["lpnl2"], groups=[group for group in QUICK if group not in left_out])
    assert {finding.rule.identifier for finding in report.of(Level.ERROR)} == PYTHON_ERRORS
    assert {"execution-tool", "undefined-python", "platforms", "crash-misuse"} <= rules(report)
    assert "execution-tool-honest" not in rules(report)
    assert not report.acceptable


#: Groups that are skipped for each FMU because it does not support them; all others run.
NOT_OFFERED = {
    "van_der_pol": {"state", "corrupt_state", "initial_dependencies", "dependencies"},
    "bouncing_mass": {"dependencies", "steps", "instances", "first_outputs"},
    "mass_spring": {"state", "corrupt_state", "initial_dependencies"},
}


@pytest.mark.nightly
@pytest.mark.parametrize("name", NOT_OFFERED)
def test_a_correct_foreign_fmu_passes_the_standard_without_false_positives(name, tmp_path):
    """Check FMUs with features that ours lack: integers, strings, enumerations, aliases, one instance per process."""
    shown = CliRunner().invoke(command, ["--standard", "--json", str(foreign_fmu(name, tmp_path))])
    (report,) = json.loads(shown.stdout)["reports"]
    assert (shown.exit_code, report["findings"]) == (0, [])
    assert set(GROUPS) - set(report["groups"]) == NOT_OFFERED[name] | {
        "ports",
        "reference",
        "rebuild",
        "model_exchange",
        "version_3",
    }


@pytest.mark.nightly
@pytest.mark.parametrize("end", ["-DENDS_AT=1.5", "-DENDS_AT=5.2", "-DSTOPS_AT=5.3"])
def test_an_fmu_that_ends_the_simulation_or_has_no_data_beyond_it_breaks_no_rule_of_the_standard(end, tmp_path):
    groups = tuple(group for group in GROUPS if group not in ("tools", "instances"))
    report = check(foreign_fmu("mass_spring", tmp_path, end), scope=Scope.STANDARD, groups=groups)
    assert rules(report) == set()
    assert "reset" in report.groups
    assert any(skipped.what.startswith("reset: a reset later than") for skipped in report.skipped)


@pytest.mark.nightly
@pytest.mark.parametrize("fault", ["-DRESET_KEEPS_TIME", "-DRESET_FAILS_AFTER=900"])
def test_a_reset_that_keeps_the_time_or_fails_late_is_reported(fault, tmp_path):
    """Check two defects: a reset that keeps the time (20-sim), and one that fails after 900 of its steps."""
    report = check(foreign_fmu("mass_spring", tmp_path, fault), groups=("simulation", "reset"))
    found = [finding.message for finding in report.findings if finding.rule.identifier == "reset"]
    assert any(message.startswith("after fmi2Reset at 12 s") for message in found)


def test_an_undeclared_log_category_of_a_refused_call_is_reported(tmp_path):
    report = check(foreign_fmu("mass_spring", tmp_path), groups=("state_machine",))
    assert [f.message for f in report.findings if f.rule.identifier == "log-undeclared"] == [
        "it uses the category 'refusals'"
    ]


def leaving_only(*kept):
    def alter(members):
        for name in [n for n in members if n.startswith("binaries/") and not n.startswith(kept)]:
            del members[name]

    return alter


@pytest.mark.repeated
@pytest.mark.parametrize(
    ("kept", "has"), [(("binaries/win64/",), "win64, sources"), ((), "sources")], ids=["only win64", "only sources"]
)
def test_an_fmu_without_a_binary_for_this_machine_breaks_no_rule_of_the_standard(universal_fmus, tmp_path, kept, has):
    if this_platform().name == "win64":
        pytest.skip("win64 is this machine's")
    path = altered(universal_fmus["lpnl2"], tmp_path / "lpnl2.fmu", leaving_only(*kept))
    assert CliRunner().invoke(command, ["--standard", str(path)]).exit_code == 0
    report = check(path)
    assert rules(report) == {"platforms"}
    (skipped,) = report.skipped
    here = this_platform().name
    assert skipped.reason == f"no binary for this platform ({here}), so nothing was run; available: {has}"
    assert {"simulation", "rebuild"} <= set(skipped.what.split(", "))


@pytest.mark.repeated
@pytest.mark.parametrize(
    ("alter", "rule", "message"),
    [
        (in_slave(b"law.response(", b"law.answer("), "simulates",
         "fmi2DoStep from 0.0 by 0.001 s returned fmi2Discard"),
        (in_slave(b"def advance(self, step):", b"def advance(self, step, end=__import__('os').abort):\n        end()"),
         "crash", "killed by signal 6 in or after fmi2DoStep from 0.0"),
    ],
)  # fmt: skip
def test_a_crash_is_a_finding_that_names_the_call(python_fmus, tmp_path, alter, rule, message):
    report = check(altered(python_fmus["lpnl2"], tmp_path / "lpnl2.fmu", alter), groups=("simulation",))
    assert any(message in finding.message for finding in report.findings if finding.rule.identifier == rule)


def test_later_checks_are_skipped_if_an_fmu_cannot_be_simulated(python_fmus, tmp_path):
    abort = in_slave(b"def advance(self, step):", b"def advance(self, step):\n        __import__('os').abort()")
    report = check(
        altered(python_fmus["lpnl2"], tmp_path / "lpnl2.fmu", abort), groups=("simulation", "reset", "steps")
    )
    assert rules(report) == {"crash"}
    assert [skipped.what for skipped in report.skipped] == ["reset, steps"]


def test_a_probe_that_cannot_be_started_is_an_error_and_not_a_finding(universal_fmus, monkeypatch):
    monkeypatch.setattr(
        run.process, "python_command", lambda *_: [sys.executable, "-c", "raise ImportError('no probes')"]
    )
    with pytest.raises(EightpostError, match=r"could not be started.*no probes"):
        check(universal_fmus["lpnl2"], groups=("simulation",))


@pytest.mark.slow
def test_a_hang_is_a_finding(python_fmus, tmp_path, monkeypatch):
    monkeypatch.setattr(run, "_PATIENCE", 1.0)
    hang = in_slave(b"def advance(self, step):", b"def advance(self, step):\n        while True: pass")
    report = check(altered(python_fmus["lpnl2"], tmp_path / "lpnl2.fmu", hang), groups=("simulation",))
    assert ["did not end within 1 s of processor time" in finding.message for finding in report.findings] == [True]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "call"),
    [
        ("-DHANGS_AT=0.5", "fmi2DoStep from 0.5 by 0.01 s"),
        ("-DHANGS_AT=4.0", "fmi2DoStep from 4.0 by 0.01 s"),
        ("-DHANGS_IN_INSTANTIATE", "fmi2Instantiate"),
        ("-DHANGS_IN_TERMINATE", "fmi2Terminate"),
    ],
)
def test_a_call_that_hangs_is_named_and_the_check_ends(fault, call, tmp_path, monkeypatch):
    monkeypatch.setattr(run, "_PATIENCE", 0.5)
    report = check(foreign_fmu("mass_spring", tmp_path, fault), groups=("simulation", "footprint"))
    (hung,) = [finding.message for finding in report.findings if finding.rule.identifier == "crash"]
    assert f"did not end within 0.5 s of processor time in or after {call}" in hung


@pytest.mark.nightly
def test_a_call_that_hangs_uses_up_the_time_of_the_check(tmp_path):
    started = resource.getrusage(resource.RUSAGE_CHILDREN)
    report = check(foreign_fmu("mass_spring", tmp_path, "-DHANGS_AT=4.0"))
    ended = resource.getrusage(resource.RUSAGE_CHILDREN)
    crashes = [finding.message for finding in report.findings if finding.rule.identifier == "crash"]
    assert any("did not end within 6 s of processor time" in message for message in crashes)
    assert ended.ru_utime + ended.ru_stime - started.ru_utime - started.ru_stime < 15.0


@pytest.mark.slow
def test_an_fmu_that_is_slow_is_skipped_from_there_on_without_a_finding(python_fmus, tmp_path, monkeypatch):
    monkeypatch.setattr(run, "_BUDGET", 1.6)
    slow = in_slave(b"def advance(self, step):", b"def advance(self, step):\n        sum(range(300000))")
    path = altered(python_fmus["lpnl2"], tmp_path / "lpnl2.fmu", slow)
    report = check(path, groups=("simulation", "reset", "steps", "instances"))
    assert rules(report) == set()
    reasons = {skipped.what: skipped.reason for skipped in report.skipped}
    assert "too much processor time" in reasons["simulation: remaining calls"]
    assert "too much processor time" in reasons["instances"]


@pytest.mark.parametrize("unit", SI_UNITS)
def test_correct_si_exponents_of_a_unit_are_accepted_and_others_reported(unit, universal_fmus, tmp_path):
    def described(exponents):
        base = "".join(f' {name}="{power}"' for name, power in exponents.items())
        text = f'<UnitDefinitions><Unit name="{unit}"><BaseUnit{base}/></Unit></UnitDefinitions>'
        xml = f'<fmiModelDescription fmiVersion="2.0">{text}</fmiModelDescription>'
        write_archive(tmp_path / "x.fmu", {"modelDescription.xml": xml.encode()})
        description = read_subject(tmp_path / "x.fmu").description
        return {finding.rule.identifier for finding in findings(units_of(description))}

    right = si_exponents(unit)
    assert "unit-exponents" not in described(right)
    assert "unit-exponents" in described({**right, "mol": 1})


def test_every_rule_has_a_unique_name_a_source_and_advice():
    names = [rule.identifier for rule in CATALOGUE]
    assert len(set(names)) == len(names) > 100
    assert all(rule.title and rule.source and rule.advice for rule in CATALOGUE)
    tools = {"FMPy", "fmu-manipulation-toolbox"}
    assert {rule.source.split()[0] for rule in CATALOGUE if rule.level is Level.ERROR} == {"FMI", *tools}


def test_the_page_lists_every_rule_and_group():
    page = Path(__file__).parents[2].joinpath("docs", "reference", "check.md").read_text(encoding="utf-8")
    lists = re.findall(r"^(Error|Drop-in|Hint)s?:\n\n((?:- .*\n)+)", page, re.MULTILINE)
    rows = {
        (name, level.lower(), title) for level, rules in lists for name, title in re.findall(r"`(.*?)`: (.*)", rules)
    }
    assert rows == {(rule.identifier, rule.level.value, rule.title) for rule in CATALOGUE}
    groups = re.findall(r"^\| `(\w+)` \| ([^|]*) \|$", page, re.MULTILINE)
    assert {name: title for name, title in groups if name in GROUPS} == {n: group.title for n, group in GROUPS.items()}


def test_files_other_than_fmus_of_fmi_2_and_3_are_rejected(tmp_path):
    (tmp_path / "x.fmu").write_text("no")
    with pytest.raises(FmuError, match="zip"):
        check(tmp_path / "x.fmu")
    write_archive(tmp_path / "y.fmu", {"readme.txt": b""})
    with pytest.raises(FmuError, match=r"no modelDescription\.xml"):
        check(tmp_path / "y.fmu")
    write_archive(tmp_path / "z.fmu", {"modelDescription.xml": b'<fmiModelDescription fmiVersion="1.0"/>'})
    with pytest.raises(FmuError, match=r"FMI 1\.0; check supports FMI 2\.0 and 3\.0"):
        check(tmp_path / "z.fmu")
    with pytest.raises(FmuError, match="no such file"):
        check(tmp_path / "none.fmu")


def test_an_unknown_group_is_refused_by_name(universal_fmus):
    with pytest.raises(FmuError, match="'dynamic'"):
        check(universal_fmus["lpnl2"], groups=("dynamic",))


@pytest.mark.parametrize(
    "content", [b"", b"<a/>", b"\xff\xfe", b"<fmiModelDescription/>", b"<?xml version='1.0' encoding='x'?><a/>"]
)
def test_a_description_with_arbitrary_content_gives_findings_but_no_traceback(content, tmp_path):
    with zipfile.ZipFile(tmp_path / "x.fmu", "w") as archive:
        archive.writestr("modelDescription.xml", content)
    assert not check(tmp_path / "x.fmu").acceptable


@pytest.mark.parametrize(
    ("native", "low", "high"),
    [("Int8", -128, 127), ("UInt8", 0, 255), ("", -(2**31), 2**31 - 1), ("Enumeration", -(2**63), 2**63 - 1)],
)
def test_a_start_value_must_be_in_the_range_of_its_type(native, low, high):
    first, beyond = _integers(native)
    assert (first, beyond - 1) == (low, high)


# ---- Third-party checkers --------------------------------------------------------------------------------------------


XML = "modelDescription.xml"


def found_by_fmpy(names):
    variables = [SimpleNamespace(name=name, sourceline=1) for name in names]
    return validate_names(SimpleNamespace(variableNamingConvention="structured", modelVariables=variables))


@pytest.mark.nightly
@settings(max_examples=8)
@given(st.lists(st.from_regex(run._PLAIN_NAME, fullmatch=True).filter(lambda name: len(name) < 30), max_size=4))
def test_fmpy_accepts_every_plain_name(names):
    assert found_by_fmpy(names) == []


@pytest.mark.repeated(2)
@pytest.mark.parametrize(
    "name", ["1x", "a b", "a..b", "a[", "a[x]", "a\n", "der(a", "der(a,)", "x\u0661", "é", "", "a."]
)
def test_a_name_that_fmpy_refuses_is_not_plain(name):
    assert found_by_fmpy([name])
    assert not run._PLAIN_NAME.fullmatch(name)


#: Changes of a description, and a word of the problem that FMPy reports.
CHANGES = {
    "none": ((b"<fmi", b"<fmi"), None),
    "a name that is not allowed": ((b'name="seal_friction"', b'name="seal friction"'), "not a legal variable name"),
    "a name that exists twice": ((b'name="seal_friction"', b'name="gas_preload"'), "not unique"),
    "an element that the schema lacks": ((b"<ModelVariables>", b"<Novelty/><ModelVariables>"), "Novelty"),
}


@pytest.mark.nightly
@pytest.mark.parametrize("change", CHANGES)
def test_the_findings_are_those_of_fmpy(universal_fmus, tmp_path, change):
    (old, new), word = CHANGES[change]
    members = read_archive(universal_fmus["lpf1"])
    assert old in members[XML]
    write_archive(tmp_path / "lpf1.fmu", members | {XML: members[XML].replace(old, new, 1)})
    found = run._fmpy(read_subject(tmp_path / "lpf1.fmu"))
    assert found == [str(problem) for problem in validate_fmu(str(tmp_path / "lpf1.fmu"))]
    assert any(word in problem for problem in found) if word else found == []


def test_the_parser_of_names_is_left_out_for_plain_names(universal_fmus, monkeypatch):
    monkeypatch.setattr("fmpy.validation._validate_variable_names", lambda _: pytest.fail("it takes long"))
    assert run._fmpy(read_subject(universal_fmus["seven_dof"])) == []
