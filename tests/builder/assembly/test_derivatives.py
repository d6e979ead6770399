"""Directional derivatives of an assembly pass through its connections."""

import numpy as np
import pytest
from fmpy import extract
from fmpy.fmi2 import FMU2Model
from fmpy.model_description import read_model_description


@pytest.fixture
def corner_fmu(corner, tmp_path):
    """An instance of the quarter car with its damper, for model exchange, and its description."""
    description = read_model_description(corner)
    fmu = FMU2Model(
        guid=description.guid, unzipDirectory=extract(corner, tmp_path), instanceName="corner",
        modelIdentifier=description.modelExchange.modelIdentifier,
    )  # fmt: skip
    fmu.instantiate()
    fmu.setupExperiment(startTime=0.0)
    fmu.enterInitializationMode()
    fmu.exitInitializationMode()
    fmu.enterContinuousTimeMode()
    yield fmu, description
    fmu.terminate()
    fmu.freeInstance()


def test_a_derivative_along_inputs_and_states_is_the_difference_of_outputs_and_rates(corner_fmu):
    fmu, description = corner_fmu
    rates = [one.variable for one in description.derivatives]
    states = [rate.derivative for rate in rates]
    inputs, outputs = (
        [v for v in description.modelVariables if v.causality == kind and "coupling_error" not in v.name]
        for kind in ("input", "output")
    )
    knowns, unknowns = (
        [v.valueReference for v in [*some, *more]] for some, more in ((inputs, states), (outputs, rates))
    )
    scales = np.array([1.0] * len(inputs) + [float(state.nominal or 1.0) for state in states])
    generator = np.random.default_rng(3)
    place, direction = (scales * generator.uniform(0.2, 1.0, scales.size) for _ in range(2))

    def at(step):
        fmu.setReal(knowns, list(place + step * direction))
        return np.array(fmu.getReal(unknowns))

    h = 1e-6
    differences = (at(h) - at(-h)) / (2.0 * h)
    rounding = 1e-8 * np.abs(at(0.0))
    found = np.array(fmu.getDirectionalDerivative(unknowns, knowns, list(direction)))
    assert (np.abs(found - differences) <= 1e-5 * np.abs(differences) + rounding).all()
