"""Tables, figures and reasons of the validation of a vehicle, from results that are known."""

from __future__ import annotations

import json
from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from eightpost.errors import FileFormatError
from eightpost.ident.validation.comparison import Trend
from eightpost.ident.validation.vehicle_page import _order_figure, port_table, write_vehicle_page
from eightpost.ident.validation.vehicles import Limits, _common_levels, validate_vehicle, vehicle_verdict
from eightpost.ident.vehicle.trust import ForceEstimate, OrderCandidate, Orders, OutputTrust, PolePair, Trust
from eightpost.ident.vehicle.vehicle_fit import read_fit, with_validity, write_fit
from eightpost.report.tables import Amount
from eightpost.uncertainty import MeasureUncertainty
from eightpost.vehicle import Bristle, Friction
from eightpost.verdict import Grade

from .conftest import records_of


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


@pytest.mark.parametrize(("is_clear", "why"), [(True, "a clear gap"), (False, "their misfit")])
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


if TYPE_CHECKING:
    pass

TRIED = (OrderCandidate(2, 1.1, (PolePair(3.0, 0.1, False),)), OrderCandidate(4, 40.0, (PolePair(3.0, 0.1, True),)))
TRUST = Trust(
    {"velocity": OutputTrust(0.0123, 0.004, 1.7, 0.456), "tire_force": OutputTrust(0.01, 0.002, 1.0, None)},
    {"": ForceEstimate(61.25, 1.5)},
    {"": ForceEstimate(4.0, 0.25)},
    {"springs": "Springs are not straight."},
    Orders(TRIED, 4, True, 16.0),
    8,
)
MEASURES = {"velocity": MeasureUncertainty(0.01, 0.1)}  #: All that a recipe states that searches no effects.


def written(place, document, **changes):
    place.write_text(json.dumps(document | changes, indent=5), encoding="utf-8")


def test_an_edited_car_or_report_of_its_fit_is_unknown_without_uncertainty(corner, tmp_path):
    fit = with_validity(replace(corner, trust=TRUST))
    car, _, report = write_fit(tmp_path / "car.json", fit)
    known, figures = (json.loads(path.read_text()) for path in (car, report))
    written(car, known)  # white space changes nothing
    written(report, figures)
    assert read_fit(car).trust == TRUST and read_fit(car).verdict == fit.verdict
    written(report, figures, residual={"velocity": 0.001})
    found = read_fit(car)
    assert [reason.origin for reason in found.verdict.reasons] == ["car.fit.json"]
    assert found.trust is None and found.verdict.grade is Grade.UNKNOWN
    written(report, figures)
    written(car, known, A=(1.001 * fit.vehicle.state_space.A).tolist())
    found = read_fit(car)
    assert [reason.origin for reason in found.verdict.reasons] == ["car.json"]
    assert found.trust is None and found.verdict.grade is Grade.UNKNOWN


def test_a_report_of_another_fit_is_refused(corner, tmp_path):
    car, _, report = write_fit(tmp_path / "car.json", with_validity(corner))
    known, figures = (json.loads(path.read_text()) for path in (car, report))
    for own, stated in (
        ({"validity": known["validity"] | {"judged": "0" * 64}}, {}),
        ({"validity": known["validity"] | {"judged": None}}, {}),
        ({"validity": known["validity"] | {"judged": None}}, {"vehicle_judged": None}),
    ):
        written(car, known, **own)
        written(report, figures, **stated)
        with pytest.raises(FileFormatError, match="belongs to another vehicle"):
            read_fit(car)


@pytest.mark.nightly
def test_a_flag_of_the_fit_is_on_the_page_and_no_reason_as_records_tell_more(corner, setups, tmp_path):
    plain = validate_vehicle(corner, records_of(corner, *setups[:1]))
    fit = replace(corner, trust=TRUST)
    study = validate_vehicle(fit, records_of(fit, *setups[:1]))
    assert vehicle_verdict(study).grade is vehicle_verdict(plain).grade
    assert len(vehicle_verdict(study).reasons) == len(vehicle_verdict(plain).reasons)
    page = write_vehicle_page(tmp_path / "car.html", study).read_text(encoding="utf-8")
    texts = ("Self-assessment of the fit", "Springs are not straight.", "Stabilisation diagram", "4 states were chosen")
    for text in texts:
        assert text in page
    found = tmp_path / "linear.html"
    for trust, says in ((replace(TRUST, flags={}), True), (Trust({}, measures=MEASURES), False)):
        other = replace(study, fit=replace(corner, trust=trust))
        text = write_vehicle_page(found, other).read_text(encoding="utf-8")
        assert ("no nonlinear effect" in text, "Estimates at the ports" in text) == (says, says)
        assert ("setups that were not tested" in text) is not says
