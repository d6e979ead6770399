"""Documents of all models, and of a shock as a fit writes it."""

import numpy as np
import pytest

from builder.product import Product, shock_product, vehicle_product
from eightpost.shock import Lpnl2, Shock, StaticCurve
from eightpost.vehicle import read_vehicle, shipped

from .members import CARS, members_of


@pytest.fixture(scope="session")
def products(shocks) -> dict[str, Product]:
    cars = {name: vehicle_product(read_vehicle(shipped(name)), name) for name in CARS}
    return {name: shock_product(shock, name) for name, shock in shocks.items()} | cars


@pytest.fixture(scope="session")
def archives(products) -> dict[str, dict[str, bytes]]:
    return {name: members_of(product) for name, product in products.items()}


FITTED = {
    "conditions": {
        "build": "build 7",
        "clicks": "14 from closed",
        "gas_pressure [Pa]": 1034213.59,
        "temperature_range [K]": [299.9833, 302.0944],
        "velocity_range [m/s]": [-0.827, 0.7851],
        "source": "run_7_raw.csv",
    },
    "fit": {
        "rms [N]": 11.255,
        "percent": 1.35,
        "held_out": {"left_out": "quarters", "percent": 1.6, "lpnl2_percent": 2.4},
        "status": "converged from dyno_7.csv",
        "parameters": {
            "time_constant": {"value": 0.00148, "unit": "s", "standard_error": 4e-5, "bounds": [1e-4, 1e-2]},
            "gas_stiffness": {"value": 615.5, "unit": "N/m", "standard_error": 39.0, "bounds": [0.0, None]},
        },
        "changes": ["the outer cubics join the inner polynomial"],
        "warnings": ["few samples at 30 in/s"],
    },
    "inputs": ({"name": "dyno_7.csv", "sha256": "84a0a12e0ced6a1f"},),
}


@pytest.fixture(scope="session")
def fitted() -> Product:
    """Return a shock as `eightpost fit` writes it: coefficients with all digits, conditions, a fit, source files."""
    rng = np.random.default_rng(7)
    curve = StaticCurve(
        inner=(2605.7363180956877, *rng.uniform(-300.0, 300.0, 14).tolist()),
        compression=tuple(rng.uniform(100.0, 900.0, 4).tolist()),
        rebound=tuple(rng.uniform(-900.0, -100.0, 4).tolist()),
        transition_speed=0.3812345678,
        transition_width=0.0127123456,
        compression_speed=0.7850956316405265,
        rebound_speed=0.8269828490984555,
        compression_slope=2057.320521989052,
        rebound_slope=2635.797629716069,
    )
    shock = Shock("dyno_7", Lpnl2(curve, 0.00148, 123.8, 1881.9), **FITTED)
    return shock_product(shock, "front_shock")
