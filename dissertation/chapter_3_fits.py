"""Chapter 3.3 and 3.4: fits of the three laws, and their errors on other records."""

from __future__ import annotations

from functools import cache

import numpy as np

from dissertation.chapter_3_tests import FORCE, VELOCITY
from dissertation.checks import shown
from dissertation.dyno_bench import FITTED, HELD_OUT, LAWS, fitted, random_record, record
from dissertation.effort import Effort
from dissertation.findings import Findings
from dissertation.plots import TIME, TRUTH, Line, Plot, figure_of
from eightpost.array_types import Array
from eightpost.ident import evaluate
from eightpost.ident.validation.records import dyno_record
from eightpost.ident.validation.shock_tests import (
    BumpValidation,
    SineValidation,
    StaticValidation,
    validate_bump,
    validate_sine,
    validate_static,
)
from eightpost.report.charts import Axis, Figure
from eightpost.shock import Lpf1, Lpnl2
from eightpost.units import si_factor
from eightpost.virtual import bump, sine_tests, static_steps

_POUND = si_factor("lbf")

#: Shown part of a record over time [s].
_PART = (3.0, 4.0)


def _over_velocity(law: str) -> Figure:
    fit = fitted(1, law)
    measured = fit.measured
    model = Line(LAWS[law], measured["velocity"], fit.predicted["force"], "dots")
    plot = Plot("", VELOCITY, FORCE, [Line(TRUTH, measured["velocity"], measured["force"], "dots"), model])
    return figure_of(f"Record of configuration 1, and {LAWS[law]}.", [plot], columns=1)


def _over_time(law: str) -> Figure:
    fit = fitted(1, law)
    part = (fit.measured.time >= _PART[0]) & (fit.measured.time < _PART[1])
    time = fit.measured.time[part]
    measured, force = fit.measured["force"][part], fit.predicted["force"][part]
    plots = [
        Plot("force", TIME, FORCE, [Line(TRUTH, time, measured), Line(LAWS[law], time, force)]),
        Plot("error", TIME, Axis("measured minus fitted", "N"), [Line(LAWS[law], time, measured - force)]),
    ]
    return figure_of(f"One second of the record of configuration 1, and {LAWS[law]}.", plots, columns=2)


def _percent(law: str) -> float:
    fit = fitted(1, law)
    return 100.0 * fit.rms / fit.deviation


def _reduction(law: str) -> float:
    return 100.0 * (1.0 - fitted(1, law).rms / fitted(1, "polylinear").rms)


def figure_3_14(_: Effort) -> Findings:
    """Polylinear over velocity."""
    return Findings({"rms": fitted(1, "polylinear").rms}, blocks=[_over_velocity("polylinear")])


def figure_3_15(_: Effort) -> Findings:
    """Polylinear over time."""
    values = {"deviation": fitted(1, "polylinear").deviation, "percent": _percent("polylinear")}
    return Findings(values, blocks=[_over_time("polylinear")])


def figure_3_16(_: Effort) -> Findings:
    """LPF1 over velocity."""
    law = fitted(1, "lpf1").shock.law
    assert isinstance(law, Lpf1)
    return Findings({"tau": law.time_constant}, blocks=[_over_velocity("lpf1")])


def figure_3_17(_: Effort) -> Findings:
    """LPF1 over time."""
    values = {"rms": fitted(1, "lpf1").rms, "percent": _percent("lpf1"), "reduction": _reduction("lpf1")}
    return Findings(values, blocks=[_over_time("lpf1")])


def table_3_4(_: Effort) -> Findings:
    """Fits of the three laws to configuration 1."""
    values: dict[str, float] = {}
    for law in LAWS:
        fit = fitted(1, law)
        values |= {f"{law}/rms": fit.rms, f"{law}/percent": _percent(law), f"{law}/fit": fit.seconds}
    values |= {f"{law}/reduction": _reduction(law) for law in ("lpf1", "lpnl2")}
    best = fitted(1, "lpnl2").shock.law
    assert isinstance(best, Lpnl2)
    own = {"tau": best.time_constant, "low": best.lag_full_force, "high": best.lag_zero_force}
    return Findings(values | {f"lpnl2/{name}": value for name, value in own.items()})


# ---- Random validation ----------------------------------------------------------------------------------------------


@cache
def _error(number: int, law: str) -> float:
    """Return the error of a law on the other random record of its configuration [N]."""
    return evaluate(fitted(number, law).shock, random_record(number, HELD_OUT)).rms


def table_3_5(effort: Effort) -> Findings:
    """Errors of all laws and configurations."""
    values = {f"{law}/configuration {number}": _error(number, law) for law in LAWS for number in effort.configurations}
    return Findings(values, is_partial=True)


def figure_3_18(effort: Effort) -> Findings:
    """Errors as a picture, and the statements about them."""
    numbers = effort.configurations
    errors = {law: np.array([_error(number, law) for number in numbers]) for law in LAWS}
    static, lag, blend = errors.values()
    gains, less = 100.0 * (1.0 - lag / static), 100.0 * (1.0 - blend / lag)
    soft = [number in (5, 6) for number in numbers]
    fourth = [number > 8 for number in numbers]
    x = np.array(numbers, dtype=np.float64)
    lines = [Line(LAWS[law], x, row, "marks") for law, row in errors.items()]
    plot = Plot("", Axis("configuration of Table 3.1"), Axis("RMS error", "N"), lines)
    names = ", ".join(str(number) for number in np.array(numbers)[np.argsort(static)][::-1][:2])
    best = str(numbers[int(np.argmin(static))])
    return Findings(
        claims={
            "dynamic": (
                bool(gains.min() > 20.0),
                f"{gains.min():.0f} to {gains.max():.0f} % less (printed: 45 to 75 %)",
            ),
            "lpnl2": (
                bool(less.min() > 0.0),
                f"{less.min():.1f} to {less.max():.1f} % less (printed: 1 to 7 %; 0 in Table 3.5 for configuration 1)",
            ),
            "largest": (bool(soft[int(np.argmax(static))]), f"the two largest errors are those of {names}"),
            "smallest": (bool(fourth[int(np.argmin(static))]), f"the smallest error is that of {best}"),
        },
        blocks=[figure_of("Errors on another draw of phases.", [plot], columns=1)],
    )


# ---- Sines ----------------------------------------------------------------------------------------------------------


@cache
def _sine(test: int, law: str) -> SineValidation:
    """Return the error of a law of configuration 2 on a sine test."""
    chosen = sine_tests()[test]
    return validate_sine(fitted(2, law).shock, dyno_record(_sine_record(test), name=chosen.name, kind="sine"))


@cache
def _sine_record(test: int):  # type: ignore[no-untyped-def]
    return record(2, sine_tests()[test].drivefile, FITTED)


def figure_3_20(_: Effort) -> Findings:
    """Errors of all sine tests."""
    tests = sine_tests()
    errors = {law: np.array([_sine(k, law).rms for k in range(len(tests))]) for law in LAWS}
    amplitude = np.array([test.amplitude for test in tests])
    frequency = np.array([test.frequency for test in tests])
    plots, low, high = [], [], []
    for size in sorted(set(amplitude.tolist()), reverse=True):
        own = np.flatnonzero(amplitude == size)
        lines = [Line(LAWS[law], frequency[own], row[own], "marks") for law, row in errors.items()]
        title = f"{size / si_factor('in'):g} in"
        plots.append(Plot(title, Axis("frequency [Hz]", kind="log"), Axis("RMS error", "N"), lines))
        low.append(float(np.ptp([row[own[0]] for row in errors.values()]) / errors["polylinear"][own[0]]))
        high.append(float(1.0 - errors["lpnl2"][own[-1]] / errors["polylinear"][own[-1]]))
    dynamic = max(float(errors[law][frequency > 1.0].max()) for law in ("lpf1", "lpnl2"))
    slowest = int(
        np.flatnonzero((amplitude == amplitude.min()) & (frequency == frequency[amplitude == amplitude.min()].min()))[0]
    )
    return Findings(
        {"dynamic": dynamic, "largest": float(errors["lpnl2"][slowest])},
        {
            "low": (max(low) < 0.5, f"spread {', '.join(f'{100.0 * v:.0f}' for v in low)} % for 1, 0.5, 0.25, 0.1 in"),
            "high": (min(high) > 0.0, f"LPNL2 {', '.join(f'{100.0 * v:.0f}' for v in high)} % less than Polylinear"),
        },
        [figure_of("RMS error over frequency for each amplitude.", plots, columns=4)],
    )


def figure_3_21(_: Effort) -> Findings:
    """Loops of two slow and two fast sines of 1 in."""
    plots = []
    for test, title in ((0, "1 in/s"), (2, "6 in/s"), (4, "20 in/s"), (5, "30 in/s")):
        found = {law: _sine(test, law) for law in LAWS}
        loop = found["lpnl2"].measured
        lines = [Line(TRUTH, loop.velocity, loop.force)]
        lines += [Line(LAWS[law], one.predicted.velocity, one.predicted.force) for law, one in found.items()]
        plots.append(Plot(title, VELOCITY, FORCE, lines))
    return Findings(
        {"hysteresis": _sine(5, "lpnl2").measured.hysteresis},
        blocks=[figure_of("Last period of sines of 1 in with these peak velocities.", plots, columns=2)],
    )


# ---- Static and bump tests ------------------------------------------------------------------------------------------

#: Configurations of the static tests, at 1 click: builds 1, 2 and 4 at 50 and 150 psi.
_STATIC = {"build 1, 50 psi": 1, "build 2, 50 psi": 5, "build 4, 50 psi": 9, "build 1, 150 psi": 3,
           "build 2, 150 psi": 7, "build 4, 150 psi": 11}  # fmt: skip


@cache
def _static(number: int) -> StaticValidation:
    test = record(number, static_steps(), FITTED)
    return validate_static(fitted(number, "lpnl2").shock, dyno_record(test, kind="static"))


def _settling(found: StaticValidation) -> float:
    """Return the longest time for which the force of a hold stays over 1 lbf away from its average [s]."""
    series, longest = found.series, 0.0
    for hold in found.holds:
        if hold.direction == "compression":
            begin = hold.start - found.settling
            inside = (series.time >= begin) & (series.time < hold.stop)
            away = np.abs(series["force"][inside] - hold.force) > _POUND
            last = np.flatnonzero(away)
            longest = max(longest, float(series.time[inside][last[-1]] - begin) if last.size else 0.0)
    return longest


def figure_3_22(_: Effort) -> Findings:
    """Force over time."""
    series = _static(3).series
    lines = [
        Line(name, one.time, one["force"] - one["force"][0])
        for name, one in ((n, _static(k).series) for n, k in _STATIC.items())
    ]
    plots = [
        Plot("drive", TIME, Axis("displacement", "m"), [Line("displacement", series.time, series["displacement"])]),
        Plot("force", TIME, FORCE, lines),
    ]
    return Findings(
        {"settling": max(_settling(_static(number)) for number in _STATIC.values())},
        blocks=[figure_of("Static tests, each force relative to its start.", plots, columns=1)],
        note="The time is that in which the force comes within 1 lb of its average; our check valve closes otherwise.",
    )


def figure_3_23(_: Effort) -> Findings:
    """Force at the holds over displacement, and the rates."""
    found = {name: _static(number) for name, number in _STATIC.items()}
    lines = []
    for name, one in found.items():
        x, force = (np.array([getattr(hold, key) for hold in one.holds]) for key in ("displacement", "force"))
        lines.append(Line(name, x, force - force[0], "marks"))
    rates = {name: one.gas_rate or 0.0 for name, one in found.items()}
    stiff = [rates[f"build {k}, 150 psi"] for k in (1, 2, 4)]
    soft = [rates[f"build {k}, 50 psi"] for k in (1, 2, 4)]
    offsets = [one.hysteresis or 0.0 for one in found.values()]
    unit = si_factor("lbf/in")
    return Findings(
        {
            "rise": 3.0 * si_factor("in") * float(np.mean(stiff)),
            "rate": float(np.mean(stiff)),
            "offset": float(np.mean(offsets)),
        },
        {
            "pressure": (
                min(stiff) > max(soft),
                f"{shown([r / unit for r in soft])} and {shown([r / unit for r in stiff], 'lbf/in')}",
            )
        },
        [
            figure_of(
                "Force at each hold, relative to the first.",
                [Plot("", Axis("displacement", "m"), FORCE, lines)],
                columns=1,
            )
        ],
    )


@cache
def _bump(law: str) -> BumpValidation:
    return validate_bump(fitted(9, law).shock, dyno_record(record(9, bump(), FITTED), kind="bump"))


def _bump_lines(law: str) -> tuple[Array, Array, Array, Array]:
    """Return time, velocity, measured and predicted force of the bump."""
    one = _bump(law).prediction
    return one.measured.time, one.measured["velocity"], one.measured["force"], one.predicted["force"]


def figure_3_24(_: Effort) -> Findings:
    """Force over time around both ramps."""
    plots, errors = [], {}
    time, _v, measured, _f = _bump_lines("lpnl2")
    for k, title in enumerate(("compression", "rebound")):
        event = _bump("lpnl2").events[k]
        inside = (time >= event.start - 0.02) & (time <= event.stop + 0.02)
        lines = [Line(TRUTH, time[inside], measured[inside])]
        for law in ("polylinear", "lpnl2"):
            lines.append(Line(LAWS[law], time[inside], _bump_lines(law)[3][inside]))
            errors[law, title] = _bump(law).events[k].peak_error
        plots.append(Plot(title, TIME, FORCE, lines))
    text = ", ".join(f"{LAWS[law]} {title} {error:+.1f} %" for (law, title), error in errors.items())
    return Findings(
        claims={"good": (max(map(abs, errors.values())) < 15.0, f"error of the peak force: {text}")},
        blocks=[figure_of("Bump of configuration 9 (build 4).", plots, columns=2)],
    )


def figure_3_25(_: Effort) -> Findings:
    """Force over velocity of the bump."""
    lines: list[Line] = []
    for law in ("polylinear", "lpnl2"):
        _t, velocity, measured, predicted = _bump_lines(law)
        lines = lines or [Line(TRUTH, velocity, measured)]
        lines.append(Line(LAWS[law], velocity, predicted))
    errors = [_bump(law).rms / _POUND for law in ("polylinear", "lpnl2")]
    return Findings(
        claims={"lpnl2": (errors[1] < errors[0], f"RMS error {errors[1]:.3g} lbf, Polylinear {errors[0]:.3g} lbf")},
        blocks=[figure_of("Bump of configuration 9 (build 4).", [Plot("", VELOCITY, FORCE, lines)], columns=1)],
    )


COMPUTATIONS = {
    "figure-3.14": figure_3_14,
    "figure-3.15": figure_3_15,
    "figure-3.16": figure_3_16,
    "figure-3.17": figure_3_17,
    "figure-3.18": figure_3_18,
    "figure-3.20": figure_3_20,
    "figure-3.21": figure_3_21,
    "figure-3.22": figure_3_22,
    "figure-3.23": figure_3_23,
    "figure-3.24": figure_3_24,
    "figure-3.25": figure_3_25,
    "table-3.4": table_3_4,
    "table-3.5": table_3_5,
}
