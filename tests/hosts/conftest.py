"""Programs of examples/hosts whose packages may be missing: import them, run a loop of one, and get its error."""

import importlib
import sys
from pathlib import Path

import pytest

from builder.build import build

HOSTS = Path(__file__).parents[2] / "examples" / "hosts"
SECONDS = 1.0


@pytest.fixture(scope="session")
def program():
    """Import a program of examples/hosts: program("pathsim_host", "pathsim"); skip without its packages."""
    sys.path.insert(0, str(HOSTS))

    def imported(name, *packages):
        for package in packages:
            reason = f"{package} is not installed (see the extras host-... in pyproject.toml)"
            pytest.importorskip(package, reason=reason, exc_type=ImportError)
        return importlib.import_module(name)

    yield imported
    sys.path.remove(str(HOSTS))


@pytest.fixture(scope="session")
def case(tmp_path_factory, program):
    """Return a case of the host programs at a step: 1 s of the track, with FMUs that are built once."""
    folder, reference = tmp_path_factory.mktemp("host_fmus"), program("reference")
    build([reference.CAR, reference.SHOCK], folder)
    return lambda step: reference.Case(step, SECONDS, folder / "shock.fmu", folder / "car.fmu")


@pytest.fixture(scope="session")
def motion_of(case):
    """Run a loop of a program at a step, each once: motion_of(host, "C", 2e-3)."""
    kept = {}

    def once(host, loop, step):
        key = (host.__name__, loop, step)
        if key not in kept:
            kept[key] = host.LOOPS[loop](case(step))
        return kept[key]

    return once


@pytest.fixture(scope="session")
def error_of(motion_of, program):
    """Errors of shock velocity and tire force [%] of a loop of a program at a step."""
    return lambda host, loop, step: program("reference").errors(motion_of(host, loop, step), SECONDS)
