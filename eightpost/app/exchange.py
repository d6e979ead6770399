"""`eightpost build`, `check` and `export`: FMUs, and files for other tools."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click
from rich.console import Console
from rich.markup import escape

from eightpost.api.reading import existing_toml, is_system
from eightpost.app.options import STATED, FilePath, OutputFile, Quantity, argument, group, option, setting, verb
from eightpost.app.show import bar, details, is_detailed, show_files, show_notes, show_table, show_text, show_verdict
from eightpost.errors import InputError
from eightpost.outputs import EXPORT, FMU, PACKAGE, check_file
from eightpost.report.console import Column, Table, console_table, folded, print_error, unbroken

if TYPE_CHECKING:
    from builder.assembly import Assembled
    from builder.build import Built
    from builder.check import CheckReport, Finding, Level, NotChecked, Scope
    from cosim.study.host_steps import HostSteps
    from eightpost.verdict import Verdict


TARGETS = ("native", "python", "all")
VERSIONS = ("2", "3", "all")


# ---- One FMU of a system ---------------------------------------------------------------------------------------------


def _assemble_with_progress(console: Console, source: Path, output: Path, *, fmi: int = 2) -> Assembled:
    """Build one FMU from a system file."""
    from builder.assembly import assemble
    from builder.build import fmu_identifier
    from cosim.system_file import read_case

    existing_toml(source, "system")
    path = output if output.suffix == ".fmu" else output / f"{fmu_identifier(source.stem)}.fmu"
    wiring = read_case(source).wiring
    with bar(console, "compiling") as advance:
        return assemble(wiring, path, fmi=fmi, progress=advance)


def _show_assembled(console: Console, built: Assembled) -> None:
    """Print the components of the FMU, its micro step and its platforms."""
    from eightpost.report.tables import file_size
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
    from builder.reference import Disclosure

    how = {"disclosure": Disclosure.CONFIDENTIAL if confidential else Disclosure.FULL, "target": target, "fmi": fmi}
    built = build_with_progress(console, sources, output, temperature_input=temperature_input, **how)
    verdict = show_built(console, built)
    ctx.exit(0 if verdict.is_acceptable else 1)


def build_with_progress(console: Console, sources: Sequence[str | Path], output: Path, **how: Any) -> list[Built]:
    """Build with a progress bar, because a first build compiles for all platforms; see `builder.build.build`."""
    from builder.build import build as build_fmus

    with bar(console, "compiling") as advance:
        return build_fmus(sources, output, progress=advance, **how)


def show_built(console: Console, built: list[Built]) -> Verdict:
    """Print the FMUs and the verdict that they carry; return the verdict."""
    from builder.build import verdict_on
    from eightpost.report.tables import file_size

    files = [f"{item.path}: {item.interface.kind} {item.interface.version}, FMI {item.fmi}.0, {item.target}, "
             f"{file_size(item.path)}" for item in built]  # fmt: skip
    show_notes(console, files, "wrote", most=5)
    show_notes(console, dict.fromkeys(item.limits for item in built if item.limits), most=1)
    verdict = verdict_on(built)
    show_verdict(console, verdict)
    return verdict


# ---- `eightpost check` ----------------------------------------------------------------------------------------------

_COLOURS = {"error": "bold red", "drop-in": "yellow", "hint": "cyan"}


@verb
def check(
    ctx: click.Context,
    files: tuple[Path, ...] = argument("FILE...", kind=FilePath()),
    standard: bool = option("Report only violations of the FMI standard; default: all findings."),
    as_json: bool = option("Print one JSON document instead of tables (docs/reference/check.md).", "--json"),
) -> None:  # fmt: skip
    """Check FMUs of any maker: the rules of the FMI standard, and known causes of failed imports.

    A FILE may also be a system file (.toml) with one vehicle and its shocks: then the result is the largest steps of a
    simulator that integrates the vehicle and imports the shocks, for each loop of docs/how_to/hosts.md.

    The check runs fmpy validate, fmutool -check, more than a hundred rules of its own, and the FMU itself. Findings are
    errors (violations of the FMI standard), drop-in rules (known causes of failed imports into tools) or hints.

    The FMU runs in separate processes, so a crash is a finding. This is not a sandbox: the FMU's code has all your
    permissions. The exit code is 0 if there are no findings except hints, 1 if there are other findings, and 2 if a
    file is not an FMU of FMI 2.0 or 3.0; the other files are reported nevertheless.

    \b
    Examples:
      eightpost check dist/*.fmu
      eightpost check examples/seven_dof.toml
      eightpost check --standard --json supplier.fmu > supplier.json
    """
    from builder.check import CheckReport, NotChecked, Scope, json_document

    fmus = [path for path in files if path.suffix != ".toml"]
    systems = {str(path): _host_steps(path) for path in files if path.suffix == ".toml"}
    scope = Scope.STANDARD if standard else Scope.ALL
    reports: list[CheckReport | NotChecked] = []
    with Console(stderr=True).status("") as status:
        for path in fmus:
            status.update(f"checking {escape(str(path))}")
            reports.append(_checked(path, scope))
    _warn(reports)
    refused = [report for report in reports if isinstance(report, NotChecked)]
    if as_json:
        document = json_document(reports)
        if systems:
            document["host_steps"] = {path: asdict(steps) for path, steps in systems.items()}
        click.echo(json.dumps(document, indent=1))  # ASCII, because a terminal may support nothing else
    else:
        console = Console()
        for report in reports:
            if isinstance(report, CheckReport):
                show_report(console, report)
        for name, steps in systems.items():
            _show_host_steps(console, name, steps)
    for report in refused:
        print_error(report.error)
    ctx.exit(2 if refused else int(not all(report.acceptable for report in reports)))


def _warn(reports: list[CheckReport | NotChecked]) -> None:
    """Print a note that the FMUs' code was run; on stderr, so that stdout holds only tables or JSON."""
    from builder.check import CheckReport

    if any(isinstance(report, CheckReport) and set(report.groups) - {"static", "tools"} for report in reports):
        text = "check runs the FMU's code in separate processes; this is not a sandbox"
        Console(stderr=True, soft_wrap=True).print(f"note: {text}", highlight=False, style="dim")


def _checked(path: Path, scope: Scope) -> CheckReport | NotChecked:
    """Check a file; a file that cannot be read must not hide the findings in the others."""
    from builder.check import NotChecked
    from builder.check import check as check_fmu

    try:
        return check_fmu(path, scope=scope)
    except InputError as error:
        return NotChecked(path, str(error))


def show_report(console: Console, report: CheckReport, *, with_findings: bool = True) -> None:
    """Print the findings in an FMU by level, the groups that were performed or skipped, and what no check sees."""
    from builder.check import LIMITS, Level

    console.print(f"{escape(str(report.path))}: {_verdict(report)}", highlight=False, soft_wrap=True)
    more = details(console)
    if not with_findings:
        return
    if report.findings:
        more.print(_table(report))
    if not is_detailed():
        findings = [_sentence(finding) for level in Level for finding in report.of(level)]
        show_notes(console, findings, "finding", most=3)
    show_text(more, f"performed {', '.join(report.groups) or 'nothing'}", begin="  ")
    for skipped in report.skipped:
        show_text(more, f"skipped {skipped.what}: {skipped.reason}", begin="  ")
    show_text(more, LIMITS, begin="  ")


def _sentence(finding: Finding) -> str:
    """Return a finding in a sentence: rule, what is wrong and where, what to do."""
    rule = finding.rule
    return f"{rule.identifier} {rule.title}{': ' if finding.message else ''}{finding.message}; {rule.advice}"


def _host_steps(path: Path) -> HostSteps:
    from cosim.study.host_steps import host_steps
    from cosim.system_file import read_case

    with Console(stderr=True).status(f"finding the steps for {escape(str(path))}"):
        return host_steps(read_case(existing_toml(path, "system")))


def _show_host_steps(console: Console, name: str, found: HostSteps) -> None:
    """Print the largest steps of each loop for a host that integrates the car."""
    from cosim.study.host_steps import LIMITS, LOOPS

    def milliseconds(step: float) -> str:
        return f"{1e3 * step:.3g} ms" if step else "below 0.1 ms"

    show_text(
        console,
        f"{name}: largest steps of a host that integrates {found.car} with Runge-Kutta, for errors of the "
        f"{found.quantity} in {found.seconds:g} s of the drive",
    )
    rows = [(loop, milliseconds(found.stable[loop]), *map(milliseconds, found.steps[loop])) for loop in LOOPS]
    show_table(console, console_table(["loop", "stable to", *(f"{limit:g} %" for limit in LIMITS)], rows))
    show_text(console, "loops of docs/how_to/hosts.md; friction at the vehicle's ports is left out", begin="  ")


def _verdict(report: CheckReport) -> str:
    from builder.check import Level

    counts = {level: len(report.of(level)) for level in Level}
    parts = [f"[{_COLOURS[level.value]}]{_count(level, number)}[/]" for level, number in counts.items() if number]
    return ", ".join(parts) if parts else "[bold green]clean[/]"


def _count(level: Level, number: int) -> str:
    from builder.check import Level

    names = {Level.ERROR: "error", Level.DROP_IN: "drop-in rule", Level.HINT: "hint"}
    return f"{number} {names[level]}{'' if number == 1 else 's'}"


def _table(report: CheckReport) -> Table:
    from builder.check import Level

    wide = [Column(name, overflow="fold", ratio=ratio) for name, ratio in (("finding", 3), ("what to do", 2))]
    groups = (map(_row, report.of(level)) for level in Level)
    return console_table([*unbroken("level", "rule"), *wide], *groups, expand=True)


def _row(finding: Finding) -> tuple[str, ...]:
    rule, level = finding.rule, finding.rule.level.value
    text = f"{rule.title}: {finding.message}" if finding.message else rule.title
    advice = f"{escape(rule.advice)} [dim]({rule.source})[/]"
    return (f"[{_COLOURS[level]}]{level}[/]", rule.identifier, escape(text), advice)


# ---- `eightpost export` ---------------------------------------------------------------------------------------------

#: Settings of a vehicle or a response, and options and settings of shocks.
_VEHICLE_SETTINGS, _OF_SHOCKS = {"ports", "high", "step"}, {"error", "speed", "--format", "--over"}


def _default_package(given: Mapping[str, Any]) -> Path:
    """Return the package of a system; other sources have no default."""
    (first, *_) = given["sources"]
    if not is_system(first):
        raise click.UsageError("Missing option '-o' / '--output'.")
    return Path(first).with_suffix(".ssp")


@dataclass(frozen=True, slots=True)
class _ExportOptions:
    """Options of `eightpost export`."""

    # fmt: off
    sources: tuple[Path, ...] = argument("SOURCE...", kind=FilePath())
    output: Path = option(
        "Output file: of a vehicle .mat, .uff or .unv; of shocks .csv, .mat, .m, .txt or .dpr; of a system .ssp. "
        "Default: of a system its name with the suffix .ssp (of a package _new.ssp); no default for others.",
        "-o", "--output", kind=OutputFile(EXPORT, default=_default_package),
    )
    table_format: str | None = option(
        "Shocks: format of the table: csv (.csv), mat and m (Simulink lookup tables, .mat and .m), modelica "
        "(CombiTable, .txt), dpr (Adams TeimOrbit, .dpr), carmaker (lines of a vehicle file, any suffix). Default: by "
        "the suffix of the output.",
        "--format", kind=("csv", "mat", "m", "modelica", "dpr", "carmaker"),
    )
    over: str | None = option(
        "Shocks: setting in which several shocks differ, with a value for each in the order of the files, e.g. "
        "clicks=0,4,8; or settings of one shock that was fitted over them, e.g. rebound=0,7,14 or 'temperature "
        "[degC]=20,60'. Default: none, for one shock at its reference setting.",
        metavar="NAME=VALUE,...",
    )
    ports: Literal["difference", "whole"] = setting(
        "Meaning of a vehicle's shock inputs. difference: the force of the shock minus the force of the baseline "
        "damper. whole: the whole force of the shock.",
        kind=("difference", "whole"), default="difference",
    )
    high: float = setting("Highest frequency of a vehicle's response.", kind=Quantity("Hz", bare=True), default="25 Hz")
    step: float = setting(
        "Distance between the frequencies of a vehicle's response.", kind=Quantity("Hz", bare=True), default="0.05 Hz"
    )
    error: float = setting(
        "Shocks: maximum error of linear interpolation by velocity [% of the range of force]; a smaller one gives "
        "more points.",
        kind=click.FLOAT, default=0.1,
    )
    speed: float | None = setting(
        "Shocks: highest velocity in both directions, e.g. '2 m/s'; default: the fitted range.", kind=Quantity("m/s")
    )
    # fmt: on


@verb
def export(ctx: click.Context, asked: _ExportOptions = group(_ExportOptions)) -> None:
    """Export models, frequency responses, shock curves and systems for other tools.

    SOURCE is a vehicle (.json, or .toml with parameters), a frequency response (.npz), or one or more shocks (.json). A
    vehicle is exported to a .mat file with A, B, C, D, names and units, or as its frequency response to a universal
    file (dataset 58). A frequency response is exported to either format.

    A shock is exported as a table of its static curve. Several shocks, or one that was fitted over its settings, are a
    table over a setting, which --over names. Gas force, seal friction and lag are not in a table; the file states them
    in its comments. For conventions of signs and the origin of each format see docs/how_to/exports.md.

    A system file or package becomes an SSP 1.0 package with its FMUs, their connections, and for each component a file
    of its settable parameters, resources/<component>.ssv; subsystems become one flat system. A package cannot hold a
    drive file: the tool that imports it drives the open inputs.

    \b
    Examples:
      eightpost export vehicle.json -o car.mat
      eightpost export vehicle.json -o car.uff --set high='20 Hz' --set step='0.05 Hz'
      eightpost export response.npz -o response.mat
      eightpost export shock.json -o shock.dpr
      eightpost export shock.json --format carmaker -o damper_front.info --set error=0.5
      eightpost export c0.json c4.json c8.json --over clicks=0,4,8 -o clicks.mat
      eightpost export adjustable.json --over rebound=0,7,14,21,28 -o clicks.txt
      eightpost export examples/seven_dof.toml -o car.ssp
    """
    from eightpost.ident.export import export as write
    from eightpost.ident.export import export_shocks, has_shocks

    console = Console(soft_wrap=True, highlight=False)
    if is_system(asked.sources[0]):
        _export_system(console, asked.sources[0], asked.output)
        return
    is_shock = has_shocks(asked.sources)
    options = {"--format": asked.table_format, "--over": asked.over}
    stated = {*ctx.meta[STATED], *(name for name, given in options.items() if given)}
    wrong, kind = (_VEHICLE_SETTINGS, "shocks") if is_shock else (_OF_SHOCKS, "vehicles and responses")
    if refused := stated & wrong:
        raise click.BadParameter(f"it does not apply to {kind}; omit it", param_hint=", ".join(sorted(refused)))
    if is_shock:
        error, speed = asked.error / 100.0, asked.speed
        summary, *remarks = export_shocks(
            asked.sources, asked.output, name=asked.table_format, over=asked.over, error=error, speed=speed
        )  # fmt: skip
        show_notes(console, remarks)
    else:
        summary = write(asked.sources[0], asked.output, ports=asked.ports, high=asked.high, step=asked.step)
    show_files(console, [asked.output], f": {summary}")


def _export_system(console: Console, system: Path, output: Path) -> None:
    from builder.ssp import write_ssp
    from cosim.system_file import read_case

    check_file(output, PACKAGE, "-o")
    case = read_case(system)
    open_inputs = write_ssp(output, case.wiring)
    count = len(case.system.components)
    show_text(console, f"wrote {output}: {count} components, {len(case.system.all_connections)} connections, SSP 1.0")
    if open_inputs:
        show_text(console, f"open inputs, 0 unless driven: {', '.join(open_inputs)}", begin="  ")
