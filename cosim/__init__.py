"""Co-simulation of FMUs: components, systems, algorithms, results. Knows FMI and signals, no physics."""

from cosim.components.component import Capabilities, Component, UnitDefinition, Variable
from cosim.components.fmu_component import FmuComponent
from cosim.components.isolated import IsolatedComponent
from cosim.force_law import ExtrapolatedForce, ForceLaw, HeldForce
from cosim.session.result import Result
from cosim.session.run import Verification, run, verify
from cosim.session.session import RunInterrupted
from cosim.session.verdict import BondEnergy, Coupled
from cosim.system_file import open_component
from cosim.systems.algorithm import SCHEMES, Adaptive, Algorithm, Automatic, GaussSeidel, Implicit, Jacobi
from cosim.systems.coupling import Scenario
from cosim.systems.system import DEFAULT_STEP, Bond, Connection, System

__all__ = [
    "DEFAULT_STEP", "SCHEMES", "Adaptive", "Algorithm", "Automatic", "Bond", "BondEnergy", "Capabilities",
    "Component", "Connection", "Coupled", "ExtrapolatedForce", "FmuComponent", "ForceLaw", "GaussSeidel",
    "HeldForce", "Implicit", "IsolatedComponent", "Jacobi", "Result", "RunInterrupted", "Scenario", "System",
    "UnitDefinition", "Variable", "Verification", "open_component", "run", "verify",
]  # fmt: skip
