"""Curves of shocks measured on their FMUs, and the pages that the FMUs carry."""

import numpy as np
import pytest

from cosim.study.definition import Build
from cosim.study.sheet import VELOCITIES, copy_shock_pages, shock_curve, shock_curves

from ..coupled import SCALES, study


@pytest.mark.nightly
def test_the_curve_of_an_fmu_is_the_static_force_of_its_law(fmus, shocks):
    for name in ("polylinear", "lpf1", "lpnl2"):
        law = shocks[name].law
        port, static = law.port, np.array([law.static_force(velocity) for velocity in VELOCITIES])
        expected = static + port.gas_force(0.0) + [port.seal_force(velocity) for velocity in VELOCITIES]
        np.testing.assert_allclose(shock_curve(Build(fmus[name])).force, expected, atol=1.0)


def test_every_build_of_a_bank_has_the_curve_of_its_own_parameters(fmus):
    curves = shock_curves(study(fmus))
    assert set(curves) == set(SCALES)
    assert curves["stiff"].force[-1] > 1.5 * curves["middle"].force[-1] > 0.0


def test_a_build_whose_fmu_is_missing_has_no_curve_and_no_page(fmus, tmp_path):
    made = study(fmus)
    gone = type(made)(**{**vars(made), "bank": made.bank | {"soft": Build(tmp_path / "gone.fmu")}})
    assert "soft" not in shock_curves(gone)
    pages = copy_shock_pages(gone, tmp_path)
    assert set(pages) == set(SCALES) - {"soft"}
    assert all((tmp_path / page).read_bytes().startswith(b"<!") for page in pages.values())
