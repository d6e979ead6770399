"""Checks, before a run, that the components have the abilities that an algorithm needs."""

from __future__ import annotations

from cosim.algorithm import Adaptive, Algorithm
from cosim.session.times import Times
from cosim.system import System
from eightpost.errors import WiringError


def check_variable_step(system: System, algorithm: Algorithm, times: Times, step: float) -> None:
    """Refuse steps of several sizes for a component that accepts only one size.

    Args:
        system: System with its components.
        algorithm: Algorithm of the run.
        times: Communication points (K+1,) [s].
        step: Coupling step [s].

    Raises:
        WiringError: The message names the component.
    """
    if not isinstance(algorithm, Adaptive) and abs(times[-1] - times[-2] - step) <= 1e-9 * step:
        return
    for name, component in system.components.items():
        if not component.capabilities.variable_step:
            raise WiringError(
                f"{name} accepts steps of one size only, and the stop time is not a whole number of coupling steps of "
                f"{step} s; change one of them"
                if not isinstance(algorithm, Adaptive)
                else f"{name} accepts steps of one size only: adaptive cannot step it"
            )


def check_repeats(system: System, algorithm: Algorithm) -> None:
    """Refuse an algorithm that repeats steps for a component that cannot save its state.

    Raises:
        WiringError: The message names the component.
    """
    if not algorithm.repeats:
        return
    for name, component in system.components.items():
        if not component.capabilities.state:
            raise WiringError(
                f"{algorithm.name} repeats steps, and {name} ({component.source}) cannot save and restore its state "
                "(canGetAndSetFMUstate); use gauss-seidel"
            )
