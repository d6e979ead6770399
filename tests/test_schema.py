"""A document's entries have the types of its schema, or the message names the entry, what it must be, and its value."""

from dataclasses import dataclass

import pytest

from eightpost.errors import FileFormatError
from eightpost.files import parse_json
from eightpost.schema import checked


@dataclass(frozen=True)
class Part:
    name: str
    sizes: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if self.name == "":
            raise ValueError("a part needs a name")


@dataclass(frozen=True)
class Whole:
    parts: tuple[Part, ...]
    is_new: bool
    count: int = 1


def test_values_become_the_fields_of_dataclasses_inside_each_other():
    content = {"parts": [{"name": "a", "sizes": [1, 2.5]}], "is_new": True}
    assert checked(Whole, content) == Whole((Part("a", (1.0, 2.5)),), is_new=True)


@pytest.mark.parametrize(("content", "message"), [
    ({"parts": [], "is_new": 1}, "is_new: must be true or false, not 1"),
    ({"parts": [], "is_new": True, "count": 1.5}, "count: must be a whole number, not 1.5"),
    ({"parts": [], "is_new": True, "count": True}, "count: must be a whole number, not True"),
    ({"parts": {}, "is_new": True}, "parts: must be a list, not {}"),
    ({"parts": [1], "is_new": True}, "parts.0: must be an object, not 1"),
    ({"parts": [{"name": None}], "is_new": True}, "parts.0.name: must be a text, not None"),
    ({"parts": [{"name": "a", "sizes": ["1"]}], "is_new": True}, "parts.0.sizes.0: must be a number, not '1'"),
    ({"parts": [{"name": "a", "sizes": [float("inf")]}], "is_new": True}, "sizes.0: must be a finite number, not inf"),
    ({"parts": [{"name": ""}], "is_new": True}, "t.json: a part needs a name"),
    ({"parts": [{"name": "a", "colour": 1}], "is_new": True}, "parts.0.colour: is not an entry of this file"),
    ({"is_new": "y" * 100}, "is_new: must be true or false, not '" + "y" * 59 + "...; parts: is missing"),
    ({"part": [], "is_new": True}, "part: is not an entry of this file; did you mean parts?; parts: is missing"),
    ({"parts": [], "is_new": True, "sizes": []}, "sizes: is not an entry of this file; another part of the file has"),
    ({"parts": [], "is_new": True, "zzz": []}, "zzz: is not an entry of this file; there are: parts, is_new, count"),
    ({"a": 1, "b": 2, "c": 3}, "; and 2 more"),
    ([], r"t.json: it must be an object, not \\[\\]"),
])  # fmt: skip
def test_a_wrong_entry_is_refused_with_its_place_and_value(content, message):
    with pytest.raises(FileFormatError) as caught:
        checked(Whole, content, path="t.json")
    assert message.replace("\\", "") in str(caught.value)


def test_a_part_of_a_document_is_named_with_its_place():
    with pytest.raises(FileFormatError, match=r"^car\.1: must be a number, not 'x'$"):
        checked(list[float], [1.0, "x"], place="car")


@pytest.mark.parametrize("text", ['{"a": 1, "a": 1}', '{"b": [{"a": 1, "c": 2, "a": 3}]}'])
def test_an_entry_that_appears_twice_is_refused_by_name(text):
    with pytest.raises(FileFormatError, match=r"t.json: cannot be read as JSON: the entry 'a' appears twice; keep one"):
        parse_json(text, "t.json")
