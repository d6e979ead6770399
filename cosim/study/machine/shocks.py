"""Shock FMUs as data of the machine."""

from __future__ import annotations

from pathlib import Path

from cosim.components.fmu_component import FmuComponent
from cosim.study.definition import Parameters
from cosim.study.machine.sources import Sources
from eightpost.machine import LAWS, NotInBatchError, ShockData


def read_shock(component: FmuComponent, path: Path, given: Parameters) -> ShockData:
    """Return the data of a shock FMU.

    Args:
        component: FMU.
        path: FMU file.
        given: Values of parameters that differ from the FMU's.

    Raises:
        NotInBatchError: It is not a shock of this project, contains no sources, or has settings.
    """
    sources = Sources.of(component, path)
    law = sources.kind.removeprefix("shock_")
    if law not in LAWS:
        raise NotInBatchError(f"{path.name} is {sources.kind}, a law that has no batch")
    if "settings_data.h" in sources.files:
        raise NotInBatchError(f"{path.name} has settings")
    own = component.variables.values()
    values = {v.name: v.start for v in own if v.causality == "parameter" and v.start is not None}
    values |= given

    def numbers(parameter: str, count: int) -> list[float]:
        names = [parameter] if count == 1 else [f"{parameter}[{k + 1}]" for k in range(count)]
        return [float(values[name]) for name in names]

    try:
        return ShockData.of(law, numbers)
    except (KeyError, ValueError) as error:
        raise NotInBatchError(f"{path.name} has other parameters than this version knows: {error}") from error
