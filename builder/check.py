"""What others would find wrong with an FMU: fmpy's validation, fmutool's checks, and a short simulation.

The simulation runs in a process of its own, so that an FMU that crashes is a finding and not the end of the check.
"""

from __future__ import annotations

import json
import logging
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from eightpost.archive import read_archive
from eightpost.errors import FmuError

_TIMEOUT = 120.0


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that is wrong: who found it and what it is."""

    source: str
    message: str


@dataclass(frozen=True, slots=True)
class CheckReport:
    """What was done to an FMU and what was found; acceptable when there is no finding."""

    path: Path
    done: tuple[str, ...]
    findings: tuple[Finding, ...]


def check(path: str | Path) -> CheckReport:
    """Check any FMI 2.0 co-simulation FMU.

    Raises:
        FmuError: The file is missing, damaged or unsafe to unpack, or has no modelDescription.xml.
    """
    path = Path(path)
    if "modelDescription.xml" not in read_archive(path):
        raise FmuError(f"{path}: is not an FMU: there is no modelDescription.xml at its top")
    simulated, simulation_findings = _simulate(path)
    return CheckReport(
        path=path,
        done=(
            "fmpy validate: schema, names, start values, units, model structure",
            "fmutool -check: schema and semantic rules of FMI 2.0",
            simulated,
        ),
        findings=(*_fmpy(path), *_fmutool(path), *simulation_findings),
    )


def _fmpy(path: Path) -> Iterator[Finding]:
    from fmpy.validation import validate_fmu  # noqa: PLC0415 - slow to import

    for problem in validate_fmu(str(path)):
        yield Finding("fmpy validate", problem)


def _fmutool(path: Path) -> list[Finding]:
    from fmu_manipulation_toolbox.checker import get_checkers  # noqa: PLC0415
    from fmu_manipulation_toolbox.operations import FMU  # noqa: PLC0415

    with _errors_logged("fmu_manipulation_toolbox") as messages:
        try:
            with FMU(str(path)) as fmu:
                for checker in get_checkers():
                    fmu.apply_operation(checker())
        except Exception as error:  # its parser raises what it likes on a bad description: that is a finding
            messages.append(f"{type(error).__name__}: {error}")
    return [Finding("fmutool -check", message) for message in messages]


@contextmanager
def _errors_logged(name: str) -> Iterator[list[str]]:
    """Collect what a library logs as errors; it has no other way to say them."""
    messages: list[str] = []
    handler = logging.Handler(logging.ERROR)
    handler.emit = lambda record: messages.append(record.getMessage())  # type: ignore[method-assign]
    source = logging.getLogger(name)
    propagate, source.propagate = source.propagate, False
    source.addHandler(handler)
    try:
        yield messages
    finally:
        source.removeHandler(handler)
        source.propagate = propagate


def _simulate(path: Path) -> tuple[str, list[Finding]]:
    """Run builder.short_run on the FMU; return what was done and what was found."""
    command = [sys.executable, "-m", "builder.short_run", str(path.resolve())]
    source = "simulation"
    try:
        ran = subprocess.run(command, capture_output=True, text=True, timeout=_TIMEOUT, check=False)
    except subprocess.TimeoutExpired:
        return "a short simulation, which hung", [Finding(source, f"did not end within {_TIMEOUT:g} s")]
    last = ran.stdout.strip().splitlines()[-1:]
    if ran.returncode != 0 or not last:
        how = f"was killed by signal {-ran.returncode}" if ran.returncode < 0 else f"exit code {ran.returncode}"
        said = " ".join((ran.stderr or ran.stdout).strip().splitlines()[-3:])
        return "a short simulation, which failed", [Finding(source, f"the process {how}: {said or 'it said nothing'}")]
    outcome = json.loads(last[0])
    return str(outcome["done"]), [Finding(source, message) for message in outcome["findings"]]
