"""A fit in Python: its summary, its tables and its picture contain the estimate, the model and their misfit."""

from dataclasses import replace

import numpy as np
import pytest

from eightpost.errors import ParameterError
from eightpost.ident.vehicle.frequency_response import response_of
from eightpost.ident.vehicle.trust import OutputTrust, Trust

from .conftest import truth_fit


@pytest.fixture(scope="module")
def fit():
    known = truth_fit("quarter_car")
    trust = Trust({"velocity": OutputTrust(0.01, 0.02, 1.5)}, {}, {}, {})
    return replace(known, residual={"velocity": 0.01, "tire_force": 0.034}, notes=("one", "two"), trust=trust)


def test_the_summary_names_the_output_with_the_largest_misfit(fit):
    text = repr(fit)
    assert "Identified vehicle quarter_car, recipe exact" in text
    assert "up to 3.4 % (tire_force)" in text
    assert f"{fit.states} states, stable" in text
    assert "0.1 to 20 Hz" in text
    assert "2; see .notes" in text


def test_the_table_of_outputs_has_the_misfit_and_what_is_known_of_their_uncertainty(fit):
    table = fit.to_pandas()
    assert list(table.columns) == ["misfit", "response_deviation", "measure_deviation"]
    assert table.loc["velocity"].tolist() == [0.01, 0.01, 0.02]
    assert table.loc["tire_force"].isna().tolist() == [False, True, True]
    assert list(replace(fit, trust=None).to_pandas().columns) == ["misfit"]


def test_the_dataset_has_estimate_model_and_coherence_of_every_path(fit):
    found = fit.to_xarray()
    path = found.sel(output="tire_force", input="road")
    model = response_of(fit.vehicle.state_space, fit.response.frequency).between("tire_force", "road")
    np.testing.assert_allclose(path["model"].values, model)
    np.testing.assert_array_equal(path["estimate"].values, fit.response.between("tire_force", "road"))
    assert (found["coherence"].values == 0.995).all()
    assert (str(path["output_unit"].values), str(path["input_unit"].values)) == ("N", "m")
    assert found.attrs["vehicle"] == "quarter_car"
    assert "coherence" not in replace(fit, response=replace(fit.response, coherence=None)).to_xarray()


def test_the_picture_has_the_magnitudes_of_the_worst_output_to_each_input(fit):
    figure = fit.plot().figure
    panels = {axes.get_title(): axes for axes in figure.axes}
    assert list(panels) == [f"tire_force / {name}" for name in fit.response.input_names]
    axes = panels["tire_force / road"]
    estimate, model = axes.get_lines()
    assert (estimate.get_label(), model.get_label()) == ("estimate", "model")
    size = np.abs(fit.response.between("tire_force", "road"))
    np.testing.assert_allclose(estimate.get_ydata(), 20.0 * np.log10(size))
    assert axes.get_ylabel() == "magnitude [dB re N per m]"
    assert fit.plot("velocity").figure.axes[0].get_title().startswith("velocity / ")
    with pytest.raises(ParameterError, match=r"quarter_car has no output 'tire_forces'; .*tire_force"):
        fit.plot("tire_forces")
