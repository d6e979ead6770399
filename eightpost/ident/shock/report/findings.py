"""Warnings about a fit that a user should know before using the shock."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eightpost.ident.shock.force.linear import linear_solution
from eightpost.ident.shock.laws.closed import FadingLag
from eightpost.units import convert

if TYPE_CHECKING:
    from collections.abc import Iterable

    from eightpost.ident.shock.report.parameters import Parameter
    from eightpost.ident.shock.solvers.solution import Solution

#: Share of the standard deviation from which a remaining offset or a negative gas force is reported.
_NOTABLE_OFFSET = 0.01

#: Share of the standard deviation from which the residual is reported as too large for the law.
_POOR = 0.1

_IN_WORDS = {
    "s": (1e3, "ms"),
    "N": (convert(1.0, "N", "lbf"), "lbf"),
    "N/m": (convert(1.0, "N/m", "lbf/in"), "lbf/in"),
    "N.s/m": (convert(1.0, "N.s/m", "lbf.s/in"), "lbf.s/in"),
}


def in_field_units(value: float, unit: str) -> tuple[float, str]:
    """Return an SI value in the unit used in the field: ms, lbf, lbf/in."""
    factor, name = _IN_WORDS.get(unit, (1.0, unit))
    return factor * value, name


def findings(solution: Solution, parameters: Iterable[Parameter], *, recipe: str, gas: str, rms: float) -> list[str]:
    """Return a sentence for each doubt about a solution.

    Args:
        solution: Solution of a recipe.
        parameters: Scalar parameters of the solution.
        recipe: Name of the recipe.
        gas: Treatment of the gas force.
        rms: RMS of the residual [N].
    """
    # A gas stiffness at its lower bound, 0, is normal.
    own = [parameter for parameter in parameters if parameter.name != "gas_stiffness"]
    found = [] if solution.converged else [f"the fit did not converge: {solution.status}"]
    found += [_at_bound(parameter) for parameter in own if parameter.at_bound]
    found += doubts(solution, own, recipe=recipe, gas=gas)
    deviation = solution.model.runs.deviation
    if rms > _POOR * deviation:
        found.append(
            f"the residual is {100.0 * rms / deviation:.1f} % of the force's standard deviation: this law does not "
            "describe this record well"
        )
    return found


def doubts(solution: Solution, parameters: Iterable[Parameter], *, recipe: str, gas: str) -> list[str]:
    """Return a sentence for each doubt besides convergence, bounds and residual; see `findings` for the arguments."""
    notable = _NOTABLE_OFFSET * solution.model.runs.deviation
    pulling = [_pulling(p) for p in parameters if p.name == "gas_preload" and p.value < -notable]
    offset = _offset(solution) if gas == "subtracted" else []
    return [*_unused_fading(solution), *_stiff_with_lag(solution, recipe), *pulling, *offset]


def _at_bound(parameter: Parameter) -> str:
    value, unit = in_field_units(parameter.value, parameter.unit)
    return f"{parameter.name} = {value:.4g} {unit} is at its {parameter.at_bound} bound"


def _unused_fading(solution: Solution) -> list[str]:
    """Return a warning if LPNL2's transition forces have no effect, or cannot be as high as LPF1 would need them."""
    model = solution.model
    if not isinstance(model.dynamics, FadingLag):
        return []
    b, _, theta = model.split(solution.parameters)
    peak = float(np.abs(model.static(b)).max())
    if float(model.dynamics.values(theta)[1]) >= peak:
        return ["alpha is 1 over the whole record: LPNL2 equals LPF1 here, and its transition forces are arbitrary"]
    if model.dynamics.bounds()[1][1] < peak:
        highest, unit = in_field_units(float(model.dynamics.bounds()[1][1]), "N")
        return [
            f"the bound of {highest:.4g} {unit} on lag_full_force is below the record's largest static force: LPNL2 "
            "cannot become LPF1 here and may be worse"
        ]
    return []


def _stiff_with_lag(solution: Solution, recipe: str) -> list[str]:
    """Return a warning if the gas stiffness was fitted without a lag that could explain part of it."""
    if not solution.model.gas.size or (recipe == "joint" and solution.model.dynamics.names):
        return []
    return ["gas_stiffness was fitted without a lag and includes part of it; a joint LPF1 fit separates the two"]


def _pulling(preload: Parameter) -> str:
    value, unit = in_field_units(preload.value, preload.unit)
    return (
        f"gas_preload is {value:.3g} {unit}, but gas pushes: either the load cell was zeroed with the gas force on it, "
        "or the record is positive in extension. Then negate force and motion (--flip force with --flip velocity or "
        "--flip displacement), otherwise compression and rebound are swapped"
    )


def _offset(solution: Solution) -> list[str]:
    """Return a warning if a force from which the gas force was subtracted still has an offset at rest."""
    runs = solution.model.runs
    columns = np.column_stack([solution.model.basis.columns[runs.inside], np.ones(int(runs.inside.sum()))])
    offset = float(linear_solution(columns, runs.measured)[-1])
    if abs(offset) <= _NOTABLE_OFFSET * runs.deviation:
        return []
    pounds, unit = in_field_units(offset, "N")
    return [
        f"an offset of {pounds:.3g} {unit} ({offset:.3g} N) remains in the force, although the gas force was declared "
        "as subtracted; the curve passes through zero and cannot represent it: fit with gas 'estimate'"
    ]
