"""`eightpost demo`: the whole workflow once, on shipped synthetic data."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console

from eightpost import completion
from eightpost.app.exchange import build_with_progress, show_built, show_report
from eightpost.app.fit import show_fit, show_test
from eightpost.app.options import OutputFolder, option, verb
from eightpost.app.run import run_with_progress
from eightpost.app.show import ConsoleListener, details, is_detailed, show_text
from eightpost.app.study import show_result as show_study_result
from eightpost.app.study import show_study, without_builds
from eightpost.app.study_hardware import measure_table
from eightpost.corners import CORNERS
from eightpost.examples_folder import examples_folder

if TYPE_CHECKING:
    import cosim
    from eightpost.ident import ShockFit
    from eightpost.ident.shock.law_fit import LawName
    from eightpost.rig import DynoTest

_SYNTHETIC = "(synthetic data)"
_BUILDS = ("A", "B", "C")
_BASELINE, _SWAP, _CORNER = "A", "B", "lf"
#: Length of the lap in the study of every setup [s].
_STUDIED = 12.0
#: Number of changed measures that are listed.
_LISTED = 6
_TRACES = ("car.lf.velocity", "lf.force", "car.lf.tire_force", "car.front.ride_height", "car.lf.hub_acceleration")
_SPECTRA = ("car.lf.tire_force", "car.front.ride_height", "car.lf.hub_acceleration", "car.lf.velocity")


@verb
def demo(
    ctx: click.Context,
    output: Path = option(
        "Output folder for all files of the demo.", "-o", "--output", kind=OutputFolder(), default=Path("demo")
    ),
) -> None:  # fmt: skip
    """Run the whole workflow on shipped data: fit, build, check, couple, swap a shock, measure, run every setup.

    All data are SYNTHETIC: examples/make_demo_data.py computes the dynamometer records and the track,
    examples/make_identified.py the identified car and its lap.
    """
    console = Console()
    examples = examples_folder()
    completion.begin(output)
    _fit_builds(console, examples, output)
    clean = _build_and_check(console, examples, output)
    results = _couple_and_swap(console, examples, output)
    _measure(console, results, output)
    _study(console, examples, output)
    ctx.exit(0 if clean and all(result.acceptable for result in results.values()) else 1)


def _fit_builds(console: Console, examples: Path, output: Path) -> None:
    """Fit three laws to the first record and LPNL2 to the others; write shock files and pictures."""
    from eightpost.ident import fit_table, plot_force_velocity
    from eightpost.rig import read_dyno_test
    from eightpost.shock import write_shock

    console.rule("1. Fit shock laws to dynamometer records (synthetic)")
    tests = {name: read_dyno_test(examples / "data" / f"dyno_{name}.csv") for name in _BUILDS}
    show_test(console, tests["A"])
    laws: tuple[LawName, ...] = ("polylinear", "lpf1", "lpnl2")
    first = [_fit("A", tests["A"], law) for law in laws]
    details(console).print(fit_table(first))
    show_fit(console, first[-1])
    fits = {"A": first[-1]} | {name: _fit(name, tests[name], "lpnl2") for name in _BUILDS[1:]}
    details(console).print(fit_table(list(fits.values())))
    for name, shock_fit in fits.items():
        write_shock(shock_fit.shock, output / f"dyno_{name}.json")
    plot_force_velocity(first, output / "fit_laws.png")
    plot_force_velocity(list(fits.values()), output / "fit_builds.png")


def _fit(name: str, test: DynoTest, law: LawName) -> ShockFit:
    # The demo's static tire loads and ride heights already include the gas force.
    from eightpost.ident import fit_shock

    return fit_shock(test, law, gas="included", name=f"build {name} {_SYNTHETIC}")


def _build_and_check(console: Console, examples: Path, output: Path) -> bool:
    from builder.check import check as check_fmu

    console.rule("2. Build and check FMUs")
    shocks = [output / f"dyno_{name}.json" for name in _BUILDS]
    built = build_with_progress(console, [*shocks, examples / "car.toml"], output / "fmus")
    show_built(console, built)
    checked = (built[0], built[-1])
    reports = [check_fmu(item.path) for item in checked]
    for report in reports:
        show_report(console, report, with_findings=is_detailed())
    return all(report.acceptable for report in reports)


def _couple_and_swap(console: Console, examples: Path, output: Path) -> dict[str, cosim.Result]:
    from cosim.system_file import read_case
    from eightpost.app.show import show_result

    console.rule(f"3. Couple the car with four shocks, then swap the {_CORNER} shock")
    folder = output / "fmus"
    shocks = dict.fromkeys(CORNERS, folder / f"dyno_{_BASELINE}.fmu")
    swapped = shocks | {_CORNER: folder / f"dyno_{_SWAP}.fmu"}
    results = {}
    for label, fmus in ((f"{_BASELINE} everywhere", shocks), (f"{_SWAP} at {_CORNER}", swapped)):
        case = read_case(examples / "seven_dof.toml", fmus={"car": folder / "car.fmu", **fmus})
        results[label] = run_with_progress(console, case)
        results[label].write(output / label.replace(" ", "_"))
    show_result(console, f"{_BASELINE} everywhere", results[f"{_BASELINE} everywhere"])
    return results


def _measure(console: Console, results: dict[str, cosim.Result], output: Path) -> None:
    from cosim.report.page import plot_spectra
    from cosim.study.choice import compare
    from eightpost.report import pictures

    console.rule("4. Response measures")
    compared = compare.compare_runs(results)
    details(console).print(measure_table(compared))
    changes = {measure.name: compared.change(measure) for measure in compared.measures}
    largest = sorted((name for name, change in changes.items() if change), key=lambda name: -abs(changes[name] or 0.0))
    for name in largest[:_LISTED]:
        console.print(f"  {changes[name]:+.2f} %  {name}", highlight=False)
    series = compared.runs
    traces = pictures.traces(series, _TRACES, start=10.0, stop=14.0, title=f"Time traces {_SYNTHETIC}")
    pictures.save(traces, output / "traces.png")
    plot_spectra(series, _SPECTRA, output / "spectra.png", f"Power spectral densities {_SYNTHETIC}")
    measures = compare.changes(series, compared.measures, title=f"Response measures {_SYNTHETIC}")
    pictures.save(measures, output / "measures.png")


def _study(console: Console, examples: Path, output: Path) -> None:
    """Run every setup of the three builds on the identified car; print the best one, how sure, and the page."""
    from cosim.study import Build, Drive, Study, Term, Vehicle
    from cosim.study.choice.certainty import summary_lines
    from cosim.study.measures import ride_measures
    from eightpost.api.study_folder import StudyFolder

    console.rule("5. Every setup on an identified car, and how sure the choice is")
    fmus, identified = output / "fmus", examples / "identified"
    (car,) = build_with_progress(console, [identified / "car.json"], fmus / "identified")
    bank = {name: Build(fmus / f"dyno_{name}.fmu") for name in _BUILDS}
    study = Study(
        name=f"three builds on an identified car {_SYNTHETIC}",
        vehicle=Vehicle(car.path, means_trusted=False),
        bank=bank,
        corners=dict.fromkeys(CORNERS, tuple(bank)),
        drives=(Drive("lap", identified / "lap.parquet", stop=_STUDIED),),
        measures=tuple(measure for measure in ride_measures("car") if not measure.absolute),
        objective=(Term("front ride height, RMS", 1000.0, "in"), Term("total tire force, RMS", 1.0, "lbf")),
        baseline=dict.fromkeys(CORNERS, _BASELINE),
    )
    more = details(console)
    folder = StudyFolder(output / "study", study, listener=ConsoleListener(more))
    show_study(more, folder.sweep)
    result = folder.run()
    show_study_result(more, result, result.certainty, top=5)
    page = folder.write_page()
    console.rule("The answer, for synthetic data")
    console.print(f"best of {len(result)} setups: {result.setup(int(result.ranking()[0]))}", highlight=False)
    if result.certainty is not None:
        show_text(console, without_builds(next(summary_lines(result, result.certainty))))
    console.print(f"page: {page}", highlight=False, soft_wrap=True)
