"""Items that need no records agree with print: equations, tables and the responses of chapters 4 and 5."""

import pytest

from dissertation import QUICK, Basis, State, chosen, inventory, reproduce

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
