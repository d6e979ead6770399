"""resources/eightpost.json: the validity of an FMU's model, which a run of the FMU reads."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import fields, replace

from builder.documents.reference import Disclosure
from eightpost.errors import InputError
from eightpost.shock import Shock
from eightpost.shock.fit_uncertainty import shock_uncertainty
from eightpost.validity import MEMBER, Range, Validity
from eightpost.vehicle import StructuralVehicle, Vehicle
from eightpost.vehicle.structural import doubts
from eightpost.verdict import Grade, Reason, Rule, Rules, Verdict

RULES = Rules()

SHOCK_UNKNOWN = RULES.add("fit of the shock unknown", "fit of the shock", Grade.UNKNOWN,
    condition="the shock file contains no verdict: it is from an older version, or was not fitted",
    why="how well it describes a shock was not recorded",
    remedy="fit the record again (eightpost fit), and build again",
)  # fmt: skip
VEHICLE_UNKNOWN = RULES.add("fit of the vehicle unknown", "fit of the vehicle", Grade.UNKNOWN,
    condition="the vehicle file contains no verdict: it is from an older version, or was not identified",
    why="how well it describes a car was not recorded",
    remedy="identify it again (eightpost identify), and build again",
)  # fmt: skip
PARAMETERS_STATED = RULES.add("vehicle of stated parameters", "fit of the vehicle", Grade.LIMITED,
    condition="the vehicle is defined by masses, springs and dampers",
    why="the model represents these parameters; whether they match the real car was not examined",
    remedy="compare it with rig records (eightpost validate --against), or identify the car (eightpost identify)",
)  # fmt: skip
_WHY = "the usual ranges cover karts, sedans, GT and formula cars (eightpost/vehicle/structural.py)"
_CHECK = "check the values and their units in the vehicle file"
PARAMETERS_IMPLAUSIBLE = RULES.add("implausible parameters", "fit of the vehicle", Grade.LIMITED,
    condition="a frequency, ratio, mass, stiffness or distance of the stated parameters is outside its usual range",
    why=_WHY,
    remedy=_CHECK,
)  # fmt: skip
PARAMETERS_IMPOSSIBLE = RULES.add("impossible parameters", "fit of the vehicle", Grade.NOT_USABLE,
    condition="one of them, but not a damping ratio, is more than 1.5 times beyond it",
    why=_WHY,
    remedy=_CHECK,
)  # fmt: skip


def validity_of(source: Shock | Vehicle) -> Validity:
    """Return the validity of a shock or vehicle; that of a shock contains the uncertainty of its fit."""
    if isinstance(source, Shock):
        known = source.validity or _unknown(SHOCK_UNKNOWN, source.name)
        return replace(known, uncertainty=shock_uncertainty(source), judged=None)
    if isinstance(source, StructuralVehicle):
        figure = f"{len(fields(source.parameters))} parameters"
        summary = "the car's parameters were stated, not identified"
        stated = PARAMETERS_STATED.reason(summary, figure=figure, origin=source.name)
        return Validity(Verdict([stated, *_doubtful(source)]))
    if source.validity is not None:
        return replace(source.validity, judged=None)
    return _unknown(VEHICLE_UNKNOWN, source.name)


def _doubtful(source: StructuralVehicle) -> Iterator[Reason]:
    for doubt in doubts(source.parameters):
        rule = PARAMETERS_IMPOSSIBLE if doubt.is_gross else PARAMETERS_IMPLAUSIBLE
        statement = "the parameters are those of no car" if doubt.is_gross else "the parameters are unusual"
        yield rule.reason(statement, figure=doubt.summary, origin=source.name, remedy=doubt.remedy)


def validity_member(source: Shock | Vehicle, identifier: str, disclosure: Disclosure) -> dict[str, bytes]:
    """Return the archive's member; a confidential archive has the FMU's name in place of file names."""
    known = validity_of(source)
    if disclosure is Disclosure.CONFIDENTIAL:
        known = _with_origin(known, identifier)
    return _member(known)


def combined_member(
    parts: Mapping[str, bytes | None], fed: Mapping[str, str], variables: frozenset[str]
) -> dict[str, bytes]:
    """Return the member of an FMU that is assembled from other FMUs.

    Args:
        parts: Content of this member in each part, by component name; None if a part has no such member.
        fed: Source of each input that is connected without a factor, both as `component.variable`.
        variables: Names of the assembled FMU's variables; a variable of a part is named `component.variable`.
    """
    verdicts, ranges = [], list[Range]()
    for name, content in parts.items():
        known = _read_validity(content) or _unknown(SHOCK_UNKNOWN, name)
        verdicts.append(Verdict(replace(r, origin=f"{name}: {r.origin}") for r in known.verdict.reasons))
        places = [f"{name}.{covered.variable}" for covered in known.ranges]
        named = [replace(c, variable=fed.get(place, place)) for c, place in zip(known.ranges, places, strict=True)]
        ranges += [covered for covered in named if covered.variable in variables or covered.kind == "condition"]
    return _member(Validity(Verdict.combined(verdicts), tuple(dict.fromkeys(ranges))))


def _read_validity(content: bytes | None) -> Validity | None:
    """Return the validity in a member; None if there is no member or it cannot be read."""
    try:
        return None if content is None else Validity.from_json(json.loads(content))
    except (ValueError, InputError):
        return None


def _unknown(rule: Rule, origin: str) -> Validity:
    reason = rule.reason("how good the fit is was not recorded", figure="0 findings stated", origin=origin)
    return Validity(Verdict([reason]))


def _with_origin(known: Validity, origin: str) -> Validity:
    return replace(known, verdict=Verdict(replace(reason, origin=origin) for reason in known.verdict.reasons))


def _member(known: Validity) -> dict[str, bytes]:
    return {MEMBER: (json.dumps(known.to_json(), indent=1, allow_nan=False) + "\n").encode()}
