"""Runs of small systems without any FMU with every scheme, kept number by number."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import astuple, replace
from typing import Any

import numpy as np
import pytest

from cosim import (
    Adaptive,
    Automatic,
    Bond,
    Capabilities,
    Connection,
    GaussSeidel,
    Implicit,
    Jacobi,
    Result,
    Scenario,
    System,
    run,
)
from cosim.session.run import verify
from cosim.session.setup import among, coupling_times, joined, merged, step_sizes
from cosim.session.verdict import RULES, BondEnergy, Coupled, Model
from cosim.systems.algorithm import VALUES
from eightpost.errors import DivergedError, InputError, WiringError
from eightpost.signals import Drivefile, TimeSeries
from eightpost.validity import Range, Validity
from eightpost.verdict import Grade, Verdict

Unchanged = Callable[..., None]

SCHEMES: dict[str, Any] = {
    **{f"{scheme.__name__}_{values}": scheme(values=values) for scheme in (Jacobi, GaussSeidel) for values in VALUES},
    "implicit": Implicit(tolerance=1e-7),
    "implicit_few": Implicit(tolerance=1e-9, iterations=2),
    "adaptive": Adaptive(relative=1e-3, largest=0.02),
    "adaptive_jacobi": Adaptive(Jacobi("extrapolated"), relative=3e-3, least=1e-4),
    "adaptive_implicit": Adaptive(Implicit(), relative=1e-3),
    "automatic": Automatic(tolerance=0.5),
    "automatic_coarse": Automatic(tolerance=1e-6, least=1e-3),
}


#: Fields of a result that are kept elsewhere, or differ from run to run.
_LEFT_OUT = {"series", "models", "decisive", "identities", "sources", "order", "seconds", "stepping_seconds", "coupled"}


def kept(result: Result) -> dict[str, Any]:
    """Return what a run gives, without wall times, a line for each channel and each field, and its verdict."""
    fields = {name: getattr(result, name) for name in result.__dataclass_fields__ if name not in _LEFT_OUT}
    fields |= {"coupled": {name: astuple(one) for name, one in result.coupled.items()},
               "energy": {name: astuple(one) for name, one in result.energy.items()}}  # fmt: skip
    record: dict[str, Any] = {name: result.series[name] for name in result.series.names}
    record |= {name: _line(value) for name, value in fields.items() if value not in ({}, (), None, "")}
    return record | {"time": result.series.time, "verdict": "; ".join(map(str, result.verdict.reasons))}


def _line(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{name} {_line(one)}" for name, one in value.items())
    if isinstance(value, tuple):
        return " ".join(map(_line, value))
    return f"{value:.8g}" if isinstance(value, float) else str(value)


def law(x: float, v: float) -> float:
    return float(4000.0 * x + 60.0 * v + 20.0 * np.tanh(20.0 * v))


def car(parts: Any, make: Any, damping: float = 0.0) -> System:
    """A mass that a drive pushes, with two dampers: a hidden limit, a gain, a constant, an output without delay."""
    made = parts(law=None if damping else law, damping=damping)
    mass, shock = made["car"], made["shock"]
    mass.variables = {**mass.variables, "push": make.variable("push", "input", "N"),
                      "extra": make.variable("extra", "input", "N"),
                      "lf.static_tire_force": make.variable("lf.static_tire_force", "parameter", "N"),
                      "lf.tire_force": make.variable("lf.tire_force", "output", "N")}  # fmt: skip
    mass.outputs = lambda v, _: {"velocity": v, "lf.tire_force": 40.0 - 60.0 * v}
    mass.advance = lambda v, a, b, h: v + 0.05 * h * sum(
        end["push"] + end["extra"] - end["force"] for end in (a, b))  # fmt: skip
    shock.variables = {**shock.variables, "beyond_fit": make.variable("beyond_fit", "output"),
                       "beyond_settings": make.variable("beyond_settings", "output")}  # fmt: skip
    plain = shock.outputs
    shock.outputs = lambda x, u: plain(x, u) | {"beyond_fit": float(x > 0.004), "beyond_settings": 400.0 * x}
    gain = make.gain(-15.0, "m/s", "N", capabilities=Capabilities(interpolates_inputs=True, state=True))
    gain.save, gain.restore, gain.free = (lambda: None), (lambda _: None), (lambda _: None)
    return System(
        made | {"gain": type(shock)(gain.variables, gain.outputs, capabilities=gain.capabilities)},
        [Bond.between("car", "shock", displacement=False)],
        connections=[Connection("car.velocity", "gain.u", 2.0, 0.1), Connection("gain.y", "car.extra")],
        parameters={"car": {"lf.static_tire_force": 40.0}},
    )


def drive() -> Drivefile:
    time = np.array([0.0, 0.0105, 0.013, 0.02, 0.031, 0.0455, 0.06, 0.09])
    return Drivefile(TimeSeries.from_channels(time, {"push": ("N", 30.0 * np.sin(150.0 * time))}))


@pytest.mark.parametrize("name", SCHEMES)
def test_a_run_is_unchanged(name: str, parts: Any, make: Any, unchanged: Unchanged) -> None:
    scenario = Scenario(0.062, drive(), drive_start=0.002, settling=0.011)
    algorithm = SCHEMES[name]
    if isinstance(algorithm, Automatic):
        result = run(car(parts, make), replace(scenario, record_step=3.1e-3), algorithm=algorithm, engine="python")
    else:
        result = run(car(parts, make), scenario, algorithm=algorithm, step=0.004, engine="python")
    unchanged(kept(result))


@pytest.mark.parametrize(("damping", "options"), [
    (9000.0, {}), (9000.0, {"step": 2e-3}), (60.0, {"step": 2e-3}),
    (9000.0, {"step": 2e-3, "algorithm": Implicit(tolerance=1e-8)}),
], ids=["default", "at_a_step", "not_stiff", "implicit"])  # fmt: skip
def test_a_run_of_a_stiff_system_is_unchanged(
    damping: float, options: dict[str, Any], parts: Any, make: Any, unchanged: Unchanged
) -> None:
    unchanged(kept(run(car(parts, make, damping), Scenario(0.03, drive()), engine="python", **options)))


@pytest.mark.parametrize("name", ["Jacobi_held", "GaussSeidel_extrapolated", "GaussSeidel_parabolic"])
def test_a_run_with_a_component_that_holds_its_inputs_is_unchanged(
    name: str, parts: Any, make: Any, unchanged: Unchanged
) -> None:
    """The mass takes the mean of the drive; its points are between those of the coupling."""
    system = car(parts, make)
    system.components["car"].capabilities = Capabilities()
    result = run(system, Scenario(0.06, drive()), algorithm=SCHEMES[name], step=0.012, engine="python")
    unchanged(kept(result))


def test_a_verification_is_unchanged(parts: Any, make: Any, unchanged: Unchanged) -> None:
    system, scenario = car(parts, make), Scenario(0.06, drive(), settling=0.01)
    for name in ("GaussSeidel_parabolic", "adaptive", "automatic"):
        algorithm = SCHEMES[name]
        step = None if name == "automatic" else 0.004
        result = run(system, scenario, algorithm=algorithm, step=step, engine="python")
        found = verify(system, scenario, algorithm, result, engine="python")
        unchanged({"difference": found.difference, "finer": found.finer.step, "samples": len(found.finer.series)}, name)


# ---- Start, tolerances and divergence -------------------------------------------------------------------------------


@pytest.mark.parametrize(("factor", "sweeps"), [
    (-0.2, range(15, 25)), (-0.5, range(31, 60)), (0.0, range(2, 4)),
    (0.9, range(31, 60)), (-4.0, range(31, 60)), (1.0, range(31, 400)),
])  # fmt: skip
def test_a_loop_without_delay_starts_at_its_equilibrium(factor: float, sweeps: range, make: Any) -> None:
    """y = factor (y + 3) has the solution 3 factor / (1 - factor); without one, the start is no equilibrium."""
    parts = {"a": make.gain(factor), "b": make.gain(1.0)}
    joined_parts = (Connection("a.y", "b.u"), Connection("b.y", "a.u", 1.0, 3.0))
    scenario = Scenario(0.01)
    result = run(
        System(parts, connections=joined_parts), scenario, algorithm=Jacobi("held"), step=0.01, engine="python"
    )
    assert result.converged == (factor != 1.0) and result.equilibrium_sweeps in sweeps
    if factor != 1.0:
        assert result.series["a.y"][0] == pytest.approx(3.0 * factor / (1.0 - factor), rel=1e-9)
    else:
        assert any("the start is not an equilibrium" in note for note in result.notes)


def test_an_absolute_tolerance_of_a_signal_that_is_not_coupled_is_refused(parts: Any, make: Any) -> None:
    algorithm = Adaptive(absolute={"shock.travel": 1e-3})
    with pytest.raises(
        WiringError, match=r"shock.travel is not a coupled signal; those are car.velocity, gain.y, shock"
    ):
        run(car(parts, make), Scenario(0.05, drive()), algorithm=algorithm, step=0.004, engine="python")


@pytest.mark.parametrize(
    "absolute", [{"shock.force": 50.0}, {"car.velocity": 0.5}, {}], ids=["force", "velocity", "none"]
)
def test_an_adaptive_run_with_absolute_tolerances_is_unchanged(
    absolute: dict[str, float], parts: Any, make: Any, unchanged: Unchanged
) -> None:
    algorithm = Adaptive(absolute=absolute, relative=1e-6 if absolute else 1e-9, least=1e-4)
    result = run(car(parts, make), Scenario(0.02, drive()), algorithm=algorithm, step=0.004, engine="python",
                 compared=False)  # fmt: skip
    unchanged({
        "steps": result.steps, "rejected": result.rejected_steps, "largest": result.largest_step, "least": result.step,
        "partial": result.partial, "velocity": result.series["car.velocity"],
    })  # fmt: skip


@pytest.mark.parametrize(("scheme", "advice"), [
    (Jacobi(), "smaller coupling step, gauss-seidel, or implicit"),
    (GaussSeidel(), "smaller coupling step, or implicit"),
])  # fmt: skip
def test_a_coupling_that_diverges_ends_with_advice(scheme: Any, advice: str, parts: Any, make: Any) -> None:
    with pytest.raises(DivergedError, match=rf"the coupling diverged: \S+ is \S+ after \S+ s; use a {advice}"):
        run(car(parts, make, 90000.0), Scenario(0.06, drive()), algorithm=scheme, step=0.004, engine="python")


# ---- Times ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("stop", "step", "last"), [(1.0, 0.3, 0.1), (0.9, 0.3, 0.3), (0.3, 0.3, 0.3), (1.0, 0.01, 0.01)]
)
def test_steps_are_equal_to_the_bit_except_a_shorter_last_one(stop: float, step: float, last: float) -> None:
    times = coupling_times(stop, step)
    steps = step_sizes(times, step)
    assert times[-1] == stop and set(steps[:-1].tolist()) <= {step}
    assert steps[-1] == pytest.approx(last) and (steps[-1] == step) == (last == step)


def test_times_that_differ_by_rounding_are_one() -> None:
    times = np.array([0.0, 0.5, 1.0])
    assert joined(times, np.array([0.5 + 9e-10, 0.5 + 2e-9, 0.7])).tolist() == [0.0, 0.5, 0.5 + 2e-9, 0.7, 1.0]
    assert joined(times, np.array([0.5 - 9e-10])) is times
    assert merged(np.array([1.0, 0.25, 0.0, 0.25 + 9e-10, 0.25 + 4e-9])).tolist() == [
        0.0,
        0.25 + 9e-10,
        0.25 + 4e-9,
        1.0,
    ]
    near = np.array([-9e-10, 0.5 + 9e-10, 0.5 - 9e-10, 0.5 + 2e-9, 0.75, 1.0, 1.0 + 2e-9])
    assert among(near, times, 1.0).tolist() == [True, True, True, False, False, True, False]


@pytest.mark.parametrize("step", [0.0, -0.1, 1.0 + 1e-12, float("nan"), float("inf"), 9.9e-9])
def test_a_step_that_does_not_fit_into_a_run_is_refused(step: float) -> None:
    with pytest.raises(InputError, match=r"coupling step must be positive|at most 1e"):
        coupling_times(1.0, step)
    assert coupling_times(1.0, 1.0).tolist() == [0.0, 1.0]


# ---- Limits of a verdict --------------------------------------------------------------------------------------------

TIME = np.arange(0.0, 10.0, 0.01)


def sound(**changes: Any) -> Result:
    series = TimeSeries.from_channels(TIME, {"car.velocity": ("m/s", np.sin(TIME))})
    fields: dict[str, Any] = {
        "series": series, "converged": True, "notes": (), "algorithm": "default", "order": ("car", "lf"), "step": 1e-3,
        "steps": 10, "seconds": 1.0, "equilibrium_sweeps": 3, "energy": {"lf": BondEnergy(0.1, 1000.0)},
        "held_direct": (), "identities": {}, "stated_error": {"car.velocity": 0.1}, "tolerance": 0.0,
        "coupled": {"lf": Coupled(1e-4, 0.5, 1.0, 800.0, 0.5, 800.0)}, "decisive": frozenset({"car.velocity"}),
    }  # fmt: skip
    return Result(**fields | changes)


def ranged(*ranges: Range, **channels: np.ndarray) -> dict[str, Any]:
    """Return changes: a model with ranges, and recorded channels of the component `lf`."""
    units = {"velocity": "m/s", "displacement": "m"}
    series = TimeSeries.from_channels(TIME, {f"lf.{n}": (units.get(n, "N"), rows) for n, rows in channels.items()})
    known = {name: (f"lf.{name}", 1.0) for name in channels}
    return {"series": series, "models": {"lf": Model(Validity(Verdict([]), ranges), "lf.fmu", known)}}


def pulse(count: int, size: float, rest: float = 0.0) -> np.ndarray:
    """Return 1000 samples of which `count` have another value than the others."""
    return np.where(np.arange(TIME.size) < count, size, rest)


def velocity(count: int, size: float) -> dict[str, Any]:
    return ranged(Range("velocity", "amplitude", -1.0, 2.0, "m/s"), velocity=pulse(count, size))


def displacement(size: float) -> dict[str, Any]:
    wave = size * np.sign(np.sin(2.0 * np.pi * 0.5 * TIME + 1e-3))
    return ranged(Range("displacement", "amplitude", 1.0, 3.0, "m"), displacement=7.0 + wave)


def tones(low: float, high: float, share: float) -> dict[str, Any]:
    inside, outside = (np.sqrt(part) * np.sin(2.0 * np.pi * f * TIME) for part, f in ((1.0 - share, 3.0), (share, 8.0)))
    return ranged(Range("force", "frequency", low, high, "Hz"), force=5.0 + inside + outside)


EDGES: list[tuple[str, dict[str, Any], str, bool]] = [
    ("error", {"stated_error": {"car.velocity": 5.001}}, "coupling error too large", True),
    ("error", {"stated_error": {"car.velocity": 5.0}}, "coupling error too large", False),
    ("good error", {"stated_error": {"car.velocity": 1.001}}, "coupling tolerance not met", True),
    ("good error", {"stated_error": {"car.velocity": 1.0}}, "coupling tolerance not met", False),
    ("tolerance", {"stated_error": {"car.velocity": 0.301}, "tolerance": 0.3}, "coupling tolerance not met", True),
    ("tolerance", {"stated_error": {"car.velocity": 0.3}, "tolerance": 0.3}, "coupling tolerance not met", False),
    ("local", {"coupled": {"lf": Coupled(0.02501, 1.0, 1.0, 1.0, 0.5, 800.0)}}, "local error of a bond", True),
    ("local", {"coupled": {"lf": Coupled(0.02499, 1.0, 1.0, 1.0, 0.5, 800.0)}}, "local error of a bond", False),
    ("energy", {"energy": {"lf": BondEnergy(10.001, 1000.0)}}, "energy residual notable", True),
    ("energy", {"energy": {"lf": BondEnergy(9.999, 1000.0)}}, "energy residual small", True),
    ("energy", {"energy": {"lf": BondEnergy(-49.99, 1000.0)}}, "energy residual notable", True),
    ("energy", {"energy": {"lf": BondEnergy(-50.01, 1000.0)}}, "energy residual too large", True),
    ("fit", {"share_beyond_fit": {"lf": 0.01}}, "within the fitted velocities", True),
    ("fit", {"share_beyond_fit": {"lf": 0.0101}}, "outside the fitted velocities", True),
    ("fit", {"share_beyond_fit": {"lf": 0.2}}, "outside the fitted velocities", True),
    ("fit", {"share_beyond_fit": {"lf": 0.2001}}, "mostly outside the fitted velocities", True),
    ("tire", {"share_tire_off": {"car.lf": 1e-9}}, "tire off the ground", True),
    ("tire", {"share_tire_off": {"car.lf": 0.2}}, "tire off the ground", True),
    ("tire", {"share_tire_off": {"car.lf": 0.2001}}, "tire mostly off the ground", True),
    ("settings", {"share_beyond_settings": {"lf": 1e-9}}, "beyond the settings of a shock", True),
    ("velocity", velocity(500, 2.19), "within the fitted ranges", True),
    ("velocity", velocity(11, 2.21), "beyond the fitted amplitudes", True),
    ("velocity", velocity(10, 2.21), "within the fitted ranges", True),
    ("velocity", velocity(200, -1.11), "beyond the fitted amplitudes", True),
    ("velocity", velocity(201, -1.11), "mostly beyond the fitted amplitudes", True),
    ("velocity", velocity(500, -1.09), "within the fitted ranges", True),
    ("displacement", displacement(1.09), "within the fitted ranges", True),
    ("displacement", displacement(1.11), "mostly beyond the fitted amplitudes", True),
    ("frequency", tones(0.0, 5.0, 0.099), "within the fitted ranges", True),
    ("frequency", tones(0.0, 5.0, 0.101), "beyond the fitted frequencies", True),
    ("frequency", tones(5.0, 9.0, 0.901), "within the fitted ranges", True),
    ("frequency", tones(3.0, 8.0, 0.5), "within the fitted ranges", True),
]


@pytest.mark.parametrize(("changes", "rule", "holds"), [edge[1:] for edge in EDGES],
                         ids=[f"{edge[0]} {k}" for k, edge in enumerate(EDGES)])  # fmt: skip
def test_a_limit_of_the_verdict_is_where_it_is_stated(changes: dict[str, Any], rule: str, holds: bool) -> None:
    assert (rule in [reason.rule for reason in sound(**changes).verdict.reasons]) == holds


def test_reasons_of_a_verdict_are_unchanged(unchanged: Unchanged) -> None:
    other = {"car.velocity": 0.1, "car.a": 7.25, "car.b": 12.0}
    faults: dict[str, dict[str, Any]] = {
        "sound": {}, "other channels": {"stated_error": other},
        "one other channel": {"stated_error": {**other, "car.a": 0.0}}, "unknown": {"stated_error": {}},
        "no number": {"stated_error": {"car.velocity": np.nan}}, "infinite": {"stated_error": {"car.velocity": np.inf}},
        "nothing coupled": {"stated_error": {}, "energy": {}, "coupled": {}},
        "fit": {"share_beyond_fit": {"lf": 0.05}}, "tire": {"share_tire_off": {"car.lf": 0.256}},
        "no static force": {"share_tire_off": {"car.lf": None}}, "early": {"partial": True},
        "settings": {"share_beyond_settings": {"lf": 0.5}, "share_far_beyond_settings": {"lf": 0.25}},
        "untested": {"share_beyond_settings": {"lf": 0.0}, "share_untested_settings": {"lf": 0.125}},
        "at the settings": {"share_beyond_settings": {"lf": 0.0}},
        "unsettled": {"converged": False, "notes": ("a note",)}, "model": {"models": {"lf": Model(None, "lf.fmu", {})}},
        "amplitude": velocity(123, 2.5), "frequency": tones(0.0, 5.0, 0.3), "within": velocity(0, 0.0),
        "condition": ranged(Range("temperature", "condition", 290.0, 310.0, "K"), velocity=pulse(0, 0.0)),
    }  # fmt: skip
    found = {name: sound(**changes).verdict.reasons for name, changes in faults.items()}
    unchanged({name: [f"{one.about} | {one.grade} | {one}" for one in reasons] for name, reasons in found.items()})
    assert sound(stated_error={}).acceptable and not sound(partial=True).acceptable
    rules = {rule for _, changes, rule, holds in EDGES if holds} | {one.rule for one in sum(found.values(), ())}
    assert rules >= {rule.name for rule in RULES}


def test_the_file_of_a_run_is_unchanged(parts: Any, make: Any, tmp_path: Any, unchanged: Unchanged) -> None:
    result = run(car(parts, make), Scenario(0.06, drive()), algorithm=GaussSeidel(), step=0.004, engine="python")
    *_, path = replace(result, seconds=0.0, stepping_seconds=0.0).write(tmp_path)
    unchanged(path)
    unchanged(repr(result), "summary")


# ==== Settings, local errors and energies in a verdict ===============================================================


def only(verdict: Verdict, rule: str):
    (reason,) = [reason for reason in verdict.reasons if reason.rule == rule]
    return reason


def test_a_large_local_error_makes_a_run_not_usable_even_if_the_stated_error_is_small():
    """Two runs that oscillate from step to step can agree at the recorded points."""
    chatter = sound(coupled={"lf": Coupled(1.4, 0.5, 1.0, 800.0, 0.5, 800.0)}, stated_error={"car.velocity": 1e-3})
    assert chatter.verdict.grade is Grade.NOT_USABLE
    assert not chatter.acceptable
    assert "280 %" in only(chatter.verdict, "local error of a bond").figure


def test_the_energy_beyond_the_fitted_velocities_is_limited_like_the_time():
    """A shock that is beyond its fitted range for a short time, but dissipates most of its energy then."""
    time = np.linspace(0.0, 10.0, 1001)
    beyond = (time > 9.9).astype(float)
    series = TimeSeries.from_channels(
        time, {"lf.beyond_fit": ("1", beyond), "lf.dissipated_power": ("W", 1.0 + 1e4 * beyond)}
    )
    reason = only(sound(series=series, share_beyond_fit={"lf": 0.01}).verdict, "mostly outside the fitted velocities")
    assert "99.0% of its energy" in reason.figure
