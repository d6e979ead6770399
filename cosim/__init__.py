"""Co-simulation of FMUs: components, systems, algorithms, results. Knows FMI and signals, no physics."""

from cosim.algorithm import ALGORITHMS, Algorithm, GaussSeidel, Jacobi
from cosim.component import Capabilities, Component, UnitDefinition, Variable
from cosim.energy import BondEnergy
from cosim.fmu_component import FmuComponent
from cosim.master import DEFAULT_STEP, run
from cosim.result import Result
from cosim.scenario import Scenario
from cosim.system import Bond, Connection, System

__all__ = [
    "ALGORITHMS",
    "DEFAULT_STEP",
    "Algorithm",
    "Bond",
    "BondEnergy",
    "Capabilities",
    "Component",
    "Connection",
    "FmuComponent",
    "GaussSeidel",
    "Jacobi",
    "Result",
    "Scenario",
    "System",
    "UnitDefinition",
    "Variable",
    "run",
]
