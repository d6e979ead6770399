"""Differences are stated in words that follow from the numbers, and judged by the stated tolerance."""

from dataclasses import replace

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from dissertation import Basis, Comparison, Findings, Item, Kind, Outcome, State, chosen
from dissertation.item import Claim, PrintedValue
from dissertation.verdict import reproduction_verdict
from eightpost.errors import InputError


def compared(text, value, within="", unit=""):
    return Comparison.of(PrintedValue("key", "value", text, unit, within), value)


@pytest.mark.parametrize(
    ("text", "ours", "words"),
    [
        ("6.10", 6.101, "equal in every printed digit"),
        ("6.10", 6.11, "0.16 % higher"),
        ("1", 0.538, "0.54 times the printed value, which rounds to the printed digits"),
        ("30", 38.1, "27 % higher"),
        ("30", 90.0, "3.0 times the printed value"),
        ("20..30", 25.0, "as printed"),
        ("20..30", 33.0, "10 % above the printed range"),
        ("<25", 24.0, "as printed"),
        ("<25", 50.0, "2.0 times the printed limit"),
        (">20", 18.0, "10 % below the printed limit"),
        ("0.00", 0.5, "0.50 above 0"),
        ("5", 0.0, "0 instead of the printed value"),
    ],
)
def test_the_words_for_a_difference(text, ours, words):
    assert compared(text, ours).words == words


@pytest.mark.parametrize(
    ("text", "within", "inside", "outside"),
    [
        ("6.10", "digits", 6.104, 6.106),
        ("20..30", "digits", 25.1, 30.1),
        ("<25", "digits", 1.0, 25.1),
        ("100", "2 %", 101.9, 102.1),
        ("100", "x 2", 51.0, 49.0),
        ("100", "x 2", 199.0, 201.0),
        ("<25", "x 2", 49.0, 51.0),
        ("20..30", "10 %", 32.9, 33.1),
    ],
)
def test_a_tolerance_separates_values_inside_and_outside(text, within, inside, outside):
    assert compared(text, inside, within).is_within is True
    assert compared(text, outside, within).is_within is False


def test_a_value_without_tolerance_is_not_judged():
    assert compared("100", 500.0).is_within is None


@given(st.floats(1e-3, 1e6), st.integers(0, 3))
def test_a_value_printed_with_some_digits_equals_itself(value, decimals):
    text = f"{value:.{decimals}f}"
    assume(float(text) > 0.0)
    one = compared(text, value, "digits")
    assert one.is_within and one.has_printed_digits


@given(st.floats(1e-3, 1e3), st.floats(1.0, 10.0))
def test_half_and_double_are_equally_far(value, factor):
    text = f"{value:.9f}"
    for ours in (float(text) * factor, float(text) / factor):
        assert compared(text, ours, "x 10.1").is_within


def test_values_are_compared_in_the_printed_unit():
    assert compared("16.67", 16.67 * 175.126835, "digits", "lbf/(in/s)").is_within


ITEM = replace(chosen(["table-4.1"])[0], values=(PrintedValue("a", "value a", "10", "", "2 %"),), claims=())


def test_the_state_of_an_item_follows_from_its_values_and_its_basis():
    agrees, differs = (Outcome(ITEM, Findings({"a": value})) for value in (10.1, 11.0))
    assert agrees.state is State.REPRODUCED
    assert differs.state is State.DIFFERS
    assert differs.beyond == ("value a: 10 % higher",)
    assert Outcome(replace(ITEM, basis=Basis.STAND_IN), Findings({"a": 10.1})).state is State.STAND_IN
    assert Outcome(ITEM, error="no record").state is State.FAILED


@pytest.mark.parametrize(
    ("holds", "state"), [((True, True), State.STAND_IN), ((True, False), State.PARTLY), ((False, False), State.SHOWN)]
)
def test_a_stand_in_item_states_how_much_of_it_agrees(holds, state):
    claims = tuple(Claim(str(k), "it is so", is_judged=False) for k in range(2))
    item = replace(ITEM, basis=Basis.STAND_IN, values=(), claims=claims)
    outcome = Outcome(item, Findings(claims={str(k): (one, "") for k, one in enumerate(holds)}))
    assert outcome.state is state


@pytest.mark.parametrize(("judged", "state"), [(True, State.DIFFERS), (False, State.REPRODUCED)])
def test_a_judged_statement_that_does_not_hold_differs(judged, state):
    item = replace(ITEM, values=(), claims=(Claim("low", "it is low", judged),))
    outcome = Outcome(item, Findings(claims={"low": (False, "it is 3")}))
    assert outcome.state is state
    assert outcome.words == "0 of 1 statements hold; not: it is low"


def test_a_computation_must_return_every_printed_value():
    with pytest.raises(InputError, match=r"Table 4\.1"):
        Outcome(ITEM, Findings({"b": 1.0}))
    with pytest.raises(InputError, match=r"Table 4\.1"):
        Outcome(ITEM, Findings())
    assert Outcome(ITEM, Findings(is_partial=True)).comparisons == ()


def test_the_verdict_is_that_of_the_worst_item():
    good, bad = (Outcome(ITEM, Findings({"a": value})) for value in (10.0, 12.0))
    nothing = Outcome(Item(Kind.FIGURE, "3.9", "", "3.2", 48, Basis.NOTHING, "a photograph", (), ()))
    assert reproduction_verdict([good, nothing]).is_acceptable
    verdict = reproduction_verdict([good, bad, nothing])
    assert not verdict.is_acceptable
    assert "value a: 20 % higher" in verdict.summary()
