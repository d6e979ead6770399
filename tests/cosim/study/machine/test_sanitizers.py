"""A batch with every law, friction and a filter causes no finding of the address and undefined-behaviour sanitizers."""

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


@pytest.mark.nightly
def test_batches_cause_no_sanitizer_finding(fmus, tmp_path):
    compiler = shutil.which("gcc")
    if compiler is None:
        pytest.skip("gcc is not installed")
    asked = subprocess.run([compiler, "-print-file-name=libasan.so"], capture_output=True, text=True, check=True)
    if not Path(asked.stdout.strip()).is_absolute():
        pytest.skip("gcc has no address sanitizer")
    options = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    folder = next(iter(fmus.values())).parent
    environment = os.environ | {
        "CC": compiler,
        "LD_PRELOAD": asked.stdout.strip(),
        "ASAN_OPTIONS": "detect_leaks=0",
        "PYTHONPATH": str(ROOT),
        "EIGHTPOST_CACHE": str(tmp_path),
    }
    write_vehicle(tmp_path / "car.json", car_with_seat())
    seated = build([tmp_path / "car.json"], tmp_path)[0].path
    module = "tests.cosim.study.machine.sanitized"
    ran = subprocess.run(
        [sys.executable, "-m", module, str(folder), str(seated), *options],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.returncode == 0 and "no finding" in ran.stdout, ran.stderr[-2000:]
