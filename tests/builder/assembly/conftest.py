"""A car with four dampers and a quarter car with one, assembled for this platform."""

import pytest

from builder.assembly import assemble
from cosim.system_file import read_case

from .hosts import CORNERS, corner_file, host

#: Different laws on one car, gas springs, and a damper that is positive in extension at rr.
SYSTEM = """
schema = 1
name = "a car with four dampers"
sums = ["car.lr.force"]

[components.car]
fmu = "{folder}/seven_dof.fmu"
inputs = {{ heave_force = "-100 lbf", roll_moment = 20.0, "lr.force" = 25.0 }}
parameters = {{ "lf.static_tire_force" = 3000.0, "rr.friction_force" = 30.0 }}

[components.lf]
fmu = "{folder}/lpnl2.fmu"
parameters = {{ gas_stiffness = "10 lbf/in", compression_scale = 1.2 }}

[components.rf]
fmu = "{folder}/lpf1.fmu"

[components.lr]
fmu = "{folder}/hysteresis.fmu"
parameters = {{ seal_friction = 20.0 }}

[components.rr]
fmu = "{folder}/lpnl2.fmu"

[[bond]]
between = ["car.lf", "lf"]

[[bond]]
between = ["car.rf", "rf"]
displacement = false

[[connection]]
from = "car.rf.displacement"
to = "rf.displacement"
gain = 0.5

[[bond]]
between = ["car.lr", "lr"]

[[bond]]
between = ["car.rr", "rr"]
gain = -1.0

[scenario]
stop = 1.0
"""


@pytest.fixture(scope="session")
def system_file(fmus, tmp_path_factory):
    path = tmp_path_factory.mktemp("system") / "system.toml"
    path.write_text(SYSTEM.format(folder=fmus["lpnl2"].parent.as_posix()))
    return path


@pytest.fixture(scope="session")
def made(tmp_path_factory):
    """Assemble a case: made(case, name) -> path."""
    folder = tmp_path_factory.mktemp("assembled")

    def make(case, name):
        return assemble(case.wiring, folder / f"{name}.fmu").path

    return make


@pytest.fixture(scope="session")
def case(system_file):
    return read_case(system_file)


@pytest.fixture(scope="session")
def car(made, case):
    return made(case, "car_with_shocks")


@pytest.fixture(scope="session")
def measured(car, case):
    """Return names of outputs of the car and the exact response at 125 Hz: (names, exact)."""
    names = [f"car.{corner}.{name}" for name in ("velocity", "tire_force") for corner in CORNERS]
    return names, host(car, 0.008, parameters={"coupling_step": 1e-5}, outputs=names)


@pytest.fixture(scope="session")
def corner(fmus, tmp_path_factory, made):
    """A quarter car, whose gas spring affects every start."""
    path = tmp_path_factory.mktemp("corner") / "corner.toml"
    return made(read_case(corner_file(path, fmus["quarter_car"], fmus["lpnl2"])), "corner_with_damper")
