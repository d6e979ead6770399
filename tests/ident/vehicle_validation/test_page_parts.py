"""Tables, figures and reasons of the validation of a vehicle, from results that are known."""

from types import SimpleNamespace

import numpy as np
import pytest

from eightpost.ident.validation.comparison import Trend
from eightpost.ident.validation.vehicle_page import _order_figure, port_table
from eightpost.ident.validation.vehicles import Limits, _common_levels
from eightpost.ident.vehicle.trust import ForceEstimate, OrderCandidate, Orders, PolePair, Trust
from eightpost.report.tables import Amount
from eightpost.vehicle import Bristle, Friction


def a_fit(trust: Trust | None, **friction: Friction) -> SimpleNamespace:
    return SimpleNamespace(trust=trust, vehicle=SimpleNamespace(friction=friction))


def rows_of(table) -> list[tuple[float | str, ...]]:
    """Return the cells of a table as numbers and texts."""
    return [tuple(cell.value if isinstance(cell, Amount) else cell for cell in row) for row in table.rows]


def test_a_port_has_the_velocity_of_a_smooth_law_and_the_reach_of_a_bristle() -> None:
    trust = Trust({}, {"lf": ForceEstimate(50.0, 2.0), "rf": ForceEstimate(60.0, 3.0), "lr": ForceEstimate(1.0, 1.0)},
                  {"lf": ForceEstimate(20.0, 4.0)})  # fmt: skip
    fit = a_fit(trust, lf=Friction(48.0, 0.005), rf=Friction(bristle=Bristle(57.0, 1e-4)))
    lf, rf, lr = rows_of(port_table(fit))
    none = lr[6]
    assert lf == ("lf", 50.0, 2.0, 48.0, 0.005, none, 20.0, 4.0)
    assert rf == ("rf", 60.0, 3.0, 57.0, none, 1e-4, none, none)
    assert lr == ("lr", 1.0, 1.0, "none", none, none, none, none)


@pytest.mark.parametrize(("is_clear", "why"), [(True, "a clear gap"), (False, "the description length")])
def test_the_stabilisation_diagram_has_the_poles_and_gaps_of_each_order(is_clear: bool, why: str) -> None:
    """Poles beyond 1.2 times the highest frequency of the fit are not drawn."""
    tried = (
        OrderCandidate(2, 1.5, (PolePair(3.0, 0.1, steady=False), PolePair(25.0, 0.1, steady=False))),
        OrderCandidate(4, 30.0, (PolePair(3.1, 0.1, steady=True), PolePair(23.9, 0.2, steady=False))),
    )
    figure = _order_figure(Orders(tried, 4, is_clear, 20.0))
    assert why in figure.caption
    assert "4 states were chosen" in figure.caption
    moved, steady, gaps = ((t["name"], list(t["x"]), list(t["y"])) for t in figure._traces)
    assert moved == ("moved", [3.0, 23.9], [2.0, 4.0])
    assert steady == ("same as at the previous order", [3.1], [4.0])
    assert gaps == ("gap", [1.5, 30.0], [2.0, 4.0])
    assert [(shape["yref"], shape["y0"]) for shape in figure._shapes] == [("y", 4.0), ("y2", 4.0)]
    assert (figure.panels[0].x.span, figure.panels[0].y.span) == ((0.0, 24.0), (0.0, 6.0))


MEASURED = np.array([1.0, 1.2, 1.4, 1.6])


@pytest.mark.parametrize(
    ("factors", "is_common"),
    [
        ((1.10, 1.10, 1.10, 1.10), True),
        ((0.90, 0.92, 0.90, 0.92), True),
        ((1.04, 1.04, 1.04, 1.04), False),  # within the limit
        ((1.16, 1.16, 1.16, 1.16), False),  # more than three times the limit
        ((1.00, 1.10, 1.00, 1.10), False),  # the records deviate from the common error by as much
        ((1.10, 1.10, 1.10), False),  # too few records
    ],
)
def test_a_level_that_all_records_share_is_a_reason_of_its_own(factors: tuple[float, ...], is_common: bool) -> None:
    measured = MEASURED[: len(factors)]
    trend = Trend("lf.tire_force", "N", measured, measured * factors)
    found = [*_common_levels(SimpleNamespace(trends=[trend]), Limits())]
    assert len(found) == is_common


def test_equal_setups_do_not_show_that_a_wrong_level_is_harmless() -> None:
    flat = Trend("lf.tire_force", "N", np.ones(4), np.full(4, 1.1))
    assert [*_common_levels(SimpleNamespace(trends=[flat]), Limits())] == []


def test_the_common_level_is_stated_for_the_worst_output() -> None:
    trends = [Trend(name, "N", MEASURED, factor * MEASURED) for name, factor in (("a", 1.06), ("b", 0.9), ("c", 1.0))]
    (found,) = _common_levels(SimpleNamespace(trends=trends), Limits())
    assert found.figure == (
        "b: -10.0 % on 4 records, 0.0 % without the common factor; rank correlation 1.00; limit 5 %"
    )
    assert found.origin == "a, b"
