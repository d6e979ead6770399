"""Validity of a model: its verdict, ranges and uncertainty, passed on from the fit to the FMU and to a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from math import isfinite
from typing import Any, Literal, get_args

from eightpost.errors import InputError
from eightpost.files import check_schema
from eightpost.model_uncertainty import ModelUncertainty
from eightpost.verdict import Verdict

#: Schema version of the JSON document that is written, and the only one that is read.
SCHEMA = 1

#: Path of the document in an FMU built by eightpost.
MEMBER = "resources/eightpost.json"

Kind = Literal["amplitude", "frequency", "condition"]


@dataclass(frozen=True, slots=True)
class Range:
    """Range of one quantity that the records of a fit covered.

    Attributes:
        variable: Name of the model's variable, or name of the condition.
        kind: "amplitude" of the variable about its mean, "frequency" range of the variable's power, or "condition" of
            the measurement that is not a variable of the model.
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
            raise InputError(f"the range of {self.variable!r} must be two increasing numbers, not {numbers!r}")
        if self.kind not in get_args(Kind):
            raise InputError(
                f"the range of {self.variable!r}: kind is {self.kind!r}, not {' or '.join(get_args(Kind))}"
            )

    def __str__(self) -> str:
        return f"{self.low:.3g} to {self.high:.3g} {self.unit}"


@dataclass(frozen=True, slots=True)
class Validity:
    """Verdict on a model and ranges in which it can be used.

    Attributes:
        verdict: Verdict on the model itself, from its fit and its validation.
        ranges: Ranges covered by the records of the fit.
        uncertainty: Uncertainty of the model's measures or parameters; None if it is not known.
    """

    verdict: Verdict
    ranges: tuple[Range, ...] = ()
    uncertainty: ModelUncertainty | None = None

    @classmethod
    def with_verdict(cls, known: Validity | None, verdict: Verdict) -> Validity:
        """Return the validity with the reasons of a new verdict; they replace earlier reasons on the same subjects."""
        if known is None:
            return cls(verdict)
        kept = [reason for reason in known.verdict.reasons if reason.about not in verdict.grades]
        return replace(known, verdict=Verdict((*kept, *verdict.reasons)))

    def to_json(self) -> dict[str, Any]:
        """Return the validity as a JSON document."""
        return {
            "schema": SCHEMA,
            "verdict": self.verdict.to_json(),
            "ranges": [asdict(covered) for covered in self.ranges],
            **({} if self.uncertainty is None else {"uncertainty": self.uncertainty.to_json()}),
        }

    @classmethod
    def from_json(cls, document: object) -> Validity:
        """Return the validity of a document written by `to_json`.

        Raises:
            InputError: The document is not a validity, or has another schema version.
        """
        if not isinstance(document, Mapping):
            raise InputError(f"a model's validity must be an object, not {type(document).__name__}")
        check_schema(document, SCHEMA, None, what="validity")
        ranges = document.get("ranges", [])
        if not isinstance(ranges, Sequence) or not all(isinstance(entry, Mapping) for entry in ranges):
            raise InputError("a model's validity: ranges must be a list of objects")
        stated = document.get("uncertainty")
        uncertainty = None if stated is None else ModelUncertainty.from_json(stated)
        try:
            return cls(Verdict.from_json(document.get("verdict")), tuple(Range(**e) for e in ranges), uncertainty)
        except TypeError as error:
            raise InputError(f"a model's validity: {error}") from error
