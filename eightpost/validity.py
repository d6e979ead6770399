"""Validity of a model: its verdict, ranges and uncertainty, passed on from the fit to the FMU and to a run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from math import inf, isfinite
from typing import TYPE_CHECKING, Any, Literal, Protocol, TypeVar, get_args

from eightpost.errors import InputError
from eightpost.files import check_schema
from eightpost.verdict import KEY, Reason, Verdict, digest_of, edited, edits_in

if TYPE_CHECKING:
    from eightpost.uncertainty import LeftOutBlocks, MeasureUncertainty


# ---- Uncertainty ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class ParameterUncertainty:
    """Uncertainty of one parameter of a fitted model, in the parameter's unit.

    Raises:
        InputError: A standard deviation is negative or not finite.
    """

    name: str  #: Name of the parameter in the FMU.
    deviation: float  #: Standard deviation due to the fit; all copies of the model share this error.
    #: Standard deviation from one copy of the part to another (build to build); None if it is not known.
    copies: float | None = None
    lowest: float = -inf  #: Lower limit of the parameter.
    highest: float = inf  #: Upper limit of the parameter.

    def __post_init__(self) -> None:
        for what, value in (("deviation", self.deviation), ("copies", self.copies)):
            if value is not None and not (isfinite(value) and value >= 0.0):
                raise InputError(
                    f"the uncertainty of the parameter {self.name!r}: {what} is {value!r}; it must be a number of 0 or "
                    "more"
                )


@dataclass(frozen=True, slots=True)
class ModelUncertainty:
    """Uncertainty of a model."""

    #: Uncertainty of the RMS of the outputs of an identified vehicle, by output; see MeasureUncertainty.
    measures: Mapping[str, MeasureUncertainty] = field(default_factory=dict)
    parameters: tuple[ParameterUncertainty, ...] = ()  #: Uncertainty of the parameters of a fitted shock.
    held: tuple[str, ...] = ()  #: A sentence for each parameter whose uncertainty the fit could not determine.
    #: Changes of the parameters when blocks of the fit's test are left out, which show what several fits have in
    #: common; None if they are not known.
    left_out: LeftOutBlocks | None = None

    def to_json(self) -> dict[str, Any]:
        """Return the uncertainty as a JSON document; open limits are omitted."""
        return {
            "measures": {name: one.to_json() for name, one in self.measures.items()},
            "parameters": [_finite(asdict(one)) for one in self.parameters],
            "held": list(self.held),
            **(self.left_out.section() if self.left_out else {}),
        }

    @classmethod
    def from_json(cls, document: object) -> ModelUncertainty:
        """Return the uncertainty of a document written by `to_json`.

        Raises:
            InputError: The document is not an uncertainty.
        """
        if not isinstance(document, Mapping):
            raise InputError(f"a model's uncertainty must be an object, not {type(document).__name__}")
        from eightpost.schema import checked  # noqa: PLC0415 -- help texts do not need it
        from eightpost.uncertainty import MeasureUncertainty, left_out_of  # noqa: PLC0415 -- loads numpy

        place = "uncertainty.parameters"
        parameters = checked(tuple[ParameterUncertainty, ...], document.get("parameters", []), place=place)
        held = checked(tuple[str, ...], document.get("held", []), place="uncertainty.held")
        stated = checked(dict[str, dict[str, Any]], document.get("measures", {}), place="uncertainty.measures")
        measures = {name: MeasureUncertainty.from_json(entry) for name, entry in stated.items()}
        return cls(measures, parameters, held, left_out_of(document))


def _finite(entry: dict[str, Any]) -> dict[str, Any]:
    """Return the entries that JSON can represent: without open limits and unknown deviations."""
    return {n: v for n, v in entry.items() if isinstance(v, str) or (v is not None and isfinite(v))}


# ---- Validity -------------------------------------------------------------------------------------------------------

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
        if not -inf < self.low <= self.high < inf:
            raise InputError(f"the range of {self.variable!r} must be two increasing numbers, not {self}")
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
        """Return what is known about a model with these numbers: nothing if they are not those that were judged."""
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
        from eightpost.schema import checked  # noqa: PLC0415 -- help texts do not need it

        if not isinstance(document, Mapping):
            raise InputError(f"a model's validity must be an object, not {type(document).__name__}")
        check_schema(document, SCHEMA, None, what="validity")
        ranges = checked(tuple[Range, ...], document.get("ranges", []), place="validity.ranges")
        stated, verdict = document.get("uncertainty"), Verdict.from_json(document.get("verdict"))
        uncertainty = None if stated is None else ModelUncertainty.from_json(stated)
        return cls(verdict, ranges, uncertainty, _judged(document, verdict))


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
