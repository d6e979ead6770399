"""Only a diverging coupling is retried with a smaller step or an implicit scheme, never a component that failed."""

import numpy as np
import pytest

from cosim import Bond, Capabilities, FmuComponent, GaussSeidel, Scenario, System, run
from eightpost.errors import DivergedError, StepError
from eightpost.signals import Drivefile, TimeSeries

SCALES = ("compression_scale", "rebound_scale")


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


@pytest.mark.nightly
def test_a_vehicle_that_refuses_a_step_of_a_diverging_coupling_is_retried(fmus):
    """Its port spring grows with the square of the displacement, so that it refuses before signals are at the limit."""
    components = {
        name: FmuComponent(fmus[fmu], name) for name, fmu in {"car": "quarter_car", "shock": "polylinear"}.items()
    }
    time = np.arange(0.0, 0.6, 0.01)
    road = 0.01 * np.sin(12.0 * time) + 0.003 * np.sin(70.0 * time)
    scenario = Scenario(0.5, Drivefile(TimeSeries.from_channels(time, {"road": ("m", road)})), {"road": "car.road"})
    for scale in np.linspace(6.0, 16.0, 11):
        shock = dict.fromkeys(SCALES, float(scale))
        parameters = {"car": {"port_spring": 4e5, "bristle_force": 100.0}, "shock": shock}
        bonds = [Bond.between("car", "shock")]
        system = System(components, bonds, constants={"car.aero_force": 0.0}, parameters=parameters)
        with pytest.raises(DivergedError, match="the coupling diverged"):
            run(system, scenario, step=2e-3, algorithm=GaussSeidel(values="parabolic"))
        assert np.abs(run(system, scenario).series["car.displacement"]).max() < 0.02
