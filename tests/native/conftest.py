"""Fixtures: the C sources of every FMU, compilers and instances."""

import ctypes
import shutil
import subprocess
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import ModuleType

import pytest

from builder.assembly import Assembly, read_parts
from builder.assembly.assembled_fmu import assembly_sources, without_binaries
from builder.assembly.plan import assembly_interface
from builder.native_fmu import _c_sources, compiled, version_files
from builder.product import shock_product, vehicle_product
from builder.toolchain import find_toolchain, fmi_headers
from eightpost.archive import extract_archive, write_archive
from eightpost.shock import Shock
from eightpost.vehicle import CORNERS, Bristle, Friction, IdentifiedVehicle, read_vehicle, shipped
from eightpost.wiring import Wire
from tests.double_modes import car_with_seat

from . import host as host_module
from . import host3 as host3_module

STRICT = ("-std=c99", "-ffp-contract=off", "-Wall", "-Wextra", "-Wpedantic", "-Wshadow", "-Wconversion", "-Werror")
#: Plain function names in programs, too.
PLAIN = ("-DFMI2_OVERRIDE_FUNCTION_PREFIX", "-DFMI3_OVERRIDE_FUNCTION_PREFIX")


@pytest.fixture(scope="session")
def source_folders(
    tmp_path_factory: pytest.TempPathFactory, shocks: dict[str, Shock], assembly: Assembly
) -> dict[str, Path]:
    """Return the folder with an FMU's sources by model."""
    return _source_folders(tmp_path_factory, shocks, assembly, 2)


@pytest.fixture(scope="session")
def source_folders_3(
    tmp_path_factory: pytest.TempPathFactory, shocks: dict[str, Shock], assembly: Assembly
) -> dict[str, Path]:
    """Return the folder with the sources of an FMU of FMI 3.0 by model."""
    return _source_folders(tmp_path_factory, shocks, assembly, 3)


def car_with_friction() -> IdentifiedVehicle:
    """Return the seven-DOF car with friction of all kinds and springs at its ports."""
    friction = Friction(30.0, 0.01, Bristle(120.0, 1e-4, 1.2, 0.01), spring=2e5)
    model = read_vehicle(shipped("seven_dof")).coupled()
    return IdentifiedVehicle("car", model, friction=dict.fromkeys(CORNERS, friction))


def _source_folders(
    factory: pytest.TempPathFactory, shocks: dict[str, Shock], assembly: Assembly, fmi: int
) -> dict[str, Path]:
    products = [shock_product(shock, name) for name, shock in shocks.items()]
    products += [vehicle_product(read_vehicle(shipped(name)), name) for name in ("seven_dof", "quarter_car")]
    products.append(vehicle_product(car_with_seat(), "car_with_seat"))
    products.append(vehicle_product(car_with_friction(), "car_with_friction"))
    found = {product.identifier: _c_sources(product, product.interface, "0") for product in products}
    found["assembly"] = assembly_sources(assembly, assembly_interface(assembly), "0")
    folders = {}
    for model, files in found.items():
        folders[model] = factory.mktemp(model)
        for name, content in (files | version_files(model, fmi)).items():
            (folders[model] / name).write_bytes(content)
    return folders


@pytest.fixture(scope="session")
def assembly(fmus: dict[str, Path]) -> Assembly:
    """The seven-DOF car with shocks of different laws."""
    laws = {"lf": "lpnl2", "rf": "hysteresis", "lr": "polylinear", "rr": "lpf1"}
    links = [
        Wire(*ends)
        for corner in laws
        for ends in (
            (f"car.{corner}.velocity", f"{corner}.velocity"),
            (f"{corner}.force", f"car.{corner}.force"),
            (f"car.{corner}.displacement", f"{corner}.displacement"),
        )
    ]
    parts = read_parts({"car": fmus["seven_dof"]} | {corner: fmus[law] for corner, law in laws.items()})
    return Assembly("assembly", "An assembly", parts, tuple(links))


@pytest.fixture(scope="session")
def headers() -> Path:
    """Return the folder of the FMI headers."""
    return fmi_headers()


@pytest.fixture(scope="session")
def compiler(headers: Path) -> Callable[..., Path]:
    """Run the system's C compiler on files, in a folder: compile(folder, options, output)."""
    command = next((path for name in ("gcc", "clang", "cc") if (path := shutil.which(name))), None)
    if command is None:
        pytest.skip("no C compiler (gcc, clang or cc) on this machine")

    def run(folder: Path, options: Sequence[str], output: Path) -> Path:
        line = [command, *STRICT, *PLAIN, f"-I{headers}", f"-I{folder}", *options, "-o", str(output), "-lm", "-pthread"]
        ran = subprocess.run(line, capture_output=True, text=True, check=False)
        assert ran.returncode == 0, ran.stderr[:2000]
        return output

    return run


@pytest.fixture(scope="session")
def elementary(compiler: Callable[..., Path], tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    """Return the elementary functions of the C core as a shared library."""
    source = Path(__file__).resolve().parents[2] / "fmus" / "common" / "elementary.c"
    path = tmp_path_factory.mktemp("elementary") / "elementary.so"
    path.with_name("prefix.h").write_bytes(version_files("elementary", 2)["prefix.h"])
    options = [f"-I{path.parent}", "-O1", "-fPIC", "-shared", str(source)]
    library = ctypes.CDLL(str(compiler(source.parent, options, path)))
    for name in ("exponential", "exponential_minus_1", "hyperbolic_tangent", "logarithm"):
        getattr(library, name).argtypes, getattr(library, name).restype = [ctypes.c_double], ctypes.c_double
    pointer = ctypes.POINTER(ctypes.c_double)
    library.sine_and_cosine.argtypes, library.sine_and_cosine.restype = [ctypes.c_double, pointer, pointer], None
    return library


@pytest.fixture(scope="session")
def c_level() -> ModuleType:
    """Return the module tests/native/host.py."""
    return host_module


@pytest.fixture(scope="session")
def c_level_3() -> ModuleType:
    """Return the module tests/native/host3.py."""
    return host3_module


@pytest.fixture(scope="session")
def folders(fmus: dict[str, Path], assembly: Assembly, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Return unpacked native FMUs by name."""
    return _unpacked(fmus, assembly, tmp_path_factory, 2)


@pytest.fixture(scope="session")
def folders_3(fmus3: dict[str, Path], assembly: Assembly, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Return unpacked native FMUs of FMI 3.0 by name."""
    return _unpacked(fmus3, assembly, tmp_path_factory, 3)


def _unpacked(fmus: dict[str, Path], assembly: Assembly, factory: pytest.TempPathFactory, fmi: int) -> dict[str, Path]:
    path = factory.mktemp("assembled") / "assembly.fmu"
    source = without_binaries(assembly, assembly_interface(assembly), fmi)
    (members,) = compiled([source], toolchain=find_toolchain())
    write_archive(path, members)
    found = {}
    for name, file in (fmus | {"assembly": path}).items():
        found[name] = factory.mktemp(f"{name}_{fmi}")
        extract_archive(file, found[name])
    return found


@pytest.fixture
def host(folders: dict[str, Path]) -> Iterator[Callable[..., object]]:
    """Make instances of FMUs by name; they are freed with the test."""
    yield from _instances(folders, host_module.Host)


@pytest.fixture
def host_3(folders_3: dict[str, Path]) -> Iterator[Callable[..., object]]:
    """Make instances of FMUs of FMI 3.0 by name; they are freed with the test."""
    yield from _instances(folders_3, host3_module.Host3)


def _instances(folders: dict[str, Path], kind: type[host_module.Host]) -> Iterator[Callable[..., object]]:
    made = []

    def make(model: str, **options: object) -> object:
        made.append(kind(folders[model], **options))
        return made[-1]

    yield make
    for item in made:
        item.free()
