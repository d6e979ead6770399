"""What is read from modelDescription.xml of other makers' FMUs, of both versions: no entry changes unseen."""

import dataclasses
import xml.etree.ElementTree as ET
from collections.abc import Callable

import pytest

from eightpost.fmi import Description, Variable, read_description

from .check_defects import FOREIGN, XML

NAMES = ("van_der_pol", "bouncing_mass", "mass_spring", "filter_bank")
#: Sizes of arrays, each with a dimension of a number and one of a structural parameter.
SIZES = ("0", "1", "3", "500000", "500001", "x", "-2", " 4 ")


def _of(variable: Variable) -> str:
    stated = {name: getattr(variable, name) for name in (
        "index", "reference", "type", "native", "causality", "variability", "initial", "effective_initial", "start",
        "unit", "is_array", "is_callable", "is_continuous_real", "is_settable_at_start", "aliases", "dimensions",
        "starts",
    )}  # fmt: skip
    numbers = [variable.number(name) for name in ("start", "min", "max", "nominal")]
    return f"{ {name: one for name, one in stated.items() if one} } {dict(variable.attributes)} {numbers}"


def _kept(found: Description) -> dict[str, object]:
    stated = {field.name: getattr(found, field.name) for field in dataclasses.fields(found)}
    names = ("identifier", "guid", "lengths", "event_indicators", "output_derivative_order")
    return {
        **{name: str(one) for name, one in stated.items() if name not in ("variables", "sections")},
        **{name: str(getattr(found, name)) for name in names}, "sections": sorted(found.sections),
        "variables": {variable.name: _of(variable) for variable in found.variables},
        "interpolated": [one.name for one in found.interpolated_inputs],
        "states": [[one.name for one in pair] for pair in found.state_pairs()],
        "listed": {name: [one.name for one in found.listed_in(name)] for name in sorted(found.sections)},
        "named": [found.name_of(unknown) for unknown in found.unknowns],
        "of": {kind: [one.name for one in found.of(kind)] for kind in ("input", "output", "parameter", "independent")},
        "can": [found.can(name) for name in ("canGetAndSetFMUstate", "canHandleVariableCommunicationStepSize", "none")],
        "can exchange": [found.can_exchange(f"can{name}") for name in ("GetAndSetFMUstate", "SerializeFMUstate")],
    }  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
def test_a_description_is_read_in_the_same_way(name: str, unchanged: Callable[..., None]) -> None:
    unchanged(_kept(read_description(ET.parse(FOREIGN / name / XML).getroot())))


@pytest.mark.parametrize("size", SIZES)
def test_an_array_has_as_many_values_as_its_dimensions_say(size: str) -> None:
    root = ET.fromstring(
        '<fmiModelDescription fmiVersion="3.0"><ModelVariables>'
        f'<UInt64 name="n" valueReference="1" causality="structuralParameter" start="{size}"/>'
        '<Float64 name="x" valueReference="2"><Dimension start="2"/><Dimension valueReference="1"/></Float64>'
        '<Float64 name="y" valueReference="3"/></ModelVariables></fmiModelDescription>'
    )
    count = {"1": 2, "3": 6, "500000": 1_000_000, " 4 ": 8}.get(size, 0)
    assert read_description(root).lengths.get("x", 1) == count
    assert read_description(root).lengths.get("y", 1) == 1
