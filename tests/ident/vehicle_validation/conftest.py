"""Fits of cars that are known exactly, and records of the virtual rig, which has its own integrator."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from eightpost.ident.validation.comparison import RigRecord, rig_record
from eightpost.ident.vehicle.frequency_response import FrequencyResponse, response_of
from eightpost.ident.vehicle.vehicle_fit import VehicleFit
from eightpost.rig import RigConditions, RigTest
from eightpost.units import convert
from eightpost.vehicle import Friction as PortFriction
from eightpost.vehicle import IdentifiedVehicle, StateSpace, add_port_damping, read_vehicle, shipped
from eightpost.virtual import (
    NO_DRIFT,
    Friction,
    LinearDamper,
    RigSensors,
    Shock,
    bump_drive,
    quarter_truth,
    random_drive,
    run_test,
    seven_dof_truth,
    sine_drive,
)

BASELINE = convert(17.5, "lbf/(in/s)", "N.s/m")
SOFT, HARD = 0.5 * BASELINE, 1.6 * BASELINE
COULOMB = convert(15.0, "lbf", "N")
INCH = 0.0254

QUARTER = ("velocity", "displacement", "tire_force", "ride_height", "hub_acceleration")
FREQUENCY = np.arange(0.1, 20.01, 0.1)
#: Ranges that random tests of the quarter car cover.
RANGES = {"frequency": (0.1, 20.0), "velocity": (-1.5, 1.5), "tire_force": (-15e3, 15e3), "force": (-5e3, 5e3)}

Recorder = Callable[..., RigTest]


def truth_fit(name: str, *, friction: float = 0.0, ranges: dict[str, tuple[float, float]] | None = None) -> VehicleFit:
    """Return the exact car of the dissertation around the baseline damper, as a fit."""
    whole = read_vehicle(shipped(name)).coupled()  # type: ignore[arg-type]
    ports = [n.removesuffix("force").rstrip(".") for n in whole.input_names if n in ("force",) or n.endswith(".force")]
    damping = dict.fromkeys(ports, BASELINE)
    outputs = [n for n in whole.output_names if n.rpartition(".")[2] in QUARTER]
    model = add_port_damping(whole, damping).select(outputs=outputs)
    rub = {port: PortFriction(friction, 0.005) for port in ports} if friction else {}
    return fit_of(IdentifiedVehicle(name, model, damping, friction=rub), ranges=ranges)


def fit_of(vehicle: IdentifiedVehicle, *, ranges: dict[str, tuple[float, float]] | None = None) -> VehicleFit:
    """Return a fit whose estimate is the model's own response with 1 % of noise, and the variance of that noise."""
    exact = response_of(vehicle.state_space, FREQUENCY)
    generator = np.random.default_rng(3)
    deviation = 0.01 * np.sqrt(np.mean(np.abs(exact.H) ** 2, axis=2, keepdims=True))
    noise = np.sqrt(0.5) * (generator.standard_normal(exact.H.shape) + 1j * generator.standard_normal(exact.H.shape))
    variance = np.broadcast_to(deviation**2, exact.H.shape)
    coherence = np.full((len(exact.outputs), FREQUENCY.size), 0.995)
    estimate = FrequencyResponse(
        FREQUENCY, exact.H + deviation * noise, exact.inputs, exact.outputs, coherence, None, variance
    )
    return VehicleFit(vehicle, "exact", estimate, {"velocity": 0.01}, ranges=RANGES if ranges is None else ranges)


def softer(fit: VehicleFit, factor: float = 0.6) -> VehicleFit:
    """Return the same car with its time scaled by `factor`, so that it responds too slowly."""
    model = fit.vehicle.state_space
    slow = StateSpace(
        factor * model.A, factor * model.B, model.C, model.D, model.inputs, model.outputs, None, model.name
    )
    return fit_of(replace(fit.vehicle, state_space=slow))


def quarter_test(
    damping: float | Shock = BASELINE, *, kind: str = "random", seed: int = 1, friction: float = 0.0, **drive: float
) -> RigTest:
    """Return a record of the quarter-car rig with 1 % of noise."""
    one = np.ones((1, 1))
    rub = Friction(friction * one, 1.1 * friction * one, convert(4000.0, "lbf/in", "N/m") * max(friction, 1e-9) * one)
    car = replace(quarter_truth(), friction=rub)
    drives = {
        "random": lambda: random_drive(car, 7, duration=30.0),
        "sine": lambda: sine_drive(car, drive["frequency"], drive["amplitude"], duration=12.0),
        "bump": lambda: bump_drive(car, duration=16.0, period=4.0),
    }
    shock = LinearDamper(damping) if isinstance(damping, float) else damping
    return run_test(
        car,
        drives[kind](),
        (shock,),
        seed=seed,
        sensors=RigSensors.perfect(relative=0.01),
        drift=NO_DRIFT,
        conditions=RigConditions(drivefile=kind, shocks=("soft" if damping == SOFT else "other",)),
    )


def seven_test(shocks: Sequence[Shock]) -> RigTest:
    """Return a record of the seven-DOF car on the virtual rig, without noise."""
    car = seven_dof_truth()
    drive = random_drive(car, 5, duration=8.0)
    return run_test(car, drive, tuple(shocks), seed=1, sensors=RigSensors.perfect(), drift=NO_DRIFT)


def records_of(fit: VehicleFit, *tests: RigTest) -> list[RigRecord]:
    """Return the prepared tests, named by their number."""
    return [rig_record(test, fit.vehicle.state_space, name=f"r{k}") for k, test in enumerate(tests, start=1)]


@pytest.fixture(scope="session")
def corner() -> VehicleFit:
    """Fit of the exact quarter car."""
    return truth_fit("quarter_car")


@pytest.fixture(scope="session")
def setups() -> list[RigTest]:
    """Records of four dampers with one drive."""
    return [quarter_test(damping, seed=k) for k, damping in enumerate((SOFT, BASELINE, 1.2 * BASELINE, HARD))]


@pytest.fixture(scope="session")
def others() -> list[RigTest]:
    """Records of two sines of Table 6.2 and of a bump."""
    sines = [quarter_test(kind="sine", frequency=f, amplitude=a * INCH) for f, a in ((6.0, 0.3), (10.0, 0.1))]
    return [*sines, quarter_test(kind="bump")]


@pytest.fixture(scope="session")
def rig_files(setups: list[RigTest], others: list[RigTest], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with all these records as files."""
    folder = tmp_path_factory.mktemp("rig")
    for name, test in zip(("soft", "base", "firm", "hard", "sine6", "sine10", "bump"), [*setups, *others], strict=True):
        test.write(folder / f"{name}.parquet")
    return folder
