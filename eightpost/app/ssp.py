"""`eightpost ssp`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console

from eightpost.errors import InputError, WiringError

if TYPE_CHECKING:
    from builder.ssp import SspSystem
    from cosim.system_file import Case


@click.command()
@click.argument("system", type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path),
              help="Output package; default: SYSTEM with the suffix .ssp.")  # fmt: skip
def ssp(system: Path, output: Path | None) -> None:
    """Write a system of coupled FMUs as an SSP 1.0 package for other tools.

    SYSTEM is a file that `eightpost run` accepts; a package with subsystems is written as one flat system. The package
    holds the FMUs, their connections, and for each component a file of its settable parameters,
    resources/<component>.ssv. A package cannot hold a drive file: the tool that imports the package drives the open
    inputs.

    \b
    Example:
      eightpost ssp examples/seven_dof.toml -o car.ssp
    """
    from builder.ssp import write_ssp
    from cosim.system_file import read_case

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
    from builder.ssp import SspComponent, SspConnection, SspSystem
    from cosim import DEFAULT_STEP
    from cosim.conversion import convert_between

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
