"""The Windows libraries of the FMUs, loaded by a Windows program under Wine, against the Linux ones."""

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from fmpy import read_model_description

from builder.build import build
from builder.toolchain import Zig, find_toolchain, fmi_headers

WINE = shutil.which("wine64") or shutil.which("wine")
HOST = Path(__file__).with_name("load_and_step.c")

#: FMUs: the shocks are those of the law.
MODELS = ("polylinear", "lpf1", "lpnl2", "hysteresis", "quarter_car", "seven_dof")
#: Folders of the libraries by FMI version.
FOLDERS = {2: ("linux64", "win64"), 3: ("x86_64-linux", "x86_64-windows")}
#: Amplitude of an input by the end of its name: SI units. The displacement is the integral of the velocity.
AMPLITUDES = {"velocity": 0.5, "displacement": 0.5 / 64.0, "road": 0.01, "moment": 500.0, "force": 500.0}

pytestmark = [pytest.mark.nightly, pytest.mark.skipif(WINE is None, reason="wine is not installed (Debian: wine64)")]


@pytest.fixture(scope="module")
def both(universal_fmus, all_platforms, model_files, tmp_path_factory):
    """Return the FMUs with the libraries of all platforms by FMI version."""
    folder = tmp_path_factory.mktemp("wine")
    return {2: universal_fmus, 3: {item.path.stem: item.path for item in build(model_files, folder, fmi="3")}}


@pytest.fixture(scope="module")
def programs(tmp_path_factory):
    """Return the host program for Linux and for Windows, by FMI version."""
    if not isinstance(find_toolchain(), Zig):
        pytest.skip("programs for Windows need the extra build (zig)")
    folder = tmp_path_factory.mktemp("host")
    targets = {"linux": ("x86_64-linux-gnu", ["-lm", "-ldl"]), "windows": ("x86_64-windows-gnu", [])}
    made = {}
    for fmi in FOLDERS:
        for name, (target, libraries) in targets.items():
            made[fmi, name] = folder / f"{name}_{fmi}.exe"
            command = [sys.executable, "-m", "ziglang", "cc", "-target", target, "-O1", "-ffp-contract=off"]
            command += [f"-DFMI={fmi}", f"-I{fmi_headers()}", HOST, *libraries, "-o", made[fmi, name]]
            subprocess.run(command, check=True, timeout=300)
    return made


def outputs(program, library, description, mode, *prefix):
    """Return the outputs (1000, K) that a host prints."""
    inputs = [variable for variable in description.modelVariables if variable.causality == "input"]
    wanted = [variable for variable in description.modelVariables if variable.causality == "output"]
    given = ",".join(f"{v.valueReference}:{AMPLITUDES[v.name.rpartition('.')[2].rpartition('_')[2]]!r}" for v in inputs)
    named = ",".join(str(variable.valueReference) for variable in wanted)
    states = str(description.numberOfContinuousStates)
    done = subprocess.run(
        [*prefix, program, library, description.guid, mode, states, given, named],
        check=False, capture_output=True, text=True, timeout=300, env=os.environ | {"WINEDEBUG": "-all"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return np.array([float.fromhex(word) for word in done.stdout.split()]).reshape(1000, len(wanted))


@pytest.mark.parametrize("mode", ["cs", "me"])
@pytest.mark.parametrize("fmi", FOLDERS)
@pytest.mark.parametrize("model", MODELS)
def test_an_fmu_gives_the_same_outputs_on_windows(both, programs, tmp_path, model, fmi, mode):
    description = read_model_description(both[fmi][model])
    with zipfile.ZipFile(both[fmi][model]) as archive:
        archive.extractall(tmp_path)
    (linux,), (windows,) = ([*(tmp_path / "binaries" / name).glob("*.*")] for name in FOLDERS[fmi])
    native = outputs(programs[fmi, "linux"], linux, description, mode)
    foreign = outputs(programs[fmi, "windows"], windows, description, mode, WINE)
    assert np.ptp(native, axis=0).max() > 100.0
    assert (np.abs(foreign - native) <= 1e-12 * np.abs(native).max(axis=0)).all()
