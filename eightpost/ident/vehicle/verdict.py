"""Verdict on an identified vehicle, from its fit."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Protocol

from eightpost.ident.vehicle.trust import NOT_SIMULATED as NO_SIMULATION
from eightpost.ident.vehicle.trust import UNUSABLE, Trust
from eightpost.measure_uncertainty import TOTAL
from eightpost.verdict import Grade, Reason, Rules, Verdict, listed

ABOUT = "fit of the vehicle"

#: Misfit of an output, weighted by frequency as in the fit, from which a vehicle is not usable [1].
POOR_FIT = 0.3

#: Levels of the car's own tests: error up to which a vehicle is usable, and from which it is not [1].
GOOD_LEVELS, POOR_LEVELS = 0.01, 0.03

#: The same for half the 95 % interval of the total tire force [1].
NARROW, WIDE = 0.05, 0.15

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
    condition="simulated with the shocks of its own tests, the car has levels of shock velocities, tire forces and "
    f"ride heights that are wrong by {100 * POOR_LEVELS:g} % or more (RMS)",
    why="other setups are predicted worse, and setups differ by a few percent",
    remedy="see the other reasons; otherwise identify with another recipe (--recipe)",
)  # fmt: skip
DOUBTFUL_LEVELS = RULES.add("own tests predicted roughly", ABOUT, Grade.LIMITED,
    condition=f"the same by more than {100 * GOOD_LEVELS:g} %",
    why="other setups are predicted worse",
    remedy="rank setups that differ by more, and validate on other records (eightpost validate)",
)  # fmt: skip
GOOD_OWN_TESTS = RULES.add("own tests predicted", ABOUT, Grade.USABLE,
    condition=f"the same by at most {100 * GOOD_LEVELS:g} %",
    why="setups differ by more",
)  # fmt: skip
UNCERTAIN = RULES.add("levels not known", ABOUT, Grade.NOT_USABLE,
    condition=f"the 95 % interval of the total tire force is wider than +-{100 * WIDE:g} %",
    why="that is more than setups differ by",
    remedy="identify with longer tests",
)  # fmt: skip
ROUGH = RULES.add("levels known roughly", ABOUT, Grade.LIMITED,
    condition=f"the same above +-{100 * NARROW:g} %",
    why="setups share most of this error: their order is better known than their levels",
    remedy="do not rely on levels; longer tests make the interval narrower",
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


def fit_verdict(fit: Judged, levels: Mapping[str, float] | None = None) -> Verdict:
    """Return the verdict on a fit.

    Args:
        fit: Fit of a vehicle.
        levels: Relative errors of levels of the car's own tests [1], by output, from a simulation with their shocks;
            empty if a test cannot be simulated, None if they were not.
    """
    return Verdict(_reasons(fit, levels))


def _reasons(fit: Judged, levels: Mapping[str, float] | None) -> Iterator[Reason]:
    origin = f"{fit.recipe} fit to {listed(fit.sources) or 'records in memory'}"
    if not fit.stable:
        yield UNSTABLE.reason("the car is not stable with every damper", figure="1 damper or more", origin=origin)
    flags = {} if fit.trust is None else fit.trust.flags
    if UNUSABLE in flags or levels == {}:
        sentence = flags.get(UNUSABLE, NO_SIMULATION)
        yield NOT_SIMULATED.reason("the car cannot be simulated", figure=sentence.rstrip("."), origin=origin)
    worst = max(fit.residual, key=lambda name: fit.residual[name])
    value = fit.residual[worst]
    figure = f"{worst} {100 * value:.1f} %; limit {100 * POOR_FIT:g} %"
    if value >= POOR_FIT:
        yield MISFIT.reason("the model does not reproduce its tests", figure=figure, origin=origin)
    elif not levels:
        yield GOOD.reason("the model reproduces its tests", figure=figure, origin=origin)
    if levels:
        yield _level_reason(levels, origin)
    stated = None if fit.trust is None else fit.trust.measures.get(TOTAL)
    if stated is not None and (half := stated.half_width(0.0)) > NARROW:
        figure = f"+-{100 * half:.0f} %; limits {100 * NARROW:g} and {100 * WIDE:g} %"
        rule = UNCERTAIN if half > WIDE else ROUGH
        yield rule.reason("the 95 % interval of the total tire force is wide", figure=figure, origin=origin)


def _level_reason(levels: Mapping[str, float], origin: str) -> Reason:
    error = math.sqrt(sum(value**2 for value in levels.values()) / len(levels))
    worst = max(levels, key=lambda name: levels[name])
    figure = f"RMS {100 * error:.1f} %, worst {worst} {100 * levels[worst]:.1f} %"
    if error <= GOOD_LEVELS:
        return GOOD_OWN_TESTS.reason("the car predicts the levels of its own tests", figure=figure, origin=origin)
    rule = WRONG_LEVELS if error >= POOR_LEVELS else DOUBTFUL_LEVELS
    figure += f"; limits {100 * GOOD_LEVELS:g} and {100 * POOR_LEVELS:g} %"
    return rule.reason("the car predicts wrong levels of its own tests", figure=figure, origin=origin)
