"""Co-simulation of FMUs: components, systems, algorithms, results. Knows FMI and signals, no physics."""

from cosim.algorithm import Adaptive, Algorithm, GaussSeidel, Implicit, Jacobi
from cosim.automatic import SCHEMES, Automatic
from cosim.component import Capabilities, Component, UnitDefinition, Variable
from cosim.fmu_component import FmuComponent
from cosim.isolated_component import IsolatedComponent
from cosim.master import Verification, run, verify
from cosim.result import BondEnergy, Coupled, Result
from cosim.session import RunInterrupted
from cosim.system import DEFAULT_STEP, Bond, Connection, Scenario, System
from cosim.system_file import open_component

__all__ = [
    "DEFAULT_STEP",
    "SCHEMES",
    "Adaptive",
    "Algorithm",
    "Automatic",
    "Bond",
    "BondEnergy",
    "Capabilities",
    "Component",
    "Connection",
    "Coupled",
    "FmuComponent",
    "GaussSeidel",
    "Implicit",
    "IsolatedComponent",
    "Jacobi",
    "Result",
    "RunInterrupted",
    "Scenario",
    "System",
    "UnitDefinition",
    "Variable",
    "Verification",
    "open_component",
    "run",
    "verify",
]
