"""Setup studies."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from eightpost.api.arguments import existing_toml
from eightpost.errors import InputError, check_number

if TYPE_CHECKING:
    from builder.build import Built
    from cosim.study import Study, StudyResult
    from eightpost.progress import Progress


def study(
    definition: Study | str | Path,
    folder: str | Path,
    *,
    workers: int | None = None,
    progress: Progress | None = None,
) -> StudyResult:
    """Run every setup of shocks that a study allows.

    A study that was stopped resumes where it stopped when it is run again with the same folder.

    Args:
        definition: Study, or its file (docs/how_to/study.md). FMUs of its shock and vehicle files are built first.
        folder: Folder of results.parquet and of the intermediate results.
        workers: Number of processes; default: one for each processor.
        progress: Callback that receives the amount of work done and the total.

    Returns:
        The table: `.ranking()`, `.setup(row)`, `.to_pandas()` (a row per setup), `.to_xarray()`, `.plot()`.

    Raises:
        InputError: The study cannot be run; no simulation was started.
        StepError: No setup could be run.

    Example:
        >>> result = ep.study(ep.examples() / "study.toml", "study")
        >>> result.to_pandas().nsmallest(10, "objective")
    """
    from builder.build import build
    from cosim.study import Study
    from cosim.study.running.sweep import run_study
    from cosim.study.running.workers import ProcessWorkers
    from eightpost.progress import advance, portion, reported_to
    from eightpost.workers.process import usable_processors

    check_number("workers", workers)
    if workers is not None and workers < 1:
        raise InputError(f"workers is {workers!r}; it must be 1 or more")
    with reported_to(progress):
        if not isinstance(definition, Study):
            with portion(0.0, 0.05):
                definition, _ = read_with_fmus(
                    definition, Path(folder) / "fmus", lambda sources, to: build(sources, to, progress=advance)
                )
        pool = ProcessWorkers(workers or usable_processors())
        try:
            with portion(0.05, 1.0):
                return run_study(definition, folder, pool, advance)
        finally:
            pool.close()


def read_with_fmus(
    path: str | Path, folder: Path, build: Callable[[Sequence[Path], Path], list[Built]]
) -> tuple[Study, list[Built]]:
    """Read a study; FMUs of its shock and vehicle files are built first. Return the study and the FMUs.

    Args:
        path: Study file.
        folder: Folder of the FMUs.
        build: Function that builds FMUs of files in a folder.

    Raises:
        InputError: The file cannot be read, or names a file that does not exist.
    """
    from cosim.study.study_file import read_study, source_files

    sources = source_files(existing_toml(path, "study"))
    if missing := [source for source in sources if not source.is_file()]:
        raise InputError(f"{path}: the file {missing[0]} does not exist; correct its name there, or make it first")
    built = build(sources, folder) if sources else []
    fmus = {Path(item.source): item.path for item in built}
    return read_study(path, lambda source: fmus.get(source, source)), built
