"""The inventory has every numbered figure and table of chapters 3 to 7, each with a computation or a reason."""

import re

import pytest

from dissertation import QUICK, Basis, Kind, State, chosen, inventory, reproduce
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


#: Items based on printed equations and parameters only, without those that simulate the rig first.
QUICK_ITEMS = [
    item for item in inventory() if item.basis is Basis.PRINTED and item.name not in ("table-6.1", "table-6.3")
]


@pytest.mark.parametrize("item", QUICK_ITEMS, ids=lambda item: item.name)
def test_an_item_of_printed_equations_agrees_with_print(item):
    (outcome,) = reproduce([item], QUICK)
    assert outcome.state is State.REPRODUCED, outcome.beyond


def test_table_4_5_agrees_in_what_it_prints_but_for_the_compression_shims():
    (outcome,) = reproduce(chosen(["table-4.5"]), QUICK)
    assert {one.printed.key.partition("/")[2] for one in outcome.comparisons} == {"build", "gas"}
    assert {one.claim.key: (one.holds, one.finding) for one in outcome.claims} == {
        "bleed": (True, "1 and 14 clicks from fully open"),
        "head": (True, "shims B and A+ (Table 7.2)"),
        "compression": (False, "shims B, B and A (Table 7.2)"),
    }


def test_table_6_6_follows_from_table_6_5_only_with_one_cell_moved():
    (outcome,) = reproduce(chosen(["table-6.6"]), QUICK)
    (printed,) = outcome.claims
    assert all(one.has_printed_digits for one in outcome.comparisons)
    assert len(outcome.comparisons) == 56
    assert not printed.holds


def test_eq_3_17_needs_the_other_sign():
    (outcome,) = reproduce(chosen(["eq 3.17"]), QUICK)
    assert {one.claim.key: one.holds for one in outcome.claims} == {"printed": False, "minus": True}


@pytest.mark.nightly
@pytest.mark.parametrize("chapter", ["3", "4", "5", "6", "7"])
def test_a_chapter_is_reproduced_within_its_tolerances(chapter):
    beyond = {one.item.label: one.beyond or one.error for one in reproduce(chosen([chapter]), QUICK)}
    assert not {label: texts for label, texts in beyond.items() if texts}
