"""Seeded defects of FMI 3.0: `check` must find each with the right rule, and name things as FMI 3.0 does.

The defects are in check_defects_version3.toml.
"""

import re
from pathlib import Path

import pytest

import builder.check
from builder.check import check

from . import check_defects as defects

TABLES = defects.read_tables("check_defects_version3.toml")

ON_FILE = {name: defects.tabled(entry, defects.on_file) for name, entry in TABLES["on_file"].items()}
IN_CODE = {name: defects.tabled(entry, defects.in_either) for name, entry in TABLES["in_code"].items()}

#: Defects of code by the FMU that has them.
BUNDLES = defects.bundles(IN_CODE)

#: Faults that are compiled into the foreign FMU by a definition.
BY_DEFINITION = {
    "-DANOTHER_GAIN": ("array-start", "gains"),
    "-DSTATES=2": ("number-of-states", "returns 2, the description lists 4"),
    "-DANOTHER_VERSION": ("version-string", "'3.1'"),
}

#: Names of FMI 2.0 that a finding about FMI 3.0 must not contain.
OLD_NAMES = re.compile(r"fmi2|GUID|guid|FMUstate|ScalarVariable|\bReals?\b|NewDiscrete|model\.png|\bFMI 2")


@pytest.fixture(scope="module")
def bases(fmus3, tmp_path_factory):
    """FMUs without defects, by name."""
    return fmus3 | {"filter_bank": defects.foreign_fmu("filter_bank", tmp_path_factory.mktemp("foreign"))}


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """Return a change that recompiles an FMU for this machine."""
    return defects.recompiler(tmp_path_factory)


def findings_of(path, groups):
    """Check an FMU; names of FMI 2.0 in the findings are a failure."""
    found = check(path, groups=groups).findings
    texts = [f"{f.rule.title}: {f.message} -> {f.rule.advice} ({f.rule.source})" for f in found]
    assert [text for text in texts if OLD_NAMES.search(text)] == []
    return found


def assert_found(findings, defect):
    own = [finding.message for finding in findings if finding.rule.identifier == defect.rule]
    assert own, f"found {sorted({finding.rule.identifier for finding in findings})}"
    assert any(re.search(defect.message, message) for message in own), own


def test_every_rule_of_fmi_3_has_a_seeded_defect():
    seeded = {defect.rule for defect in (*ON_FILE.values(), *IN_CODE.values())} | {r for r, _ in BY_DEFINITION.values()}
    text = Path(builder.check.__file__).with_name("rules.txt").read_text(encoding="utf-8")
    own = set(re.findall(r"^([\w-]+) \|", text[text.index("# FMI 3.0: Description") :], re.MULTILINE))
    assert own <= seeded <= defects.RULES
    assert len(seeded - own) >= 25


@pytest.mark.repeated(30)
@pytest.mark.parametrize("name", ON_FILE)
def test_a_defect_in_the_files_is_found_by_its_rule(name, bases, tmp_path):
    defect = ON_FILE[name]
    assert_found(findings_of(defects.defective(bases[defect.fmu], tmp_path, defect), defect.groups), defect)


@pytest.mark.nightly
@pytest.mark.parametrize(
    "bundle",
    [pytest.param(b, marks=pytest.mark.nightly if IN_CODE[n[0]].is_nightly else ()) for b, n in BUNDLES.items()],
)
def test_defects_in_the_code_are_found_by_their_rules(bundle, bases, tmp_path, compiled):
    first, *others = (IN_CODE[name] for name in BUNDLES[bundle])
    path = defects.defective(bases[first.fmu], tmp_path, first, *(other.change for other in others), compiled)
    found = findings_of(path, tuple({group for defect in (first, *others) for group in defect.groups}))
    for defect in (first, *others):
        assert_found(found, defect)


@pytest.mark.slow
@pytest.mark.parametrize("definition", BY_DEFINITION)
def test_a_defect_of_arrays_and_versions_of_a_foreign_fmu_is_found(definition, tmp_path):
    rule, message = BY_DEFINITION[definition]
    found = findings_of(defects.foreign_fmu("filter_bank", tmp_path, definition), ("simulation", "version_3"))
    assert [finding.rule.identifier for finding in found] == [rule]
    assert message in found[0].message


@pytest.mark.repeated
@pytest.mark.parametrize("name", ["lpnl2", "quarter_car", "filter_bank"])
def test_an_fmu_without_a_defect_breaks_no_static_rule_of_the_standard(name, bases):
    found = findings_of(bases[name], ("static", "tools"))
    assert [f.message for f in found if f.rule.level.value == "error"] == []
