"""Recorded outputs that follow an input without delay have its value at the end of the step, not an assumed one."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from cosim import (
    Adaptive,
    Algorithm,
    Capabilities,
    FmuComponent,
    GaussSeidel,
    Implicit,
    IsolatedComponent,
    Jacobi,
    Scenario,
    System,
    run,
)
from cosim.components.component import Callbacks, address_of
from cosim.components.fmu_file import FmuFile
from cosim.engine import blocks
from cosim.systems.system import Connection
from eightpost.corners import CORNERS
from eightpost.errors import StepError
from eightpost.fmi import read_description
from eightpost.signals import Drivefile, TimeSeries

Join = Callable[..., System]

STEP, STOP = 0.25, 1.5
TIME = STEP * np.arange(7)
#: A bent drive, so that no extrapolation of it is exact [m].
DRIVE = np.sin(3.0 * TIME) ** 2


@pytest.fixture
def sums(make: Any) -> Callable[..., Any]:
    """Return a function that builds a component with the output y, a weighted sum of its inputs."""

    class Sum(make.component):
        def functions(self) -> Any:
            return Callbacks(self).table()

        def refused(self, what: str, *_: Any) -> StepError:
            return StepError(f"refused to {what}")

        def derive(self, outputs: Sequence[str], inputs: Sequence[str], changes: Sequence[float]) -> list[float]:
            assert set(outputs) <= {"y"}
            return [self.outputs(0.0, dict.fromkeys(self.inputs, 0.0) | dict(zip(inputs, changes, strict=True)))["y"]]

    def build(weights: Mapping[str, float], *, ramps: bool = False, derivatives: bool = True, unit: str = "mm") -> Any:
        inputs = [make.variable(name, "input", unit) for name in weights]
        outputs = [make.variable("y", "output", unit, weights), make.variable("late", "output", unit)]
        return Sum(
            make.table(*inputs, *outputs),
            lambda state, u: {"y": sum(weights[name] * u[name] for name in weights), "late": state},
            lambda _state, _start, end, _step: sum(end.values()),
            capabilities=Capabilities(interpolates_inputs=ramps, derivatives=derivatives),
        )

    return build


def driven(target: str, *recorded: str) -> Scenario:
    drive = Drivefile(TimeSeries.from_channels(TIME, {"x": ("m", DRIVE)}))
    return Scenario(STOP, drive, {"x": target}, record=recorded)


def test_units_may_have_another_zero_than_the_drive(sums: Any) -> None:
    drive = Drivefile(TimeSeries.from_channels(TIME, {"x": ("K", 300.0 + DRIVE)}))
    system = System({"a": sums({"u": 1.0}, unit="degC")})
    series = run(system, Scenario(STOP, drive, {"x": "a.u"}, record=("a.y",)), step=STEP, compared=False).series
    assert series["a.y"] == pytest.approx(300.0 + DRIVE, abs=1e-9)


@pytest.mark.parametrize("derivatives", [True, False])
def test_without_directional_derivatives_it_counts_with_its_mean_over_the_step(sums: Any, derivatives: bool) -> None:
    system = System({"a": sums({"u": 1.0}, derivatives=derivatives)})
    result = run(system, driven("a.u", "a.y", "a.late"), step=STEP, compared=False)
    means = np.concatenate([[0.0], 0.5 * (DRIVE[1:] + DRIVE[:-1])])
    expected = DRIVE if derivatives else means
    assert result.series["a.y"] == pytest.approx(expected, abs=1e-12)
    assert result.series["a.late"] == pytest.approx(means, abs=1e-12)  # has no delay-free input, and is left as it is
    assert result.held_direct == (() if derivatives else ("a.y",))


@pytest.mark.parametrize("name", ["u", "y"])
def test_discrete_variables_have_no_derivatives_and_are_left_as_they_are(sums: Any, name: str) -> None:
    part = sums({"u": 1.0})
    part.variables = part.variables | {name: replace(part.variables[name], variability="discrete")}
    result = run(System({"a": part}), driven("a.u", "a.y"), step=STEP, compared=False)
    assert result.series["a.y"][1:] == pytest.approx(0.5 * (DRIVE[1:] + DRIVE[:-1]), abs=1e-12)
    assert result.held_direct == ("a.y",)


@pytest.mark.parametrize("engine", ["python", "compiled"])
@pytest.mark.parametrize("values", ["held", "interpolated", "extrapolated", "parabolic"])
@pytest.mark.parametrize("ramps", [True, False], ids=["ramps", "holds"])
@pytest.mark.parametrize("scheme", [Jacobi, GaussSeidel])
def test_an_assumed_input_counts_with_the_value_that_its_sources_have_reached(
    sums: Any, scheme: Any, ramps: bool, values: str, engine: str
) -> None:
    """The input is a sum of two connections, one with a gain and an offset, of the drive and of a constant."""
    parts = {"b": sums({"u": 1.0, "w": 3.0}, ramps=ramps), "d": sums({"u": 1.0}, ramps=ramps)}
    parts |= {name: sums({"u": 1.0}, ramps=True) for name in "ac"}
    connections = (Connection("a.y", "b.u", gain=-4.0, offset=0.5), Connection("c.late", "b.u"))
    system = System(
        parts,
        connections=(*connections, Connection("a.y", "c.u"), Connection("a.y", "d.u")),
        constants={"b.u": 7.0, "b.w": 1.0},
        sums=frozenset({"b.u"}),
    )
    scheme = Jacobi(values) if scheme is Jacobi else GaussSeidel(tuple(parts), values=values)
    drive = Drivefile(TimeSeries.from_channels(TIME, {"x": ("m", DRIVE), "z": ("m", 10.0 * DRIVE)}))
    scenario = Scenario(STOP, drive, {"x": "a.u", "z": "b.u"}, record=("a.y", "b.y", "c.y", "c.late", "d.y"))
    series = run(system, scenario, algorithm=scheme, step=STEP, compared=False, engine=engine).series
    reached = -4.0 * series["a.y"] + series["c.late"] + 10.0 * DRIVE + 0.0005 + 0.007
    assert series["b.y"] == pytest.approx(reached + 0.003, abs=1e-9)
    for name in ("c.y", "d.y"):
        assert series[name] == pytest.approx(series["a.y"], abs=1e-9)


def test_an_input_that_is_known_at_the_end_of_the_step_needs_no_derivatives(sums: Any) -> None:
    system = System(
        {"a": sums({"u": 1.0}, ramps=True), "b": sums({"u": 1.0}, ramps=True)}, connections=(Connection("a.y", "b.u"),)
    )
    for part in system.components.values():
        part.derive = None  # a call would fail
    series = run(system, driven("a.u", "a.y", "b.y"), algorithm=GaussSeidel(), step=STEP, compared=False).series
    assert series["b.y"] == pytest.approx(DRIVE, abs=1e-12)


# ---- FMUs -----------------------------------------------------------------------------------------------------------


class Changed(FmuComponent):
    """An FMU that declares something else than it does."""

    can: Mapping[str, bool] = {}
    follows_all = False

    @property
    def capabilities(self) -> Capabilities:
        return replace(super().capabilities, **self.can)

    @property
    def variables(self) -> Any:
        found = super().variables
        inputs = frozenset(name for name, v in found.items() if v.causality == "input")
        everything = {n: replace(v, direct=inputs) if v.causality == "output" else v for n, v in found.items()}
        return everything if self.follows_all else found


def changed(fmus: Mapping[str, Path], *, follows_all: bool = False, **can: bool) -> FmuComponent:
    car = Changed(fmus["seven_dof"], "car")
    car.can, car.follows_all = can, follows_all
    return car


class Lacking(FmuComponent):
    """An FMU whose library lacks the function that it declares."""

    def functions(self) -> Any:
        return replace(super().functions(), derive=0)


def with_car(system: System, car: Any) -> System:
    return replace(system, components={**system.components, "car": car})


NAMES = tuple(f"car.{c}.{what}" for c in CORNERS for what in ("velocity", "tire_force", "hub_acceleration"))


def on_track(system: System, track: Drivefile, algorithm: Algorithm | None = None) -> TimeSeries:
    scenario = Scenario(0.1, track, record=NAMES, drive_start=2.0)
    return run(system, scenario, algorithm=algorithm or GaussSeidel(), step=0.001, compared=False).series


def test_an_fmu_whose_library_lacks_the_function_is_not_corrected(
    seven_dof: Join, track: Drivefile, fmus: Mapping[str, Path]
) -> None:
    found = on_track(with_car(seven_dof(), Lacking(fmus["seven_dof"], "car")), track)
    plain = on_track(with_car(seven_dof(), changed(fmus, derivatives=False)), track)
    assert found.values.tobytes() == plain.values.tobytes()


def test_only_outputs_that_follow_the_forces_directly_change(
    seven_dof: Join, track: Drivefile, fmus: Mapping[str, Path]
) -> None:
    corrected = on_track(seven_dof(), track)
    plain = on_track(with_car(seven_dof(), changed(fmus, derivatives=False)), track)
    for name in NAMES:
        is_equal = corrected[name].tobytes() == plain[name].tobytes()
        assert is_equal == ("hub" not in name), name


@pytest.mark.parametrize("algorithm", [GaussSeidel(), Implicit(), Adaptive(relative=0.1)], ids=lambda a: a.name)
def test_the_tire_force_of_a_car_that_holds_its_roads_is_that_of_road_and_wheel_at_the_same_time(
    seven_dof: Join, track: Drivefile, monolithic: Any, fmus: Mapping[str, Path], algorithm: Algorithm
) -> None:
    car = changed(fmus, interpolates_inputs=False)
    names = ("car.rf.tire_force", "car.rf.wheel_position")
    scenario = Scenario(0.05, track, record=names, record_step=0.001, drive_start=2.0)
    series = run(with_car(seven_dof(), car), scenario, algorithm=algorithm, step=0.001, compared=False).series
    force, wheel = (series[name] for name in names)
    road = np.interp(2.0 + series.time, track.series.time, track.series["rf.road"])
    static = float(car.variables["rf.static_tire_force"].start)
    assert force == pytest.approx(static + monolithic.Car().tire_stiffness[1] * (road - wheel), abs=1e-6)


def test_an_fmu_that_declares_no_dependencies_is_corrected_in_the_same_way(
    seven_dof: Join, track: Drivefile, fmus: Mapping[str, Path]
) -> None:
    """Every output is then assumed to follow every input; the derivatives of those that do not are zero."""
    expected = on_track(seven_dof(), track, GaussSeidel(("car", *CORNERS)))
    undeclared = with_car(seven_dof(), changed(fmus, follows_all=True))
    found = on_track(undeclared, track, GaussSeidel(("car", *CORNERS)))
    np.testing.assert_allclose(found.values, expected.values, rtol=0.0, atol=1e-9 * np.abs(expected.values).max())


@pytest.mark.slow
def test_an_isolated_fmu_gives_the_same_bits(seven_dof: Join, track: Drivefile, fmus: Mapping[str, Path]) -> None:
    isolated = IsolatedComponent(fmus["seven_dof"], "car")
    try:
        found = on_track(with_car(seven_dof(), isolated), track)
    finally:
        isolated.close()
    assert found.values.tobytes() == on_track(seven_dof(), track).values.tobytes()


@pytest.mark.slow
def test_a_car_of_fmi_3_gives_the_same_bits(seven_dof: Join, track: Drivefile, fmus3: Mapping[str, Path]) -> None:
    found = on_track(seven_dof(car=fmus3["seven_dof"]), track)
    assert found.values.tobytes() == on_track(seven_dof(), track).values.tobytes()


@pytest.mark.parametrize("engine", ["python", "compiled"])
def test_refused_derivatives_are_an_error_that_names_the_component(
    seven_dof: Join, track: Drivefile, fmus: Mapping[str, Path], engine: str
) -> None:
    refusing = blocks.DERIVE(lambda *_: 3)

    class Refusing(FmuComponent):
        def functions(self) -> Any:
            return replace(super().functions(), derive=address_of(refusing))

    system = with_car(seven_dof(), Refusing(fmus["seven_dof"], "car"))
    with pytest.raises(StepError, match=r"'car'.*failed to give directional derivatives"):
        run(system, Scenario(0.1, track), step=0.001, compared=False, engine=engine)


@pytest.mark.parametrize(("flag", "kind", "given"), [("true", "Float64", True), ("true", "Float32", False),
                                                     ("false", "Float64", False)])  # fmt: skip
def test_fmi_3_derivatives_are_used_if_they_are_given_and_of_doubles(flag: str, kind: str, given: bool) -> None:
    root = ET.fromstring(
        f'<fmiModelDescription fmiVersion="3.0"><CoSimulation providesDirectionalDerivatives="{flag}"/><ModelVariables>'
        f'<{kind} name="u" valueReference="1" causality="input"/><Float32 name="z" valueReference="2"/>'
        "</ModelVariables></fmiModelDescription>"
    )
    assert FmuFile(Path("x.fmu"), Path(), read_description(root)).capabilities.derivatives == given
