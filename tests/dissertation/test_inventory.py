"""The inventory has every numbered figure and table of chapters 3 to 7, each with a computation or a reason."""

import re

import pytest

from dissertation import Basis, Kind, chosen, inventory
from dissertation.item import CHAPTERS, PrintedValue
from dissertation.reproduction import computations
from eightpost.errors import InputError

#: Numbers of the figures and tables in the dissertation's lists.
FIGURES = {3: 25, 4: 21, 5: 17, 6: 32, 7: 7}
TABLES = {3: 5, 4: 5, 5: 1, 6: 6, 7: 5}


@pytest.mark.parametrize(("kind", "counts"), [(Kind.FIGURE, FIGURES), (Kind.TABLE, TABLES)])
def test_every_figure_and_table_is_listed_once(kind, counts):
    numbers = [item.number for item in inventory() if item.kind is kind]
    assert numbers == [f"{chapter}.{k}" for chapter in CHAPTERS for k in range(1, counts[chapter] + 1)]


def test_every_item_has_a_computation_or_says_why_it_has_no_printed_data():
    for chapter in CHAPTERS:
        own = [item for item in inventory() if item.chapter == chapter]
        assert set(computations(chapter)) == {item.name for item in own if item.is_computed}
    for item in inventory():
        assert item.reason or item.basis is Basis.PRINTED, item.label
        if not item.is_computed:
            assert not item.values and not item.claims, item.label


def test_a_reference_to_another_reason_leads_to_it():
    labels = {item.label.replace("Figure", "Fig"): item for item in inventory()}
    references = [(item, found[1]) for item in inventory() if (found := re.match(r"See (Fig [\d.]+\d)", item.reason))]
    assert references
    for item, target in references:
        assert not labels[target].reason.startswith("See"), item.label


def test_names_and_keys_are_unique():
    names = [item.name for item in inventory()]
    assert len(names) == len(set(names))
    for item in inventory():
        keys = [one.key for one in (*item.values, *item.claims)]
        assert len(keys) == len(set(keys)), item.label


@pytest.mark.parametrize("word", ["4.2", "table-4.2", "Table 4.2", "tab4.2", "fig 4.2", "Eq 4.2", "eq. 4.2", "4"])
def test_an_item_is_found_by_the_words_that_people_use(word):
    assert any(item.number == "4.2" for item in chosen([word]))


def test_a_number_names_all_its_items_and_a_kind_only_one():
    assert [item.name for item in chosen(["4.2"])] == ["figure-4.2", "table-4.2", "equation-4.2"]
    assert [item.name for item in chosen(["table-7.1", "3.8"])] == ["figure-3.8", "table-7.1"]


def test_an_unknown_number_is_an_error_with_the_nearest_items():
    with pytest.raises(InputError, match=r"no item '4\.22'; the nearest are Figure 4\.21, Eq 4\.21, .*--list"):
        chosen(["4.22"])
    with pytest.raises(InputError, match=r"Table 7\.5"):
        chosen(["table 7.9"])


@pytest.mark.parametrize(("text", "within"), [("about 3", ""), ("3", "loose"), ("", "2 %"), ("3..", "")])
def test_a_printed_value_that_cannot_be_read_is_an_error(text, within):
    with pytest.raises(InputError, match="printed value"):
        PrintedValue("key", "what", text, "", within)
