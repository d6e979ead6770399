"""Uncertainty of models, from their fits to the documents that FMUs contain."""

from __future__ import annotations

import json
from dataclasses import replace
from math import inf
from pathlib import Path

import numpy as np
import pytest

from builder.reference import validity_of
from eightpost.errors import InputError
from eightpost.shock import read_shock
from eightpost.uncertainty import LeftOutBlocks, MeasureUncertainty
from eightpost.validity import ModelUncertainty, ParameterUncertainty, Validity, judged
from eightpost.verdict import Verdict

BANK = Path(__file__).resolve().parents[1] / "examples" / "bank"


def test_an_uncertainty_survives_its_document_with_open_limits_and_unknown_copies():
    stated = ModelUncertainty(
        {"lf.tire_force": MeasureUncertainty(0.01, 0.2)},
        (ParameterUncertainty("lag", 1e-3, None, 0.0, inf), ParameterUncertainty("scale", 0.0, 0.0)),
        ("a sentence",),
        LeftOutBlocks.of(np.linspace(0.1, 0.2, 9), {"lag": np.arange(9.0)}),
    )
    validity = Validity(Verdict([]), (), stated)
    assert Validity.from_json(json.loads(json.dumps(validity.to_json(), allow_nan=False))) == validity
    assert Validity.from_json(Validity(Verdict([])).to_json()).uncertainty is None
    assert Validity.with_verdict(validity, Verdict([])).uncertainty == stated


@pytest.mark.parametrize(
    ("document", "what"),
    [
        (3, "must be an object, not int"),
        ({"measures": {"a": {"common": -1.0, "own": 0.1}}}, "numbers of 0 or more"),
        ({"measures": {"a": {"common": 1.0}}}, "own"),
        ({"parameters": [{"name": "lag"}]}, "deviation"),
        ({"left_out_blocks": {"velocity [m/s]": [0.1], "changes": {"lag": [1.0, 2.0]}}}, "lag must be 1 finite"),
        ({"parameters": [{"name": "lag", "deviation": -1.0}]}, "the parameter 'lag': deviation is -1.0"),
    ],
)
def test_a_document_that_is_no_uncertainty_is_refused(document, what):
    with pytest.raises(InputError, match=what):
        ModelUncertainty.from_json(document)


def test_the_fmu_of_a_fitted_shock_states_the_standard_errors_of_its_fit():
    shock = read_shock(BANK / "C_C.json")
    known = validity_of(shock).uncertainty
    assert known is not None
    found = {one.name: one for one in known.parameters}
    assert set(found) == {"time_constant", "lag_zero_force", "compression_scale", "rebound_scale"}
    assert found["time_constant"].deviation == pytest.approx(shock.fit["parameters"]["time_constant"]["standard_error"])
    assert found["time_constant"].copies is None
    pooled = judged(
        shock, fit={**shock.fit, "between_builds": {"parameters": {"time_constant": {"standard_deviation": 2e-4}}}}
    )
    again = validity_of(pooled).uncertainty
    assert again is not None and {one.name: one.copies for one in again.parameters}["time_constant"] == 2e-4


def test_a_shock_whose_fit_states_nothing_or_nonsense_has_an_unknown_uncertainty():
    shock = read_shock(BANK / "C_C.json")
    assert validity_of(replace(shock, fit={})).uncertainty is None
    assert validity_of(replace(shock, fit={"parameters": {"time_constant": 3}, "curve_band": {}})).uncertainty is None
