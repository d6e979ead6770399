"""`check` passes clean FMUs and finds what is wrong with others."""

import re

import pytest

from builder.check import check
from eightpost.archive import read_archive, write_archive
from eightpost.errors import FmuError


def altered(source, target, alter):
    members = read_archive(source)
    alter(members)
    write_archive(target, members)
    return target


def in_description(old, new):
    def alter(members):
        assert old in members["modelDescription.xml"]
        members["modelDescription.xml"] = members["modelDescription.xml"].replace(old, new)

    return alter


def in_slave(old, new):
    def alter(members):
        (name,) = [n for n in members if n.endswith("_law/shock_slave.py")]
        assert old in members[name]
        members[name] = members[name].replace(old, new)

    return alter


ABORT = b"def advance(self, step, end=__import__('os').abort):\n        end()"


@pytest.mark.parametrize("name", ["lpnl2", "polylinear", "lpf1", "seven_dof", "quarter_car"])
def test_our_fmus_are_clean_and_the_report_says_what_was_done(fmus, name):
    report = check(fmus[name])
    assert report.findings == ()
    assert [what.split()[0] for what in report.done] == ["fmpy", "fmutool", "simulation"]


@pytest.mark.parametrize(
    ("alter", "source", "said"),
    [
        (in_description(b'unit="m/s"', b'unit="knots"'), "fmpy validate", "knots"),
        (in_description(b'name="displacement"', b'name="velocity"'), "fmutool -check", "several variables"),
        (in_description(b'causality="output"', b'causality="result"'), "fmutool -check", "result"),
        (in_description(b"<InitialUnknowns>", b"<Outputs>"), "fmpy validate", ""),
        (in_description(b'variability="tunable"', b'variability="continuous"'), "fmutool -check", "cannot be combined"),
        (lambda members: members.pop("binaries/linux64/lpnl2.so"), "simulation", "platform|binary|linux64|lpnl2"),
        (in_slave(b"law.response(", b"law.answer("), "simulation", r"logged an error.*answer"),
        (in_slave(b"def advance(self, step):", ABORT), "simulation", "killed by signal 6"),
        (in_slave(b'getattr(response, name)', b'getattr(response, name) + id(self)'), "simulation", "other outputs"),
        (in_slave(b'getattr(response, name)', b'float("nan")'), "simulation", "force is not finite"),
    ],
)  # fmt: skip
def test_a_defect_is_found_and_a_crash_is_a_finding_not_the_end(fmus, tmp_path, alter, source, said):
    report = check(altered(fmus["lpnl2"], tmp_path / "lpnl2.fmu", alter))
    messages = [finding.message for finding in report.findings if finding.source == source]
    assert any(re.search(said, message) for message in messages), report.findings


def test_what_is_no_archive_is_refused(tmp_path):
    (tmp_path / "x.fmu").write_text("no")
    with pytest.raises(FmuError, match="zip"):
        check(tmp_path / "x.fmu")
    write_archive(tmp_path / "y.fmu", {"readme.txt": b""})
    with pytest.raises(FmuError, match=r"no modelDescription\.xml"):
        check(tmp_path / "y.fmu")
