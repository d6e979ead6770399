"""Fixtures that are shared by several test folders."""

from __future__ import annotations

import atexit
import gc
import importlib
import os
import pickle
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

import pytest
from filelock import FileLock
from hypothesis import settings
from matplotlib.layout_engine import ConstrainedLayoutEngine
from threadpoolctl import threadpool_limits

import builder.assembly.assembled_fmu
import builder.documents
from builder.build import build
from builder.toolchain import PLATFORMS, Platform, Zig, this_platform
from cosim import FmuComponent
from eightpost.shock import (
    LAWS,
    Hysteresis,
    Lpf1,
    Lpnl2,
    Polylinear,
    Port,
    Shock,
    ShockLaw,
    fit_parameters,
    write_shock,
)
from eightpost.vehicle import shipped

from .shock.example_curve import curve, knot_curve

pytest_plugins = ["tests.run_rules", "tests.unchanged", "tests.drawn"]

# Linear algebra in one thread, here and in what tests start: the threads of two workers wait for each other, and a
# decomposition of 150 states then lasts a second in place of 50 ms.
os.environ |= dict.fromkeys(("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
threadpool_limits(1, "blas")
# A developer's own choice of units does not change what tests read.
os.environ["EIGHTPOST_UNITS"] = "file"

# What the collection makes is kept until the end: the search for garbage in it took a fifth of the collection's time.
gc.disable()


def pytest_collection_finish() -> None:
    """Search for garbage from now on, but not among the tests and their modules."""
    gc.freeze()
    gc.enable()


# Python deletes all objects at its end, because a library reports those that are left. pytest's own search for garbage
# at the end of a run comes before that, and still leaves out the modules.
atexit.register(gc.unfreeze)


# A busy machine must not fail a property: no deadline per example. `make nightly` tries four times as many examples.
settings.register_profile("daily", deadline=None, max_examples=25)
settings.register_profile("nightly", deadline=None, max_examples=100)
settings.load_profile("daily")

_PLACE = ConstrainedLayoutEngine.execute


@pytest.fixture(scope="session")
def monolithic() -> ModuleType:
    """The module tests/monolithic.py, the coupled car as one system of equations."""
    return importlib.import_module("tests.monolithic")


@pytest.fixture(scope="session")
def chromium() -> ModuleType:
    """The module tests/chromium.py, which controls a browser."""
    return importlib.import_module("tests.chromium")


@pytest.fixture(scope="module")
def browser(chromium: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Iterator[object]:
    """Headless Chromium, shared by the tests of a module because its start takes longer than a page."""
    program = chromium.program()
    if program is None:
        pytest.skip(f"needs {' or '.join(chromium.NAMES)} on the PATH, and a system with inherited file descriptors")
    opened = chromium.Browser(program, tmp_path_factory.mktemp("profile"))
    yield opened
    opened.close()


def _hysteresis(port: Port) -> Hysteresis:
    knots = knot_curve()
    lagged = tuple(0.6 * slope for slope in knots.knot_slope)
    return Hysteresis(knots, lagged, (0.004, 0.001, 0.002), 1e5, 4e-4, 0.01, port=port)


@pytest.fixture(scope="session")
def knots() -> dict[str, float]:
    """A curve through knots as parameters of a shock FMU."""
    curve = knot_curve()
    fields = ("compression_speed", "rebound_speed", "compression_slope", "rebound_slope")
    arrays = ("knot_velocity", "knot_force", "knot_slope")
    values = {f"curve.{name}": getattr(curve, name) for name in fields}
    return values | {f"curve.{name}[{k + 1}]": one for name in arrays for k, one in enumerate(getattr(curve, name))}


@pytest.fixture(scope="session")
def shocks() -> dict[str, Shock]:
    """One shock of each law, by the law's name; laws that are not listed here have the initial parameters of a fit."""
    port = Port(gas_preload=50.0, gas_stiffness=700.0, seal_friction=15.0)
    laws: dict[str, ShockLaw] = {
        "polylinear": Polylinear(curve(), port=port),
        "lpf1": Lpf1(curve(), 0.0013),
        "lpnl2": Lpnl2(curve(), 0.0013, 800.0, 1600.0, port=port),
        "hysteresis": _hysteresis(port),
    }
    for name, law in LAWS.items():
        if name not in laws:
            laws[name] = law(curve(), port=port, **{p.name: p.start for p in fit_parameters(law)})
    return {name: Shock(name, law) for name, law in laws.items()}


@pytest.fixture(scope="session")
def model_files(tmp_path_factory: pytest.TempPathFactory, shocks: dict[str, Shock]) -> list[Path]:
    """Files of the shocks, the seven-DOF car and the quarter car, from which FMUs are built."""
    folder = tmp_path_factory.mktemp("models")
    sources = [shipped("seven_dof"), shipped("quarter_car")]
    for name, shock in shocks.items():
        sources.append(folder / f"{name}.json")
        write_shock(shock, sources[-1])
    return sources


def _built_once(factory: pytest.TempPathFactory, name: str, sources: list[Path], **options: str) -> dict[str, Path]:
    """Build FMUs in the first test process that asks for them, in a folder that all processes of a run share."""
    folder = factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent
    with FileLock(folder / f"{name}.lock"):
        if not (folder / name).is_dir():
            build(sources, folder / f"{name}.part", **options)
            (folder / f"{name}.part").rename(folder / name)
    return {path.stem: path for path in (folder / name).iterdir()}


@pytest.fixture(scope="session")
def fmus(tmp_path_factory: pytest.TempPathFactory, model_files: list[Path]) -> dict[str, Path]:
    """Native FMUs of all models, by name."""
    return _built_once(tmp_path_factory, "native", model_files)


@pytest.fixture(scope="session")
def quarter_car_system(fmus: dict[str, Path]) -> str:
    """System file of two seconds of the shipped track on a quarter car."""
    track = Path(__file__).parents[1] / "examples" / "data" / "track.parquet"
    return f"""
schema = 1
name = "quarter car"
components.corner = {{ fmu = "{fmus["quarter_car"].as_posix()}", inputs = {{ aero_force = 0.0 }} }}
components.shock = {{ fmu = "{fmus["lpf1"].as_posix()}" }}
bond = [{{ between = ["corner", "shock"] }}]

[scenario]
drivefile = "{track.as_posix()}"
stop = "2 s"
settling = "0.5 s"
targets = {{ "lf.road" = "corner.road" }}
"""


@pytest.fixture(scope="session")
def fmus3(tmp_path_factory: pytest.TempPathFactory, model_files: list[Path]) -> dict[str, Path]:
    """Native FMUs of FMI 3.0 of all models, by name."""
    return _built_once(tmp_path_factory, "native3", model_files, fmi="3")


@pytest.fixture(scope="session")
def python_fmus(tmp_path_factory: pytest.TempPathFactory, model_files: list[Path]) -> dict[str, Path]:
    """Python FMUs of all models, by name."""
    return _built_once(tmp_path_factory, "python", model_files, target="python")


@contextmanager
def _platforms(*names: Platform) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Zig, "platforms", names)
        yield


@pytest.fixture(scope="session", autouse=True)
def _one_platform() -> Iterator[None]:
    """Native FMUs are built for this platform alone, to the same bytes: a sixth of the work."""
    here = (this_platform(),) if this_platform().name in PLATFORMS else Zig.platforms
    with _platforms(*here):
        yield


@pytest.fixture(scope="session", autouse=True)
def _pictures_drawn_once() -> Iterator[None]:
    """The picture of a model is drawn once per process: it takes four fifths of a build whose code is compiled."""
    with pytest.MonkeyPatch.context() as patch:
        for module, name in (
            (builder.documents, "shock_picture"),
            (builder.documents, "vehicle_picture"),
            (builder.assembly.assembled_fmu, "curves_picture"),
        ):
            patch.setattr(module, name, _once(getattr(module, name)))
        yield


@pytest.fixture(scope="session", autouse=True)
def _panels_at_rest() -> Iterator[None]:
    """Panels of pictures stay where they are: placing them takes as long as drawing them; see `placed_panels`."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ConstrainedLayoutEngine, "execute", lambda *_: None)
        yield


@pytest.fixture
def placed_panels(monkeypatch: pytest.MonkeyPatch) -> None:
    """Panels of pictures are placed as they are for users, for tests that look at the pictures."""
    monkeypatch.setattr(ConstrainedLayoutEngine, "execute", _PLACE)


def _once(draw: Callable[..., bytes]) -> Callable[..., bytes]:
    pictures: dict[bytes, bytes] = {}

    def drawn(*arguments: object) -> bytes:
        key = pickle.dumps(arguments)
        if key not in pictures:
            pictures[key] = draw(*arguments)
        return pictures[key]

    return drawn


class UniversalFmus:
    """Native FMUs with binaries for all platforms, by name; one is built when it is first asked for."""

    def __init__(self, factory: pytest.TempPathFactory, sources: list[Path]) -> None:
        self._factory, self._sources = factory, {path.stem: path for path in sources}

    def __getitem__(self, name: str) -> Path:
        with _platforms(*PLATFORMS.values()):
            return _built_once(self._factory, f"universal_{name}", [self._sources[name]])[name]


@pytest.fixture(scope="session")
def universal_fmus(tmp_path_factory: pytest.TempPathFactory, model_files: list[Path]) -> UniversalFmus:
    """Native FMUs with binaries for all platforms, by name."""
    return UniversalFmus(tmp_path_factory, model_files)


@pytest.fixture(scope="module")
def all_platforms() -> Iterator[None]:
    """Native FMUs are built for all platforms, for tests that look at the other binaries."""
    with _platforms(*PLATFORMS.values()):
        yield


Load = Callable[..., FmuComponent]


@contextmanager
def _loading(fmus: dict[str, Path]) -> Iterator[Load]:
    loaded: list[FmuComponent] = []

    def load(name: str, **parameters: float) -> FmuComponent:
        loaded.append(FmuComponent(fmus[name], f"{name}{len(loaded)}"))
        loaded[-1].begin(0.0, 1e6, parameters)
        return loaded[-1]

    yield load
    for fmu in loaded:
        fmu.finish()


@pytest.fixture
def component(fmus: dict[str, Path]) -> Iterator[Load]:
    """Load native FMUs by name, and terminate them at the end of the test."""
    with _loading(fmus) as load:
        yield load


@pytest.fixture
def python_component(python_fmus: dict[str, Path]) -> Iterator[Load]:
    """Load Python FMUs by name, and terminate them at the end of the test."""
    with _loading(python_fmus) as load:
        yield load
