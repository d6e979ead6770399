"""Verdict on an identified vehicle, from its fit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Protocol

from eightpost.ident.vehicle.trust import UNUSABLE, Trust
from eightpost.verdict import Grade, Reason, Rules, Verdict

ABOUT = "fit of the vehicle"

#: Limits of the misfit of an output, weighted by frequency as in the fit [1].
GOOD_FIT, POOR_FIT = 0.1, 0.3

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
DOUBTFUL_FIT = RULES.add("notable misfit of the vehicle", ABOUT, Grade.LIMITED,
    condition=f"misfit of an output above {100 * GOOD_FIT:g} %",
    why="differences between setups are of similar size",
    remedy="compare setups by the other outputs, and validate on other records (eightpost validate)",
)  # fmt: skip
GOOD = RULES.add("small misfit of the vehicle", ABOUT, Grade.USABLE,
    condition=f"misfit of every output at most {100 * GOOD_FIT:g} %",
    why="differences between setups are larger",
)  # fmt: skip
FLAG = RULES.add("flag of the identification", ABOUT, Grade.LIMITED,
    condition="the tests show effects that a linear model does not have: nonlinear springs, tires that lift off, a "
    "misfit larger than noise, an output that no input explains",
    why="the model is accurate only near the amplitudes of the tests",
    remedy="test at the amplitudes of the track, and validate on other records (eightpost validate)",
)  # fmt: skip
NOT_SIMULATED = RULES.add("vehicle cannot be simulated", ABOUT, Grade.NOT_USABLE,
    condition="no model of the car can be simulated with other dampers, or one of its own tests cannot be simulated",
    why="a run with other shocks may diverge, and the accuracy of predictions is not known",
    remedy="see the notes on the models that were rejected; identify with more or longer tests, or with fewer outputs",
)  # fmt: skip


#: Flags that need no reason, because the model includes the effect.
_MODELLED = ("friction", "port springs")


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
    origin = f"{fit.recipe} fit to {', '.join(fit.sources) or 'records in memory'}"
    if not fit.stable:
        yield UNSTABLE.reason("the car is not stable with every damper", figure="1 damper or more", origin=origin)
    worst = max(fit.residual, key=lambda name: fit.residual[name])
    value = fit.residual[worst]
    rule = GOOD if value <= GOOD_FIT else DOUBTFUL_FIT if value < POOR_FIT else MISFIT
    statement = "the model reproduces its tests" if rule is GOOD else "the model does not reproduce its tests well"
    figure = f"{worst} {100 * value:.1f} %; limits {100 * GOOD_FIT:g} and {100 * POOR_FIT:g} %"
    yield rule.reason(statement, figure=figure, origin=origin)
    for name, sentence in ({} if fit.trust is None else fit.trust.flags).items():
        if name == UNUSABLE:
            yield NOT_SIMULATED.reason("the car cannot be simulated", figure=sentence.rstrip("."), origin=origin)
        elif name not in _MODELLED:
            yield FLAG.reason("the car is not fully linear", figure=sentence.rstrip("."), origin=origin)
