"""Fixed bank of vehicles, and FMUs of them and of every law, so that few builds give many systems.

Other differences between systems (curves, lags, ports, friction) are parameters of the FMUs.
"""

from __future__ import annotations

import hashlib
import os
import shutil
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from unittest.mock import patch

import numpy as np

from benchmarks.case import ROOT
from benchmarks.honesty.shocks import LAWS, log_uniform
from builder.build import build
from builder.native.toolchain import PLATFORMS, Zig, this_platform
from eightpost.cache import cache_folder
from eightpost.shock import LAWS as CLASSES
from eightpost.shock import Port, Shock, StaticCurve, fit_parameters, write_shock
from eightpost.vehicle import Corners, IdentifiedVehicle, QuarterCar, SevenDof, StructuralVehicle, write_vehicle

QUARTER_CARS, SEVEN_DOFS = 32, 8
#: Unsprung masses [kg].
LIGHTEST, HEAVIEST = 8.0, 60.0
#: Sources of the FMUs; the FMUs are built again if any of them has changed.
_MADE_FROM = ("fmus", "builder", "eightpost/shock", "eightpost/vehicle", "benchmarks/honesty/cars.py")

#: Number of source versions for which FMUs are kept.
_KEPT = 8


def vehicle_names() -> tuple[str, ...]:
    """Return the names of all vehicles of the bank."""
    return tuple([f"quarter_{k:02d}" for k in range(QUARTER_CARS)] + [f"seven_{k:02d}" for k in range(SEVEN_DOFS)])


@cache
def vehicle(name: str) -> StructuralVehicle:
    """Return a vehicle of the bank, without dampers; for `name` see `vehicle_names`."""
    kind, _, number = name.partition("_")
    make = _quarter_car if kind == "quarter" else _seven_dof
    return StructuralVehicle(name, make(int(number)))


def _quarter_car(k: int) -> QuarterCar:
    random = np.random.default_rng((k, 4))
    share = (k + random.random()) / QUARTER_CARS  # masses cover their range evenly
    return QuarterCar(
        sprung_mass=log_uniform(random, 80.0, 600.0),
        unsprung_mass=LIGHTEST * (HEAVIEST / LIGHTEST) ** share,
        suspension_stiffness=log_uniform(random, 1.5e4, 3e5),
        tire_stiffness=log_uniform(random, 1e5, 4.5e5),
    )


def _seven_dof(k: int) -> SevenDof:
    random = np.random.default_rng((k, 7))
    front, rear = (log_uniform(random, LIGHTEST, HEAVIEST) for _ in range(2))
    mass, track, a, b = (random.uniform(*ends) for ends in ((450, 1300), (1.3, 1.8), (1.1, 1.7), (1.1, 1.7)))
    return SevenDof(
        track_width=track,
        cg_to_front_axle=a,
        cg_to_rear_axle=b,
        sprung_mass=mass,
        roll_inertia=mass * (track * random.uniform(0.3, 0.45)) ** 2,
        pitch_inertia=mass * ((a + b) * random.uniform(0.35, 0.5)) ** 2,
        unsprung_mass=Corners.axles(front, rear),
        spring_rate=Corners.axles(log_uniform(random, 3e4, 3e5), log_uniform(random, 3e4, 3e5)),
        tire_stiffness=Corners.axles(log_uniform(random, 1.5e5, 4e5), log_uniform(random, 1.5e5, 4e5)),
        front_anti_roll_rate=float(random.choice([0.0, 2e4])),
        driver_ahead_of_cg=0.1,
        driver_left_of_centreline=0.3,
    )


def build_fmus(names: Iterable[str]) -> Path:
    """Return a folder with an FMU of each name, `<name>.fmu`; missing ones are built.

    Args:
        names: Names of vehicles and laws; with the suffix `_python` for python FMUs.
    """
    folder = cache_folder() / "honesty" / _digest()
    folder.mkdir(parents=True, exist_ok=True)
    os.utime(folder)
    _forget_the_oldest(folder.parent)
    missing = [name for name in sorted(set(names)) if not (folder / f"{name}.fmu").is_file()]
    with patch.object(Zig, "platforms", (this_platform(),) if this_platform().name in PLATFORMS else ()):
        for target, chosen in (
            ("native", [name for name in missing if not name.endswith("_python")]),
            ("python", [name for name in missing if name.endswith("_python")]),
        ):
            if chosen:
                build([_model_file(folder / "models", name) for name in chosen], folder, target=target)
    return folder


def _forget_the_oldest(folder: Path) -> None:
    """Remove the FMUs of old source versions."""
    for path in sorted(folder.iterdir(), key=lambda path: path.stat().st_mtime)[:-_KEPT]:
        shutil.rmtree(path, ignore_errors=True)


def _digest() -> str:
    """Return a digest that identifies the sources of a build."""
    key = hashlib.sha256()
    for place in _MADE_FROM:
        path = ROOT / place
        for file in sorted(path.rglob("*")) if path.is_dir() else [path]:
            if file.is_file() and "__pycache__" not in file.parts:
                key.update(str(file.relative_to(ROOT)).encode() + file.read_bytes())
    return key.hexdigest()[:16]


def _model_file(folder: Path, name: str) -> Path:
    """Write the file that an FMU is built from."""
    folder.mkdir(parents=True, exist_ok=True)
    path, model = folder / f"{name}.json", name.removesuffix("_python")
    if model in LAWS:
        law = CLASSES[model]
        own = {p.name: p.start for p in fit_parameters(law)}
        write_shock(Shock(name, law(_straight(), port=Port(), **own)), path)
    else:
        write_vehicle(path, IdentifiedVehicle(name, vehicle(model).coupled(), static={}))
    return path


def _straight() -> StaticCurve:
    """Return a curve to build with; every system sets its own."""
    ends = (400.0, 400.0, 0.0, 0.0), (-400.0, -400.0, 0.0, 0.0)
    return StaticCurve((400.0, *[0.0] * 14), *ends, 0.4, 0.01, 2.0, 2.0, 1000.0, 1000.0)
