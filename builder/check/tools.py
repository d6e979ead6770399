"""Third-party checkers: `fmpy validate` and `fmutool -check`."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from builder.check.catalogue import archive as rules
from builder.check.rules import Finding

_SUMMARY = ("This FMU does not validate", "semantic error(s)")


def tool_findings(path: Path) -> Iterator[Finding]:
    """Apply both checkers to an FMU."""
    for problem in _fmpy(path):
        yield rules.FMPY.finding(problem)
    for message in _fmutool(path):
        if not any(text in message for text in _SUMMARY):
            yield rules.FMUTOOL.finding(message)


def _fmpy(path: Path) -> list[str]:
    from fmpy.validation import validate_fmu  # noqa: PLC0415 - slow to import

    try:
        return [str(problem) for problem in validate_fmu(str(path))]
    except Exception as error:  # an exception of its parser is a finding
        return [f"{type(error).__name__}: {error}"]


def _fmutool(path: Path) -> list[str]:
    from fmu_manipulation_toolbox.checker import get_checkers  # noqa: PLC0415 - slow to import
    from fmu_manipulation_toolbox.operations import FMU  # noqa: PLC0415

    with _errors_logged("fmu_manipulation_toolbox") as messages:
        try:
            with FMU(str(path)) as fmu:
                for checker in get_checkers():
                    fmu.apply_operation(checker())
        except Exception as error:  # an exception of its parser is a finding
            messages.append(f"{type(error).__name__}: {error}")
    return messages


@contextmanager
def _errors_logged(name: str) -> Iterator[list[str]]:
    """Collect the errors that a library logs; it reports them in no other way."""
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
