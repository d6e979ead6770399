"""A study's result says the same as a table, as labelled arrays, as a picture and in a few lines."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cosim.study.definition import Constraint, Term

from .constructed import CORNERS, result

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


def test_rows_of_setups_are_sorted_by_a_measure(found):
    assert found.setups[found.rows_of(np.array([7, 1, 3]), "b")].tolist() == [7, 3, 1]
    assert found.shown_difference("a", 1.0) == pytest.approx(1.0 / INCH)


def test_the_summary_counts_setups_and_names_the_best(found):
    text = repr(found)
    assert "13 of 16 ran, 5 violate a constraint" in text
    assert str(found.study.space.setup(1)) in text and "up to 0.1 %" in text
    none = replace(found, study=replace(found.study, constraints=(Constraint("a", at_most=0.0),)), partial=True)
    assert "none is feasible" in repr(none) and "run it again with the same folder to resume" in repr(none)


def test_a_picture_shows_two_measures_of_the_best_and_the_baseline(found, monkeypatch):
    drawn = []
    monkeypatch.setattr("eightpost.report.pictures.cloud", lambda cloud, title: drawn.append((cloud, title)))
    found.plot()
    found.plot("b", "a")
    (cloud, title), (turned, _) = drawn
    assert title == "constructed" and cloud.labels == ("a [in]", "b [in]") == turned.labels[::-1]
    np.testing.assert_allclose(cloud.values[0], found.values("a") / INCH)
    assert [(mark.label, mark.row) for mark in cloud.marks] == [("best", 1), ("baseline", 15)]
    assert cloud.kept.sum() == 8
