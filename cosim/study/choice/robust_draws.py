"""Uncertain parameters of shocks and vehicle, and studies in which they are drawn.

One draw is one study: the same shocks and the same vehicle for all setups, on the same drive. Errors that two setups
have in common therefore cancel in their difference, and a difference can be certain although neither level is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import norm, qmc

from cosim.study.study import Parameters, Study
from eightpost.errors import InputError

Array = NDArray[np.float64]

#: Tolerance for the symmetry and the eigenvalues of a covariance, as a share of its largest entry.
_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Uncertain:
    """Parameters of one FMU with their covariance, such as that of a fit. n parameters.

    Attributes:
        part: Name of the build, or of the vehicle's component. A build has the same errors at every corner.
        names: Names of the FMU's parameters.
        values: Best values (n,), each in the parameter's unit.
        covariance: Covariance of the parameters (n, n).
        lowest: Lower limits (n,), or one number for all; draws below are set to the limit.
        highest: Upper limits (n,), or one number for all.

    Raises:
        InputError: The shapes disagree, or the covariance is not symmetric or has negative variances.
    """

    part: str
    names: tuple[str, ...]
    values: Array
    covariance: Array
    lowest: ArrayLike = -inf
    highest: ArrayLike = inf

    def __post_init__(self) -> None:
        n = len(self.names)
        if np.shape(self.values) != (n,) or np.shape(self.covariance) != (n, n):
            found = f"{np.shape(self.values)} and {np.shape(self.covariance)}"
            raise InputError(
                f"{self.part}: {n} parameters need {n} values and a square covariance of that size; the shapes are "
                f"{found}"
            )
        scale = _ROUNDING * float(np.abs(self.covariance).max(initial=0.0))
        if not np.allclose(self.covariance, self.covariance.T, rtol=0.0, atol=scale):
            raise InputError(f"{self.part}: the covariance of {', '.join(self.names)} is not symmetric")
        if not np.linalg.eigvalsh(self.covariance).min(initial=0.0) >= -scale:
            raise InputError(
                f"{self.part}: the covariance of {', '.join(self.names)} has negative variances or NaN; omit the "
                "parameters that the fit did not determine"
            )

    @classmethod
    def independent(cls, part: str, parameters: Mapping[str, tuple[float, float]], **limits: float) -> Uncertain:
        """Return independent parameters, given by value and standard deviation."""
        values, deviations = np.array(list(parameters.values()), dtype=np.float64).reshape(-1, 2).T
        return cls(part, tuple(parameters), values, np.diag(deviations**2), **limits)

    def at(self, standard: Array) -> Array:
        """Return parameter values (S, n) for standard normal numbers (S, n)."""
        variances, axes = np.linalg.eigh(self.covariance)
        drawn = self.values + (standard * np.sqrt(np.maximum(variances, 0.0))) @ axes.T
        return np.asarray(np.clip(drawn, self.lowest, self.highest), dtype=np.float64)


def drawn_studies(
    study: Study, uncertain: Sequence[Uncertain], *, draws: int, seed: int = 0, vehicles: Sequence[Path] = ()
) -> tuple[Study, ...]:
    """Return studies with drawn parameters: a Latin hypercube of their normal distribution.

    Args:
        study: Study with the best values.
        uncertain: Uncertain parameters; each parameter at most once.
        draws: Number of studies S.
        seed: Seed of the random number generator; the same seed gives the same studies.
        vehicles: FMUs of equivalent vehicles; the draws use the study's own vehicle and these in turn.

    Raises:
        InputError: Fewer than two draws, or a part is neither a build of the bank nor the vehicle.
    """
    if draws < 2:
        raise InputError(f"a spread needs two or more draws, not {draws}")
    for entry in uncertain:
        if entry.part != study.vehicle.name and entry.part not in study.bank:
            known = ", ".join((study.vehicle.name, *study.bank))
            raise InputError(f"there is no part {entry.part!r}; the parts are {known}")
    sizes = [len(entry.names) for entry in uncertain]
    uniform = qmc.LatinHypercube(max(sum(sizes), 1), rng=seed).random(draws)[:, : sum(sizes)]
    parts = np.split(norm.ppf(uniform), np.cumsum(sizes)[:-1], axis=1) if sizes else []
    values = [entry.at(part) for entry, part in zip(uncertain, parts, strict=True)]
    cars = [replace(study, vehicle=replace(study.vehicle, fmu=fmu)) for fmu in (study.vehicle.fmu, *vehicles)]
    return tuple(_with(cars[s % len(cars)], uncertain, [rows[s] for rows in values]) for s in range(draws))


def _with(study: Study, uncertain: Sequence[Uncertain], values: Sequence[Array]) -> Study:
    drawn: dict[str, dict[str, float]] = {}
    for entry, row in zip(uncertain, values, strict=True):
        drawn.setdefault(entry.part, {}).update(zip(entry.names, row.tolist(), strict=True))
    bank = {n: replace(b, parameters=_over(b.parameters, drawn.get(n))) for n, b in study.bank.items()}
    vehicle = study.vehicle
    vehicle = replace(vehicle, parameters=_over(vehicle.parameters, drawn.get(vehicle.name)))
    return replace(study, bank=bank, vehicle=vehicle)


def _over(own: Parameters, drawn: Mapping[str, float] | None) -> Parameters:
    return {**own, **(drawn or {})}
