"""Only a diverging coupling is retried with a smaller step or an implicit scheme, never a component that failed."""

import pytest

from cosim import Bond, Capabilities, Scenario, System, run
from eightpost.errors import DivergedError, StepError


@pytest.mark.parametrize("options", [{}, {"step": 0.01}], ids=["default", "given step"])
def test_a_component_error_that_mentions_divergence_is_not_treated_as_a_diverged_coupling(make, options):
    def advance(v, start, end, step):
        raise StepError("the solver inside this component diverged")

    ports = make.table(make.variable("velocity", "output", "m/s"), make.variable("force", "input", "N"))
    damper = make.table(make.variable("velocity", "input", "m/s"), make.variable("force", "output", "N", ["velocity"]))
    ramps = Capabilities(interpolates_inputs=True, state=True)
    mass = make.component(ports, lambda v, _: {"velocity": v}, advance, capabilities=ramps)
    shock = make.component(damper, lambda _, u: {"force": 4.0 * u["velocity"]}, capabilities=ramps)
    system = System({"mass": mass, "shock": shock}, [Bond.between("mass", "shock", displacement=False)])
    with pytest.raises(StepError, match="the solver inside") as raised:
        run(system, Scenario(0.1), **options)
    assert not isinstance(raised.value, DivergedError)
    assert sum(entry == ("started",) for entry in mass.log) == 1
