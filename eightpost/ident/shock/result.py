"""Result of a fit: shock, misfit, description, stated uncertainty, console tables."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from eightpost.array_types import Array
from eightpost.display import Summarized, Summary
from eightpost.errors import ParameterError, suggestion
from eightpost.ident.shock.curve import fitted_curve
from eightpost.ident.shock.force import GasColumns
from eightpost.ident.shock.law_fit import HeldOutErrors
from eightpost.ident.shock.problem import LEVEL, CurveBand, Solution, blocks_of, curve_band, factor_rows, quantile
from eightpost.ident.shock.runs import PreparedRun, Runs
from eightpost.ident.shock.simulation import predicted_force, r_squared, simulate
from eightpost.ident.shock.verdict import (
    BuildSpread,
    Parameter,
    error_at_low_speeds,
    findings,
    in_field_units,
    parameters_of,
    shock_validity,
)
from eightpost.labelled import data_frame, dataset
from eightpost.report.console import Table, console_table, right, unbroken
from eightpost.rig.dyno_test import DynoTest
from eightpost.shock import Polylinear, Port, Shock, ShockLaw, law_title, write_shock
from eightpost.signals import TimeSeries
from eightpost.uncertainty import LeftOutBlocks
from eightpost.units import convert
from eightpost.validity import judged
from eightpost.verdict import Verdict

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from eightpost.ident.shock.simulation import Motion
    from eightpost.report.pictures import Picture


# ==== Uncertainty of the static curve and of the other parameters, as the shock file states it =======================

#: Number of velocities at which the curve's band is stated.
_BAND = 61

#: Parameters of the FMU that are the factors on the force in compression and in rebound.
_FACTORS = ("compression_scale", "rebound_scale")


def curve_band_of(solution: Solution, error: float) -> CurveBand:
    """Return the band of a solution's static curve over the velocities of its records."""
    model = solution.model
    n, inside = model.curve_count, model.runs.velocity[model.runs.inside]
    velocity = np.linspace(inside.min(), inside.max(), _BAND)
    covariance, reach = np.nan_to_num(solution.covariance[:, :n, :n]), quantile(model.runs)
    columns, samples = model.basis.at(velocity), _samples(solution)
    band = curve_band(columns, samples, solution.parameters[:n], covariance, velocity, reach)
    return replace(band, half_width=np.hypot(band.half_width, error))


def factor_half_widths(band: CurveBand) -> dict[str, float]:
    """Return the half-width of the factor on each side that has samples, by the name of the parameter."""
    return {name: half for name, half in zip(_FACTORS, band.factors.tolist(), strict=True) if np.isfinite(half)}


def left_out_blocks(solution: Solution) -> LeftOutBlocks:
    """Return the changes of the law's parameters and of the factors on both sides when each block is left out.

    Runs are taken in the order of their RMS velocity, the fastest first: the order of the tests does not matter.
    """
    model, changes = solution.model, solution.left_out
    n, m, (_, _, theta) = model.curve_count, model.linear_count, model.split(solution.parameters)
    factors = changes[:, :n] @ factor_rows(_samples(solution), solution.parameters[:n]).T
    own = changes[:, m:] @ model.dynamics.values_jacobian(theta).T
    names, columns = (*_FACTORS, *model.dynamics.names), np.hstack([factors, own])
    order = _by_speed(model.runs)
    squares = [np.mean(model.runs.row_velocity[block] ** 2) for block in blocks_of(model.runs)]
    return LeftOutBlocks.of(np.sqrt(squares)[order], dict(zip(names, columns[order].T, strict=True)))


def _samples(solution: Solution) -> Array:
    """Return the columns of the curve at the rows that count."""
    model = solution.model
    return model.basis.at(model.runs.row_velocity[model.runs.weights > 0.0])


def _by_speed(runs: Runs) -> list[int]:
    """Return the blocks (B,) in the order of the RMS velocity of their runs, the fastest run first."""
    ends = np.cumsum([f.rows.size for f in runs.filters])
    squares = np.array([np.mean(part**2) for part in np.split(runs.row_velocity, ends[:-1])])
    numbers = np.searchsorted(ends, [block.start for block in blocks_of(runs)], side="right")
    order: list[int] = np.argsort(-squares[numbers], kind="stable").tolist()
    return order


# ==== The result =====================================================================================================

# ---- The sections of a shock file that describe its measurement and its fit -----------------------------------------

#: Share of the velocity's power that is outside the stated frequency range at either end.
_LEFT_OUT = 0.005


def _conditions_of(
    tests: Sequence[DynoTest], runs: Runs, columns: GasColumns, *, gas: str, gas_force: tuple[float, float]
) -> dict[str, Any]:
    """Return the conditions, those of the first record, and the ranges of the measurement; units in the keys, SI.

    `gas_force` is the estimated preload [N] and stiffness [N/m], `gas` the treatment of the gas force.
    """
    known = tests[0].conditions
    stated: dict[str, Any] = {"build": known.build, "clicks": known.clicks, "gas_pressure [Pa]": known.gas_pressure}
    described: dict[str, Any] = {key: value for key, value in stated.items() if value is not None}
    described |= _temperature(tests, runs)
    described |= {
        "velocity_range [m/s]": _range(runs.velocity[runs.inside]),
        "frequency_range [Hz]": _widest([_frequency_range(p) for p in runs.prepared]),
        "gas_treatment": gas,
        "gas_preload_estimate [N]": gas_force[0],
        "gas_stiffness_estimate [N/m]": gas_force[1],
    }
    moved = [p.record["displacement"][p.inside] + p.reference for p in runs.prepared if "displacement" in p.record]
    if moved:
        described["displacement_range [m]"] = _range(np.concatenate(moved))
        described["displacement_reference [m]"] = columns.reference
    if derived := sorted({what for test in tests for what in test.derived}):
        described["derived"] = derived
    return described


def _fit_of(
    solution: Solution, parameters: Iterable[Parameter], band: CurveBand, *, recipe: str, rms: float, static: float
) -> dict[str, Any]:
    """Return the results of the fit as JSON values, units in the keys, SI."""
    runs = solution.model.runs
    return {
        "recipe": recipe,
        "runs": len(runs.prepared),
        "rms [N]": rms,
        "standard_deviation [N]": runs.deviation,
        "percent": 100.0 * rms / runs.deviation,
        "percent_of_static_curve": 100.0 * static / runs.deviation,
        "segment [s]": _range(runs.first.record.time[runs.first.inside]),
        "cutoff [Hz]": runs.first.cutoff,
        "converged": solution.converged,
        "status": solution.status,
        "parameters": {parameter.name: _entry(parameter) for parameter in parameters},
        "curve_band": {
            "level": LEVEL,
            "velocity [m/s]": band.velocity.tolist(),
            "force [N]": band.force.tolist(),
            "half_width [N]": band.half_width.tolist(),
            "factor_half_width": factor_half_widths(band),
        },
    }


def digest_of(test: DynoTest) -> str:
    """Return the SHA-256 of a test's file, or of its samples if it has none."""
    return test.sha256 or hashlib.sha256(test.series.time.tobytes() + test.series.values.tobytes()).hexdigest()


def _inputs_of(tests: Sequence[DynoTest]) -> tuple[dict[str, str], ...]:
    """Return name and digest of each file that tests come from; a file with several runs is listed once."""
    files = dict.fromkeys((test.source.name, digest_of(test)) for test in tests if test.source)
    return tuple({"name": name, "sha256": digest} for name, digest in files)


def _notes_of(tests: Sequence[DynoTest]) -> list[str]:
    """Return the notes on the records, with the number of the run if there are several."""
    numbered = enumerate(tests, start=1)
    return [note if len(tests) == 1 else f"run {number}: {note}" for number, test in numbered for note in test.warnings]


def interval_of(parameter: Parameter) -> tuple[float, float] | None:
    """Return the 95 % interval; None if the record does not determine the parameter, or the fit ended at its bound."""
    return None if parameter.at_bound else parameter.interval


def _entry(parameter: Parameter) -> dict[str, Any]:
    bounds = [bound if np.isfinite(bound) else None for bound in parameter.bounds or ()] or None
    return {
        "value": parameter.value,
        "unit": parameter.unit,
        "standard_error": parameter.error,
        "interval_95": list(interval) if (interval := interval_of(parameter)) else None,
        "bounds": bounds,
        "at_bound": parameter.at_bound,
    }


def _temperature(tests: Sequence[DynoTest], runs: Runs) -> dict[str, Any]:
    ranges = []
    for test, prepared in zip(tests, runs.prepared, strict=True):
        if "temperature" in test.series:
            time = prepared.record.time[prepared.inside] + test.series.time[0]
            here = (test.series.time >= time[0]) & (test.series.time <= time[-1])
            ranges.append(_range(test.series["temperature"][here]))
    return {"temperature_range [K]": _widest(ranges)} if ranges else {}


def _widest(ranges: list[list[float]]) -> list[float]:
    return [min(low for low, _ in ranges), max(high for _, high in ranges)]


def _range(values: Array) -> list[float]:
    return [float(values.min()), float(values.max())]


def _frequency_range(prepared: PreparedRun) -> list[float]:
    """Return the range of frequencies [Hz] that contains 99 % of the velocity's power."""
    velocity = prepared.record["velocity"][prepared.inside]
    power = np.cumsum(np.abs(np.fft.rfft(velocity - velocity.mean())) ** 2)
    frequency = np.fft.rfftfreq(velocity.size, prepared.step)
    ends = np.searchsorted(power, np.array([_LEFT_OUT, 1.0 - _LEFT_OUT]) * power[-1])
    return [float(frequency[end]) for end in ends]


# ---- The result of a fit --------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ShockFit(Summarized):
    """A fitted shock and the quality of the fit."""

    shock: Shock  #: Shock that `write_shock` writes.
    recipe: str  #: `joint` or `boggs`.
    rms: float  #: RMS of the residual inside the segment, model and measurement through the same low-pass [N].
    deviation: float  #: Standard deviation of the low-passed measured force [N].
    parameters: tuple[Parameter, ...]  #: Scalar parameters.
    band: CurveBand  #: 95 % band of the static curve.
    downweighted: int  #: Number of samples treated as outliers, over all runs.
    converged: bool  #: Whether the optimiser ended at a minimum.
    status: str  #: Description of how the optimiser ended.
    seconds: float  #: Computing time [s].
    changes: tuple[str, ...]  #: Every departure from the dissertation's choices, one sentence each.
    warnings: tuple[str, ...]  #: Everything that is wrong or doubtful, one sentence each.
    #: Velocity [m/s], force [N] and, if measured, displacement [m] from the reference: low-passed, inside the segment,
    #: several runs one after the other.
    measured: TimeSeries
    predicted: TimeSeries  #: Force and its part gas_force [N] of the model, at the times of `measured`.
    digest: str  #: SHA-256 of the first record's file, or of its samples if it has none.
    #: Errors of the law and of LPNL2 on left-out parts of the records; None if they are not known.
    held_out: HeldOutErrors | None = None
    between_builds: BuildSpread | None = None  #: Spread between the builds of the records if there are several.

    @property
    def verdict(self) -> Verdict:
        """Whether the shock can be used, and why (docs/reference/verdict.md)."""
        assert self.shock.validity is not None  # set by `result_of`
        return self.shock.validity.verdict

    @property
    def percent(self) -> float:
        """The residual's RMS in percent of the standard deviation."""
        return 100.0 * self.rms / self.deviation

    def parameter(self, name: str) -> Parameter:
        """Return a parameter by its name.

        Raises:
            ParameterError: The fit has no parameter of that name.
        """
        found = {parameter.name: parameter for parameter in self.parameters}
        if name not in found:
            raise ParameterError(f"the fit has no parameter {name!r}; {suggestion(name, found)}")
        return found[name]

    def _summary(self) -> Summary:
        return Summary.of(
            f"Fit of {self.shock.name}: {law_title(self.shock.law_name)}",
            ("verdict", self.verdict.headline),
            ("reason", str(self.verdict.decisive[0]) if self.verdict.reasons else ""),
            ("residual", f"{self.rms:.3g} N RMS, {self.percent:.2g} % of the force's standard deviation"),
            ("held out", str(self.held_out or "")),
            ("search", "" if self.converged else f"did not converge: {self.status}"),
            ("parameters", ", ".join(f"{p.name} {p.value:.4g} {p.unit}" for p in self.parameters)),
            ("changes", f"{len(self.changes)}; see .changes" if self.changes else ""),
            ("warnings", "; ".join(self.warnings)),
        )

    def predict(self, motion: Motion, *, step: float | None = None) -> Array:
        """Return the force (N,) [N] that the dynamometer would measure, with the gas force of the fitted records.

        Args:
            motion: Record with `velocity` [m/s] and, for the gas force, `displacement` [m]; or an array of samples: the
                velocity (N,), or velocity and displacement (N, 2).
            step: Time between the samples of an array [s].

        Raises:
            InputError: An array has another shape, or no step.
            MissingChannelError: The record has no velocity.
        """
        return predicted_force(self.shock, motion, step)

    def score(self, motion: Motion, force: Array | None = None, *, step: float | None = None) -> float:
        """Return the coefficient of determination R^2 of `predict`, as regressors of scikit-learn do.

            R^2 = 1 - sum (F - F_predicted)^2 / sum (F - mean F)^2

        All samples count, as they were recorded: without the low-pass and the segment of `percent`.

        Args:
            motion: Motion; see `predict`.
            force: Measured force (N,) [N]; default: the channel `force` of the record.
            step: Time between the samples of an array [s].
        """
        return r_squared(self.shock, motion, force, step)

    def to_pandas(self) -> pd.DataFrame:
        """Return the parameters, one row each: value, unit, ends of the 95 % interval.

        Raises:
            MissingExtraError: pandas is not installed.
        """
        ends = [interval_of(parameter) or (np.nan, np.nan) for parameter in self.parameters]
        columns = {
            "value": [parameter.value for parameter in self.parameters],
            "unit": [parameter.unit for parameter in self.parameters],
            "low": [low for low, _ in ends],
            "high": [high for _, high in ends],
        }
        return data_frame(columns, [parameter.name for parameter in self.parameters], "parameter")

    def to_xarray(self) -> xr.Dataset:
        """Return measured and fitted force over `time`, and the static curve with its 95 % band over `speed`.

        Raises:
            MissingExtraError: xarray is not installed.
        """
        along, measured, band = ("time",), self.measured, self.band
        variables = {
            "velocity": (along, measured["velocity"], "m/s"),
            "measured_force": (along, measured["force"], "N"),
            "fitted_force": (along, self.predicted["force"], "N"),
            "gas_force": (along, self.predicted["gas_force"], "N"),
            "curve": (("speed",), band.force, "N"),
            "curve_half_width": (("speed",), band.half_width, "N"),
        }
        coordinates = {"time": (along, measured.time, "s"), "speed": (("speed",), band.velocity, "m/s")}
        return dataset(variables, coordinates, {"shock": self.shock.name, "law": self.shock.law_name})

    def plot(self) -> Picture:
        """Return a picture of force over velocity: measured, fitted, static curve with its 95 % band."""
        from eightpost.ident.shock.plots import force_velocity  # noqa: PLC0415 -- matplotlib takes long to load
        from eightpost.report.pictures import Picture  # noqa: PLC0415

        return Picture(force_velocity([self]))

    def write(self, path: str | Path) -> Path:
        """Write the shock file (.json) that `build` makes an FMU of, and return its path."""
        write_shock(self.shock, path)
        return Path(path)


@dataclass(frozen=True, slots=True)
class Story:
    """Options and history of a fit that the solution does not contain."""

    recipe: str  #: Name of the recipe.
    gas: str  #: Treatment of the gas force.
    name: str | None  #: Name of the shock, if given.
    changes: tuple[str, ...]  #: Every departure from the dissertation's choices.
    downweighted: int  #: Number of samples treated as outliers.
    #: Errors of the law and of LPNL2 on left-out parts of the records; None if they are not known.
    held_out: HeldOutErrors | None = None
    between_builds: BuildSpread | None = None  #: Spread between the builds of the records if there are several.
    #: Difference of the preload from that of LPNL2 [N] where the runs have one motion, which hardly determines it; else
    #: 0.
    level: float = 0.0


def result_of(tests: Sequence[DynoTest], solution: Solution, story: Story, seconds: float) -> ShockFit:
    """Return the fitted shock of a solution."""
    model = solution.model
    runs, (b, g, theta) = model.runs, model.split(solution.parameters)
    tests = [test.judged(until=p.stop) for test, p in zip(tests, runs.prepared, strict=True)]
    measured = _joined([p.record.at(p.inside) for p in runs.prepared])
    curve, ends = fitted_curve(model.basis.curve, model.basis.to_curve @ b, measured["velocity"])
    preload, stiffness = model.gas.values(g)
    fitted_port = Port(gas_preload=preload, gas_stiffness=stiffness)
    predicted = _predicted(model.dynamics.law(curve, Port(), theta), runs, model.gas.columns @ g)
    static = _predicted(Polylinear(curve), runs, model.gas.columns @ g)
    rms, static_rms = (float(np.sqrt(np.mean((one["force"] - measured["force"]) ** 2))) for one in (predicted, static))
    parameters = parameters_of(solution, story.level)
    found = findings(solution, parameters, recipe=story.recipe, gas=story.gas)
    warnings = (*_notes_of(tests), *found, *ends)
    conditions = _conditions_of(tests, runs, model.gas, gas=story.gas, gas_force=(preload, stiffness))
    band = curve_band_of(solution, 0.01 * story.held_out.percent * runs.deviation if story.held_out else 0.0)
    further: dict[str, Any] = {"held_out": story.held_out.to_json()} if story.held_out else {}
    further |= {"between_builds": story.between_builds.to_json()} if story.between_builds else {}
    further |= left_out_blocks(solution).section() if solution.left_out.size else {}
    further |= {"changes": list(story.changes), "warnings": list(warnings), "weighed_down": story.downweighted}
    shock = Shock(
        name=story.name or tests[0].conditions.build or (tests[0].source.stem if tests[0].source else "shock"),
        law=model.dynamics.law(curve, Port() if story.gas == "included" else fitted_port, theta),
        conditions=conditions,
        fit=_fit_of(solution, parameters, band, recipe=story.recipe, rms=rms, static=static_rms) | further,
        inputs=_inputs_of(tests),
        validity=shock_validity(
            tests,
            runs,
            percent=100.0 * rms / runs.deviation,
            static=100.0 * static_rms / runs.deviation,
            level=next((p.reach * p.error for p in parameters if p.name == "gas_preload" and p.error), None),
            low_speeds=error_at_low_speeds(measured, predicted),
            held_out=story.held_out,
            trouble="" if solution.converged else solution.status or "no minimum was found",
            conditions=conditions,
        ),
    )
    return ShockFit(
        shock=judged(shock),
        recipe=story.recipe,
        rms=rms,
        deviation=runs.deviation,
        parameters=parameters,
        band=band,
        downweighted=story.downweighted,
        converged=solution.converged,
        status=solution.status,
        seconds=seconds,
        changes=story.changes,
        warnings=warnings,
        measured=measured,
        predicted=predicted,
        digest=digest_of(tests[0]),
        held_out=story.held_out,
        between_builds=story.between_builds,
    )


def _predicted(law: ShockLaw, runs: Runs, gas: Array) -> TimeSeries:
    """Return the law's own force and the gas force (N,) [N] over the segments, through each record's low-pass."""
    series = []
    for prepared, part in zip(runs.prepared, runs.parts, strict=True):
        force = prepared.filtered(simulate(law, prepared.record) + gas[part])
        channels = {"force": ("N", force), "gas_force": ("N", gas[part])}
        series.append(TimeSeries.from_channels(prepared.record.time, channels).at(prepared.inside))
    return _joined(series)


def _joined(series: list[TimeSeries]) -> TimeSeries:
    """Return runs one after the other, with the channels that all of them have."""
    if len(series) == 1:
        return series[0]
    names = [name for name in series[0].names if all(name in s for s in series)]
    series = [s.select(names) for s in series]
    time, start = [], float(series[0].time[0])
    for s in series:
        time.append(s.time - s.time[0] + start)
        start = float(time[-1][-1]) + s.duration / (len(s) - 1)
    return TimeSeries(np.concatenate(time), np.hstack([s.values for s in series]), series[0].names, series[0].units)


# ==== Console tables: misfit by law, parameters ======================================================================


def fit_table(fits: Sequence[ShockFit]) -> Table:
    """Return a table of fits like Table 3.4; the reduction is relative to Polylinear of the same shock, if fitted."""
    static = {fit.shock.name: fit.rms for fit in fits if fit.shock.law_name == "polylinear"}
    columns = right("RMS, lbf", "RMS, N", "% of std", "% less than static", "time, s")
    rows = [
        (
            fit.shock.name,
            law_title(fit.shock.law_name),
            *(f"{rms:.2f}" for rms in (convert(fit.rms, "N", "lbf"), fit.rms, fit.percent)),
            _reduction(fit, static.get(fit.shock.name)),
            f"{fit.seconds:.2f}",
        )
        for fit in fits
    ]
    return console_table(["shock", *unbroken("law"), *columns], rows, title="Fits")


def parameter_table(fit: ShockFit) -> Table:
    """Return the parameters of a fit: value, 95 % interval and bounds in SI and in field units."""
    columns = [*unbroken("parameter"), *right("value", "95 % interval", "SI", "bounds"), "at bound"]
    title = f"{fit.shock.name}, {law_title(fit.shock.law_name)}: parameters"
    return console_table(columns, map(_parameter_row, fit.parameters), title=title)


def _parameter_row(parameter: Parameter) -> tuple[str, ...]:
    value, unit = in_field_units(parameter.value, parameter.unit)
    shown = f"{value:.4g} {unit}", _interval(parameter), f"{parameter.value:.4g} {parameter.unit}", _bounds(parameter)
    return (parameter.name, *shown, parameter.at_bound or "-")


def _reduction(fit: ShockFit, static: float | None) -> str:
    if static is None or fit.shock.law_name == "polylinear":
        return "-"
    return f"{100.0 * (1.0 - fit.rms / static):.1f}"


def _interval(parameter: Parameter) -> str:
    if (interval := interval_of(parameter)) is None:
        return "-" if parameter.at_bound else "not determined"
    (low, _), (high, unit) = (in_field_units(end, parameter.unit) for end in interval)
    return f"{low:.4g} to {high:.4g} {unit}"


def _bounds(parameter: Parameter) -> str:
    if parameter.bounds is None:
        return "-"
    (low, unit), (high, _) = (in_field_units(bound, parameter.unit) for bound in parameter.bounds)
    return f"{low:.4g} to {high:.4g} {unit}" if isfinite(high) else f"{low:.4g} or more"
