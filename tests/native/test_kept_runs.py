"""Runs and messages of native FMUs: no number changes unseen."""

import math
import re
from collections.abc import Callable
from ctypes import c_double, c_int, c_size_t
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from builder.build import build
from eightpost.archive import extract_archive
from eightpost.shock import LAWS, write_shock
from tests.builder.shock_over_settings import shock_of

from .host import ERROR, MODEL_EXCHANGE, OK, Host, packed, saved

MODELS = (*LAWS, "quarter_car", "seven_dof", "assembly")
OVER_SETTINGS = ("lpnl2", "hysteresis_lagged")

#: Sizes of changes of variables by unit; a parameter that is not zero changes by its third.
SIZES = {"m/s": 1.3, "m": 0.01, "N": 400.0, "N.m": 300.0, "K": 20.0, "N/m2": 3e5, "rad": 0.01}
#: Machine code of other processors and compilers differs in the last digits only, because no function is a library's.
RELATIVE = 1e-7

#: Parameters of a curve that depend on others.
_BOUND = r"curve\.(knot_\w+|\w+_speed|transition_width)"


class Runs:
    """Runs of one model, with random numbers that only depend on their place."""

    def __init__(self, fmu: Host, seed: int) -> None:
        self.fmu, self.draw = fmu, np.random.default_rng(seed)
        self.reals = [v for v in fmu.description.modelVariables if v.type in ("Real", "Float64") and v.name != "time"]
        self.parameters = [v for v in self.reals if v.causality == "parameter"]
        self.seen = [v.name for v in self.reals if v.causality in ("output", "local")]
        self.inputs = {v.name: SIZES.get(v.unit, 0.1) for v in self.reals if v.causality == "input"}
        self.starts = {v.name: float(v.start) for v in self.reals if v.causality == "input"}

    def changed(self, variable: Any) -> float:
        start = float(variable.start)
        change = start / 3.0 if start else 0.5 * SIZES.get(variable.unit, 0.1)
        return float(start + change * self.draw.uniform(0.0, 1.0))

    def parametrized(self) -> list[str]:
        """Change every parameter; return what the FMU does not accept."""
        values = {v.name: self.changed(v) for v in self.parameters if not re.search(_BOUND, v.name)}
        return [name for name, value in values.items() if self.fmu.set_named({name: value}) != OK]

    def drawn(self) -> dict[str, float]:
        values = {name: self.starts[name] + size * self.draw.uniform(-1.0, 1.0) for name, size in self.inputs.items()}
        return {name: round(value) if name.startswith("clicks") else value for name, value in values.items()}

    def initialized(self, time: float) -> dict[str, object]:
        """Initialize with changed parameters and inputs; return what is seen there, and its sensitivities."""
        fmu = self.fmu
        rejected = self.parametrized()
        assert fmu.set_named(self.drawn()) == OK
        assert fmu.call("SetupExperiment", 0, c_double(0.0), c_double(time), 0, c_double(0.0)) == OK
        assert fmu.call("EnterInitializationMode") == OK
        knowns = [*[v.name for v in self.parameters if not re.search(_BOUND, v.name)][:40], *self.inputs]
        tangents = self.tangents(knowns, fmu.outputs())
        start = np.array(fmu.get(*self.seen))
        assert fmu.call("ExitInitializationMode") == OK, fmu.messages_text()
        return {"rejected": rejected, "at the start": start, "tangents at the start": tangents}

    def steps(self, time: float, count: int = 60) -> tuple[np.ndarray, np.ndarray]:
        """Make random steps with held and with moving inputs; return what is seen after each, and sensitivities."""
        rows, tangents = [], []
        for k in range(count):
            step = float(10.0 ** self.draw.uniform(-5.0, -2.0))
            assert self.fmu.set_named(self.drawn()) == OK
            if k % 2:
                slopes = {name: 20.0 * size * self.draw.uniform(-1.0, 1.0) for name, size in self.inputs.items()}
                assert self.fmu.set_slopes(slopes) == OK
            if k % 9 == 8:
                tunable = [v for v in self.parameters if v.variability == "tunable" and not re.search(_BOUND, v.name)]
                self.fmu.set_named({v.name: self.changed(v) for v in self.draw.choice(np.array(tunable), 3)})
            assert self.fmu.step(time, step) == OK, self.fmu.messages_text()
            time += step
            rows.append(self.fmu.get(*self.seen))
            tangents.append(self.tangents([*self.inputs], self.fmu.outputs()))
        return np.array(rows), np.array(tangents)

    def tangents(self, knowns: list[str], unknowns: list[str]) -> np.ndarray:
        status, found = self.fmu.tangent(unknowns, knowns, self.draw.uniform(-1.0, 1.0, len(knowns)))
        assert status == OK, self.fmu.messages_text()
        return found


def _columns(names: list[str], rows: np.ndarray) -> dict[str, np.ndarray]:
    """Return the rows of each column; of a car with shocks, those of the left side."""
    return {name: rows for name, rows in zip(names, np.asarray(rows).T, strict=True) if "car.r" not in name}


def _co_simulation(fmu: Host, seed: int) -> dict[str, object]:
    runs = Runs(fmu, seed)
    result = runs.initialized(1.5)
    rows, tangents = runs.steps(1.5)
    size = len(packed(fmu, saved(fmu)))
    return result | _columns(runs.seen, rows) | {"tangents": tangents, "size of a state": size}


def _model_exchange(fmu: Host, seed: int) -> dict[str, object]:
    runs = Runs(fmu, seed)
    assert fmu.set_named(runs.drawn()) == OK
    flags = [v.name for v in fmu.description.modelVariables if v.type == "Boolean"]
    for flag in flags:
        assert fmu.call("SetBoolean", fmu.of([flag]), c_size_t(1), (c_int * 1)(0)) == OK
    result: dict[str, object] = {"flags": flags, "rejected": runs.parametrized()}
    result["at the start"] = np.array(fmu.exchange(1.5).get(*runs.seen))
    names, rows, tangents = fmu.state_names, [], []
    nominals = fmu.nominals()
    for _ in range(20):
        assert fmu.set_named(runs.drawn()) == OK
        assert fmu.set_states((nominals * runs.draw.uniform(-1.0, 1.0, len(nominals))).tolist()) == OK
        rows.append([*fmu.derivatives(), *fmu.get(*runs.seen)])
        tangents.append(runs.tangents([*runs.inputs, *names], [*fmu.outputs(), *fmu.derivative_names]))
    labels = [*(f"rate of {name}" for name in names), *runs.seen]
    return result | {"nominals": nominals, "tangents": np.array(tangents)} | _columns(labels, np.array(rows))


@pytest.mark.parametrize("name", MODELS)
def test_a_run_gives_the_same_numbers(name: str, host: Callable[..., Host], unchanged: Callable[..., None]) -> None:
    result = {"steps": _co_simulation(host(name), 1), "exchange": _model_exchange(host(name, kind=MODEL_EXCHANGE), 2)}
    unchanged(result, relative=RELATIVE)


@pytest.fixture(scope="module")
def over_settings(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Unpacked FMUs of shocks over their settings, of which the first has the temperature as a parameter."""
    folder, found = tmp_path_factory.mktemp("settings"), {}
    for name in OVER_SETTINGS:
        write_shock(shock_of(name), folder / f"{name}.json")
        (item,) = build([folder / f"{name}.json"], folder / name, temperature_input=name != OVER_SETTINGS[0])
        found[name] = folder / f"unpacked {name}"
        extract_archive(item.path, found[name])
    return found


@pytest.mark.parametrize("name", OVER_SETTINGS)
def test_a_run_over_settings_gives_the_same_numbers(
    name: str, over_settings: dict[str, Path], unchanged: Callable[..., None]
) -> None:
    fmu = Host(over_settings[name])
    result = _co_simulation(fmu, 3)
    fmu.free()
    unchanged(result, relative=RELATIVE)


NUMBERS = (
    *(0.0, -0.0, 1.0, -1.0, 0.5, 7.0, 10.0, 99.0, 123.0, 1000.0, 99999.0, 123456.0, 999999.0, 999999.4, 999999.6, 1e6),
    *(1234567.0, 1e7, 1e15, 123456789012345680.0, 1e16, 1e21, 1e100, 1.7976931348623157e308, 9.999995, 9.9999949, 0.1),
    *(0.01, 1e-3, 1e-4, 1.5e-4, 9.9999999e-5, 1e-5, 1.25e-7, 1e-9, 1e-10, 5e-324, 2.2e-308, 1 / 3, 2 / 3, 1e-300),
    *(math.nan, math.inf, -math.inf, 3.141592653589793, 271828.18284, 100.5, 12345.678, 0.001234567, 4096.0),
)


def test_a_number_is_written_as_the_same_text(host: Callable[..., Host], unchanged: Callable[..., None]) -> None:
    fmu = host("lpnl2").start()
    for number in NUMBERS:
        assert fmu.step(number, -1.0) == ERROR
    unchanged([text.rpartition("from ")[2].removesuffix(" s") for *_, text in fmu.messages])


@pytest.mark.parametrize("seed", range(3))
def test_a_number_is_written_with_six_digits(seed: int, host: Callable[..., Host]) -> None:
    fmu, draw = host("lpnl2").start(), np.random.default_rng(seed)
    for number in (draw.choice([-1.0, 1.0], 200) * 10.0 ** draw.uniform(-300.0, 300.0, 200)).tolist():
        assert fmu.step(number, -1.0) == ERROR
        written = float(fmu.messages[-1][2].rpartition("from ")[2].removesuffix(" s"))
        assert written == pytest.approx(number, rel=5.1e-6)
