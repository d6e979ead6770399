"""Uncertainty of an identified model, passed on from its fit to the FMU and to a study."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from math import inf, isfinite
from typing import TYPE_CHECKING, Any

from eightpost.errors import InputError
from eightpost.files import MALFORMED

if TYPE_CHECKING:
    from eightpost.left_out_blocks import LeftOutBlocks
    from eightpost.measure_uncertainty import MeasureUncertainty


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
        try:
            measures = {str(name): _measure(entry) for name, entry in document.get("measures", {}).items()}
            parameters = tuple(_parameter(entry) for entry in document.get("parameters", []))
            held = tuple(str(text) for text in document.get("held", []))
            return cls(measures, parameters, held, _left_out(document))
        except MALFORMED as error:
            raise InputError(f"a model's uncertainty: {error}") from error


def _finite(entry: dict[str, Any]) -> dict[str, Any]:
    """Return the entries that JSON can represent: without open limits and unknown deviations."""
    return {n: v for n, v in entry.items() if isinstance(v, str) or (v is not None and isfinite(v))}


def _measure(entry: Mapping[str, Any]) -> MeasureUncertainty:
    """Return the uncertainty of a measure; entries of earlier versions are kept for the file's digest."""
    from eightpost.measure_uncertainty import (  # noqa: PLC0415 -- loads numpy, which shocks do not need
        MeasuredLevel,
        MeasureUncertainty,
    )

    levels = tuple(
        MeasuredLevel(float(one["error"]), float(one["deviation"]), float(one["spread"]), tuple(one["shares"]))
        for one in entry.get("levels", [])
    )
    common, own, bias = float(entry["common"]), float(entry["own"]), float(entry.get("bias", 0.0))
    if not (isfinite(bias) and all(isfinite(value) and value >= 0.0 for value in (common, own))):
        raise InputError(f"the uncertainty of a measure must be numbers of 0 or more, not {dict(entry)!r}")
    known = ("common", "own", "bias", "levels")
    earlier = tuple((str(name), float(value)) for name, value in entry.items() if name not in known)
    return MeasureUncertainty(common, own, bias, levels, earlier)


def _left_out(document: Mapping[str, Any]) -> LeftOutBlocks | None:
    from eightpost.left_out_blocks import left_out_of  # noqa: PLC0415 -- loads numpy, which help texts do not need

    return left_out_of(document)


def _parameter(entry: Mapping[str, Any]) -> ParameterUncertainty:
    numbers = {name: float(value) for name, value in entry.items() if name != "name"}
    return ParameterUncertainty(str(entry["name"]), **numbers)
