"""What a model carries from its fit to its FMU and on into a run: the verdict on it, and the ranges that it covers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from math import isfinite
from typing import Any, Literal, get_args

from eightpost.errors import InputError
from eightpost.verdict import Verdict

#: The newest layout of such a document that is understood, and the one written.
SCHEMA = 1

#: Where an FMU of ours has it.
MEMBER = "resources/eightpost.json"

Kind = Literal["amplitude", "frequency", "condition"]


@dataclass(frozen=True, slots=True)
class Range:
    """What the records of a fit covered of one quantity.

    Args:
        variable: Name of the model's variable; of a condition, the condition's name.
        kind: amplitude: of the variable about its mean. frequency: of the variable's power. condition: of the
            measurement, which the model does not have as a variable.
        low: Lowest value, SI.
        high: Highest value, SI.
        unit: SI unit.
    """

    variable: str
    kind: Kind
    low: float
    high: float
    unit: str

    def __post_init__(self) -> None:
        numbers = (self.low, self.high)
        if not all(type(n) in (int, float) and isfinite(n) for n in numbers) or self.low > self.high:
            raise InputError(f"the range of {self.variable!r} must be two rising numbers, not {numbers!r}")
        if self.kind not in get_args(Kind):
            raise InputError(
                f"the range of {self.variable!r}: kind is {self.kind!r}, not {' or '.join(get_args(Kind))}"
            )

    def __str__(self) -> str:
        return f"{self.low:.3g} to {self.high:.3g} {self.unit}"


@dataclass(frozen=True, slots=True)
class Validity:
    """How far a model can be used.

    Args:
        verdict: On the model itself: its fit, its validation.
        ranges: Ranges that the model's records covered.
    """

    verdict: Verdict
    ranges: tuple[Range, ...] = ()

    @classmethod
    def with_verdict(cls, known: Validity | None, verdict: Verdict) -> Validity:
        """Return what is known of a model with another verdict on it; it replaces reasons about the same things."""
        if known is None:
            return cls(verdict)
        kept = [reason for reason in known.verdict.reasons if reason.about not in verdict.grades]
        return cls(Verdict((*kept, *verdict.reasons)), known.ranges)

    def to_json(self) -> dict[str, Any]:
        """Return what a JSON file holds."""
        return {
            "schema": SCHEMA,
            "verdict": self.verdict.to_json(),
            "ranges": [asdict(covered) for covered in self.ranges],
        }

    @classmethod
    def from_json(cls, document: object) -> Validity:
        """Return what `to_json` wrote.

        Raises:
            InputError: The document is something else, or of a newer schema.
        """
        if not isinstance(document, Mapping):
            raise InputError(f"a model's validity must be an object, not {type(document).__name__}")
        if document.get("schema") != SCHEMA:
            raise InputError(f"a model's validity has schema {document.get('schema')!r}, this version reads {SCHEMA}")
        ranges = document.get("ranges", [])
        if not isinstance(ranges, Sequence) or not all(isinstance(entry, Mapping) for entry in ranges):
            raise InputError("a model's validity: ranges must be a list of objects")
        try:
            return cls(Verdict.from_json(document.get("verdict")), tuple(Range(**entry) for entry in ranges))
        except TypeError as error:
            raise InputError(f"a model's validity: {error}") from error
