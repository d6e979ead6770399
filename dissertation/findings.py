"""What was computed for an item, and how far it is from the printed values, in words."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING

from dissertation.item import Basis, Claim, Item, PrintedValue
from eightpost.errors import InputError
from eightpost.report.tables import plain
from eightpost.units import si_factor

if TYPE_CHECKING:
    from eightpost.report.page import Block

#: Units of which values are already in print's unit.
_KEPT = ("", "%", "dB")

#: Relative difference up to which a value with the printed digits is equal [1].
_CLOSE = 0.06

#: Largest ratio that is stated in percent; beyond, it is stated as a factor [1].
_IN_PERCENT = 1.5


@dataclass(frozen=True, slots=True)
class Findings:
    """Result of an item's computation."""

    #: Our value for each printed value, in SI units; percent, dB and plain numbers as they are.
    values: Mapping[str, float] = field(default_factory=dict)
    #: Whether each statement holds, and the finding behind it.
    claims: Mapping[str, tuple[bool, str]] = field(default_factory=dict)
    blocks: Sequence[Block] = ()  #: Figures and tables to show.
    note: str = ""  #: Remark, such as the reason for a difference.
    is_partial: bool = False  #: Whether values were left out to save time.


@dataclass(frozen=True, slots=True)
class Comparison:
    """A printed value beside ours."""

    printed: PrintedValue  #: Printed value.
    ours: float  #: Our value in the printed unit.

    @classmethod
    def of(cls, printed: PrintedValue, value: float) -> Comparison:
        """Return the comparison with a value in SI units."""
        unit = printed.unit
        return cls(printed, float(value) if unit in _KEPT else float(value) / si_factor(unit))

    @property
    def has_printed_digits(self) -> bool:
        """Whether our value has every printed digit after rounding."""
        text = self.printed.text
        if len(self.printed.numbers) > 1 or text[0] in "<>":
            return False
        half = 0.5 * 10.0 ** -len(text.partition(".")[2])
        return abs(self.ours - float(text)) <= half * (1.0 + 1e-9)

    @property
    def is_equal(self) -> bool:
        """Whether our value has every printed digit and is close: 0.54 rounds to 1, but does not equal it."""
        return self.has_printed_digits and abs(self.excess) <= _CLOSE

    @property
    def is_within(self) -> bool | None:
        """Whether our value is within the tolerance; None if there is no tolerance."""
        within = self.printed.within
        if not within:
            return None
        if within == "digits":
            return self.has_printed_digits or self.excess == 0.0
        if within.endswith("%"):
            return abs(self.excess) <= float(within[:-1]) / 100.0
        ratio = 1.0 + self.excess
        return ratio > 0.0 and 1.0 / float(within[1:]) <= ratio <= float(within[1:])

    @property
    def words(self) -> str:
        """Difference in words."""
        text, excess = self.printed.text, self.excess
        if self.is_equal:
            return "equal in every printed digit"
        if excess == 0.0:
            return "as printed" if text[0] in "<>" or ".." in text else "equal"
        target = "the printed limit" if text[0] in "<>" else "the printed range" if ".." in text else ""
        if not all(self.printed.numbers):
            return (
                f"{plain(abs(self.ours), 2)} {self.printed.unit}".rstrip()
                + (" above" if self.ours > 0 else " below")
                + " 0"
            )
        rounded = ", which rounds to the printed digits" if self.has_printed_digits else ""
        return _in_words(excess, target) + rounded

    @property
    def excess(self) -> float:
        """Relative distance from the printed value, range or limit; 0 inside."""
        numbers, text = self.printed.numbers, self.printed.text
        low, high = min(numbers), max(numbers)
        if (text[0] != "<" and self.ours < low) or (text[0] != ">" and self.ours > high):
            nearest = high if self.ours > high else low
            return self.ours / nearest - 1.0 if nearest else self.ours
        return 0.0

    @property
    def shown(self) -> str:
        """Our value with one digit more than printed, at least three significant ones."""
        first = self.printed.text.lstrip("<>").partition("..")[0]
        digits = max(3, len(first.lstrip("-0.").replace(".", "")) + 1)
        return plain(self.ours, digits if self.has_printed_digits else min(digits, 4))


def _in_words(excess: float, target: str) -> str:
    ratio = 1.0 + excess
    if abs(ratio) < 1e-3:
        return f"0 instead of {target or 'the printed value'}"
    if 1.0 / _IN_PERCENT <= ratio <= _IN_PERCENT:
        side = ("above" if excess > 0.0 else "below") if target else ("higher" if excess > 0.0 else "lower")
        return f"{plain(100.0 * abs(excess), 2)} % {side} {target}".rstrip()
    return f"{plain(ratio, 2)} times {target or 'the printed value'}"


@dataclass(frozen=True, slots=True)
class CheckedClaim:
    """A statement of the text and what we found."""

    claim: Claim  #: Statement.
    holds: bool  #: Whether it holds.
    finding: str  #: Numbers behind it.


class State(StrEnum):
    """State of an item's reproduction."""

    REPRODUCED = "reproduced"
    STAND_IN = "reproduced on the stand-in"
    PARTLY = "partly reproduced on the stand-in"
    SHOWN = "shown on the stand-in"
    DIFFERS = "differs"
    FAILED = "failed"
    NOTHING = "nothing to compute"


@dataclass(frozen=True, slots=True)
class Outcome:
    """An item with its computation."""

    item: Item  #: Item.
    findings: Findings | None = None  #: Result of the computation; None for an item without one.
    seconds: float = 0.0  #: Time of the computation [s].
    error: str = ""  #: Error message of a computation that failed.

    def __post_init__(self) -> None:
        found = self.findings
        if found is None:
            return
        expected = {printed.key for printed in self.item.values}, {claim.key for claim in self.item.claims}
        missing = expected[0] - set(found.values) if found.is_partial else set()
        if (set(found.values) | missing, set(found.claims)) != expected:
            raise InputError(
                f"{self.item.label}: computed {sorted(found.values)} and {sorted(found.claims)}, printed are "
                f"{sorted(expected[0])} and {sorted(expected[1])}"
            )

    @property
    def comparisons(self) -> tuple[Comparison, ...]:
        """Printed values beside ours."""
        found = self.findings
        if found is None:
            return ()
        return tuple(Comparison.of(one, found.values[one.key]) for one in self.item.values if one.key in found.values)

    @property
    def claims(self) -> tuple[CheckedClaim, ...]:
        """Checked statements."""
        found = self.findings
        return tuple(CheckedClaim(one, *found.claims[one.key]) for one in self.item.claims) if found else ()

    @property
    def beyond(self) -> tuple[str, ...]:
        """Differences beyond their tolerance, in words."""
        numbers = (f"{one.printed.what}: {one.words}" for one in self.comparisons if one.is_within is False)
        texts = (
            f"{one.claim.statement}: {one.finding}" for one in self.claims if one.claim.is_judged and not one.holds
        )
        return (*numbers, *texts)

    @property
    def state(self) -> State:
        """State of the reproduction."""
        if self.error:
            return State.FAILED
        if self.findings is None:
            return State.NOTHING
        if self.beyond:
            return State.DIFFERS
        return self._on_stand_in() if self.item.basis is Basis.STAND_IN else State.REPRODUCED

    def _on_stand_in(self) -> State:
        """Return how much of an item without differences beyond tolerance the stand-in reproduces.

        It is shown only if nothing is judged and no statement holds, and partly reproduced if a reported statement does
        not hold.
        """
        held = [one.holds for one in self.claims]
        is_judged = any(one.is_within is not None for one in self.comparisons)
        if not is_judged and not any(held):
            return State.SHOWN
        return State.STAND_IN if all(held) else State.PARTLY

    @property
    def words(self) -> str:
        """Difference between printed and ours in one sentence."""
        if self.error:
            return self.error
        if self.findings is None:
            return self.item.reason
        parts = [text for text in (_of_values(self.comparisons), _of_claims(self.claims)) if text]
        return "; ".join(parts) or "no value in print; the picture is drawn from our computation"


def _of_values(found: Sequence[Comparison]) -> str:
    if not found:
        return ""
    if len(found) == 1:
        return f"{found[0].printed.what}: {found[0].words}"
    exact = sum(one.is_equal for one in found)
    if exact == len(found):
        return f"{'both' if len(found) == 2 else f'all {len(found)}'} values equal in every printed digit"
    judged = [one for one in found if one.is_within is not None]
    inside = f"{sum(bool(one.is_within) for one in judged)} of {len(judged)} values within tolerance" if judged else ""
    farthest = max(found, key=lambda one: abs(_logarithm(one)))
    worst = f"largest difference of {len(found)}: {farthest.printed.what}, {farthest.words}"
    digits = f"{exact} of {len(found)} equal in every printed digit" if exact else ""
    return "; ".join(text for text in (inside, digits, worst) if text)


def _logarithm(one: Comparison) -> float:
    """Return the logarithm of the ratio to the printed value, so that half and double are equally far."""
    ratio = 1.0 + one.excess
    return float("inf") if ratio <= 0.0 else math.log(ratio)


def _of_claims(found: Sequence[CheckedClaim]) -> str:
    if not found:
        return ""
    held = sum(one.holds for one in found)
    failing = ", ".join(one.claim.statement for one in found if not one.holds)
    return f"{held} of {len(found)} statements hold" + (f"; not: {failing}" if failing else "")
