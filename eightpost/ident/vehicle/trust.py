"""Uncertainty of an identified vehicle, as stored in its fit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from pydantic import TypeAdapter

from eightpost.uncertainty import MeasureUncertainty

#: Flag of a vehicle that cannot be simulated, so that no setup can be predicted.
UNUSABLE = "unusable"

#: Its sentence on a vehicle that cannot be simulated with the shocks of its own tests.
NOT_SIMULATED = (
    "A test could not be simulated with its own shocks in the loop, so the accuracy of predicted measures is not known."
)

#: Number of standard deviations above which a force is significant [1].
SIGNIFICANT = 4.0


class PolePair(NamedTuple):
    """Pole pair of a model: frequency [Hz], damping ratio [1], and whether the next lower order has it too."""

    frequency: float
    damping: float
    steady: bool


class OrderCandidate(NamedTuple):
    """Model of one order: number of states, ratio of its singular value to the next one, and its poles."""

    states: int
    gap: float
    poles: tuple[PolePair, ...]


@dataclass(frozen=True, slots=True)
class Orders:
    """Choice of the number of states."""

    tried: tuple[OrderCandidate, ...]  #: Models of increasing order.
    chosen: int  #: Number of states of the chosen model, without the road lags.
    #: Whether a clear gap of the singular values gives the order; otherwise the description length does.
    is_clear: bool
    high: float  #: Highest frequency of the fit [Hz].


@dataclass(frozen=True, slots=True)
class ForceEstimate:
    """Estimated force at a port."""

    value: float  #: Force [N].
    deviation: float  #: Standard deviation of the force [N].

    @property
    def is_significant(self) -> bool:
        """Whether the force is significant, i.e. not explained by noise."""
        return abs(self.value) > SIGNIFICANT * self.deviation

    @property
    def text(self) -> str:
        """The force and twice its standard deviation as text."""
        return f"{self.value:.1f} +- {2.0 * self.deviation:.1f} N"


@dataclass(frozen=True, slots=True)
class OutputTrust:
    """Uncertainty of one output."""

    response: float  #: Relative standard deviation of the model's responses, RMS over inputs and frequencies [1].
    #: Relative standard deviation of the output's RMS on the drive of the tests [1]; the largest value with linear
    #: dampers of half, one and two times the baseline damping.
    measure: float
    misfit: float  #: RMS of model minus estimate in standard deviations of the estimate; 1 if noise explains it.
    #: RMS of the part that no linear response explains, with friction at the ports relative to without [1]; None if
    #: friction was not estimated.
    with_friction: float | None = None


@dataclass(frozen=True, slots=True)
class Trust:
    """Uncertainty and limits of a fit."""

    outputs: Mapping[str, OutputTrust]  #: Uncertainty by output.
    #: Estimated sliding friction by port, significant or not; empty if friction was not estimated.
    friction: Mapping[str, ForceEstimate] = field(default_factory=dict)
    #: Spring force that grows with the square of the travel, at the RMS travel, by port; empty if it was not estimated.
    springs: Mapping[str, ForceEstimate] = field(default_factory=dict)
    #: Sentences on effects in the car that a linear model does not have, by `friction`, `springs`, `lift-off`, `misfit`
    #: and `unexplained`; and why it cannot be simulated, by `UNUSABLE`.
    flags: Mapping[str, str] = field(default_factory=dict)
    orders: Orders | None = None  #: Choice of the number of states.
    samples: int = 0  #: Number of models with resampled noise or drawn parameters that give the standard deviations.
    #: Uncertainty of RMS measures of setups on other drives, by measure: the outputs and the sum of the tire forces;
    #: empty if it was not estimated.
    measures: Mapping[str, MeasureUncertainty] = field(default_factory=dict)

    def as_json(self) -> Any:
        """Return the content as JSON values."""
        return _ADAPTER.dump_python(self, mode="json")

    @classmethod
    def of_json(cls, content: Any) -> Trust:
        """Return the object from JSON values that `as_json` returned; ValueError: the JSON values have another form."""
        return _ADAPTER.validate_python(content)


_ADAPTER: TypeAdapter[Trust] = TypeAdapter(Trust)
