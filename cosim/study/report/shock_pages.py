"""Curves of the shocks of a bank, measured on their FMUs, and the pages that the FMUs carry."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cosim.components.fmu_component import FmuComponent
from cosim.session.master import run
from cosim.study.study import Build, Study
from cosim.systems.scenario import Scenario
from cosim.systems.system import System
from eightpost.array_types import Array
from eightpost.errors import EightpostError
from eightpost.files import atomic_path
from eightpost.signals import Drivefile, TimeSeries

#: Velocities of a curve [m/s]: closer together where shocks have their knees.
VELOCITIES = np.sign(np.linspace(-1.0, 1.0, 61)) * np.linspace(-1.0, 1.0, 61) ** 2

#: Time for which each velocity is held [s], much longer than the lag of a shock, and step of the run [s].
HELD, STEP = 0.05, 1e-3

#: Page that an FMU carries about itself.
_PAGE = "documentation/index.html"

#: File by which an FMU of this project is recognised; pages of other FMUs are not copied.
_OWN = "resources/eightpost.json"


@dataclass(frozen=True, slots=True, eq=False)
class ShockCurve:
    """Force of a shock at constant velocities, after its lag has died out."""

    velocity: Array  #: Velocities (K,) [m/s], positive in compression.
    force: Array  #: Forces (K,) [N], at rest displacement.


def shock_curves(study: Study) -> dict[str, ShockCurve]:
    """Return the curve of every build of a study's bank, measured by a run of its FMU with the build's parameters.

    A build whose FMU cannot run alone is left out: its curve is an addition to the page, not a result of the study.
    """
    curves = dict[str, ShockCurve]()
    for name, build in study.bank.items():
        try:
            curves[name] = shock_curve(build)
        except (EightpostError, OSError):
            continue
    return curves


def shock_curve(build: Build) -> ShockCurve:
    """Return the curve of one build.

    Raises:
        EightpostError: The FMU cannot be loaded or run alone.
    """
    time = STEP * np.arange(round(VELOCITIES.size * HELD / STEP) + 1)
    places = np.minimum((time / HELD + 1e-9).astype(np.int64), VELOCITIES.size - 1)
    shock = FmuComponent(build.fmu, "shock")
    inputs = [one for one in shock.variables.values() if one.causality == "input"]
    channels = {
        one.name: (one.unit.name if one.unit else "1", np.full(time.size, float(one.start or 0.0))) for one in inputs
    }
    channels["velocity"] = ("m/s", VELOCITIES[places])
    drive = Drivefile(TimeSeries.from_channels(time, channels))
    system = System({"shock": shock}, parameters={"shock": build.parameters})
    scenario = Scenario(float(time[-1]), drive, {name: f"shock.{name}" for name in channels}, record=("shock.force",))
    series = run(system, scenario, step=STEP, compared=False).series
    ends = HELD * (1.0 + np.arange(VELOCITIES.size)) - STEP
    return ShockCurve(VELOCITIES, np.interp(ends, series.time, series["shock.force"]))


def copy_shock_pages(study: Study, folder: Path) -> Mapping[str, str]:
    """Copy the page that each FMU of a bank carries; return the pages' paths relative to the folder, by build."""
    pages = dict[str, str]()
    for name, build in study.bank.items():
        try:
            with zipfile.ZipFile(build.fmu) as archive:
                content = archive.read(_PAGE) if {_PAGE, _OWN} <= set(archive.namelist()) else b""
        except (OSError, zipfile.BadZipFile):
            continue
        if content:
            page = Path("shocks", f"{re.sub(r'[^A-Za-z0-9]+', '_', name)}_{len(pages) + 1}.html")
            with atomic_path(folder / page) as temporary:
                temporary.write_bytes(content)
            pages[name] = page.as_posix()
    return pages
