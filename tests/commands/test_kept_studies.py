"""What the verbs of studies print and write for constructed studies, kept word by word."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from cosim.study.choice.assess import Knowledge, certainty_of
from cosim.study.choice.certainty import write_certainty
from cosim.study.definition import Constraint, Term
from cosim.study.measures import Measure
from cosim.study.table import StudyResult
from eightpost.__main__ import main
from eightpost.api.study_folder import StudyFolder
from eightpost.corners import CORNERS
from eightpost.signals import TimeSeries, write_series
from tests.cosim.study.assessed import lag, stating
from tests.cosim.study.constructed import result

Unchanged = Callable[..., None]

BUILDS = ("A", "B", "C")
PLACES = {"lf": BUILDS, "rf": ("B",), "lr": ("A", "B"), "rr": BUILDS}


def study() -> StudyResult:
    found = result(
        {"a": lambda d: 2.0 + 0.1 * d[:, 0] - 0.05 * d[:, 3], "b": lambda d: 1.0 + 0.02 * d[:, 1] + 0.2 * d[:, 2]},
        builds=BUILDS, corners=PLACES, baseline=dict.fromkeys(CORNERS, "B"), objective=(Term("a", 2.0, "in"),),
        constraints=(Constraint("b", at_most=1.3),), failed=(3,), marks={5: "tire off the ground: lf", 12: "beyond"},
    )  # fmt: skip
    outputs = {"a": "front.ride_height", "b": "rear.ride_height"}
    measures = tuple(Measure(name, (f"car.{output}",), display="in") for name, output in outputs.items())
    found = replace(found, study=replace(found.study, measures=measures))
    return stating(found, dict.fromkeys(outputs.values(), (0.01, 0.2)))


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder of a study with a certainty, whose page is not written."""
    monkeypatch.setattr(StudyFolder, "write_page", lambda self: self.path / "report.html")
    monkeypatch.setenv("COLUMNS", "80")
    found = study()
    found.save(tmp_path / "results.parquet")
    known = Knowledge((lag("C", 0.01, 0.5, measure="a"),), run_to_run={"a": 0.003})
    write_certainty(certainty_of(found, known, draws=128), tmp_path / "certainty.parquet")
    return tmp_path


def record(levels: tuple[float, float], path: Path) -> None:
    time = np.arange(0.0, 30.01, 0.02)
    waves = [np.sqrt(2.0) * level * np.sin(2.0 * np.pi * time) for level in levels]
    rows = {f"{axle}.ride_height": ("m", wave) for axle, wave in zip(("front", "rear"), waves, strict=True)}
    write_series(TimeSeries.from_channels(time, rows), path)


def said(*arguments: str | Path, code: int = 0) -> str:
    done = CliRunner().invoke(main, ["-v", "study", *map(str, arguments)])
    assert done.exit_code == code, done.output
    return done.output


def test_what_select_says_is_unchanged(folder: Path, unchanged: Unchanged) -> None:
    unchanged(said("select", folder, "-n", "9"))
    unchanged(said("select", folder, "--measure", "a=2", "--measure", "b=1", "--set", "twice=1"), "counts")
    wrong = said("select", folder, "--measure", "a=2", "--measure", "b", code=2)
    assert "give every --measure a count" in wrong


def test_what_sensitivity_says_is_unchanged(folder: Path, unchanged: Unchanged) -> None:
    unchanged(said("sensitivity", folder, "-o", folder / "terms.parquet"))


@pytest.fixture
def runs(folder: Path) -> Path:
    """Return a list of two rig runs each of five setups; those of the last one are far from its prediction."""
    found = study()
    factors = {0: 1.002, 1: 0.995, 10: 1.004, 13: 1.0, 16: 1.25}
    lines = ["file,setup"]
    for number, factor in factors.items():
        for k in range(2):
            size = factor * (1.0 + 0.002 * k)
            levels = [size * float(found.values(name)[number]) for name in "ab"]
            record((levels[0], levels[1]), folder / f"r{number}_{k}.parquet")
            lines.append(f"r{number}_{k}.parquet,{number}")
    (folder / "runs.csv").write_text("\n".join(lines) + "\n")
    return folder / "runs.csv"


@pytest.mark.slow
@pytest.mark.parametrize(("options", "code"), [
    (("--set", "rank=0.9"), 1), (("--set", "rank=-1", "--measure", "a"), 0),
    (("--set", "rank=-1", "--set", "level=3"), 1),
], ids=["default", "rank", "level"])  # fmt: skip
def test_what_compare_says_of_rig_runs_is_unchanged(
    options: tuple[str, ...], code: int, folder: Path, runs: Path, unchanged: Unchanged
) -> None:
    unchanged(said("compare", folder, "--measured", runs, *options, code=code))


@pytest.mark.slow
def test_what_confirm_says_of_rig_runs_is_unchanged(folder: Path, runs: Path, unchanged: Unchanged) -> None:
    unchanged(said("confirm", folder, runs, code=1), relative=1e-3)
