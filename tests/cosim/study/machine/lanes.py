"""Setups on the machine and through the FMUs, for comparison."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from cosim.session.setup import RunSetup
from cosim.study import Build, Drive, Measure, Study, Vehicle
from cosim.study.definition import Setup
from cosim.study.running.evaluator import Coupling, Evaluator
from cosim.study.running.machine import Plan, read_shock, read_vehicle
from cosim.systems.algorithm import default_scheme
from eightpost.corners import CORNERS
from eightpost.machine import Batch, BatchResult

TRACK = Path(__file__).resolve().parents[4] / "examples" / "data" / "track.parquet"

#: Channels of the vehicle and of the shocks that are compared.
CHANNELS = (
    *(f"car.{corner}.{what}" for corner in CORNERS for what in ("velocity", "tire_force")),
    "car.front.ride_height",
    *(f"{corner}.{what}" for corner in CORNERS for what in ("force", "static_force", "lagged_force")),
    *(f"lf.{what}" for what in ("lag_weight", "dissipated_power")),
)

COUPLING = Coupling("gauss-seidel", 1e-3)

#: Step at which the errors of machine and FMUs are far below what the tests compare [s].
FINE = 1.25e-4

#: Linear damping around which the ports are solved [N.s/m].
DAMPING = 4000.0

LAWS = ("polylinear", "lpf1", "lpnl2", "hysteresis")


def knots_of(component) -> dict[str, float]:
    """Return the curve of an FMU that has knots, as parameter values for another one."""
    names = [v.name for v in component.variables.values() if v.name.startswith("curve.") and "lagged" not in v.name]
    return {name: float(component.variables[name].start) for name in names}


def random_builds(fmus: Mapping[str, Path], laws: Sequence[str], count: int, seed: int) -> dict[str, Build]:
    """Return builds of some laws with random parameters of curve, lag and port."""
    rng = np.random.default_rng(seed)
    builds = {}
    for k in range(count):
        law = laws[k % len(laws)]
        own = {"compression_scale": rng.uniform(0.3, 2.5), "rebound_scale": rng.uniform(0.3, 2.5)}
        own |= {"gas_stiffness": rng.choice([0.0, 3000.0]), "gas_preload": rng.choice([0.0, 120.0])}
        own |= {"seal_friction": rng.choice([0.0, 40.0]), "friction_velocity": rng.choice([0.005, 0.0005])}
        own |= {"motion_ratio": rng.choice([1.0, 0.8, 1.3])}
        own |= {"time_constant": 10 ** rng.uniform(-4.0, -2.0)} if law in ("lpf1", "lpnl2") else {}
        if law == "lpnl2":
            own |= {"lag_full_force": 200.0, "lag_zero_force": 200.0 + rng.uniform(10.0, 1500.0)}
        own |= {"stop_yield": rng.choice([1e-5, 1e-4])} if law == "hysteresis" else {}
        builds[f"{law} {k}"] = Build(fmus[law], {name: float(value) for name, value in own.items()})
    return builds


def study_of(fmus: Mapping[str, Path], builds: Mapping[str, Build], vehicle: Vehicle | None = None, **options) -> Study:
    """Return a study of all builds at every corner on two seconds of track."""
    corners = CORNERS if vehicle is None or vehicle.fmu != fmus["quarter_car"] else ("corner",)
    return Study(
        **{
            "name": "batch",
            "vehicle": vehicle or Vehicle(fmus["seven_dof"]),
            "bank": builds,
            "corners": dict.fromkeys(corners, tuple(builds)),
            "drives": (Drive("track", TRACK, 2.0),),
            "measures": (Measure("tire", ("car.lf.tire_force",)),),
            "settling": 0.5,
        }
        | options
    )


def random_setups(study: Study, count: int, seed: int = 0) -> list[Setup]:
    """Return random setups of a study."""
    chosen = np.random.default_rng(seed).integers(0, study.space.full, count)
    return [study.space.setup(int(index)) for index in chosen]


def on_machine(
    study: Study, setups: Sequence[Setup], channels=CHANNELS, *, step=FINE, damping=DAMPING, car=None
) -> BatchResult:
    """Run up to eight setups on the machine and record some channels."""
    evaluator = Evaluator(study)
    drive, fmus = study.drives[0], evaluator.fmus
    scenario = evaluator.scenario(drive, extra=channels)
    run = RunSetup.of(evaluator.system(setups[0]), scenario, default_scheme(COUPLING.scheme), step)
    car = car or read_vehicle(fmus[str(study.vehicle.fmu)], study.vehicle.fmu, study.vehicle.parameters)
    plan = Plan(run, study.vehicle.name, car, np.full(len(study.corners), damping), (), channels)
    shocks = {n: read_shock(fmus[str(b.fmu)], b.fmu, b.parameters) for n, b in study.bank.items()}
    batch = Batch(plan.run)
    return batch.run([[shocks[build] for build in setup.builds.values()] for setup in setups])


def through_fmus(study: Study, setups: Sequence[Setup], channels=CHANNELS, *, step=FINE) -> np.ndarray:
    """Return the channels of setups that run through the FMUs (rows, channels, setups)."""
    evaluator, coupling = Evaluator(study), Coupling("gauss-seidel", step)
    runs = [evaluator.run(setup, study.drives[0], coupling, extra=channels).series for setup in setups]
    return np.stack([np.stack([run[name] for name in channels], axis=1) for run in runs], axis=2)


def largest_apart(found: np.ndarray, right: np.ndarray) -> float:
    """Return the largest rms difference of a channel (rows, channels, setups), in percent of its standard deviation."""
    spread = np.maximum(right.std(axis=0), 1e-6 * np.abs(right).max(axis=0) + 1e-9)
    return float(100.0 * (np.sqrt(np.mean((found - right) ** 2, axis=0)) / spread).max())


def apart_from_fmus(study: Study, setups: Sequence[Setup], channels=CHANNELS, *, step=FINE) -> float:
    """Return the largest difference of a channel between machine and FMUs, both at a step [%]."""
    found = on_machine(study, setups, channels, step=step)
    assert (found.ended == -1).all()
    return largest_apart(found.values, through_fmus(study, setups, channels, step=step))
