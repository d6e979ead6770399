"""The Windows libraries of the FMUs, loaded by a Windows program under Wine, against the Linux ones."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from fmpy import read_model_description

from builder.native.toolchain import Zig, find_toolchain, fmi_headers

WINE = shutil.which("wine64") or shutil.which("wine")
HOST = Path(__file__).with_name("load_and_step.c")

pytestmark = [pytest.mark.nightly, pytest.mark.skipif(WINE is None, reason="wine is not installed (Debian: wine64)")]


@pytest.fixture(scope="module")
def programs(tmp_path_factory):
    """Return the host program for Linux and for Windows."""
    if not isinstance(find_toolchain(), Zig):
        pytest.skip("programs for Windows need the extra build (zig)")
    folder = tmp_path_factory.mktemp("host")
    made = {}
    targets = {"linux": ("x86_64-linux-gnu", ["-lm", "-ldl"]), "windows": ("x86_64-windows-gnu", [])}
    for name, (target, libraries) in targets.items():
        made[name] = folder / f"{name}.exe"
        command = [sys.executable, "-m", "ziglang", "cc", "-target", target, "-O1", "-ffp-contract=off"]
        command += [f"-I{fmi_headers()}", HOST]
        subprocess.run([*command, *libraries, "-o", made[name]], check=True, timeout=300)
    return made


def forces(program, library, description, *prefix):
    references = {v.name: v.valueReference for v in description.modelVariables}
    numbers = [str(references[name]) for name in ("velocity", "displacement", "force")]
    done = subprocess.run(
        [*prefix, program, library, description.guid, "shock", *numbers],
        check=False, capture_output=True, text=True, timeout=300, env=os.environ | {"WINEDEBUG": "-all"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return np.array([float.fromhex(word) for word in done.stdout.split()])


@pytest.mark.parametrize("law", ["polylinear", "lpf1", "lpnl2", "maxwell", "hysteresis"])
def test_a_shock_gives_the_same_forces_on_windows(fmus, programs, tmp_path, law):
    description = read_model_description(fmus[law])
    with zipfile.ZipFile(fmus[law]) as archive:
        archive.extractall(tmp_path)
    (linux,), (windows,) = ((tmp_path / "binaries" / name).glob("*.*") for name in ("linux64", "win64"))
    native = forces(programs["linux"], linux, description)
    foreign = forces(programs["windows"], windows, description, WINE)
    assert native.size == 1000 and np.ptp(native) > 100.0
    assert np.abs(foreign - native).max() <= 1e-12 * np.abs(native).max()
