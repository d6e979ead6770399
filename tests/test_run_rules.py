"""The rules of every run hold: planted tests that break one fail, and the others do not."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.run_rules import (
    EXPECTED_SKIPS,
    LIMIT,
    ExpectedSkip,
    matches,
    processor_time,
    read_expected_skips,
    too_expensive,
)

ROOT = Path(__file__).parents[1]

#: A limit that costs little.
CONFTEST = """
pytest_plugins = ["tests.run_rules"]

def pytest_configure():
    from tests import run_rules
    run_rules.LIMIT = 0.1
"""
SETTINGS = """
[pytest]
markers =
    slow
    nightly
"""
DECLARED = """
[[skip]]
tests = "test_skips.py*"
reasons = ["declared *"]
why = "planted"
"""
COSTS = """
import subprocess, sys, time
import pytest

def work():
    end = time.process_time() + 0.15
    while time.process_time() < end:
        pass

def test_cheap(): pass
def test_expensive(): work()
def test_child(): subprocess.run([sys.executable, "-c", "import time\\nwhile time.process_time() < 0.15: pass"])
def test_waiting(): time.sleep(0.3)
def test_wrong_and_expensive():
    work()
    assert False, "its own failure"
@pytest.mark.slow
def test_slow(): work()
@pytest.mark.nightly
def test_nightly(): work()
@pytest.mark.slow
@pytest.mark.nightly
def test_slow_and_nightly(): pass
@pytest.fixture(scope="module")
def shared(): work()
def test_that_shares(shared): pass
"""
SKIPS = """
import pytest

def test_declared(): pytest.skip("declared here")
def test_undeclared(): pytest.skip("just so")
@pytest.mark.skipif(True, reason="marked")
def test_marked(): pass
@pytest.fixture
def absent(): pytest.importorskip("no_such_package_at_all")
def test_of_an_extra(absent): pass
@pytest.mark.parametrize("case", [])
def test_without_cases(case): pass
@pytest.mark.xfail(reason="known")
def test_expected_to_fail(): assert False
@pytest.mark.xfail(reason="known")
def test_expected_to_fail_that_passes(): pass
"""
#: Modules that skip themselves, by the rest of their names.
MODULES = {
    "itself": 'import pytest\npytest.skip("not here", allow_module_level=True)\ndef test_left_out(): pass\n',
    "of_nightly_tests": 'import pytest\npytestmark = pytest.mark.nightly\nraise RuntimeError("imported")\n',
    "of_an_extra": 'import pytest\npytest.importorskip("no_such_package_at_all")\ndef test_left_out(): pass\n',
}


@pytest.fixture(scope="module")
def planted(tmp_path_factory):
    """A folder of tests that break the rules, and some that do not."""
    folder = tmp_path_factory.mktemp("planted")
    (folder / "tests").mkdir()
    files = {"conftest.py": CONFTEST, "pytest.ini": SETTINGS, "test_costs.py": COSTS, "test_skips.py": SKIPS}
    files |= {f"test_module_{name}.py": text for name, text in MODULES.items()} | {str(EXPECTED_SKIPS): DECLARED}
    for name, text in files.items():
        (folder / name).write_text(text)
    return folder


def run(folder, *options):
    """Run pytest in a folder; return its exit code and its output."""
    paths = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST_")}
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", *options]
    ran = subprocess.run(command, cwd=folder, env=environment | {"PYTHONPATH": paths}, capture_output=True, text=True,
                         check=False)  # fmt: skip
    return ran.returncode, ran.stdout


@pytest.fixture(scope="module")
def all_planted(planted):
    """Exit code, names of tests and modules by their outcome, and output of a run of all planted tests."""
    status, output = run(planted, "-n", "1", "-rA", "--continue-on-collection-errors")
    names = {}
    for outcome, test in re.findall(r"^(PASSED|FAILED|SKIPPED|ERROR) (?:\[1\] )?([\w.:]+)", output, re.MULTILINE):
        names.setdefault(outcome, set()).add(test.rpartition("::")[2])
    return status, names, output


def test_an_unmarked_test_fails_above_the_limit_of_its_call_and_says_what_to_do(all_planted):
    status, names, output = all_planted
    assert status == pytest.ExitCode.TESTS_FAILED
    assert {"test_expensive", "test_child", "test_wrong_and_expensive"} <= names["FAILED"]
    assert len(re.findall("^This test took .* Make it cheaper, or mark it with pytest.mark.slow", output, re.M)) == 2
    assert "AssertionError: its own failure" in output


def test_cheap_tests_marked_tests_and_tests_whose_fixture_is_expensive_pass(all_planted):
    _, names, _ = all_planted
    assert names["PASSED"] == {"test_cheap", "test_waiting", "test_slow", "test_that_shares"}


def test_every_skip_and_every_expected_failure_that_is_not_declared_fails(all_planted):
    _, names, output = all_planted
    assert {"test_undeclared", "test_expected_to_fail", "test_expected_to_fail_that_passes"} <= names["FAILED"]
    assert names["ERROR"] == {
        "test_marked", "test_of_an_extra", "test_without_cases", "test_module_itself.py", "test_module_of_an_extra.py",
    }  # fmt: skip
    assert {name.split(":")[0] for name in names["SKIPPED"]} == {"test_skips.py"}
    assert "declared here" in output
    for reason in ("just so", "marked", "not here", "xfail: known", "could not import 'no_such_package_at_all'"):
        assert f"A skip that is not expected on this machine: {reason}" in output


@pytest.mark.parametrize("expression", ["nightly", pytest.param("not slow", marks=pytest.mark.nightly)])
def test_nightly_tests_and_their_modules_are_collected_only_where_the_expression_of_markers_names_them(
    planted, expression
):
    _, output = run(planted, "--collect-only", "-q", "-m", expression, ".")
    names = {"nightly", "slow_and_nightly"}
    found = set(re.findall(r"test_costs\.py::test_(\w+)", output))
    assert found == names if expression == "nightly" else not found & names and "cheap" in found
    assert ("RuntimeError: imported" in output) == (expression == "nightly")


def test_the_limit_itself_is_allowed():
    assert too_expensive(LIMIT) == ""
    assert f"took {LIMIT + 0.1:.1f} s of processor time" in too_expensive(LIMIT + 0.1)


def test_processor_time_includes_child_processes_and_no_waiting():
    before = processor_time()
    subprocess.run([sys.executable, "-c", "import time\nwhile time.process_time() < 0.2: pass"], check=True)
    assert processor_time() - before >= 0.2


def test_a_pattern_matches_whole_texts_and_takes_brackets_literally():
    assert matches("tests/test_a.py*", "tests/test_a.py::test[1-2]")
    assert matches("*[1-2]", "tests/test_a.py::test[1-2]")
    assert not matches("*[1-2]", "tests/test_a.py::test1")
    assert not matches("test_a", "tests/test_a")
    assert not matches("tests/test_a", "tests/test_abc")


def test_a_skip_is_allowed_only_for_its_tests_and_reasons(tmp_path):
    skip = ExpectedSkip("tests/a.py*", ("no wheel *", "no disk"), "because")
    assert skip.allows("tests/a.py::test", "no wheel here", tmp_path)
    assert skip.allows("tests/a.py::test", "no disk", tmp_path)
    assert not skip.allows("tests/b.py::test", "no disk", tmp_path)
    assert not skip.allows("tests/a.py::test", "no time", tmp_path)


@pytest.mark.parametrize("condition", [
    {"unless_set": "EIGHTPOST_PLANTED"},
    {"unless_program": ("eightpost-no-program", "planted")},
    {"unless_path": "planted"},
], ids=lambda condition: next(iter(condition)))  # fmt: skip
def test_a_skip_is_not_allowed_where_the_tests_can_run(condition, tmp_path, monkeypatch):
    skip = ExpectedSkip("*", ("*",), "because", **condition)
    monkeypatch.setenv("PATH", str(tmp_path))
    assert skip.allows("test", "reason", tmp_path)
    monkeypatch.setenv("EIGHTPOST_PLANTED", "1")
    (tmp_path / "planted").touch(mode=0o755)
    assert not skip.allows("test", "reason", tmp_path)


def test_a_skip_is_allowed_only_where_its_marker_holds(tmp_path):
    for platform, allowed in ((sys.platform, True), ("elsewhere", False)):
        skip = ExpectedSkip("*", ("*",), "because", where=f"sys_platform == '{platform}'")
        assert skip.allows("test", "reason", tmp_path) is allowed


def test_every_expected_skip_is_of_tests_that_exist_and_says_why():
    skips = read_expected_skips(ROOT / EXPECTED_SKIPS)
    assert skips and not read_expected_skips(ROOT / "no_such_file.toml")
    for skip in skips:
        assert (ROOT / skip.tests.rstrip("*")).exists(), skip.tests
        assert skip.reasons and skip.why.endswith(".")


def test_files_that_later_runs_read_are_noticed_and_other_files_are_not(tmp_path, monkeypatch):
    monkeypatch.setenv("EIGHTPOST_CACHE", str(tmp_path / "cache"))
    names = ("cache/loop/a", "out/b.nbi", "out/c.nbc", "unicode_data/15/a", "out/d.json")
    kept = []
    monkeypatch.setattr("tests.run_rules.kept", kept)
    for name in names:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "new").write_text("")
        (tmp_path / "new").replace(tmp_path / name)
    assert kept == [tmp_path / name for name in names[:4]]
