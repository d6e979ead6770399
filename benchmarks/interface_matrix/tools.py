"""The tools of the matrix, and how each runs the interface kinds."""

from __future__ import annotations

import importlib.metadata
from collections.abc import Callable
from dataclasses import dataclass

from benchmarks.interface_matrix import programs, python_tools
from benchmarks.interface_matrix.direct import Array, Subject, co_simulation, euler, exchange, exchange_held
from benchmarks.interface_matrix.programs import NotInstalledError

#: Interface kinds: FMI version, and whether model exchange.
KINDS = {"2.0 CS": (2, False), "2.0 ME": (2, True), "3.0 CS": (3, False), "3.0 ME": (3, True)}


@dataclass(frozen=True)
class Run:
    """How a tool runs an FMU: its outputs, and the direct result that they are compared with."""

    outputs: Callable[[Subject], Array]
    expected: Callable[[Subject], Array] = co_simulation


@dataclass(frozen=True)
class Tool:
    """A tool: how to find its version, and how it runs each interface kind, or the reason why it does not."""

    name: str
    version: Callable[[], str]
    co_simulation: Run | str
    exchange: Run | str = "co-simulation only"
    #: Reason why it refuses FMI 3.0, in the place of its message.
    fmi3: str = ""

    def run(self, kind: str) -> Run | str:
        """Return how the tool runs an interface kind, or why it does not."""
        return self.exchange if KINDS[kind][1] else self.co_simulation


def package(name: str, *others: str) -> Callable[[], str]:
    """Return a function that finds the version of a Python package, and that others, which it needs, are installed."""

    def version() -> str:
        try:
            versions = [importlib.metadata.version(one) for one in (name, *others)]
        except importlib.metadata.PackageNotFoundError as missing:
            raise NotInstalledError(f"the package {missing.name} is not installed") from None
        return versions[0]

    return version


TOOLS = (
    Tool("FMPy", package("FMPy"), Run(python_tools.fmpy_steps), Run(python_tools.fmpy_cvode, exchange_held)),
    Tool("FMPy, Euler", package("FMPy"), "see FMPy", Run(python_tools.fmpy_euler, euler)),
    Tool("`eightpost run`", package("eightpost"), Run(python_tools.own_master)),
    Tool("`cosim.HeldForce`", package("eightpost"), Run(python_tools.held_force)),
    Tool("force_law.h, gcc", programs.compiler_version, Run(programs.force_law_header), fmi3="FMI 2.0 only"),
    Tool("host.c, gcc", programs.compiler_version, Run(programs.c_host), fmi3="FMI 2.0 only"),
    Tool(
        "FMU Compliance Checker",
        programs.compliance_checker_version,
        Run(programs.checked_steps),
        Run(programs.checked_euler, euler),
        fmi3="FMI 2.0 only",
    ),
    Tool("CasADi", package("casadi"), "model exchange only", Run(python_tools.casadi, exchange)),
    Tool(
        "PathSim",
        package("pathsim", "pathsim-fmi"),
        Run(python_tools.pathsim_steps),
        Run(python_tools.pathsim_exchange, exchange),
    ),
    Tool(
        "libcosim", package("libcosimpy"), Run(programs.libcosim), fmi3="FMI 2.0 only; the process crashes, see below"
    ),
    Tool("ecos", package("ecospy"), Run(programs.ecos)),
    Tool("CoFMUPy", package("cofmupy"), Run(python_tools.cofmupy)),
    Tool("FMU Manipulation Toolbox", package("fmu_manipulation_toolbox"), Run(python_tools.fmu_container)),
)
