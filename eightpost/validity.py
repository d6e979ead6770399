"""Validity of a model: its verdict, ranges and uncertainty, passed on from the fit to the FMU and to a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from math import isfinite
from typing import Any, Literal, Protocol, TypeVar, get_args

from eightpost.errors import InputError
from eightpost.files import check_schema
from eightpost.model_uncertainty import ModelUncertainty
from eightpost.verdict import KEY, Reason, Verdict, digest_of, edited, edits_in

#: Schema version of the JSON document that is written, and the only one that is read.
SCHEMA = 1

#: Path of the document in an FMU built by eightpost.
MEMBER = "resources/eightpost.json"

Kind = Literal["amplitude", "frequency", "condition"]


@dataclass(frozen=True, slots=True)
class Range:
    """Range of one quantity that the records of a fit covered."""

    variable: str  #: Name of the model's variable, or name of the condition.
    #: "amplitude" of the variable about its mean, "frequency" range of the variable's power, or "condition" of the
    #: measurement that is not a variable of the model.
    kind: Kind
    low: float  #: Lowest value, SI.
    high: float  #: Highest value, SI.
    unit: str  #: SI unit.

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
    """Verdict on a model and ranges in which it can be used."""

    verdict: Verdict  #: Verdict on the model itself, from its fit and its validation.
    ranges: tuple[Range, ...] = ()  #: Ranges covered by the records of the fit.
    #: Uncertainty of the model's measures or parameters; None if it is not known.
    uncertainty: ModelUncertainty | None = None
    #: Digest of the model's numbers and of the above; None if they are from a version without digests.
    judged: str | None = None

    @classmethod
    def with_verdict(cls, known: Validity | None, verdict: Verdict) -> Validity:
        """Return the validity with the reasons of a new verdict; they replace earlier reasons on the same subjects."""
        if known is None:
            return cls(verdict)
        kept = [reason for reason in known.verdict.reasons if reason.about not in verdict.grades]
        return replace(known, verdict=Verdict((*kept, *verdict.reasons)), judged=None)

    def tied_to(self, numbers: Mapping[str, Any]) -> Validity:
        """Return the validity with its digest, which ties it to the numbers of a model."""
        return replace(self, judged=self._digest(numbers))

    def checked(self, numbers: Mapping[str, Any], origin: str) -> Validity:
        """Return what is known about a model with these numbers: nothing if they are not those that were judged.

        Args:
            numbers: Numbers of the model.
            origin: Name of the model or of its file.
        """
        is_known = bool(self.edits) and self.edits == self.verdict.reasons
        if self.judged is None or is_known or self.judged == self._digest(numbers):
            return self
        return Validity(edited(origin), judged=self.judged)

    @property
    def edits(self) -> tuple[Reason, ...]:
        """Reasons that say that the model's numbers are not those that were judged."""
        return edits_in(self.verdict)

    def _digest(self, numbers: Mapping[str, Any]) -> str:
        stated = {name: value for name, value in self.to_json().items() if name not in ("schema", "verdict", KEY)}
        return digest_of({"numbers": numbers, "reasons": self.verdict.to_json()["reasons"], **stated})

    def to_json(self) -> dict[str, Any]:
        """Return the validity as a JSON document."""
        return {
            "schema": SCHEMA,
            "verdict": self.verdict.to_json(),
            "ranges": [asdict(covered) for covered in self.ranges],
            **({} if self.uncertainty is None else {"uncertainty": self.uncertainty.to_json()}),
            **({} if self.judged is None else {KEY: self.judged}),
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
        stated, verdict = document.get("uncertainty"), Verdict.from_json(document.get("verdict"))
        uncertainty = None if stated is None else ModelUncertainty.from_json(stated)
        try:
            return cls(verdict, tuple(Range(**entry) for entry in ranges), uncertainty, _judged(document, verdict))
        except TypeError as error:
            raise InputError(f"a model's validity: {error}") from error


def _judged(document: Mapping[str, Any], verdict: Verdict) -> str | None:
    """Return the digest that a document states, or an empty one if its grade is not that of its reasons."""
    if document.get(KEY) is None:
        return None
    return str(document[KEY]) if document["verdict"].get("grade") == verdict.grade else ""


class _Model(Protocol):
    """Model whose numbers a verdict is about."""

    @property
    def validity(self) -> Validity | None: ...

    @property
    def numbers(self) -> Mapping[str, Any]: ...


_M = TypeVar("_M", bound=_Model)


def judged(model: _M, **changes: Any) -> _M:
    """Return a model with changes, and with its verdict tied to the numbers as they then are.

    For code that judges a model, or that writes the same model in another form. Any other change of the numbers leaves
    the verdict unknown.
    """
    validity = changes.pop("validity", model.validity)
    bare: _M = replace(model, validity=None, **changes)  # type: ignore[type-var]
    return bare if validity is None else replace(bare, validity=validity.tied_to(bare.numbers))  # type: ignore[type-var]
