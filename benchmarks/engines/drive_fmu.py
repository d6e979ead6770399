"""Drive for other engines: drive.npz for those that set inputs, drive.fmu for those that need an FMU as a source."""

from __future__ import annotations

import subprocess
from pathlib import Path

import fmpy
import numpy as np

from benchmarks.engines.job import DRIVEN
from builder.native.platforms import this_platform
from builder.native.toolchain import fmi_headers
from eightpost.archive import write_archive
from eightpost.compilers import find_compiler
from eightpost.signals import Drivefile

GUID = "{7d1c8f0e-drive-player}"
SOURCE = Path(__file__).with_name("drive.c")


def write_drive(drive: Drivefile, folder: Path) -> None:
    """Write drive.npz and drive.fmu."""
    time, values = drive.series.time, np.stack([drive.series[name] for name in DRIVEN])
    np.savez(folder / "drive.npz", time=time, values=values)
    table = np.concatenate([[float(time.size)], time, values.T.ravel()]).astype("<f8").tobytes()
    library = folder / f"drive{fmpy.sharedLibraryExtension}"
    options = ["-shared", "-fPIC", "-O2", "-w", "-I", str(fmi_headers())]
    command = [*find_compiler(), *options, str(SOURCE), "-o", str(library)]
    subprocess.run(command, check=True)
    members = {
        "modelDescription.xml": _description().encode(),
        this_platform().member("drive"): library.read_bytes(),
        "resources/drive.bin": table,
    }
    write_archive(folder / "drive.fmu", members)


def _description() -> str:
    variables = "".join(
        f'<ScalarVariable name="{name}" valueReference="{k}" causality="output" variability="continuous" '
        f'initial="calculated"><Real/></ScalarVariable>'
        for k, name in enumerate(DRIVEN)
    )
    unknowns = "".join(f'<Unknown index="{k + 1}" dependencies=""/>' for k in range(len(DRIVEN)))
    return (
        f'<?xml version="1.0" encoding="UTF-8"?><fmiModelDescription fmiVersion="2.0" modelName="drive" guid="{GUID}">'
        '<CoSimulation modelIdentifier="drive" canHandleVariableCommunicationStepSize="true"/>'
        f"<ModelVariables>{variables}</ModelVariables><ModelStructure><Outputs>{unknowns}</Outputs>"
        f"<InitialUnknowns>{unknowns}</InitialUnknowns></ModelStructure></fmiModelDescription>"
    )
