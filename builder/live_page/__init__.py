"""Page on which a shock and a quarter car run live: the C code of their FMUs as WebAssembly."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import NamedTuple

from builder.assembly import Assembly, Part, read_parts
from builder.assembly.assembled_fmu import assembly_sources
from builder.assembly.plan import VEHICLE, assembly_interface
from builder.build import product_of
from builder.interface import Interface, Variable
from builder.native_fmu import version_files, without_binaries
from builder.reference import SECRET
from builder.toolchain import Library, compile_for_browser
from eightpost import units
from eightpost.archive import read_archive, write_archive
from eightpost.errors import FmuError
from eightpost.extras import needs
from eightpost.files import parse_json
from eightpost.outputs import PAGE, check_file
from eightpost.validity import Validity
from eightpost.verdict import Verdict
from eightpost.wiring import Wire, Wiring

with needs("build", "writing a live page"):
    from eightpost.report import page as html

# ---- Controls: a slider for each quantity that its reader can change ------------------------------------------------

#: Range of the slider of a parameter that is not 0: this factor below and above its value, on a logarithmic scale.
_FACTOR = 5.0

#: Highest value of the slider of a parameter that is 0, by its unit: about a stock car's shock.
_FROM_ZERO = {"N": 500.0, "N/m": 20_000.0}


@dataclass(frozen=True)
class Control:
    """A slider."""

    name: str  #: Name of the quantity, which is a variable of the shock's FMU if it is a parameter of it.
    text: str  #: Description.
    unit: str  #: SI unit.
    us: tuple[str, float]  #: US customary unit, and the factor from SI.
    si: tuple[str, float]  #: Metric unit, and the factor from SI.
    low: float  #: Lowest value, SI.
    high: float  #: Highest value, SI.
    start: float  #: Value at the start, SI.
    is_logarithmic: bool  #: Whether equal distances on the slider are equal ratios.

    @classmethod
    def of(
        cls,
        name: str,
        text: str,
        unit: str,
        limits: tuple[float, float],
        start: float,
        *,
        shown: tuple[str, str] | None = None,
    ) -> Control:
        """Return a control.

        Args:
            name: Name of the quantity.
            text: Description.
            unit: SI unit.
            limits: Lowest and highest value, SI; the slider is logarithmic if the lowest is above 0.
            start: Value at the start, SI.
            shown: US customary and metric unit; by default, those of the project's display units.
        """
        us, si = shown or (units.us_customary(unit), units.metric(unit))
        return cls(name, text, unit, (us, _factor(unit, us)), (si, _factor(unit, si)), *limits, start, limits[0] > 0.0)


def _factor(unit: str, shown: str) -> float:
    return 1.0 if unit == shown else units.conversion(unit, shown)[0]


#: The motion of the dynamometer: a sine with a peak velocity.
DYNAMOMETER = (
    Control.of("peak velocity", "Peak velocity of the sine", "m/s", (0.01, 2.0), 0.25),
    Control.of("frequency", "Frequency of the sine", "Hz", (0.2, 30.0), 4.0),
)

#: The bump: a raised cosine that the quarter car drives over.
BUMP = (
    Control.of("height", "Height of the bump", "m", (0.0, 0.1), 0.025),
    Control.of("length", "Length of the bump", "m", (0.2, 10.0), 1.5, shown=("ft", "m")),
    Control.of("speed", "Speed of the car", "m/s", (3.0, 90.0), 30.0, shown=("mph", "km/h")),
)


def _shock_controls(interface: Interface) -> Iterator[Control]:
    """Yield a control for each parameter of a shock that may be changed at any time, except those of its curve."""
    for variable in interface.variables:
        is_tunable = variable.causality == "parameter" and variable.variability == "tunable"
        if is_tunable and variable.type == "Real" and not variable.name.startswith(SECRET):
            start = float(variable.start or 0.0)
            yield Control.of(variable.name, variable.description, variable.unit or "1", _limits(variable, start), start)


def _limits(variable: Variable, start: float) -> tuple[float, float]:
    """Return the range of a parameter's slider, within the range that the FMU accepts."""
    if start > 0.0:
        low, high = start / _FACTOR, start * _FACTOR
    else:
        high = _FROM_ZERO.get(variable.unit or "1", 1.0)
        low = start if start == 0.0 else -high
    least = low if variable.minimum is None else variable.minimum
    most = high if variable.maximum is None else variable.maximum
    return max(low, least), min(high, most)


# ---- The shock and the quarter car: their interfaces, and their C code as WebAssembly modules -----------------------

#: Names of the two components of the assembled car.
SHOCK, CAR = "shock", "car"

#: Variables of a quarter car that the page uses; a vehicle with four ports has them with a corner's name only.
_NEEDED = ("force", "road", "velocity", "displacement", "tire_force", "wheel_position", "chassis_position")


class Model(NamedTuple):
    """An FMU for a page."""

    interface: Interface  #: Variables of the FMU.
    module: bytes  #: WebAssembly module of the FMU's C code.


def _read_models(shock: Path, vehicle: Path) -> tuple[Model, Model, Part]:
    """Return the shock alone, the quarter car with the shock coupled inside, and the shock as a part of it."""
    with tempfile.TemporaryDirectory() as folder:
        fmus = {CAR: _fmu(vehicle, Path(folder) / "car.fmu"), SHOCK: _fmu(shock, Path(folder) / "shock.fmu")}
        wires = tuple(
            Wire(f"{source}.{name}", f"{target}.{name}")
            for source, target, name in ((CAR, SHOCK, "velocity"), (CAR, SHOCK, "displacement"), (SHOCK, CAR, "force"))
        )
        wiring = Wiring(f"{vehicle.stem} with {shock.stem}", fmus, wires, step=1e-3, stop=1.0)
        _refuse_others(wiring, shock, vehicle)
        assembly = Assembly.of(wiring, "car_with_shock")
        members = read_archive(fmus[SHOCK])
    part, interface = assembly.shocks[0], assembly_interface(assembly)
    code = {name.removeprefix("sources/"): text for name, text in members.items() if name.startswith("sources/")}
    coupled = assembly_sources(assembly, interface, "page") | version_files(assembly.identifier, 2)
    alone = Model(part.interface, compile_for_browser(Library("shock", code, is_one_unit=True)))
    return alone, Model(interface, compile_for_browser(Library(assembly.identifier, coupled))), part


def _fmu(source: Path, path: Path) -> Path:
    """Return the FMU of a file: itself, or one without binaries that is written to `path`."""
    if source.suffix == ".fmu":
        return source
    write_archive(path, without_binaries(product_of(source)).members)
    return path


def _refuse_others(wiring: Wiring, shock: Path, vehicle: Path) -> None:
    car, other = read_parts(wiring.fmus)
    if other.kind == VEHICLE:
        raise FmuError(f"{shock} is a vehicle; give a shock file (eightpost fit) or the FMU of a shock")
    names = {variable.name for variable in car.interface.variables}
    if missing := [name for name in _NEEDED if name not in names]:
        raise FmuError(
            f"{vehicle} is not a quarter car with one port, a road, a tire and positions: it has no "
            f"{', '.join(missing)}; choose one such as examples/corner.toml (--car)"
        )


# ---- The page -------------------------------------------------------------------------------------------------------


#: Scripts in the order of their dependencies.
_SCRIPTS = ("fmu", "controls", "dynamometer", "hand", "bump", "drawing", "page")

_PLACES = (("dynamometer", "Dynamometer"), ("bump", "Quarter car over a bump"), ("about", "About this page"))


class LivePage(NamedTuple):
    """A page that was written."""

    path: Path  #: HTML file.
    controls: tuple[Control, ...]  #: Parameters of the shock that the page can change.
    verdict: Verdict  #: Verdict that the shock's FMU carries.


def write_live_page(shock: str | Path, path: str | Path, *, vehicle: str | Path) -> LivePage:
    """Write a page in one file, which needs no network: the FMUs' C code runs in it as WebAssembly.

    The numbers on the page are those of the native FMUs: the same C code without fused operations.

    Args:
        shock: Shock file (.json), or native FMU of a shock.
        path: HTML file to write; an existing file is replaced only when the page is complete.
        vehicle: File of a quarter car (.toml, .json), or its native FMU.

    Raises:
        FmuError: A file cannot be used, or the compiler zig is not installed, or it fails.
        InputError: A file cannot be read.
    """
    check_file(Path(path), PAGE)
    alone, coupled, part = _read_models(Path(shock), Path(vehicle))
    verdict = Validity.from_json(parse_json(part.validity, shock)).verdict if part.validity else Verdict()
    controls = tuple(_shock_controls(alone.interface))
    groups = {"shock": ("Shock", controls), "dynamometer": ("Motion", DYNAMOMETER), "bump": ("Road", BUMP)}
    shown = {unit: Control.of(unit, unit, unit, (0.0, 1.0), 0.0) for unit in ("m/s", "m", "N", "J", "s")}
    content = {
        SHOCK: {variable.name: variable.reference for variable in alone.interface.variables},
        CAR: {variable.name: variable.reference for variable in coupled.interface.variables},
        "prefix": f"{SHOCK}.",
        "controls": {name: [asdict(control) for control in group] for name, (_, group) in groups.items()},
        "units": {unit: {"us": control.us, "si": control.si} for unit, control in shown.items()},
    }
    modules = {"shock-module": html.compressed(alone.module), "car-module": html.compressed(coupled.module)}
    text = html.page(
        "builder.live_page",
        [f"script/{name}.js" for name in _SCRIPTS],
        title=Path(shock).stem,
        verdict=verdict,
        places=_PLACES,
        subtitle=part.text,
        vehicle=Path(vehicle).name,
        fold=0,
        words={control.name: control.text for control in controls},
        groups=[(name, heading, group) for name, (heading, group) in groups.items()],
        data={"models": content, **modules},
    )
    return LivePage(html.write_page(path, text), controls, verdict)
