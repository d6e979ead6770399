"""Verdict on an identified vehicle, from its fit."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Protocol

from eightpost.ident.vehicle.measured_levels import level_errors
from eightpost.ident.vehicle.trust import UNUSABLE, Trust
from eightpost.measure_uncertainty import TOTAL
from eightpost.verdict import Grade, Reason, Rules, Verdict, listed

ABOUT = "fit of the vehicle"

#: Misfit of an output, weighted by frequency as in the fit, from which a vehicle is not usable [1].
POOR_FIT = 0.3

#: Quantities whose levels are judged.
_JUDGED = ("velocity", "tire_force", "ride_height", TOTAL)

#: Errors of levels up to which a vehicle is usable, and from which it is not: RMS over the measures, and worst one [1].
GOOD_LEVELS, POOR_LEVELS = (0.01, 0.02), (0.03, 0.05)

RULES = Rules()

UNSTABLE = RULES.add("vehicle not stable", ABOUT, Grade.NOT_USABLE,
    condition="the car is unstable with at least one of the linear dampers that were tried, or a motion grows by more "
    "than 100 1/s without dampers",
    why="a simulation with such shocks may diverge",
    remedy="identify with more tests of other shocks, or without the channels that fit worst",
)  # fmt: skip
MISFIT = RULES.add("large misfit of the vehicle", ABOUT, Grade.NOT_USABLE,
    condition=f"misfit of an output of {100 * POOR_FIT:g} % or more",
    why="the model does not reproduce a third of the output's response",
    remedy="check the plots of the fit; leave the output out (--output-channels), or repeat the tests",
)  # fmt: skip
GOOD = RULES.add("small misfit of the vehicle", ABOUT, Grade.USABLE,
    condition=f"misfit of every output below {100 * POOR_FIT:g} %, where the tests are not simulated",
    why="the limit above",
)  # fmt: skip
WRONG_LEVELS = RULES.add("own tests predicted wrong", ABOUT, Grade.NOT_USABLE,
    condition="simulated with the shocks of its own tests, the car has levels of shock velocities, tire forces, their "
    f"sum and ride heights that are wrong by {100 * POOR_LEVELS[0]:g} % or more (RMS), or one of them by "
    f"{100 * POOR_LEVELS[1]:g} % or more",
    why="other setups are predicted worse, and setups differ by a few percent",
    remedy="see the other reasons; otherwise identify with another recipe (--recipe)",
)  # fmt: skip
DOUBTFUL_LEVELS = RULES.add("own tests predicted roughly", ABOUT, Grade.LIMITED,
    condition=f"the same by more than {100 * GOOD_LEVELS[0]:g} %, or {100 * GOOD_LEVELS[1]:g} % for one of them",
    why="other setups are predicted worse",
    remedy="rank setups that differ by more, and validate on other records (eightpost validate)",
)  # fmt: skip
GOOD_OWN_TESTS = RULES.add("own tests predicted", ABOUT, Grade.USABLE,
    condition=f"the same by at most {100 * GOOD_LEVELS[0]:g} %, and {100 * GOOD_LEVELS[1]:g} % for each of them",
    why="setups differ by more",
)  # fmt: skip
NOT_SIMULATED = RULES.add("vehicle cannot be simulated", ABOUT, Grade.NOT_USABLE,
    condition="no model of the car can be simulated with other dampers, or one of its own tests cannot be simulated",
    why="a run with other shocks may diverge, and the accuracy of predictions is not known",
    remedy="see the notes on the models that were rejected; identify with more or longer tests, or with fewer outputs",
)  # fmt: skip


class Judged(Protocol):
    """What the verdict needs of a fit: see the attributes of `VehicleFit`."""

    @property
    def recipe(self) -> str:
        """Name of the recipe."""
        ...

    @property
    def sources(self) -> Mapping[str, str]:
        """SHA-256 digests of the input files, by name."""
        ...

    @property
    def stable(self) -> bool:
        """Whether the vehicle is stable with all dampers that were tried."""
        ...

    @property
    def residual(self) -> Mapping[str, float]:
        """Relative error of the response [1], by output."""
        ...

    @property
    def trust(self) -> Trust | None:
        """Uncertainty, friction and flags; None if unknown."""
        ...


def fit_verdict(fit: Judged) -> Verdict:
    """Return the verdict on a fit."""
    return Verdict(_reasons(fit))


def _reasons(fit: Judged) -> Iterator[Reason]:
    origin = f"{fit.recipe} fit to {listed(fit.sources) or 'records in memory'}"
    if not fit.stable:
        yield UNSTABLE.reason("the car is not stable with every damper", figure="1 damper or more", origin=origin)
    flags, measures = ({}, {}) if fit.trust is None else (fit.trust.flags, fit.trust.measures)
    errors = {n: error for n, error in level_errors(measures).items() if n.rpartition(".")[2] in _JUDGED}
    if UNUSABLE in flags:
        yield NOT_SIMULATED.reason("the car cannot be simulated", figure=flags[UNUSABLE].rstrip("."), origin=origin)
    worst = max(fit.residual, key=lambda name: fit.residual[name])
    value = fit.residual[worst]
    figure = f"{worst} {100 * value:.1f} %; limit {100 * POOR_FIT:g} %"
    if value >= POOR_FIT:
        yield MISFIT.reason("the model does not reproduce its tests", figure=figure, origin=origin)
    if errors:
        yield _level_reason(errors, origin)
    elif value < POOR_FIT:
        yield GOOD.reason("the model reproduces its tests", figure=figure, origin=origin)


def _level_reason(errors: Mapping[str, float], origin: str) -> Reason:
    worst = max(errors, key=lambda name: errors[name])
    both = (math.sqrt(sum(value**2 for value in errors.values()) / len(errors)), errors[worst])
    figure = f"RMS {100 * both[0]:.1f} %, worst {worst} {100 * both[1]:.1f} %"
    if all(error <= limit for error, limit in zip(both, GOOD_LEVELS, strict=True)):
        return GOOD_OWN_TESTS.reason("the car predicts the levels of its own tests", figure=figure, origin=origin)
    poor = any(error >= limit for error, limit in zip(both, POOR_LEVELS, strict=True))
    rule, limits = (WRONG_LEVELS, POOR_LEVELS) if poor else (DOUBTFUL_LEVELS, GOOD_LEVELS)
    figure += f"; limits {100 * limits[0]:g} and {100 * limits[1]:g} %"
    return rule.reason("the car predicts wrong levels of its own tests", figure=figure, origin=origin)
