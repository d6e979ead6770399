"""What the search for target curves of a study is asked for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from cosim.study.choice.continuous import Robustness
from eightpost.errors import InputError
from eightpost.shock.shape import CURVE_NUMBERS, NUMBERS, unit_of

#: Largest tolerance [1]: with a third, a drawn number is rarely below zero.
_WIDEST = 0.33


@dataclass(frozen=True, slots=True)
class Request:
    """What to search.

    Raises:
        InputError: There is no such number, limits are in the wrong order or of a number that does not vary, or the
            tolerance or the share of the gain is out of range.
    """

    #: Names of the numbers that vary; the others are those of the best build of the bank at each corner.
    vary: tuple[str, ...] = CURVE_NUMBERS
    #: Lower and upper limit [SI] by number; numbers without limits range over the bank.
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    corners: tuple[str, ...] = ()  #: Corners whose shocks are searched, with those that are alike; empty: all.
    tolerance: float = 0.03  #: Standard deviation of every number from shock to shock, as a share of its value [1].
    #: Draws of the tolerance, and weight of the scatter.
    robustness: Robustness = field(default_factory=lambda: Robustness(6))
    starts: int = 3  #: Number of starts of the search: the best setup of the bank, the baseline, and random points.
    keep: float = 0.8  #: Share of the gain that the band keeps [1].
    objective: str = ""  #: Measure to minimise; empty: the objective of the study.
    seed: int = 0  #: Seed of the random starts.
    uncertain: bool = True  #: Whether the errors that the vehicle states are drawn too.

    def __post_init__(self) -> None:
        if not 0.0 <= self.tolerance <= _WIDEST:
            raise InputError(f"tolerance must be 0 to {100.0 * _WIDEST:g} %, not {100.0 * self.tolerance:g} %")
        if not 0.0 < self.keep <= 1.0:
            raise InputError(
                f"keep, the share of the gain, must be above 0 and at most 100 %, not {100.0 * self.keep:g} %"
            )
        for name in (*self.vary, *self.limits):
            if name not in NUMBERS:
                raise InputError(f"a shape has no number {name!r}; its numbers are {', '.join(NUMBERS)}")
        for name, (low, high) in self.limits.items():
            if not low < high:
                unit = unit_of(name)
                raise InputError(f"limits of {name}: the lower one, {low:g} {unit}, must be below {high:g} {unit}")
            if name not in self.vary:
                raise InputError(f"there are limits of {name}, which does not vary; name it with --vary too")
