"""A study's result says the same as a table, as labelled arrays, as a picture and in a few lines."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from cosim.study.definition import Build, Constraint, Drive, Term, Vehicle
from cosim.study.table import StudyResult

from .constructed import CORNERS, result, study

INCH = 0.0254


@pytest.fixture
def found():
    """16 setups of which 3 failed; a = 1 + number of C/C, b = 8 - that; a is at most 3; the objective is 2 a [in]."""
    return result(
        {"a": lambda digits: 1.0 + digits.sum(axis=1), "b": lambda digits: 8.0 - digits.sum(axis=1)},
        builds=("B/B", "C/C"),
        failed=(0, 5, 6),
        objective=(Term("a", 2.0, "in"),),
        constraints=(Constraint("a", at_most=3.0),),
        baseline=dict.fromkeys(CORNERS, "C/C"),
    )


def test_a_table_has_a_row_for_each_setup_that_ran(found):
    table = found.to_pandas()
    assert table.index.tolist() == [k for k in range(16) if k not in (0, 5, 6)]
    assert [*table.columns] == [*CORNERS, "objective", "feasible", "a", "b"]
    row = table.loc[7]  # C/C at three corners
    assert [row[corner] for corner in CORNERS] == ["B/B", "C/C", "C/C", "C/C"]
    assert (row["a"], row["b"], row["feasible"]) == (4.0, 5.0, False)
    assert row["objective"] == pytest.approx(8.0 / INCH) and table.loc[1]["feasible"]


@pytest.mark.slow  # xarray takes long to load
def test_labelled_arrays_have_setups_builds_and_units(found):
    arrays = found.to_xarray()
    one = arrays.sel(setup=7)
    assert (float(one["a"]), float(one["objective"])) == pytest.approx((4.0, 8.0 / INCH))
    assert [str(one[corner].values) for corner in CORNERS] == ["B/B", "C/C", "C/C", "C/C"]
    assert arrays["a"].attrs["units"] == "m" and arrays.sizes["setup"] == 13


def test_a_study_without_an_objective_has_no_column_of_it(found):
    assert "objective" not in replace(found, study=replace(found.study, objective=())).to_pandas()


def test_the_summary_says_that_no_setup_is_feasible_and_how_to_resume(found):
    none = replace(found, study=replace(found.study, constraints=(Constraint("a", at_most=0.0),)), partial=True)
    assert "none is feasible" in repr(none) and "run it again with the same folder to resume" in repr(none)


# ==== A study's result leads to the files of the study from any folder ===============================================

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
