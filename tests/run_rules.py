"""Rules of every run of the tests: an unmarked test is cheap, a skip is declared, nightly tests run on request.

`repeated` marks a claim whose cases differ in cost, not in kind: one represents it daily, the others run nightly.

A test that breaks a rule fails, and says what to do. tests/conftest.py loads this module as a plugin of pytest.
"""

from __future__ import annotations

import os
import re
import shutil
import sys
import time
import tomllib
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest
from packaging.markers import Marker

from eightpost.cache import cache_folder

try:
    import resource
except ImportError:  # Windows
    resource = None

#: Processor time above which a test should be marked slow [s].
SLOW = 1.0
#: Processor time above which an unmarked test fails [s]: a test of SLOW on a machine of a fifth of the speed. Wall time
#: has no limit: on a busy machine, a test of 1.3 s of processor time lasted seven minutes.
LIMIT = 5.0

#: File of the expected skips, from the folder of pyproject.toml.
EXPECTED_SKIPS = Path("tests", "expected_skips.toml")

#: Files that this process has kept for later ones.
kept: list[Path] = []

_expected = pytest.StashKey[tuple["ExpectedSkip", ...]]()


@dataclass(frozen=True)
class ExpectedSkip:
    """Tests that may be skipped, by a pattern of their ids and of the reason; `*` stands for any text."""

    tests: str
    #: Patterns of the text that the skip gives as its reason.
    reasons: Sequence[str]
    #: Why this skip is expected.
    why: str
    #: Environment variable with which the tests must run.
    unless_set: str = ""
    #: Programs, with one of which on the PATH the tests must run.
    unless_program: Sequence[str] = ()
    #: File or folder of the checkout with which the tests must run.
    unless_path: str = ""
    #: Environment marker, as of a dependency in pyproject.toml, without which the tests must run.
    where: str = ""

    def allows(self, test: str, reason: str, root: Path) -> bool:
        """Return whether a test of the checkout `root` may be skipped on this machine for a reason."""
        return (
            matches(self.tests, test)
            and any(matches(pattern, reason) for pattern in self.reasons)
            and not os.environ.get(self.unless_set)
            and not any(map(shutil.which, self.unless_program))
            and not (self.unless_path and (root / self.unless_path).exists())
            and (not self.where or Marker(self.where).evaluate())
        )


def matches(pattern: str, text: str) -> bool:
    """Return whether a text is a pattern in which each `*` stands for any text; brackets of ids have no meaning."""
    return re.fullmatch(".*".join(map(re.escape, pattern.split("*"))), text, re.DOTALL) is not None


def read_expected_skips(path: Path) -> tuple[ExpectedSkip, ...]:
    """Read the tables `skip` of a TOML file; without the file, no skip is expected."""
    tables = tomllib.loads(path.read_text(encoding="utf-8"))["skip"] if path.exists() else ()
    return tuple(ExpectedSkip(**table) for table in tables)


def processor_time() -> float:
    """Return the processor time of this process and of its ended child processes [s]."""
    if resource is None:
        return time.process_time()
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in used)


def too_expensive(seconds: float) -> str:
    """Return why an unmarked test of this processor time [s] fails; an empty text if it does not."""
    if seconds <= LIMIT:
        return ""
    return (
        f"This test took {seconds:.1f} s of processor time; a test that is not marked fails above {LIMIT:g} s."
        f" Make it cheaper, or mark it with pytest.mark.slow, as every test above {SLOW:g} s."
    )


def note_kept_file(event: str, arguments: tuple[object, ...]) -> None:
    """Count the files that this process keeps for later ones (an audit hook of Python).

    A test that made what all later runs read, such as machine code and Hypothesis's table of characters, is not
    expensive: it was only the first.
    """
    if event == "os.rename":
        path = Path(os.fsdecode(arguments[1]))
        if path.is_relative_to(cache_folder()) or path.suffix in (".nbi", ".nbc") or "unicode_data" in path.parts:
            kept.append(path)


def undeclared(test: str, reason: str, config: pytest.Config) -> str:
    """Return why a skipped test fails; an empty text if a table of tests/expected_skips.toml expects the skip."""
    if any(skip.allows(test, reason, config.rootpath) for skip in config.stash[_expected]):
        return ""
    return (
        f"A skip that is not expected on this machine: {reason}\n"
        "Install or set what it needs (pip install -e .[test] has all packages), or, if it cannot run here, declare"
        f" the skip and why it is expected in {EXPECTED_SKIPS.as_posix()}."
    )


def reason_of(report: pytest.TestReport | pytest.CollectReport) -> str:
    """Return the reason of a report that says that a test was skipped or was expected to fail."""
    if hasattr(report, "wasxfail"):
        return f"xfail: {report.wasxfail}"
    return report.longrepr[2].removeprefix("Skipped: ") if isinstance(report.longrepr, tuple) else str(report.longrepr)


def pytest_configure(config: pytest.Config) -> None:
    """Read the expected skips, and watch for kept files."""
    sys.addaudithook(note_kept_file)
    config.stash[_expected] = read_expected_skips(config.rootpath / EXPECTED_SKIPS)


def mark_repetitions(items: Sequence[pytest.Item]) -> None:
    """Mark the cases that repeat a claim as nightly: `repeated(2)` keeps two daily, `repeated("knots")` those ids."""
    seen: Counter[str] = Counter()
    for item in items:
        for marker in item.iter_markers("repeated"):
            test = item.nodeid.partition("[")[0]
            texts = [text for text in marker.args if isinstance(text, str)]
            is_daily = any(text in item.nodeid for text in texts) if texts else seen[test] < (marker.args or (1,))[0]
            seen[test] += 1
            if not is_daily:
                item.add_marker("nightly")


#: Beginning of a module all of whose tests are nightly.
_NIGHTLY = re.compile(r"^pytestmark = \[?pytest\.mark\.nightly\b", re.MULTILINE)


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave out modules of nightly tests before they are imported, unless they are named or `-m` mentions nightly."""
    if collection_path.suffix != ".py" or "nightly" in config.getoption("markexpr") or collection_path.is_dir():
        return None
    if any(collection_path == Path(word.partition("::")[0]).absolute() for word in config.args):
        return None
    return True if _NIGHTLY.search(collection_path.read_text(encoding="utf-8")) else None


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out nightly tests, unless `-m` says something about them."""
    mark_repetitions(items)
    if "nightly" in config.getoption("markexpr"):
        return
    nightly = [item for item in items if item.get_closest_marker("nightly")]
    if nightly:
        config.hook.pytest_deselected(items=nightly)
        items[:] = [item for item in items if not item.get_closest_marker("nightly")]


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_call(item: pytest.Item) -> Iterator[None]:
    """Fail a test that passed, is not marked, and is too expensive."""
    start, before = processor_time(), len(kept)
    yield
    reason = too_expensive(processor_time() - start)
    if reason and not any(map(item.get_closest_marker, ("slow", "nightly"))) and len(kept) == before:
        pytest.fail(reason, pytrace=False)


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_makereport(item: pytest.Item) -> Iterator[None]:
    """Let a test fail that was skipped, or expected to fail, without a declaration."""
    report = yield
    if report.skipped or hasattr(report, "wasxfail"):
        _fail_undeclared(report, item.config)
    return report


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_make_collect_report(collector: pytest.Collector) -> Iterator[None]:
    """Let the collection of a module fail that skips itself without a declaration."""
    report = yield
    if report.skipped:
        _fail_undeclared(report, collector.config)
    return report


def _fail_undeclared(report: pytest.TestReport | pytest.CollectReport, config: pytest.Config) -> None:
    if reason := undeclared(report.nodeid, reason_of(report), config):
        report.outcome, report.longrepr = "failed", reason
