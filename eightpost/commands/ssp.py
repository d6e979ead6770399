"""`eightpost ssp`."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console

from builder.ssp import SspComponent, SspConnection, SspSystem, write_ssp
from cosim import DEFAULT_STEP
from cosim.conversion import convert_between
from cosim.system_file import Case, read_case
from eightpost.errors import InputError, WiringError


def ssp(system: Path, output: Path | None) -> None:
    """Write a system of coupled FMUs as an SSP 1.0 package for other tools."""
    output = output or system.with_suffix(".ssp")
    if output.resolve() == system.resolve():
        raise InputError(f"{output}: the output is the input package itself; name another file with -o")
    case = read_case(system)
    open_inputs = write_ssp(output, ssp_system(case))
    console = Console()
    count = len(case.system.components)
    console.print(f"{output}: {count} components, {len(case.system.all_connections)} connections, SSP 1.0")
    if open_inputs:
        console.print(f"  open inputs, 0 unless driven: {', '.join(open_inputs)}", highlight=False)


def ssp_system(case: Case) -> SspSystem:
    """Return the system of a case as the content of a package.

    Raises:
        InputError: A parameter is neither a number nor true or false.
        WiringError: An input adds up several sources.
    """
    system = case.system
    if system.sums:
        raise WiringError(f"{min(system.sums)} adds up several sources: SSP 1.0 allows one source per input, no sums")
    components = []
    for name in system.components:
        values = dict(system.parameters.get(name, {}))
        values |= {k.partition(".")[2]: v for k, v in system.constants.items() if k.partition(".")[0] == name}
        numbers = {k: v for k, v in values.items() if not isinstance(v, str)}
        if words := sorted(set(values) - set(numbers)):
            raise InputError(f"{name}.{words[0]} is text; the package can hold only numbers and true or false")
        components.append(SspComponent(name, case.fmus[name], numbers))
    connections = []
    for c in system.all_connections:
        conversion = convert_between(system.output(c.source).unit, system.input(c.target).unit, c.source)
        factor, offset = c.gain * conversion.factor, c.gain * conversion.offset + c.offset
        connections.append(SspConnection(c.source, c.target, factor, offset, c.convert))
    return SspSystem(case.name, tuple(components), tuple(connections), case.step or DEFAULT_STEP, case.scenario.stop)
