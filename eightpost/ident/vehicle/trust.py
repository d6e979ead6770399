"""How far an identified vehicle is to be trusted, in figures that its fit keeps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from pydantic import TypeAdapter

#: A force of fewer standard deviations than this is none.
SIGNIFICANT = 4.0


class PlacedPole(NamedTuple):
    """One pole pair of one model: frequency [Hz], damping ratio, and whether the order before has it too."""

    frequency: float
    damping: float
    steady: bool


class TriedOrder(NamedTuple):
    """One number of states that was tried: its singular value over the next one, and its poles."""

    states: int
    gap: float
    poles: tuple[PlacedPole, ...]


@dataclass(frozen=True, slots=True)
class Orders:
    """How the number of states was chosen.

    Attributes:
        tried: Models of rising order.
        chosen: States of the one that was taken, lags of the roads not counted.
        is_clear: Whether a clear gap of the singular values tells it; else the description length does.
        high: Highest frequency of the fit [Hz].
    """

    tried: tuple[TriedOrder, ...]
    chosen: int
    is_clear: bool
    high: float


@dataclass(frozen=True, slots=True)
class FoundForce:
    """A force that was found at a port.

    Attributes:
        value: [N].
        deviation: Its standard deviation [N].
    """

    value: float
    deviation: float

    @property
    def is_significant(self) -> bool:
        """Whether it is told from noise."""
        return abs(self.value) > SIGNIFICANT * self.deviation

    @property
    def said(self) -> str:
        """The force and twice its deviation, in words."""
        return f"{self.value:.1f} +- {2.0 * self.deviation:.1f} N"


@dataclass(frozen=True, slots=True)
class OutputTrust:
    """What is known of one output.

    Attributes:
        response: Standard deviation of the model's responses over the responses, RMS over inputs and frequencies [1].
        measure: Standard deviation of the output's RMS on the tests' own drive over that RMS [1], the largest of linear
            dampers of half, once and twice the baseline's.
        misfit: RMS of model less estimate in deviations of the estimate; 1 where noise explains it.
        with_friction: What no linear response explains with friction at the ports, RMS over that without [1]; None
            where friction was not looked for.
    """

    response: float
    measure: float
    misfit: float
    with_friction: float | None = None


@dataclass(frozen=True, slots=True)
class Trust:
    """What a fit says of itself.

    Attributes:
        outputs: By output.
        friction: Sliding friction by port as it was found, significant or not; empty where it was not looked for.
        springs: By port, the force of a spring that grows with the square of the travel, at the travel's RMS; empty
            where it was not looked for.
        flags: What is in the car and not in a linear model of it, a sentence each, by `friction`, `springs`,
            `lift-off`, `misfit`, `unexplained`.
        orders: How the number of states was chosen.
        samples: From how many models with other noise the deviations are.
    """

    outputs: Mapping[str, OutputTrust]
    friction: Mapping[str, FoundForce] = field(default_factory=dict)
    springs: Mapping[str, FoundForce] = field(default_factory=dict)
    flags: Mapping[str, str] = field(default_factory=dict)
    orders: Orders | None = None
    samples: int = 0

    def as_json(self) -> Any:
        """Return it as what JSON holds."""
        return _ADAPTER.dump_python(self, mode="json")

    @classmethod
    def of_json(cls, content: Any) -> Trust:
        """Return what `as_json` gave.

        Raises:
            ValueError: It is something else.
        """
        return _ADAPTER.validate_python(content)


_ADAPTER: TypeAdapter[Trust] = TypeAdapter(Trust)
