"""Fit a shock law to a dynamometer test (3.3)."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
from threadpoolctl import threadpool_limits

from eightpost.errors import ParameterError
from eightpost.ident.shock.basis import CurveBasis, working_basis
from eightpost.ident.shock.boggs import Boggs
from eightpost.ident.shock.description import conditions_of, digest_of, fit_of
from eightpost.ident.shock.dynamics import dynamics_for
from eightpost.ident.shock.findings import findings
from eightpost.ident.shock.fitted_curve import fitted_curve
from eightpost.ident.shock.force_model import ForceModel
from eightpost.ident.shock.gas import gas_columns
from eightpost.ident.shock.joint import Joint
from eightpost.ident.shock.limits import limits_for
from eightpost.ident.shock.parameters import parameters_of
from eightpost.ident.shock.preparation import prepare
from eightpost.ident.shock.simulation import simulate
from eightpost.shock import Port, Shock
from eightpost.signals import TimeSeries

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.ident.shock.basis import Join, WorkingBasis
    from eightpost.ident.shock.limits import Limits
    from eightpost.ident.shock.parameters import Parameter
    from eightpost.ident.shock.preparation import Prepared
    from eightpost.ident.shock.solution import Solution
    from eightpost.rig.dyno_test import DynoTest
    from eightpost.shock import ShockLaw

    Array = NDArray[np.float64]

LawName = Literal["polylinear", "lpf1", "lpnl2"]
RecipeName = Literal["joint", "boggs"]
GasTreatment = Literal["estimate", "included", "subtracted"]

#: Recipes by name.
RECIPES: dict[str, Joint | Boggs] = {"joint": Joint(), "boggs": Boggs()}

#: Fewest samples that an outer cubic is fitted to; with fewer it is the straight continuation of the inner part.
FEWEST_OUTER = 50


@dataclass(frozen=True, slots=True, eq=False)
class ShockFit:
    """A fitted shock and how good it is.

    Attributes:
        shock: What `write_shock` writes.
        recipe: `joint` or `boggs`.
        rms: Of the residual inside the segment, model and measurement through the same low-pass [N].
        deviation: Standard deviation of the low-passed measured force [N].
        parameters: The scalar ones.
        converged: Whether the optimiser ended at a minimum.
        status: What happened, in words.
        seconds: What it took.
        changes: Every departure from the dissertation's choices, a sentence each.
        warnings: What is wrong or doubtful, a sentence each.
        measured: velocity [m/s], force [N] (and displacement [m] from the reference): low-passed, the segment only.
        predicted: force and, as part of it, gas_force [N]: the model's, at the times of `measured`.
        digest: SHA-256 of the record's file, or of its samples where it has none.
    """

    shock: Shock
    recipe: str
    rms: float
    deviation: float
    parameters: tuple[Parameter, ...]
    converged: bool
    status: str
    seconds: float
    changes: tuple[str, ...]
    warnings: tuple[str, ...]
    measured: TimeSeries
    predicted: TimeSeries
    digest: str

    @property
    def percent(self) -> float:
        """The residual's RMS in percent of the standard deviation."""
        return 100.0 * self.rms / self.deviation

    def parameter(self, name: str) -> Parameter:
        """Return a parameter by its name.

        Raises:
            KeyError: The law or the treatment of the gas has none of that name.
        """
        found = {parameter.name: parameter for parameter in self.parameters}
        return found[name]


def fit_shock(
    test: DynoTest,
    law: LawName,
    *,
    recipe: RecipeName = "joint",
    gas: GasTreatment = "estimate",
    name: str | None = None,
    segment: tuple[float, float] | None = None,
    cutoff: float | None = None,
    transition_speed: float | None = None,
) -> ShockFit:
    """Fit a law to a dynamometer test.

    Args:
        test: Velocity and force, for the gas stiffness also displacement; positive in compression.
        law: `polylinear`, `lpf1` or `lpnl2`.
        recipe: `joint` (all parameters together) or `boggs` (one after the other, as 3.3 does).
        gas: What to do with the gas force F_0 + K (x - x_ref), x_ref the mean displacement: `estimate` fits it and
            the shock has it; `included` fits it and leaves it out of the shock, for the car's static load counts
            it; `subtracted`: the dynamometer took it out already.
        name: Of the shock; default the build, else the file's name.
        segment: Seconds from the record's start; default 1 to 10.
        cutoff: Of the low-pass [Hz]; default 50, at most 0.4 of the sampling rate.
        transition_speed: Of the curve [m/s]; default 15 in/s, less for a slow record.

    Raises:
        ParameterError: An unknown law, recipe or treatment, or an option that does not suit the record.
        TooShortError: The record has too few samples.
    """
    _check_choices(law, recipe, gas)
    started = time.perf_counter()
    prepared = prepare(test, segment=segment, cutoff=cutoff, transition_speed=transition_speed)
    chosen = RECIPES[recipe]
    limits = limits_for(prepared.measured, prepared.rate, ceiling=chosen.ceiling)
    columns, held = gas_columns(prepared, gas)
    joins = _straight_sides(prepared)
    dynamics = dynamics_for(law, limits)
    # Matrices this small gain nothing from several threads, and lose much where something else wants the cores.
    with threadpool_limits(1, "blas"):
        solution = chosen.fit(lambda join: ForceModel(prepared, _basis(prepared, join, joins), columns, dynamics))
    changes = (
        *prepared.changes,
        *_limit_changes(law, limits),
        *_straight_changes(joins),
        *held,
        *solution.notes,
    )
    return _result(test, solution, changes, recipe=recipe, gas=gas, name=name, started=started)


def _check_choices(law: str, recipe: str, gas: str) -> None:
    asked = (("law", law, LawName), ("recipe", recipe, RecipeName), ("gas treatment", gas, GasTreatment))
    for what, value, choices in asked:
        if value not in get_args(choices):
            raise ParameterError(f"unknown {what} {value!r}; it must be one of {', '.join(get_args(choices))}")


def _straight_sides(prepared: Prepared) -> dict[str, int]:
    """Return the sides, with their samples beyond the transition, that have too few for a cubic."""
    velocity = prepared.record["velocity"][prepared.inside]
    beyond = {
        "compression": int(np.sum(velocity > prepared.transition_speed)),
        "rebound": int(np.sum(velocity < -prepared.transition_speed)),
    }
    return {side: count for side, count in beyond.items() if count < FEWEST_OUTER}


def _basis(prepared: Prepared, join: Join, straight: dict[str, int]) -> WorkingBasis:
    """Return the curve's columns, the cubics joined as asked; sides that are to be straight are straight."""
    basis = CurveBasis(prepared.transition_speed, prepared.transition_width)
    compression, rebound = ("straight" if side in straight else join for side in ("compression", "rebound"))
    ties = basis.ties(compression=compression, rebound=rebound)
    return working_basis(basis, prepared.record["velocity"], ties)


def _straight_changes(straight: dict[str, int]) -> list[str]:
    return [
        f"straight line instead of the cubic in {side}: {count} samples beyond the transition, "
        f"{FEWEST_OUTER} are needed"
        for side, count in straight.items()
    ]


def _limit_changes(law: str, limits: Limits) -> tuple[str, ...]:
    """Return the sentences on those bounds that a law has."""
    changes = {"polylinear": (), "lpf1": limits.lag_changes, "lpnl2": (*limits.lag_changes, *limits.force_changes)}
    return changes[law]


def _result(
    test: DynoTest,
    solution: Solution,
    changes: tuple[str, ...],
    *,
    recipe: str,
    gas: str,
    name: str | None,
    started: float,
) -> ShockFit:
    prepared, model = solution.model.prepared, solution.model
    b, g, theta = model.split(solution.parameters)
    basis = CurveBasis(prepared.transition_speed, prepared.transition_width)
    measured = _inside(prepared.record, prepared)
    curve, ends = fitted_curve(basis, model.basis.to_curve @ b, measured["velocity"])
    preload, stiffness = model.gas.values(g)
    fitted_port = Port(gas_preload=preload, gas_stiffness=stiffness)
    predicted = _predicted(model.dynamics.law(curve, fitted_port, theta), prepared)
    rms = float(np.sqrt(np.mean((predicted["force"] - measured["force"]) ** 2)))
    parameters = parameters_of(solution)
    doubts = [*findings(solution, parameters, recipe=recipe, gas=gas, rms=rms), *ends]
    shock = Shock(
        name=name or test.conditions.build or (test.source.stem if test.source else "shock"),
        law=model.dynamics.law(curve, Port() if gas == "included" else fitted_port, theta),
        conditions=conditions_of(test, prepared, gas=gas, gas_force=(preload, stiffness)),
        fit=fit_of(solution, parameters, recipe=recipe, rms=rms) | {"changes": list(changes), "warnings": doubts},
        inputs=_inputs(test),
    )
    return ShockFit(
        shock=shock,
        recipe=recipe,
        rms=rms,
        deviation=prepared.deviation,
        parameters=parameters,
        converged=solution.converged,
        status=solution.status,
        seconds=time.perf_counter() - started,
        changes=changes,
        warnings=tuple(doubts),
        measured=measured,
        predicted=predicted,
        digest=digest_of(test),
    )


def _predicted(law: ShockLaw, prepared: Prepared) -> TimeSeries:
    """Return the law's own force over the segment, through the record's low-pass."""
    record = prepared.record
    displacement = record["displacement"] if "displacement" in record else np.zeros(len(record))
    gas = law.port.gas_preload + law.port.gas_stiffness * displacement
    force = prepared.filtered(simulate(law, record))
    return _inside(TimeSeries.from_channels(record.time, {"force": ("N", force), "gas_force": ("N", gas)}), prepared)


def _inside(series: TimeSeries, prepared: Prepared) -> TimeSeries:
    inside = prepared.inside
    return TimeSeries(series.time[inside], series.values[:, inside], series.names, series.units)


def _inputs(test: DynoTest) -> tuple[dict[str, str], ...]:
    return ({"name": test.source.name, "sha256": digest_of(test)},) if test.source else ()
