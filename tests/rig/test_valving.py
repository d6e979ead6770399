"""The valving that gives a curve: it is found among all combinations, with the level of the force left open."""

from __future__ import annotations

from pathlib import Path

import pytest

from eightpost.errors import ParameterError
from eightpost.rig.damper.valving import Valving, nearest_valving
from eightpost.shock import read_shock

BANK = Path(__file__).resolve().parents[2] / "examples" / "bank"


@pytest.mark.nightly
def test_the_static_curve_of_a_valving_is_found_again_with_a_level_that_is_not_its_own():
    valving = Valving("C", "E", head="A", clicks=12, jet=0.5e-6, dish=0.1e-3)
    damper = valving.damper()

    def force(velocity):
        return damper.static_force(velocity) + (damper.seals.drag if velocity > 0.0 else -damper.seals.drag) - 40.0

    found = nearest_valving(force)
    assert found.valving == valving and found.limits == ()
    assert found.level == pytest.approx(-40.0, abs=0.1) and found.residual < 0.1
    assert found.combinations > 10_000_000


@pytest.mark.nightly
@pytest.mark.parametrize("build", ["C/B", "B/C"])
def test_from_the_fit_of_a_dynamometer_test_the_shims_of_the_shock_are_found(build):
    shock = read_shock(BANK / f"{build.replace('/', '_')}.json")
    found = nearest_valving(shock.law.curve.force)
    assert (found.valving.compression, found.valving.rebound, found.valving.head) == (*build.split("/"), "B")
    assert found.relative < 0.02


def test_a_curve_without_force_is_refused():
    with pytest.raises(ParameterError, match="no force at any velocity"):
        nearest_valving(lambda _velocity: 0.0)
