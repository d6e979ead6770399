"""The error of a component that refuses a step states the inputs that it really had."""

from dataclasses import replace
from typing import Any

import pytest

from cosim import Bond, GaussSeidel, Implicit, Jacobi, Scenario, System, run
from eightpost.errors import StepError

from .mass_and_damper import restorable_parts


@pytest.mark.parametrize("engine", ["python", "compiled"])
@pytest.mark.parametrize(
    "algorithm",
    [Jacobi(values="held"), Jacobi(), GaussSeidel(), GaussSeidel(values="parabolic"), Implicit()],
    ids=["jacobi, held", "jacobi", "gauss-seidel", "gauss-seidel, parabolic", "implicit"],
)
@pytest.mark.parametrize("ramps", [False, True], ids=["held inputs", "ramped inputs"])
def test_the_inputs_in_an_error_are_those_that_the_component_was_given(
    make: Any, ramps: bool, algorithm: Any, engine: str
) -> None:
    reported = {}

    def refused(what: str, status: int, time: float, inputs: dict[str, float]) -> StepError:
        reported.update(inputs)
        return StepError(f"refused to {what}")

    parts = restorable_parts(make)()
    shock = parts["shock"]
    shock.capabilities = replace(shock.capabilities, interpolates_inputs=ramps)
    shock.longest, shock.refused = 0.015, refused
    system = System(parts, [Bond.between("car", "shock", displacement=False)])
    with pytest.raises(StepError, match="refused to step"):
        run(system, Scenario(0.1), algorithm=algorithm, step=0.02, engine=engine)
    assert reported == shock.inputs
    assert reported["velocity"] != 0.0
