"""Chapter 6.4: the identified stand-in on a lap, sines, a bump, and static loading."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy.signal import butter, sosfiltfilt

from dissertation.checks import shown
from dissertation.effort import Effort
from dissertation.findings import Findings
from dissertation.plots import TIME, TRUTH, Line, Plot, figure_of
from dissertation.rig_bench import (
    EIGHT_POST,
    EVERY,
    FIVE_SETUPS,
    RATE_OF_MODEL,
    Channels,
    about_mean,
    follow,
    identified,
    identified_channels,
    lap_of,
    linear_law,
    true_channels,
)
from dissertation.true_cars import TOTAL, measures_of
from eightpost.array_types import Array
from eightpost.report.charts import Axis
from eightpost.report.tables import ResultTable
from eightpost.rig.geometry import displacement_modes, force_modes
from eightpost.signals import Drivefile
from eightpost.units import si_factor
from eightpost.vehicle import CORNERS
from eightpost.virtual import (
    NO_DRIFT,
    Car,
    LinearDamper,
    RigSensors,
    Tires,
    bump_drive,
    run_test,
    sine_drive,
    static_drive,
)
from eightpost.virtual.drivefiles import HEAVE_SINES, RATE

#: Signals of Figs 6.26 to 6.28, and of Figs 6.29 to 6.31, with SI units.
_TRENDS = {"lr.velocity": "m/s", TOTAL: "N", "front.ride_height": "m", "lr.hub_acceleration": "m/s2"}
_SIGNALS = {"lf.velocity": "m/s", "lf.tire_force": "N", "front.ride_height": "m", "lf.hub_acceleration": "m/s2"}

_INCH = si_factor("in")


def _with_total(channels: Channels) -> Channels:
    tires = np.sum([channels[f"{corner}.tire_force"] for corner in CORNERS], axis=0)
    return {**channels, TOTAL: tires}


@dataclass(frozen=True, slots=True, eq=False)
class _Pair:
    """Channels of the true and of the identified car, at 1250 and 250 Hz."""

    true: Channels
    found: Channels


def _pairs(effort: Effort, drive: Drivefile | None, setups: Sequence[Sequence[int]]) -> list[_Pair]:
    """Return true and identified channels with linear dampers on a drive, or on the lap."""
    motion = follow(EIGHT_POST.car, drive) if drive else lap_of(EIGHT_POST, effort.lap_seconds)
    dampers = EIGHT_POST.dampers
    true = true_channels(EIGHT_POST, motion, [[dampers[k] for k in setup] for setup in setups])
    laws = [linear_law(one.damping) for one in dampers]
    found = identified_channels(identified(EIGHT_POST, effort.rig_seconds), motion, laws, setups)
    return [_Pair(_with_total(a), _with_total(b)) for a, b in zip(true, found, strict=True)]


# ---- Figs 6.26 to 6.28: a lap ---------------------------------------------------------------------------------------


@cache
def _lap(effort: Effort) -> tuple[_Pair, ...]:
    return tuple(_pairs(effort, None, FIVE_SETUPS))


def figure_6_26(effort: Effort) -> Findings:
    """Traces of 2 s."""
    pair, plots, errors = _lap(effort)[0], [], {}
    settled = round(3.0 * RATE_OF_MODEL)
    for name, unit in _TRENDS.items():
        true, found = about_mean(pair.true[name][::EVERY]), about_mean(pair.found[name])
        errors[name] = float(np.std((found - true)[settled:]) / np.std(true[settled:]))
        part = slice(round(6.0 * RATE_OF_MODEL), round(8.0 * RATE_OF_MODEL))
        time = np.arange(true.size)[part] / RATE_OF_MODEL
        lines = [Line(TRUTH, time, true[part]), Line("identified", time, found[part])]
        plots.append(Plot(name, TIME, Axis("", unit), lines))
    text = ", ".join(f"{name} {100.0 * error:.0f} %" for name, error in errors.items())
    return Findings(
        claims={
            "velocity": (errors["lr.velocity"] == min(errors.values()), f"errors: {text}"),
            "good": (max(errors.values()) < 0.6, f"errors: {text}"),
        },
        blocks=[
            figure_of(
                "Two seconds of a lap with the baseline shocks: stand-in (truth) and identified.", plots, columns=2
            )
        ],
    )


def _trends(effort: Effort) -> dict[str, tuple[Array, Array]]:
    """Return the RMS (5,) of each signal, true and identified."""
    pairs = _lap(effort)
    true = [measures_of(pair.true, RATE) for pair in pairs]
    found = [measures_of(pair.found, RATE_OF_MODEL) for pair in pairs]
    return {name: (np.array([m[name] for m in true]), np.array([m[name] for m in found])) for name in _TRENDS}


def figure_6_27(effort: Effort) -> Findings:
    """RMS over the setups."""
    rows = _trends(effort)
    x = Axis("setup: baseline, other shock at lf, rf, lr, rr")
    numbers = np.arange(len(FIVE_SETUPS), dtype=np.float64)
    plots = [
        Plot(
            name,
            x,
            Axis("RMS", _TRENDS[name]),
            [Line(TRUTH, numbers, t, "marks"), Line("identified", numbers, y, "marks")],
        )
        for name, (t, y) in rows.items()
    ]
    likeness = {name: float(np.corrcoef(t, y)[0, 1]) for name, (t, y) in rows.items()}
    text = ", ".join(f"{name} {100.0 * float(np.mean(y / t - 1.0)):+.1f} %" for name, (t, y) in rows.items())
    return Findings(
        {"offset": float(np.mean(rows["lr.hub_acceleration"][1] - rows["lr.hub_acceleration"][0]))},
        {
            "velocity": (likeness["lr.velocity"] > 0.9, f"correlation {likeness['lr.velocity']:.3f}"),
            "hub": (likeness["lr.hub_acceleration"] > 0.9, f"correlation {likeness['lr.hub_acceleration']:.3f}"),
        },
        [figure_of("RMS levels of five setups: stand-in (truth) and identified.", plots, columns=4)],
        f"Mean error of the levels: {text}. In the stand-in, levels are wrong because of friction, which a linear "
        "model does not have (docs/explanation/linearity.md).",
    )


def _out_of_order(true: Array, found: Array) -> int:
    """Return the smallest number of setups to leave out until the order of the others agrees."""
    order = found[np.argsort(true)]
    longest = np.ones(order.size, dtype=int)
    for k in range(order.size):
        before = [longest[i] for i in range(k) if order[i] < order[k]]
        longest[k] = 1 + max(before, default=0)
    return int(order.size - longest.max())


def figure_6_28(effort: Effort) -> Findings:
    """Simulated over measured RMS."""
    rows = _trends(effort)
    plots = []
    for name, (t, y) in rows.items():
        ends = np.array([t.min(), t.max()])
        axes = Axis("measured RMS", _TRENDS[name]), Axis("simulated RMS", _TRENDS[name])
        plots.append(Plot(name, *axes, [Line("setups", t, y, "points"), Line("equality", ends, ends)]))
    return Findings(
        {"tire": _out_of_order(*rows[TOTAL]), "ride": _out_of_order(*rows["front.ride_height"])},
        blocks=[figure_of("RMS levels of five setups.", plots, columns=4)],
    )


# ---- Figs 6.29 to 6.31: sines and a bump ----------------------------------------------------------------------------

#: Steady part of a sine [samples of the model].
_STEADY = 1250


@cache
def _sines(effort: Effort) -> tuple[tuple[float, _Pair], ...]:
    car = EIGHT_POST.car
    return tuple(
        (f, _pairs(effort, sine_drive(car, f, a * _INCH, duration=12.0), FIVE_SETUPS[:1])[0]) for f, a in HEAVE_SINES
    )


def _steady(pair: _Pair, name: str) -> tuple[Array, Array]:
    return about_mean(pair.true[name][::EVERY][-_STEADY:]), about_mean(pair.found[name][-_STEADY:])


def _third(values: Array, frequency: float) -> float:
    """Return the ratio of the third harmonic to the first [1]."""
    time = np.arange(values.size) / RATE_OF_MODEL
    first, third = (abs(values @ np.exp(-2j * np.pi * k * frequency * time)) for k in (1, 3))
    return float(third / first)


def figure_6_29(effort: Effort) -> Findings:
    """Two periods of some sines."""
    plots, harmonics = [], []
    for frequency, pair in _sines(effort):
        for name in ("lf.tire_force", "lf.hub_acceleration"):
            true, found = _steady(pair, name)
            if frequency < 8.0:
                harmonics.append((frequency, name, _third(true, frequency), _third(found, frequency)))
        if frequency in (1.0, 4.0, 8.0, 15.0):
            size = round(2.0 / frequency * RATE_OF_MODEL)
            for name, unit in _SIGNALS.items():
                true, found = _steady(pair, name)
                time = np.arange(size) / RATE_OF_MODEL
                lines = [Line(TRUTH, time, true[:size]), Line("identified", time, found[:size])]
                plots.append(Plot(f"{name}, {frequency:g} Hz", TIME, Axis("", unit), lines))
    frequency, name, true_share, share = max(harmonics, key=lambda row: row[2])
    text = f"largest: {name} at {frequency:g} Hz, {100.0 * true_share:.0f} %, simulation {100.0 * share:.1f} %"
    return Findings(
        claims={"harmonic": (true_share > 0.1 and share < 0.5 * true_share, text)},
        blocks=[figure_of("Two periods of heave sines: stand-in (truth) and identified.", plots, columns=4, row=170)],
    )


def figure_6_30(effort: Effort) -> Findings:
    """RMS of all heave sines."""
    frequencies = np.array([f for f, _pair in _sines(effort)])
    plots, errors = [], []
    for name, unit in _SIGNALS.items():
        levels = np.array([[row.std() for row in _steady(pair, name)] for _f, pair in _sines(effort)])
        errors += list(np.abs(levels[:, 1] / levels[:, 0] - 1.0))
        lines = [
            Line(TRUTH, frequencies, levels[:, 0], "marks"),
            Line("identified", frequencies, levels[:, 1], "marks"),
        ]
        plots.append(Plot(name, Axis("frequency [Hz]"), Axis("RMS", unit), lines))
    median = 100.0 * float(np.median(errors))
    return Findings(
        claims={"similar": (median < 15.0, f"median {median:.1f} %, largest {100.0 * max(errors):.0f} %")},
        blocks=[figure_of("RMS of heave sines of Table 6.2: stand-in (truth) and identified.", plots, columns=4)],
        note="The largest errors are at 4 Hz, a mode of the car, where the wheels leave the pans.",
    )


def figure_6_31(effort: Effort) -> Findings:
    """An upward bump, low-passed at 60 Hz."""
    pair = _pairs(effort, bump_drive(EIGHT_POST.car, duration=30.0), FIVE_SETUPS[:1])[0]
    low = butter(4, 60.0, fs=RATE, output="sos")
    plots, errors = [], {}
    for name, unit in _SIGNALS.items():
        true, found = sosfiltfilt(low, pair.true[name])[::EVERY], pair.found[name]
        time = np.arange(true.size) / RATE_OF_MODEL
        part = (time > 24.8) & (time < 26.0)
        true, found = (row[part] - row[part][0] for row in (true, found))
        errors[name] = float(np.ptp(found) / np.ptp(true) - 1.0)
        lines = [Line(TRUTH, time[part], true), Line("identified", time[part], found)]
        plots.append(Plot(name, TIME, Axis("", unit), lines))
    text = ", ".join(f"{name} {100.0 * error:+.0f} %" for name, error in errors.items())
    return Findings(
        claims={"good": (max(map(abs, errors.values())) < 0.25, f"peak to peak: {text}")},
        blocks=[figure_of("Upward bump of 0.4 in: stand-in (truth) and identified.", plots, columns=4)],
    )


# ---- Fig 6.32 and Eq 6.11: static loading ---------------------------------------------------------------------------

_MODES = ("heave", "pitch", "roll", "warp")

#: Period of a level [s], its hold after a ramp of 1 s, and the part that is averaged.
_PERIOD, _HOLD, _COUNTED = 6.0, 5.0, 2.0

#: Force of each aeroloader [N]: half of the rig's, so that no wheel leaves its pan when two of them pull.
_FORCE = 500.0 * si_factor("lbf")

_Levels = Mapping[str, tuple[Array, Array]]


def _levels(car: Car) -> _Levels:
    """Return displacements and forces (4, 11) of the modes at every level, up and down, for each test."""
    geometry = car.geometry
    assert geometry is not None
    damper = LinearDamper(EIGHT_POST.dampers[0].damping)
    found = {}
    for test in (*_MODES, *(f"{corner}.aero" for corner in CORNERS)):
        drive = static_drive(car, test, most=_FORCE)
        record = run_test(car, drive, (damper,) * 4, drift=NO_DRIFT, sensors=RigSensors.perfect()).series
        rows = []
        for k in range(11):
            end = _PERIOD * k + _HOLD
            held = record.window(end - _COUNTED, end)
            rows.append([held[f"{c}.{q}"].mean() for q in ("aero_position", "aero") for c in CORNERS])
        x, force = np.split(np.array(rows).T, 2)
        found[test] = displacement_modes(geometry) @ x, -force_modes(geometry) @ force
    return found


@cache
def _static(has_friction: bool) -> tuple[_Levels, Array, Array]:
    """Return levels, K (4, 4) of Eq 6.10 in modes, and the residual of each mode in its own test, relative [1]."""
    car = EIGHT_POST.car
    assert isinstance(car, Car)
    levels = _levels(car if has_friction else car.without_friction())
    x, force = (np.hstack([pair[k] for pair in levels.values()]) for k in range(2))
    factors = np.linalg.lstsq(np.vstack([x, np.ones(x.shape[1])]).T, force.T, rcond=None)[0].T
    left = [
        np.sqrt(np.mean((levels[m][1] - factors[:, :4] @ levels[m][0] - factors[:, 4:])[k] ** 2))
        / levels[m][1][k].std()
        for k, m in enumerate(_MODES)
    ]
    return levels, np.asarray(factors[:, :4], dtype=np.float64), np.array(left, dtype=np.float64)


def _units() -> Array:
    """Return the factor of each entry of K to 1000 lb and 1000 ft.lb per inch and degree."""
    per = np.array([_INCH, *[np.pi / 180.0] * 3])
    force = 1e3 * np.array([si_factor("lbf"), *[si_factor("lbf.ft")] * 3])
    return per / force[:, None]


def figure_6_32(_: Effort) -> Findings:
    """Force over displacement in the test of each mode."""
    levels, K, left = _static(True)
    _levels_without, _K, without = _static(False)
    plots = []
    for k, mode in enumerate(_MODES):
        x, force = levels[mode]
        predicted = K @ x
        predicted = predicted + (force - predicted).mean(axis=1, keepdims=True)
        unit = ("m", "N") if k == 0 else ("", "N.m")
        title = "" if k == 0 else " [rad]"
        lines = [Line(TRUTH, x[k], force[k], "marks"), Line("Eq 6.10", x[k], predicted[k], "marks")]
        plots.append(Plot(f"static {mode}", Axis(f"displacement{title}", unit[0]), Axis("force", unit[1]), lines))
    text = f"{shown(100.0 * left, '%')}, without friction {shown(100.0 * without, '%')}"
    return Findings(
        claims={"hysteresis": (bool(np.all(left > without)), f"unexplained share in heave, pitch, roll, warp: {text}")},
        blocks=[figure_of("Loading and unloading: stand-in (truth) and Eq 6.10.", plots, columns=4)],
    )


def equation_6_11(_: Effort) -> Findings:
    """Spring matrix in modes, and that of the linear car."""
    matrix = _static(True)[1] * _units()
    car = EIGHT_POST.car
    assert isinstance(car, Car)
    linear = _analytic(car) * _units()
    values = {f"{row}/{column}": float(matrix[i, j]) for i, row in enumerate(_MODES) for j, column in enumerate(_MODES)}
    off = np.abs(
        np.diag(1.0 / np.sqrt(np.diag(matrix))) @ matrix @ np.diag(1.0 / np.sqrt(np.diag(matrix))) - np.eye(4)
    ).max()
    error = float(np.abs(np.diag(matrix) / np.diag(linear) - 1.0).max())
    rows = [(row, *(f"{value:.2f}" for value in linear[i])) for i, row in enumerate(_MODES)]
    return Findings(
        values,
        {
            "diagonal": (bool(off < 1.0), f"largest other term relative to the diagonal {off:.2f}"),
            "linear": (error < 0.1, f"largest difference on the diagonal {100.0 * error:.1f} %"),
        },
        [ResultTable.of("Linear car, from its springs and geometry", ("mode", *_MODES), rows)],
    )


def _analytic(car: Car) -> Array:
    """Return K of the linear car in modes: the inverse of its compliance at the aeroloaders."""
    geometry = car.geometry
    assert geometry is not None
    springs = replace(car.springs, progression=0.0 * car.springs.progression)
    tires = Tires(car.tires.stiffness, car.tires.damping, np.full_like(car.tires.static_load, np.inf))
    stiffness = car.stiffness + car.spring.T @ (springs.rate * car.spring) + car.wheel.T @ (tires.stiffness * car.wheel)
    compliance = car.load @ np.linalg.solve(stiffness, car.load.T)
    return force_modes(geometry) @ np.linalg.inv(compliance) @ np.linalg.inv(displacement_modes(geometry))


COMPUTATIONS = {
    "figure-6.26": figure_6_26,
    "figure-6.27": figure_6_27,
    "figure-6.28": figure_6_28,
    "figure-6.29": figure_6_29,
    "figure-6.30": figure_6_30,
    "figure-6.31": figure_6_31,
    "figure-6.32": figure_6_32,
    "equation-6.11": equation_6_11,
}
