"""A study's result leads to the files of the study from any folder."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from cosim.study.definition import Build, Drive, Vehicle
from cosim.study.table import StudyResult

from .constructed import result, study

FILES = ("fmus/car.fmu", "fmus/soft.fmu", "laps/lap.parquet")


@pytest.fixture
def ran_in(tmp_path):
    """Folder in which a study with relative paths was run; its result is in out/."""
    place = tmp_path / "team"
    for file in FILES:
        (place / file).parent.mkdir(parents=True, exist_ok=True)
        (place / file).touch()
    (place / "out").mkdir()
    made = result({"height": lambda digits: 1.0 + digits.sum(1)}, builds=("soft",))
    car, soft, lap = map(Path, FILES)
    named = replace(
        study(("height",), ("soft",)),
        vehicle=Vehicle(car),
        bank={"soft": Build(soft)},
        drives=(Drive("lap", lap, 30.0),),
    )
    digests = dict.fromkeys(FILES, "0" * 64)
    replace(made, study=named, provenance=replace(made.provenance, digests=digests)).save(place / "out/results.parquet")
    return place


def paths_of(loaded: StudyResult) -> list[Path]:
    made = loaded.study
    return [made.vehicle.fmu, made.bank["soft"].fmu, made.drives[0].file]


def test_files_are_as_stated_in_the_folder_in_which_the_study_was_run(ran_in, monkeypatch):
    monkeypatch.chdir(ran_in)
    assert paths_of(StudyResult.load("out/results.parquet")) == list(map(Path, FILES))


def test_files_are_found_from_another_folder(ran_in, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    loaded = StudyResult.load("team/out/results.parquet")
    assert paths_of(loaded) == [ran_in / file for file in FILES]
    assert list(loaded.provenance.digests) == [str(ran_in / file) for file in FILES]


def test_a_file_that_is_nowhere_keeps_its_stated_path(ran_in, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (ran_in / "laps/lap.parquet").unlink()
    assert paths_of(StudyResult.load("team/out/results.parquet"))[2] == Path("laps/lap.parquet")
