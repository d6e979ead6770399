"""The functions of an FMU for a page, compiled for this machine, give what an instance gives."""

import ctypes
import math
from collections.abc import Callable
from ctypes import c_char_p, c_double
from pathlib import Path

import pytest

from .host import OK, Host

FUNCTIONS = {"open": 0, "set": 2, "set_flag": 2, "get": 1, "start": 0, "slope": 2, "step": 2}
COMMON = Path(__file__).resolve().parents[2] / "fmus" / "common"


@pytest.fixture(scope="module")
def page(
    source_folders: dict[str, Path], compiler: Callable[..., Path], tmp_path_factory: pytest.TempPathFactory
) -> Callable[..., float | str]:
    """Function that calls one of the functions of a page of the quarter car."""
    folder, target = source_folders["quarter_car"], tmp_path_factory.mktemp("page") / "page.so"
    sources = [str(path) for path in (*folder.glob("*.c"), COMMON / "browser.c")]
    library = ctypes.CDLL(str(compiler(folder, ["-fPIC", "-shared", *sources], target)))
    for name, count in FUNCTIONS.items():
        function = getattr(library, f"page_{name}")
        function.argtypes, function.restype = [c_double] * count, c_double
    library.page_message.restype = c_char_p

    def call(name: str, *numbers: float) -> float | str:
        found = getattr(library, f"page_{name}")(*numbers)
        return found.decode() if isinstance(found, bytes) else found

    return call


def test_a_page_steps_an_fmu_as_a_host_does(page: Callable[..., float | str], host: Callable[..., Host]) -> None:
    fmu = host("quarter_car")
    flag = fmu.references["start_at_equilibrium"]
    assert fmu.set(friction_force=40.0, force=200.0) == OK
    assert fmu.call("SetBoolean", (ctypes.c_uint * 1)(flag), ctypes.c_size_t(1), (ctypes.c_int * 1)(0)) == OK
    fmu.start()
    for _ in range(2):  # the second time it is reset
        assert page("open") == 1.0
        assert page("set", fmu.references["friction_force"], 40.0) == page("set", fmu.references["force"], 200.0) == 1.0
        assert page("set_flag", flag, 1.0) == page("set_flag", flag, 0.0) == page("start") == 1.0
        assert page("get", fmu.references["tire_force"]) == host("quarter_car").start().get("tire_force")[0] == 0.0
        for k in range(20):
            assert page("set", fmu.references["road"], 0.001 * k) == page("slope", fmu.references["road"], 1.0) == 1.0
            assert page("step", 1e-3 * k, 1e-3) == 1.0
    for k in range(20):
        assert (fmu.set(road=0.001 * k), fmu.set_slopes({"road": 1.0}), fmu.step(1e-3 * k)) == (OK, OK, OK)
    for name in (*fmu.outputs(), "force"):
        assert page("get", fmu.references[name]) == fmu.get(name)[0]


def test_a_page_is_told_what_the_fmu_refuses(page: Callable[..., float | str]) -> None:
    assert page("open") == 1.0
    assert page("message") == ""
    assert page("step", 0.0, 1e-3) == 0.0
    assert page("message") == "fmi2DoStep: is not allowed before initialization mode"
    assert page("set", 4321.0, 1.0) == page("set_flag", 4321.0, 1.0) == page("slope", 4321.0, 1.0) == 0.0
    assert math.isnan(page("get", 4321.0))
    assert page("start") == 1.0 and page("start") == 0.0
    assert "is not allowed between steps" in page("message")
    assert page("open") == 1.0 and page("message") == "" and page("start") == 1.0
