"""The result of a fit: the fitted shock, its parameters, warnings and predicted forces."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from eightpost.ident.shock.curve.fitted_curve import fitted_curve
from eightpost.ident.shock.laws.simulation import simulate
from eightpost.ident.shock.report.description import conditions_of, digest_of, fit_of, inputs_of, notes_of
from eightpost.ident.shock.report.findings import doubts, findings
from eightpost.ident.shock.report.parameters import parameters_of
from eightpost.ident.shock.report.verdict import shock_validity
from eightpost.ident.shock.solvers.uncertainty import CurveBand, curve_band, quantile
from eightpost.shock import Port, Shock
from eightpost.signals import TimeSeries
from eightpost.verdict import Verdict

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from eightpost.ident.shock.record.runs import Runs
    from eightpost.ident.shock.report.parameters import Parameter
    from eightpost.ident.shock.solvers.solution import Solution
    from eightpost.rig.dyno_test import DynoTest
    from eightpost.shock import ShockLaw

    Array = NDArray[np.float64]

#: Number of velocities at which the curve's band is stated.
_BAND = 61


@dataclass(frozen=True, slots=True, eq=False)
class ShockFit:
    """A fitted shock and the quality of the fit.

    Attributes:
        shock: Shock that `write_shock` writes.
        recipe: `joint` or `boggs`.
        rms: RMS of the residual inside the segment, model and measurement through the same low-pass [N].
        deviation: Standard deviation of the low-passed measured force [N].
        parameters: Scalar parameters.
        band: 95 % band of the static curve.
        downweighted: Number of samples treated as outliers, over all runs.
        converged: Whether the optimiser ended at a minimum.
        status: Description of how the optimiser ended.
        seconds: Computing time [s].
        changes: Every departure from the dissertation's choices, one sentence each.
        warnings: Everything that is wrong or doubtful, one sentence each.
        measured: Velocity [m/s], force [N] and, if measured, displacement [m] from the reference: low-passed, inside
            the segment, several runs one after the other.
        predicted: Force and its part gas_force [N] of the model, at the times of `measured`.
        digest: SHA-256 of the first record's file, or of its samples if it has none.
    """

    shock: Shock
    recipe: str
    rms: float
    deviation: float
    parameters: tuple[Parameter, ...]
    band: CurveBand
    downweighted: int
    converged: bool
    status: str
    seconds: float
    changes: tuple[str, ...]
    warnings: tuple[str, ...]
    measured: TimeSeries
    predicted: TimeSeries
    digest: str

    @property
    def verdict(self) -> Verdict:
        """Whether the shock can be used, and why (docs/verdict.md)."""
        assert self.shock.validity is not None  # set by `result_of`
        return self.shock.validity.verdict

    @property
    def percent(self) -> float:
        """The residual's RMS in percent of the standard deviation."""
        return 100.0 * self.rms / self.deviation

    def parameter(self, name: str) -> Parameter:
        """Return a parameter by its name.

        Raises:
            KeyError: The fit has no parameter of that name.
        """
        found = {parameter.name: parameter for parameter in self.parameters}
        return found[name]


@dataclass(frozen=True, slots=True)
class Story:
    """Options and history of a fit that the solution does not contain.

    Attributes:
        recipe: Name of the recipe.
        gas: Treatment of the gas force.
        name: Name of the shock, if given.
        changes: Every departure from the dissertation's choices.
        downweighted: Number of samples treated as outliers.
    """

    recipe: str
    gas: str
    name: str | None
    changes: tuple[str, ...]
    downweighted: int


def result_of(tests: Sequence[DynoTest], solution: Solution, story: Story, seconds: float) -> ShockFit:
    """Return the fitted shock of a solution."""
    model = solution.model
    runs, (b, g, theta) = model.runs, model.split(solution.parameters)
    measured = _joined([_inside(p.record, p.inside) for p in runs.prepared])
    curve, ends = fitted_curve(model.basis.curve, model.basis.to_curve @ b, measured["velocity"])
    preload, stiffness = model.gas.values(g)
    fitted_port = Port(gas_preload=preload, gas_stiffness=stiffness)
    predicted = _predicted(model.dynamics.law(curve, Port(), theta), runs, model.gas.columns @ g)
    rms = float(np.sqrt(np.mean((predicted["force"] - measured["force"]) ** 2)))
    parameters = parameters_of(solution)
    found = findings(solution, parameters, recipe=story.recipe, gas=story.gas, rms=rms)
    warnings = (*notes_of(tests), *found, *ends)
    conditions = conditions_of(tests, runs, model.gas, gas=story.gas, gas_force=(preload, stiffness))
    band = _band(solution)
    choices = {"changes": list(story.changes), "warnings": list(warnings), "weighed_down": story.downweighted}
    shock = Shock(
        name=story.name or tests[0].conditions.build or (tests[0].source.stem if tests[0].source else "shock"),
        law=model.dynamics.law(curve, Port() if story.gas == "included" else fitted_port, theta),
        conditions=conditions,
        fit=fit_of(solution, parameters, band, recipe=story.recipe, rms=rms) | choices,
        inputs=inputs_of(tests),
        validity=shock_validity(
            tests,
            percent=100.0 * rms / runs.deviation,
            trouble="" if solution.converged else solution.status or "no minimum was found",
            parameters=parameters,
            doubts=(*doubts(solution, parameters, recipe=story.recipe, gas=story.gas), *ends),
            conditions=conditions,
        ),
    )
    return ShockFit(
        shock=shock,
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
    )


def _band(solution: Solution) -> CurveBand:
    model = solution.model
    n, inside = model.curve_count, model.runs.velocity[model.runs.inside]
    velocity = np.linspace(inside.min(), inside.max(), _BAND)
    covariance = np.nan_to_num(solution.covariance[:n, :n])
    return curve_band(model.basis.at(velocity), solution.parameters[:n], covariance, velocity, quantile(model.runs))


def _predicted(law: ShockLaw, runs: Runs, gas: Array) -> TimeSeries:
    """Return the law's own force and the gas force (N,) [N] over the segments, through each record's low-pass."""
    series = []
    for prepared, part in zip(runs.prepared, runs.parts, strict=True):
        force = prepared.filtered(simulate(law, prepared.record) + gas[part])
        channels = {"force": ("N", force), "gas_force": ("N", gas[part])}
        series.append(_inside(TimeSeries.from_channels(prepared.record.time, channels), prepared.inside))
    return _joined(series)


def _inside(series: TimeSeries, inside: NDArray[np.bool_]) -> TimeSeries:
    return TimeSeries(series.time[inside], series.values[:, inside], series.names, series.units)


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
