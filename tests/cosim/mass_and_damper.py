"""A mass on a spring and damper, without any FMU; both components support rollback."""

from dataclasses import replace
from typing import Any

import numpy as np

from cosim import Algorithm, Bond, Capabilities, Result, Scenario, System, run
from cosim.components.component import Callbacks, address_of
from cosim.engine import blocks
from eightpost.errors import StepError
from eightpost.fmi import DISCARD

MASS, STIFFNESS, DAMPING = 10.0, 4000.0, 60.0


def restorable_parts(make: Any) -> Any:
    """Return a function that builds the mass and the damper; both support rollback."""

    class Restorable(make.component):
        longest = np.inf

        def functions(self) -> Any:
            table = Callbacks(self).table()

            def do_step(instance: Any, time: float, step: float, final: int) -> int:
                return DISCARD if step > self.longest else blocks.do_step(table.do_step, 0, time, step, final)

            function = blocks.STEP(do_step)
            return replace(table, do_step=address_of(function), keep=(table.keep, function))

        def refused(self, what: str, *_: Any) -> StepError:
            return StepError(f"refused to {what}")

        def save(self) -> Any:
            return self.state, dict(self.inputs), dict(self.slopes)

        def restore(self, state: Any) -> None:
            self.state, self.inputs, self.slopes = state[0], dict(state[1]), dict(state[2])

        def free(self, state: Any) -> None:
            pass

    def made(damping: float = DAMPING, law: Any = None, speed: float = 1.0) -> dict[str, Any]:
        options = {"capabilities": Capabilities(interpolates_inputs=True, state=True)}
        push = make.table(make.variable("force", "input", "N"), make.variable("velocity", "output", "m/s"))
        pull = make.table(
            make.variable("velocity", "input", "m/s"), make.variable("force", "output", "N", ["velocity"]),
            make.variable("travel", "output", "m"),
        )  # fmt: skip
        force = law or (lambda x, v: STIFFNESS * x + damping * v)
        mass = Restorable(
            push, lambda v, _: {"velocity": v},
            lambda v, a, b, h: v - 0.5 * (a["force"] + b["force"]) * h / MASS, speed, **options,
        )  # fmt: skip
        damper = Restorable(
            pull, lambda x, u: {"force": force(x, u["velocity"]), "travel": x},
            lambda x, a, b, h: x + 0.5 * (a["velocity"] + b["velocity"]) * h, **options,
        )  # fmt: skip
        return {"car": mass, "shock": damper}

    return made


def ran(parts: dict[str, Any], algorithm: Algorithm, *, step: float = 0.004, stop: float = 0.043) -> Result:
    """Run the mass and the damper; by default in steps of 4 ms, with a last step of 3 ms."""
    system = System(parts, [Bond.between("car", "shock", displacement=False)])
    return run(system, Scenario(stop), algorithm=algorithm, step=step, engine="python")
