"""Fixtures: the C sources of every FMU, compilers and instances."""

from __future__ import annotations

import ctypes
import importlib.util
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from types import ModuleType

import pytest

from builder.assembly import Assembly, read_parts
from builder.assembly.assembled import _unbuilt as assembled_source
from builder.assembly.plan import assembly_interface
from builder.assembly.sources import assembly_sources
from builder.fmu.product import shock_product, vehicle_product
from builder.native.native_fmu import c_sources, compiled
from builder.native.toolchain import find_toolchain
from eightpost.archive import extract_archive, write_archive
from eightpost.shock import Shock
from eightpost.vehicle import read_vehicle, shipped
from eightpost.wiring import Wire

STRICT = ("-std=c99", "-ffp-contract=off", "-Wall", "-Wextra", "-Wpedantic", "-Wshadow", "-Wconversion", "-Werror")


@pytest.fixture(scope="session")
def source_folders(
    tmp_path_factory: pytest.TempPathFactory, shocks: dict[str, Shock], assembly: Assembly
) -> dict[str, Path]:
    """Return the folder with an FMU's sources by model."""
    products = [shock_product(shock, name) for name, shock in shocks.items()]
    products += [vehicle_product(read_vehicle(shipped(name)), name) for name in ("seven_dof", "quarter_car")]
    folders = {}
    for product in products:
        folder = folders[product.identifier] = tmp_path_factory.mktemp(product.identifier)
        for name, content in c_sources(product, product.interface, "0").items():
            (folder / name).write_bytes(content)
    folder = folders["assembly"] = tmp_path_factory.mktemp("assembly")
    for name, content in assembly_sources(assembly, assembly_interface(assembly), "0").items():
        (folder / name).write_bytes(content)
    return folders


@pytest.fixture(scope="session")
def assembly(fmus: dict[str, Path]) -> Assembly:
    """The seven-DOF car with a shock of each law."""
    laws = {"lf": "lpnl2", "rf": "lpf1", "lr": "polylinear", "rr": "maxwell"}
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
    """Return the folder of fmpy's FMI headers."""
    spec = importlib.util.find_spec("fmpy")
    assert spec is not None and spec.origin is not None
    return Path(spec.origin).with_name("c-code")


@pytest.fixture(scope="session")
def compiler(headers: Path) -> Callable[..., Path]:
    """Run the system's C compiler on files, in a folder: compile(folder, options, output)."""
    command = next((path for name in ("gcc", "clang", "cc") if (path := shutil.which(name))), None)
    if command is None:
        pytest.skip("no C compiler (gcc, clang or cc) on this machine")

    def run(folder: Path, options: Sequence[str], output: Path) -> Path:
        line = [command, *STRICT, f"-I{headers}", f"-I{folder}", *options, "-o", str(output), "-lm"]
        ran = subprocess.run(line, capture_output=True, text=True, check=False)
        assert ran.returncode == 0, ran.stderr[:2000]
        return output

    return run


@pytest.fixture(scope="session")
def elementary(compiler: Callable[..., Path], tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    """Return the elementary functions of the C core as a shared library."""
    source = Path(__file__).resolve().parents[2] / "fmus" / "common" / "elementary.c"
    path = tmp_path_factory.mktemp("elementary") / "elementary.so"
    library = ctypes.CDLL(str(compiler(source.parent, ["-O1", "-fPIC", "-shared", str(source)], path)))
    for name in ("exponential", "exponential_minus_1", "hyperbolic_tangent"):
        getattr(library, name).argtypes, getattr(library, name).restype = [ctypes.c_double], ctypes.c_double
    pointer = ctypes.POINTER(ctypes.c_double)
    library.sine_and_cosine.argtypes, library.sine_and_cosine.restype = [ctypes.c_double, pointer, pointer], None
    return library


@pytest.fixture(scope="session")
def c_level() -> ModuleType:
    """Return the module tests/native/host.py."""
    name = "eightpost_tests_host"
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, Path(__file__).with_name("host.py"))
        assert spec is not None and spec.loader is not None
        module = sys.modules[name] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
    return sys.modules[name]


@pytest.fixture(scope="session")
def folders(fmus: dict[str, Path], assembled: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Return unpacked native FMUs by name."""
    found = {}
    for name, path in (fmus | {"assembly": assembled}).items():
        found[name] = tmp_path_factory.mktemp(name)
        extract_archive(path, found[name])
    return found


@pytest.fixture(scope="session")
def assembled(
    assembly: Assembly,
    one_platform: Callable[[], AbstractContextManager[None]],
    tmp_path_factory: pytest.TempPathFactory,
) -> Path:
    """The FMU of the assembly."""
    path = tmp_path_factory.mktemp("assembled") / "assembly.fmu"
    unbuilt = assembled_source(assembly, assembly_interface(assembly))
    with one_platform():
        (members,) = compiled([unbuilt], toolchain=find_toolchain())
    write_archive(path, members)
    return path


@pytest.fixture
def host(folders: dict[str, Path], c_level: ModuleType) -> Iterator[Callable[..., object]]:
    """Make instances of FMUs by name; they are freed with the test."""
    made = []

    def make(model: str, **options: object) -> object:
        made.append(c_level.Host(folders[model], **options))
        return made[-1]

    yield make
    for item in made:
        item.free()
