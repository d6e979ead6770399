"""A shock has the same numbers from its law and from its FMU."""

import numpy as np
import pytest

from cosim import FmuComponent
from cosim.study.running.machine import read_shock
from eightpost.machine import ShockData
from eightpost.shock import LAWS, law_name


@pytest.mark.parametrize("name", LAWS)
def test_a_law_gives_the_numbers_that_its_fmu_gives(name, shocks, fmus):
    law = shocks[name].law
    found = ShockData.of_law(law_name(type(law)), law)
    right = read_shock(FmuComponent(fmus[name], name), fmus[name], {})
    assert found.law == right.law
    np.testing.assert_array_equal(found.parameters, right.parameters)
    changed = read_shock(FmuComponent(fmus[name], name), fmus[name], {"rebound_scale": 1.7, "motion_ratio": 0.8})
    assert (changed.parameters != right.parameters).sum() == 2
