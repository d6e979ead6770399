"""Uncertainty of a fitted shock, as parameters of its FMU."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cosim.study.choice.robust import Uncertain
from eightpost.api.study_folder import StudyFolder
from eightpost.errors import FileFormatError
from eightpost.shock import Hysteresis, read_shock, write_shock
from eightpost.shock.file import fitted_parameters
from eightpost.uncertainty import LeftOutBlocks
from eightpost.validity import judged
from tests.shock.example_curve import knot_curve

from .constructed import study

BANK = Path(__file__).resolve().parents[3] / "examples" / "bank"


def document(build: str) -> dict:
    return json.loads((BANK / f"{build}.json").read_text())


@pytest.fixture
def free(tmp_path) -> Path:
    """Return a shipped build, changed as if its fit had ended within all bounds."""
    shock = read_shock(BANK / "AA_B.json")
    fitted = document("AA_B")["fit"]["parameters"]
    fitted["lag_full_force"] |= {"at_bound": "", "standard_error": 20.0}
    write_shock(judged(shock, fit={**shock.fit, "parameters": fitted}), tmp_path / "free.json")
    return tmp_path / "free.json"


def test_parameters_vary_by_their_standard_errors(free):
    found = fitted_parameters(read_shock(free))
    fitted = json.loads(free.read_text())["fit"]["parameters"]
    assert found.names == ("time_constant", "lag_full_force", "lag_zero_force", "compression_scale", "rebound_scale")
    errors = [fitted[name]["standard_error"] for name in found.names[:3]]
    np.testing.assert_allclose(np.sqrt(found.covariance.diagonal()[:3]), errors)
    assert found.held == ()


def test_every_element_of_a_fitted_parameter_varies_under_the_name_of_its_fmu_variable():
    """The time constants of Hysteresis are elements of one parameter."""
    shock = read_shock(BANK / "C_C.json")
    entry = {"value": 0.01, "standard_error": 0.001, "bounds": [3e-4, 0.2], "at_bound": "", "unit": "s"}
    fitted = {**{f"time_constant[{k}]": entry for k in (1, 2, 3)}, "gas_preload": entry}
    law = Hysteresis(knot_curve(), (0.0,) * 25, (0.01,) * 3)
    found = fitted_parameters(judged(shock, law=law, fit={**shock.fit, "parameters": fitted}))
    assert found.names[:3] == ("time_constant[1]", "time_constant[2]", "time_constant[3]")
    assert "gas_preload" not in found.names  # of the port: the vehicle moves about rest


def test_a_parameter_at_a_bound_is_held_and_reported():
    found = fitted_parameters(read_shock(BANK / "C_C.json"))
    assert "lag_full_force" not in found.names
    assert found.held == ("lag_full_force is kept at its fitted value: the fit ended at its lower bound",)


def test_the_scales_have_the_deviations_that_the_fit_derives_from_its_covariance():
    found = fitted_parameters(read_shock(BANK / "C_C.json"))
    deviation = dict(zip(found.names, np.sqrt(found.covariance.diagonal()), strict=True))
    stated = document("C_C")["fit"]["curve_band"]["factor_half_width"]
    assert list(stated) == ["compression_scale", "rebound_scale"]
    for name, half_width in stated.items():
        assert 1.96 * deviation[name] == pytest.approx(half_width, rel=1e-4)


def test_a_band_without_factors_counts_as_correlated_over_all_velocities():
    """If the force of a side is scaled by 1 ± sigma, the band has this relative width at every velocity."""
    shock, band = read_shock(BANK / "C_C.json"), document("C_C")["fit"]["curve_band"]
    del band["factor_half_width"]
    found = fitted_parameters(judged(shock, fit={**shock.fit, "curve_band": band}))
    velocity, force, half = (np.array(band[key]) for key in ("velocity [m/s]", "force [N]", "half_width [N]"))
    deviation = dict(zip(found.names, np.sqrt(found.covariance.diagonal()), strict=True))
    for name, side in (("compression_scale", velocity > 0), ("rebound_scale", velocity < 0)):
        energy = [np.sum((1.96 * deviation[name] * force[side]) ** 2), np.sum(half[side] ** 2)]
        assert energy[0] == pytest.approx(energy[1], rel=1e-3)


def test_draws_are_limited_to_the_bounds_of_the_fit(free):
    fit = fitted_parameters(read_shock(free))
    found = Uncertain("AA/B", fit.names, fit.values, fit.covariance, fit.lowest, fit.highest)
    drawn = found.at(100.0 * np.random.default_rng(1).normal(size=(50, 5)))
    low, high = document("AA_B")["fit"]["parameters"]["time_constant"]["bounds"]
    assert drawn[:, 0].min() == pytest.approx(low)
    assert drawn[:, 0].max() == pytest.approx(high)


def test_a_fit_that_an_uncertainty_file_names_is_drawn_with_what_it_has_in_common_with_others(free):
    blocks = LeftOutBlocks.of(np.linspace(0.1, 0.2, 20), {"rebound_scale": np.sin(np.arange(20.0))})
    shock = read_shock(free)
    write_shock(judged(shock, fit={**shock.fit, **blocks.section()}), free)
    folder = StudyFolder(free.parent, study(("front",)))
    (part,) = folder._fits({"AA/B": free})
    assert part.left_out == blocks
    write_shock(replace(shock, fit={**shock.fit, **blocks.section()}), free)
    with pytest.raises(FileFormatError, match="or was edited after the fit"):
        list(folder._fits({"AA/B": free}))


def test_a_shock_without_a_fit_states_no_uncertainty(shocks):
    assert fitted_parameters(shocks["lpf1"]) is None
