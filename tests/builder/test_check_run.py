"""Execution of a check: unusual surroundings, sources that are compiled, and how the end of a process is read."""

import json
import os
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from types import SimpleNamespace

import pytest

from builder.check import check, run
from builder.check.rules import RULES
from builder.check.run import Outcome, Unpacked, surroundings
from eightpost.archive import read_archive

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="the compiler below is a shell script")

OUTPUTS, OTHERS = Outcome(values={"outputs": "a"}), Outcome(values={"outputs": "b"})
FAILED = Outcome((RULES["crash"].finding("it crashed"),), completed=False)


@pytest.mark.parametrize(
    ("bare", "odd", "expected"),
    [
        (OUTPUTS, OUTPUTS, []),
        (OTHERS, OUTPUTS, [("bare-environment", "it runs, but the outputs differ")]),
        (OUTPUTS, FAILED, [("odd-path", "it crashed")]),
        (OTHERS, FAILED, [("bare-environment", "it runs, but the outputs differ"), ("odd-path", "it crashed")]),
    ],
)
def test_a_run_that_differs_elsewhere_is_found_by_its_surroundings(
    bare: Outcome, odd: Outcome, expected: list[tuple[str, str]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = []

    def trace(unpacked: Unpacked, folder: Path, environment: Mapping[str, str] | None = None) -> Outcome:
        seen.append((unpacked.folder != tmp_path, os.access(folder, os.W_OK), environment))
        assert (unpacked.folder / "here").exists() and unpacked.reach == 7
        return odd if unpacked.folder != tmp_path else bare

    monkeypatch.setattr(run, "trace", trace)
    (tmp_path / "here").touch()
    found = surroundings(Unpacked(tmp_path, 7), OUTPUTS).findings
    assert [(finding.rule.identifier, finding.message) for finding in found] == expected
    assert [(is_odd, environment) for is_odd, _, environment in seen] == [(False, {}), (True, None)]


def test_surroundings_of_an_fmu_that_fails_are_those_of_the_plain_run(tmp_path: Path) -> None:
    assert surroundings(Unpacked(tmp_path), FAILED) is FAILED


@pytest.fixture
def compiler(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], Path]:
    """Replace every C compiler by a script that writes its arguments into the file that is returned."""

    def put(script: str) -> Path:
        folder, log = tmp_path / "compilers", tmp_path / "log"
        folder.mkdir()
        for name in ("cc", "gcc", "clang"):
            (folder / name).write_text(f'#!/bin/sh\necho "$@" >> {log}\nfor last; do :; done\n{script}\n')
            (folder / name).chmod(0o755)
        monkeypatch.setenv("PATH", f"{folder}:{os.environ['PATH']}")
        run._trial.cache_clear()
        return log

    return put


#: Copies a binary to the file after -o, except for the trial of the compiler.
COPY = 'case "$*" in *trial.c*) ;; *) while [ "$1" != -o ]; do shift; done; cp {} "$2";; esac'


def _member(path: Path, folder: Path) -> Path:
    members = read_archive(path)
    (name,) = (one for one in members if one.startswith("binaries/"))
    (folder / "binary").write_bytes(members[name])
    return folder / "binary"


def _rebuilt(path: Path) -> list[tuple[str, str]]:
    return [(one.rule.identifier, one.message) for one in check(path, groups=("rebuild",)).findings]


def test_sources_are_compiled_with_their_definitions_and_compared_with_the_binary(
    fmus: Mapping[str, Path], tmp_path: Path, compiler: Callable[[str], Path]
) -> None:
    log = compiler(COPY.format(_member(fmus["lpf1"], tmp_path)))
    assert _rebuilt(fmus["lpf1"]) == []
    trial, line, *_ = log.read_text().splitlines()
    assert trial == "-shared -fPIC trial.c -o trial.so"
    words = line.split()
    assert {"-shared", "-fPIC", "-w", "-ffp-contract=off", "-I.", "step.c", "model.c", "-lm"} <= set(words)
    assert words[words.index("-o") + 1].endswith("lpf1.so")


@pytest.mark.parametrize(
    ("script", "message"),
    [
        ("echo 'a.c: warning: b'; echo 'a.c:3: Error: c'; echo end; exit 1", "a.c:3: Error: c"),
        ("echo one; echo; echo 'two '; exit 1", "two"),
        ("exit 3", "it ended with code 3 and printed nothing"),
    ],
)
def test_sources_that_do_not_compile_are_found_with_the_first_error(
    script: str, message: str, fmus: Mapping[str, Path], compiler: Callable[[str], Path]
) -> None:
    compiler(f'case "$*" in *trial.c*) ;; *) {script};; esac')
    assert _rebuilt(fmus["lpf1"]) == [("sources-compile", message)]


def test_without_a_compiler_that_works_nothing_is_compiled(
    fmus: Mapping[str, Path], compiler: Callable[[str], Path]
) -> None:
    compiler("echo licence expired; exit 1")
    (skipped,) = check(fmus["lpf1"], groups=("rebuild",)).skipped
    assert skipped.reason.endswith("does not work (licence expired)")


def test_a_compiler_that_hangs_is_ended_without_a_finding(
    fmus: Mapping[str, Path], compiler: Callable[[str], Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run, "_TRIAL_TIMEOUT", 1.0)
    compiler("sleep 600")
    started = time.monotonic()
    (skipped,) = check(fmus["lpf1"], groups=("rebuild",)).skipped
    assert skipped.reason.endswith("(it did not end within 1 s)") and time.monotonic() - started < 60.0


SIMULATED = [{"group": "simulation"}, {"rule": "start-agrees", "message": "u is 1"}, {"completed": True}]
BEGUN = [{"group": "simulation"}]
PROBE = "the process of the probe 'simulation' "


@pytest.mark.parametrize(
    ("lines", "code", "call", "found"),
    [
        (SIMULATED, 0, "fmi2DoStep", [("start-agrees", "u is 1")]),
        (SIMULATED, -11, "fmi2DoStep", [("start-agrees", "u is 1")]),
        (BEGUN, -11, "fmi2DoStep",
         [("crash", PROBE + "was killed by signal 11 in or after fmi2DoStep; it printed: last")]),
        (BEGUN, 3, "fmi2DoStep", [("crash", PROBE + "ended with code 3 in or after fmi2DoStep; it printed: last")]),
        (BEGUN, 0, "", []),
        (BEGUN, None, "fmi2Reset", [("crash", PROBE + "did not end within 900 s in or after fmi2Reset")]),
        ([*BEGUN, {"hung": "6 s"}], 1, "fmi2Reset",
         [("crash", PROBE + "did not end within 6 s in or after fmi2Reset")]),
        (BEGUN, -6, "fmi2FreeInstance(NULL)",
         [("free-null", PROBE + "was killed by signal 6 in or after fmi2FreeInstance(NULL); it printed: last")]),
    ],
)  # fmt: skip
def test_the_end_of_a_process_of_probes_is_a_finding(
    lines: list[dict[str, object]], code: int | None, call: str, found: list[tuple[str, str]],
    fmus: Mapping[str, Path], monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.setattr(run.process, "run", lambda command, *_, **__: _ended(command, lines, code, call))
    report = check(fmus["lpf1"], groups=("simulation",))
    assert [(one.rule.identifier, one.message) for one in report.findings] == found


def _words(command: list[str]) -> list[str]:
    """Return the words of a command after the folder of the FMU, of which the first is the file of its progress."""
    return command[next(k for k, word in enumerate(command) if Path(word).name == "fmu") + 1 :]


def _ended(command: list[str], lines: list[dict[str, object]], code: int | None, call: str) -> SimpleNamespace:
    """Return what a process of probes leaves that printed lines, of which a crash cut off one."""
    Path(_words(command)[0]).write_bytes(call.encode() + b"\0rest")
    printed = "".join(f"{json.dumps(line)}\n" for line in lines) + '{"cut o'
    return SimpleNamespace(code=code, output=printed.encode(), errors=b"one\nlast\n")


@pytest.mark.parametrize(
    ("used", "skipped", "calls"), [(6.9, {}, 2), (7.1, {"steps": "it would take too much processor time"}, 1)]
)
def test_groups_after_a_crash_run_in_another_process_while_there_is_time(
    used: float, skipped: dict[str, str], calls: int, fmus: Mapping[str, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    begun: list[list[str]] = []

    def ran(command: list[str], *_: object, **__: object) -> SimpleNamespace:
        begun.append(command)
        first = [{"group": "simulation"}, {"completed": True}, {"group": "inputs"}, {"completed": True, "used": used}]
        return _ended(command, first if len(begun) == 1 else [{"group": "steps"}, {"completed": True}], 0, "")

    monkeypatch.setattr(run.process, "run", ran)
    report = check(fmus["lpf1"], groups=("simulation", "inputs", "steps"))
    assert {one.what: one.reason for one in report.skipped} == skipped and len(begun) == calls
    assert report.findings == () and begun[0][-3:] == ["simulation", "inputs", "steps"]
    words = [_words(command)[1:4] for command in begun]
    assert words == [["6.0", "8.0", ""], ["6.0", str(8.0 - used), ""]][:calls]
