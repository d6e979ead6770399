"""Opening of an FMU as a component, in this process or in its own."""

from __future__ import annotations

from pathlib import Path

from cosim.fmu_component import FmuComponent
from cosim.isolated_component import IsolatedComponent


def open_component(
    path: str | Path, name: str, *, isolate: bool = False, compile_missing: bool = False
) -> FmuComponent | IsolatedComponent:
    """Open an FMU.

    Args:
        path: FMU file (.fmu).
        name: Name of the component.
        isolate: Whether to run it in its own process, where a crash or hang is a failed step.
        compile_missing: Whether to compile its sources if it has no binary for this platform.

    Raises:
        FmuError: The file is missing, damaged or unsafe, is not an FMI 2.0 co-simulation FMU, or has no binary for
            this platform.
    """
    kind = IsolatedComponent if isolate else FmuComponent
    return kind(path, name, compile_missing=compile_missing)
