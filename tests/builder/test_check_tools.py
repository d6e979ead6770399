"""The checks by FMPy leave out its slow parser of names where it has nothing to find, with the same findings."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from fmpy.validation import _validate_variable_names as validate_names
from fmpy.validation import validate_fmu
from hypothesis import given, settings
from hypothesis import strategies as st

from builder.check import run
from builder.check.archive import read_subject
from eightpost.archive import read_archive, write_archive

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
def test_the_findings_are_those_of_fmpy(fmus, tmp_path, change):
    (old, new), word = CHANGES[change]
    members = read_archive(fmus["lpf1"])
    assert old in members[XML]
    write_archive(tmp_path / "lpf1.fmu", members | {XML: members[XML].replace(old, new, 1)})
    found = run._fmpy(read_subject(tmp_path / "lpf1.fmu"))
    assert found == [str(problem) for problem in validate_fmu(str(tmp_path / "lpf1.fmu"))]
    assert any(word in problem for problem in found) if word else found == []


def test_the_parser_of_names_is_left_out_for_plain_names(fmus, monkeypatch):
    monkeypatch.setattr("fmpy.validation._validate_variable_names", lambda _: pytest.fail("it takes long"))
    assert run._fmpy(read_subject(fmus["seven_dof"])) == []
