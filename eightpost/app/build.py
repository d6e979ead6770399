"""`eightpost build`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console
from rich.markup import escape

from eightpost.api.reading import is_system
from eightpost.app.options import FilePath, OutputFile, argument, option, verb
from eightpost.app.show import bar
from eightpost.outputs import FMU
from eightpost.report.console import console_table, folded

if TYPE_CHECKING:
    from builder.assembly import Assembled
    from builder.build import Built
    from eightpost.verdict import Verdict

TARGETS = ("native", "python", "all")
VERSIONS = ("2", "3", "all")


# ---- One FMU of a system ---------------------------------------------------------------------------------------------


def _assemble_with_progress(console: Console, source: Path, output: Path, *, fmi: int = 2) -> Assembled:
    """Build one FMU from a system file."""
    from builder.assembly import assemble
    from builder.build import fmu_identifier
    from cosim.system_file import read_case
    from eightpost.api.reading import existing_toml

    existing_toml(source, "system")
    path = output if output.suffix == ".fmu" else output / f"{fmu_identifier(source.stem)}.fmu"
    wiring = read_case(source).wiring
    with bar(console, "compiling") as advance:
        return assemble(wiring, path, fmi=fmi, progress=advance)


def _show_assembled(console: Console, built: Assembled) -> None:
    """Print the components of the FMU, its micro step and its platforms."""
    from eightpost.report.numbers import file_size
    from eightpost.units import convert

    names = built.interface.names
    rows = []
    for part in built.assembly.parts:
        sources = [link.source for link in built.assembly.links if link.target.startswith(f"{part.name}.")]
        rows.append((part.name, part.file, f"{part.kind} {part.interface.version}", ", ".join(sources)))
    console.print(console_table([*folded("component", "FMU"), "interface", "sources"], rows))
    console.print(
        f"{escape(str(built.path))}: {len(names('input'))} inputs, {len(names('output'))} outputs, "
        f"{len(names('parameter'))} parameters, {file_size(built.path)}"
    )
    step = convert(built.coupling_step, "s", "ms")
    console.print(f"micro step: {step:g} ms at most (parameter coupling_step); error: output coupling_error, in %")
    console.print(f"platforms: {', '.join(built.platforms)}")
    if built.limits:
        console.print(f"[yellow]note[/] {escape(built.limits)}")


# ---- `eightpost build` ----------------------------------------------------------------------------------------------


@verb
def build(
    ctx: click.Context,
    /,
    sources: tuple[Path, ...] = argument("SOURCES...", kind=FilePath()),
    output: Path = option(
        "Output folder of the FMUs; of a system, a folder or the file name of its FMU.",
        "-o", "--output", kind=OutputFile(FMU, is_folder=lambda given: given["output"].suffix != ".fmu"),
        default=Path("dist"),
    ),
    target: str = option(
        "Code of the FMUs. native: compiled C, for any host on six platforms. python: the readable reference, for "
        "hosts with Python, numpy and scipy. all: both.",
        kind=TARGETS, default="native",
    ),
    fmi: str = option(
        "FMI version. 2: FMI 2.0. 3: FMI 3.0, for hosts that import it. all: both, from the same C code and with the "
        "same results; the FMU of FMI 3.0 is then named <name>_fmi3.fmu.",
        kind=VERSIONS, default="2",
    ),
    confidential: bool = option(
        "Leave out the sources, the static curve (picture and coefficients) and the names of the source files. The "
        "parameters of the lag, which a host may tune, stay readable.",
    ),
    temperature_input: bool = option(
        "Make the temperature of shocks that were fitted over it an input; without this option it is a tunable "
        "parameter.",
    ),
) -> None:  # fmt: skip
    """Build an FMU from each source, for co-simulation and model exchange.

    SOURCES are shock files (written by `eightpost fit`) and vehicle files: parameters (.toml) or an identified state
    space (.json). A system file (.toml) becomes one FMU: a vehicle and its shocks, with the coupling solved inside
    (docs/how_to/assembly.md).

    An FMU is named after its source, and the same source gives the same bytes. The FMU carries the verdict on its
    model, and every run repeats this verdict. The exit code is 1 if a model is not usable (docs/reference/verdict.md);
    its FMU is written nevertheless.

    \b
    Examples:
      eightpost build shock.json car.toml -o dist/
      eightpost build shock.json car.toml --fmi all -o dist/
      eightpost build system.toml -o dist/car_with_shocks.fmu
    """
    console = Console()
    if systems := [source for source in sources if is_system(source)]:
        if len(sources) > 1 or confidential or temperature_input or target != "native" or fmi == "all":
            raise click.UsageError(
                f"{systems[0]} is a system, of which one FMU is built: omit other SOURCES, --confidential, "
                "--temperature-input, --target and --fmi all"
            )
        _show_assembled(console, _assemble_with_progress(console, systems[0], output, fmi=int(fmi)))
        return
    if output.suffix == ".fmu":
        raise click.UsageError(f"{output}: FMUs are named after their SOURCES; name a folder with -o")
    built = build_with_progress(
        console,
        sources,
        output,
        target=target,
        fmi=fmi,
        confidential=confidential,
        temperature_input=temperature_input,
    )
    verdict = show_built(console, built)
    ctx.exit(0 if verdict.is_acceptable else 1)


def build_with_progress(
    console: Console,
    sources: Sequence[str | Path],
    output: Path,
    *,
    target: str = "native",
    fmi: str = "2",
    confidential: bool = False,
    temperature_input: bool = False,
) -> list[Built]:
    """Build with a progress bar, because a first build compiles for all platforms."""
    from builder.build import build as build_fmus
    from builder.reference import Disclosure

    with bar(console, "compiling") as advance:
        return build_fmus(
            sources,
            output,
            target=target,
            fmi=fmi,
            disclosure=Disclosure.CONFIDENTIAL if confidential else Disclosure.FULL,
            temperature_input=temperature_input,
            progress=advance,
        )


def show_built(console: Console, built: list[Built]) -> Verdict:
    """Print the FMUs and the verdict that they carry; return the verdict."""
    from builder.build import verdict_on
    from eightpost.app.show import show_notes, show_verdict
    from eightpost.report.numbers import file_size

    files = [f"{item.path}: {item.interface.kind} {item.interface.version}, FMI {item.fmi}.0, {item.target}, "
             f"{file_size(item.path)}" for item in built]  # fmt: skip
    show_notes(console, files, "wrote", most=5)
    show_notes(console, dict.fromkeys(item.limits for item in built if item.limits), most=1)
    verdict = verdict_on(built)
    show_verdict(console, verdict)
    return verdict
