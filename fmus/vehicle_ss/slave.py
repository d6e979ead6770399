"""vehicle_ss for PythonFMU: a linear vehicle x' = A x + B u, y = C x + D u, with friction and springs at its ports.

The linear part is stepped exactly with its inputs held. The builder copies this file to <model>_<digest>.py next to the
package <model>_<digest>_law, which contains the same stepping kernel and friction that the library uses. The host's
Python needs numpy and scipy.
"""

from importlib import import_module

import numpy as np

TableSlave = import_module(f"{__name__}_law.table_slave").TableSlave
LinearStepper = import_module(f"{__name__}_law.kernel").LinearStepper
friction = import_module(f"{__name__}_law.friction")


class VehicleSs(TableSlave):
    """A state space with named channels; a static offset may be added to an output (docs/reference/ports.md)."""

    def __init__(self, **kwargs):
        super().__init__(f"{__name__}.json", **kwargs)
        model = self.model
        self.stepper = LinearStepper(*(np.array(model[name], dtype=float) for name in "ABCD"))
        self.inputs, self.outputs, self.offsets = model["inputs"], model["outputs"], model["offsets"]
        # A port's name ends with a dot; the port of a quarter car is "".
        self.port_names = model["ports"]
        self.ports = friction.named_ports(self.stepper, (self.inputs, self.outputs), self.port_names, model["springs"])

    def refresh(self):
        self.offset = [self.values[name] if name else 0.0 for name in self.offsets]
        self.friction = friction.PortFriction.of_values(self.ports, self.port_names, self.values)

    def initialise(self):
        u = self._input()
        if self.values["start_at_equilibrium"]:
            x = friction.equilibrium(self.stepper, self.friction, u)
        else:
            x = np.zeros(self.stepper.A.shape[0] + self.friction.states)
        self._respond(x, u)

    def advance(self, step):
        u = self._input()
        self._respond(friction.advance(self.stepper, self.friction, np.array(self.state), u, u, step), u)

    def _input(self):
        return np.array([self.values[name] for name in self.inputs])

    def _respond(self, x, u):
        self.state = x.tolist()
        y = friction.output(self.stepper, self.friction, x, u).tolist()
        for name, value, offset in zip(self.outputs, y, self.offset, strict=True):
            self.values[name] = value + offset
