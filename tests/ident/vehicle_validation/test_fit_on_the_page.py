"""Tests that the self-assessment of a fit is on the page and in the verdict."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

from eightpost.errors import FileFormatError
from eightpost.ident.validation.vehicle_page import write_vehicle_page
from eightpost.ident.validation.vehicles import validate_vehicle, vehicle_verdict
from eightpost.ident.vehicle.trust import ForceEstimate, OrderCandidate, Orders, OutputTrust, PolePair, Trust
from eightpost.ident.vehicle.vehicle_fit import read_fit, with_validity, write_fit
from eightpost.uncertainty import MeasureUncertainty
from eightpost.verdict import Grade

from .conftest import records_of

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
