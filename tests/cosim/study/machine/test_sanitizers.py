"""Batches cause no finding of the address and undefined-behaviour sanitizers."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from builder.build import build
from eightpost.vehicle import write_vehicle
from tests.double_modes import car_with_seat

ROOT = Path(__file__).resolve().parents[4]
OPTIONS = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")


@pytest.fixture
def output(tmp_path):
    """Return the output of a module of this folder that runs with sanitizers."""
    compiler = shutil.which("gcc")
    if compiler is None:
        pytest.skip("gcc is not installed")
    asked = subprocess.run([compiler, "-print-file-name=libasan.so"], capture_output=True, text=True, check=True)
    if not Path(asked.stdout.strip()).is_absolute():
        pytest.skip("gcc has no address sanitizer")
    environment = os.environ | {
        "CC": compiler,
        "LD_PRELOAD": asked.stdout.strip(),
        "ASAN_OPTIONS": "detect_leaks=0",
        "PYTHONPATH": str(ROOT),
        "EIGHTPOST_CACHE": str(tmp_path),
    }

    def run(module, *arguments):
        line = [sys.executable, "-m", f"tests.cosim.study.machine.{module}", *map(str, arguments), *OPTIONS]
        ran = subprocess.run(line, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
        assert ran.returncode == 0, ran.stderr[-2000:]
        return ran.stdout

    return run


@pytest.mark.nightly
def test_batches_with_every_law_friction_and_a_filter_cause_no_finding(fmus, tmp_path, output):
    write_vehicle(tmp_path / "car.json", car_with_seat())
    seated = build([tmp_path / "car.json"], tmp_path)[0].path
    assert "no finding" in output("sanitized", next(iter(fmus.values())).parent, seated)


@pytest.mark.nightly
def test_batches_of_shocks_and_drives_of_any_numbers_cause_no_finding_and_some_end(output):
    words = output("hostile", int(os.environ.get("EIGHTPOST_CALLS", "100000")) // 50).split()
    assert words[:2] == ["no", "finding,"] and int(words[2]) > 1000
