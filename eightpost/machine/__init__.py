"""The machine: a linear car that is advanced exactly, with shocks at its ports, for several setups at once.

A `Run` is a `LinearCar` on a `Drive`, and what is recorded; a `Batch` runs it with the shocks of one setup in each lane
of the processor. The laws are the C sources of the shocks' FMUs; docs/explanation/machine.md describes the method.
"""

from eightpost.machine.car import LAWS, Drive, LinearCar, NotInBatchError, Port, ShockData, UnstableCarError, Vehicle
from eightpost.machine.run import SIGNALS, Batch, BatchResult, Limit, Quantity, Run, joined

__all__ = [
    "LAWS", "SIGNALS", "Batch", "BatchResult", "Drive", "Limit", "LinearCar", "NotInBatchError", "Port", "Quantity",
    "Run", "ShockData", "UnstableCarError", "Vehicle", "joined",
]  # fmt: skip
