"""The valving that gives a curve: it is found among all combinations, with the level of the force left open."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from eightpost.errors import ParameterError
from eightpost.shock import read_shock
from eightpost.virtual.damper import Valving, nearest_valving

BANK = Path(__file__).resolve().parents[2] / "examples" / "bank"


@pytest.mark.nightly
def test_the_static_curve_of_a_valving_is_found_again_with_a_level_that_is_not_its_own():
    valving = Valving("C", "E", head="A", clicks=12, jet=0.5e-6, dish=0.1e-3)
    found = nearest_valving(wanted(valving, -40.0))
    assert found.valving == valving and found.limits == ()
    assert found.level == pytest.approx(-40.0, abs=0.1) and found.residual < 0.1
    assert found.combinations > 10_000_000


def wanted(valving, level):
    """Return the static force of a valving, with its seals and a level."""
    damper = valving.damper()
    return lambda velocity: damper.static_force(velocity) + np.copysign(damper.seals.drag, velocity) + level


@pytest.mark.parametrize("level", [-40.0, 60.0])
def test_among_few_parts_the_valving_of_a_curve_is_found_with_its_level(monkeypatch, level):
    monkeypatch.setattr("eightpost.virtual.damper._CODES", ("B", "C", "E", "F"))
    monkeypatch.setattr("eightpost.virtual.damper.JETS", (0.3e-6, 0.5e-6, 0.8e-6))
    monkeypatch.setattr("eightpost.virtual.damper.DISHES", (0.0, 0.1e-3, 0.2e-3))
    valving = Valving("C", "E", head="C", clicks=12, jet=0.5e-6, dish=0.1e-3)
    found = nearest_valving(wanted(valving, level))
    assert (found.valving, found.limits, found.combinations) == (valving, (), 3 * 3 * 4**3 * 29)
    assert (found.level, found.residual) == (pytest.approx(level, abs=0.1), pytest.approx(0.0, abs=0.1))
    assert found.velocity == pytest.approx(-found.velocity[::-1])
    force = wanted(valving, level)
    assert found.force == pytest.approx([force(v) for v in found.velocity.tolist()], abs=0.5)
    far = nearest_valving(lambda velocity: 1e5 * velocity)
    assert {"jet", "dish", "compression", "rebound", "head"} >= set(far.limits) > {"jet"}
    assert far.relative == pytest.approx(far.residual / (1e5 * np.sqrt(np.mean(far.velocity**2))))


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
