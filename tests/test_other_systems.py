"""Code for Windows and macOS: functions of `os`, `signal` and `resource` that these systems lack are not used there."""

import subprocess
import sys

import pytest

from eightpost.workers.process import ROOT


@pytest.mark.nightly
@pytest.mark.parametrize("system", ["win32", "darwin"])
def test_the_packages_use_only_functions_that_the_system_has(system):
    options = ["--python-platform", system, "--python-interpreter-path", sys.executable]
    command = [sys.executable, "-m", "pyrefly", "check", *options]
    done = subprocess.run(command, cwd=ROOT, check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout
