"""`eightpost doctor` says whether the installation works: exit code 0 if it does, 1 if a check failed."""

import importlib.metadata
import json
from types import SimpleNamespace

import pytest
from click.testing import CliRunner

from builder.toolchain import find_toolchain
from eightpost.__main__ import main
from eightpost.app import doctor as verb
from eightpost.app import doctor_run
from eightpost.cache import cache_folder
from eightpost.extras import EXTRAS, REQUIRED


def doctor(*words):
    shown = CliRunner().invoke(main, ["doctor", *words])
    return shown.exit_code, shown.stdout


def group(document, name):
    return {finding["name"]: finding for finding in document["findings"] if finding["group"] == name}


@pytest.fixture(scope="module")
def document():
    code, text = doctor("--json")
    assert code == 0, text
    return json.loads(text)


def test_versions_are_those_that_are_installed(document):
    versions = group(document, "versions")
    for distribution in REQUIRED.values():
        assert versions[distribution]["statement"] == importlib.metadata.version(distribution)


def test_every_extra_is_listed_with_its_command_if_it_is_absent(document):
    extras = group(document, "extras")
    assert set(extras) == set(EXTRAS)
    for name, finding in extras.items():
        assert finding["state"] in ("ok", "absent")
        assert finding["remedy"] == ("" if finding["state"] == "ok" else f'pip install "eightpost[{name}]"')


def test_the_coupled_run_has_its_exact_solution(document):
    (finding,) = group(document, "coupled run").values()
    assert finding["state"] == "ok"
    assert float(finding["statement"].partition(" %")[0]) < verb.TOLERANCE


def test_the_compiler_builds_an_fmu_that_steps(document):
    compiler = group(document, "compiler")
    toolchain = find_toolchain()
    assert compiler[toolchain.name]["statement"].endswith(", ".join(one.name for one in toolchain.platforms))
    assert "N at 0.1 m/s" in compiler["FMU of a shock"]["statement"]


def test_cache_and_platform_are_described(document):
    assert str(cache_folder()) in group(document, "caches")["compiled code"]["statement"]
    assert group(document, "platform")["system"]["state"] == "ok"


def only(monkeypatch, *checks):
    monkeypatch.setattr(verb, "findings", lambda: (finding for check in checks for finding in check()))


def test_a_wrong_coupled_run_is_a_failure(monkeypatch):
    exact = doctor_run.solution
    monkeypatch.setattr(doctor_run, "solution", lambda time: 1.01 * exact(time))
    only(monkeypatch, verb._run)
    code, text = doctor()
    assert code == 1
    assert "failed" in text and "from the exact solution, limit 0.01 %" in text
    assert "The installation does not work" in text


def test_an_error_in_the_coupled_run_is_a_finding_and_no_traceback(monkeypatch):
    def broken(engine):
        raise OSError("LLVM cannot be loaded")

    monkeypatch.setattr(doctor_run, "coupled_run", broken)
    only(monkeypatch, verb._run)
    code, text = doctor("--json")
    assert code == 1
    (finding,) = json.loads(text)["findings"]
    assert finding["state"] == "failed" and "OSError: LLVM cannot be loaded" in finding["statement"]


@pytest.mark.parametrize(
    ("version", "minimum", "state"),
    [("1.26.4", "1.26", "ok"), ("2.0", "1.26", "ok"), ("1.9", "1.26", "failed"), ("1.26", "", "ok")],
)
def test_a_package_below_its_minimum_is_a_failure(monkeypatch, version, minimum, state):
    monkeypatch.setattr(importlib.metadata, "version", lambda _: version)
    finding = verb._version("numpy", minimum)
    assert finding.state.value == state
    assert (finding.remedy == "") == (state == "ok")


@pytest.mark.parametrize(("version", "state"), [((3, 10), "note"), ((3, 11), "ok"), ((3, 14), "ok"), ((3, 15), "note")])
def test_a_python_that_was_not_tested_is_noted_with_those_that_were(monkeypatch, version, state):
    monkeypatch.setattr(verb, "sys", SimpleNamespace(version_info=(*version, 9), prefix="/usr"))
    finding = next(one for one in verb._versions() if one.name == "Python")
    assert (finding.state.value, finding.remedy) == (state, "" if state == "ok" else "tested with 3.11 to 3.14")


def test_a_required_package_that_is_absent_is_a_failure():
    finding = verb._version("no-such-distribution", "")
    assert finding.state.value == "failed" and "pip install --force-reinstall" in finding.remedy


def test_without_its_packages_no_fmu_is_built_and_nothing_fails(monkeypatch):
    monkeypatch.setattr(verb, "missing", lambda extra: ["pythonfmu"])
    only(monkeypatch, verb._extras, verb._compiler)
    code, text = doctor()
    assert code == 0
    assert 'FMUs cannot be built -> pip install "eightpost[build]"' in " ".join(text.split())


def test_a_cache_that_cannot_be_written_is_a_note(monkeypatch, tmp_path):
    monkeypatch.setenv("EIGHTPOST_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(verb, "_is_writable", lambda folder: folder != tmp_path)
    (finding,) = verb._caches()
    assert finding.state.value == "note" and "set EIGHTPOST_CACHE" in finding.remedy
