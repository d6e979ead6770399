"""Runs of coupled FMUs: one, one for each value of a parameter, their comparison, and setup studies."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias

from eightpost.api.reading import a, existing_toml
from eightpost.errors import InputError, check_number, choice_of

if TYPE_CHECKING:
    from cosim import Algorithm, Automatic, Result, Scenario, System
    from cosim.session.parameter_sweep import ParameterSweep
    from cosim.session.result import SavedRun
    from cosim.session.run import Case
    from cosim.study import Study
    from cosim.study.choice.compare import RunComparison
    from eightpost.api.study_folder import AssessedStudy
    from eightpost.progress import Progress

    Value: TypeAlias = float | bool | str
    Run: TypeAlias = Result | SavedRun | str | Path


# ---- Runs -----------------------------------------------------------------------------------------------------------

Engine = Literal["auto", "compiled", "python"]
SchemeName = Literal["default", "jacobi", "gauss-seidel", "implicit", "adaptive"]


def run(
    system: System | Case | str | Path,
    scenario: Scenario | None = None,
    *,
    parameters: Mapping[str, Value] | None = None,
    algorithm: SchemeName | Algorithm | Automatic | None = None,
    step: float | None = None,
    tolerance: float | None = None,
    compared: bool = True,
    progress: Progress | None = None,
    engine: Engine = "auto",
) -> Result:
    """Run a system of coupled FMUs and state its coupling error.

    Args:
        system: System, or a system file (.toml) or package (.ssp), which has a scenario of its own.
        scenario: Drive, duration and variables to record; None: that of the system file.
        parameters: Values for this run only, by `component.parameter`: numbers in the parameter's own unit, or texts
            such as "55 lbf". FMUs are not loaded again, and the system does not change.
        algorithm: Coupling algorithm; default: that of the file, else the one that finds scheme and step itself.
        step: Coupling step [s]; default: that of the file or of the algorithm.
        tolerance: Tolerated coupling error [%], of the algorithms `default` and `adaptive`.
        compared: Whether a run at a given step is compared with another one, to state its coupling error.
        progress: Callback that receives the number of completed coupling steps and the total, about ten times a second.
        engine: `auto`: the compiled loop if an FMU has C functions; `python`: the same loop interpreted, for a
            debugger, with equal results.

    Returns:
        The result: `.series["car.lf.tire_force"]` (SI), `.verdict`, `.coupling_error`, `.to_pandas()`, `.to_xarray()`,
        `.plot(channels)`, `.write(folder)`.

    Raises:
        WiringError: The system does not fit together, or there is no such parameter; the message lists similar names.
        InputError: An argument is wrong.
        StepError: An FMU failed; the message states the FMU, the time and its last messages.

    Example:
        >>> result = ep.run("car.toml", parameters={"lf.compression_scale": 1.2})
        >>> result.plot("car.lf.tire_force")
    """
    import cosim

    case = _case(system, scenario, algorithm, step, tolerance)
    return cosim.run(
        case.system,
        case.scenario,
        parameters=parameters,
        algorithm=case.algorithm,
        step=case.step,
        compared=compared,
        progress=progress,
        engine=engine,
    )


def sweep(
    system: System | Case | str | Path,
    scenario: Scenario | None = None,
    *,
    parameters: Mapping[str, Sequence[Value]] | Iterable[Mapping[str, Value]],
    algorithm: SchemeName | Algorithm | Automatic | None = None,
    step: float | None = None,
    tolerance: float | None = None,
    compared: bool = True,
    progress: Progress | None = None,
) -> ParameterSweep:
    """Run a system for several values of parameters; FMUs are loaded once.

    Args:
        system: System, or a system file or package; see `run` for this and the other arguments.
        scenario: Drive, duration and variables to record.
        parameters: Values of each parameter, of which all combinations are run; or one mapping for each run.
        algorithm: Coupling algorithm.
        step: Coupling step [s].
        tolerance: Tolerated coupling error [%].
        compared: Whether each run states its coupling error.
        progress: Callback that receives the amount of work done and the total.

    Returns:
        The results: `.results`, `.to_pandas("rms")` (a row per run), `.plot(channel)`.

    Raises:
        WiringError: There is no such parameter, or it does not allow a value; no run was started.
        InputError: There is no value.
        StepError: An FMU failed.

    Example:
        >>> found = ep.sweep("car.toml", parameters={"lf.compression_scale": [0.8, 1.0, 1.2]})
        >>> found.to_pandas()[["lf.compression_scale", "car.lf.tire_force"]]
    """
    from cosim.session.parameter_sweep import sweep_parameters
    from eightpost.progress import reported_to

    case = _case(system, scenario, algorithm, step, tolerance)
    with reported_to(progress):
        return sweep_parameters(
            case.system, case.scenario, parameters, algorithm=case.algorithm, step=case.step, compared=compared
        )


def compare(runs: Mapping[str, Run] | Sequence[Run], *, vehicle: str = "car") -> RunComparison:
    """Compare the response measures of runs; the first run is the baseline.

    Args:
        runs: Results, or folders that `eightpost run` wrote, by label or as a list.
        vehicle: Component whose channels give the ride measures.

    Returns:
        The comparison: `.to_pandas()` (a row per measure, with the change from the first run to the last), `.plot()`,
        `.verdict`.

    Raises:
        InputError: There are fewer than two runs, or they have no channel in common.

    Example:
        >>> ep.compare({"soft": soft, "stiff": stiff}).to_pandas()
    """
    from cosim.session.result import Result, SavedRun
    from cosim.study.choice.compare import compare_runs

    if isinstance(runs, str | Path | Result | SavedRun):
        raise InputError("compare needs a list or a mapping of at least two runs; the first is the baseline")
    if isinstance(runs, Mapping):
        named: dict[str, Run] = dict(runs)
    else:
        named = {str(run) if isinstance(run, str | Path) else f"run {k}": run for k, run in enumerate(runs, start=1)}
    found: dict[str, Result | SavedRun] = {}
    for label, given in named.items():
        if isinstance(given, str | Path):
            found[label] = SavedRun.load(given)
        elif isinstance(given, Result | SavedRun):
            found[label] = given
        else:
            raise InputError(f"compare takes results of runs and their folders; {label!r} is {a(given)}")
    return compare_runs(found, vehicle)


def _case(
    system: System | Case | str | Path,
    scenario: Scenario | None,
    algorithm: SchemeName | Algorithm | Automatic | None,
    step: float | None,
    tolerance: float | None,
) -> Case:
    """Return the system to run with its scenario and coupling."""
    from cosim.session.run import Case
    from cosim.system_file import read_case
    from cosim.systems.algorithm import SCHEMES
    from cosim.systems.coupling import Scenario
    from cosim.systems.system import System

    check_number("step", step, "s")
    check_number("tolerance", tolerance, "%")
    if isinstance(scenario, int | float):
        raise InputError(f"the scenario is {scenario!r}; write Scenario(stop={scenario!r}, drive=...)")
    if scenario is not None and not isinstance(scenario, Scenario):
        raise InputError(f"the scenario must be a Scenario, not {a(scenario)}; write Scenario(stop=5.0, drive=...)")
    if isinstance(system, System):
        if scenario is None:
            raise InputError("a System has no scenario; give one: run(system, Scenario(stop=5.0, drive=...))")
        case = Case("system", system, scenario)
    elif isinstance(system, Case | str | Path):
        case = system if isinstance(system, Case) else read_case(existing_toml(system, "system"))
        case = case if scenario is None else replace(case, scenario=scenario)
    else:
        raise InputError(f"run takes a System or a system file, not {a(system)}")
    if isinstance(algorithm, str):
        return case.with_coupling(choice_of("algorithm", algorithm, SCHEMES), step, tolerance)
    if algorithm is not None:
        case = replace(case, algorithm=algorithm)
    return case.with_coupling(None, step, tolerance)


# ---- Setup studies --------------------------------------------------------------------------------------------------


def study(
    definition: Study | str | Path,
    folder: str | Path,
    *,
    certainty: bool = True,
    workers: int | None = None,
    progress: Progress | None = None,
) -> AssessedStudy:
    """Run every setup of shocks that a study allows, and compute how sure the choice of the best one is.

    A study that was stopped resumes where it stopped when it is run again with the same folder. The verbs that use its
    results are methods of `eightpost.api.study_folder.StudyFolder`.

    Args:
        definition: Study, or its file (docs/how_to/study.md). FMUs of its shock and vehicle files are built first.
        folder: Folder of results.parquet and of the intermediate results.
        certainty: Whether the certainty is computed, which runs some setups again with changed shocks.
        workers: Number of processes; default: one for each processor.
        progress: Callback that receives the amount of work done and the total.

    Returns:
        The table: `.ranking()`, `.setup(row)`, `.certainty`, `.verdict`, `.to_pandas()` (a row per setup),
        `.to_xarray()`, `.plot()`.

    Raises:
        InputError: The study cannot be run; no simulation was started.
        StepError: No setup could be run.

    Example:
        >>> result = ep.study(ep.examples() / "study.toml", "study")
        >>> result.to_pandas().nsmallest(10, "objective")
        >>> result.certainty.ties
    """
    check_number("workers", workers)
    if workers is not None and workers < 1:
        raise InputError(f"workers is {workers!r}; it must be 1 or more")
    from cosim.study import Study
    from eightpost.api.study_folder import StudyFolder
    from eightpost.progress import portion, reported_to

    with reported_to(progress):
        with portion(0.0, 0.05):
            file = definition if isinstance(definition, Study) else existing_toml(definition, "study")
            opened = StudyFolder(folder, file, workers=workers)
        with portion(0.05, 1.0):
            return opened.run(certainty=certainty)
