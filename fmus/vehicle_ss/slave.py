"""vehicle_ss for PythonFMU: a linear vehicle x' = A x + B u, y = C x + D u, stepped exactly with its inputs held.

The builder stages this file as <model>_<digest>.py beside the package <model>_<digest>_law, which holds the library's
own stepping kernel, to the byte. Needs numpy and scipy in the host's Python.
"""

from importlib import import_module

import numpy as np

TableSlave = import_module(f"{__name__}_law.table_slave").TableSlave
LinearStepper = import_module(f"{__name__}_law.kernel").LinearStepper


class VehicleSs(TableSlave):
    """A state space with named channels; outputs may carry a static offset (docs/ports.md)."""

    def __init__(self, **kwargs):
        super().__init__(f"{__name__}.json", **kwargs)
        model = self.model
        self.stepper = LinearStepper(*(np.array(model[name], dtype=float) for name in "ABCD"))
        self.inputs, self.outputs, self.offsets = model["inputs"], model["outputs"], model["offsets"]

    def refresh(self):
        self.offset = [self.values[name] if name else 0.0 for name in self.offsets]

    def initialise(self):
        u = self._input()
        x = self.stepper.equilibrium(u) if self.values["start_at_equilibrium"] else np.zeros(self.stepper.A.shape[0])
        self._respond(x, u)

    def advance(self, step):
        u = self._input()
        self._respond(self.stepper.advance(np.array(self.state), u, u, step), u)

    def _input(self):
        return np.array([self.values[name] for name in self.inputs])

    def _respond(self, x, u):
        self.state = x.tolist()
        y = self.stepper.output(x, u).tolist()
        for name, value, offset in zip(self.outputs, y, self.offset, strict=True):
            self.values[name] = value + offset
