"""Tables of the verbs on a terminal of 80 columns: no name, number or heading is broken or lost."""

from __future__ import annotations

import io
from types import SimpleNamespace

import numpy as np
import pytest
from rich.console import Console

from builder.check.rules import Level, Rule
from cosim.study.choice.compare import RunComparison
from cosim.study.choice.optimise import Optimum
from cosim.study.measures import Measure
from eightpost.api.shape_page import number_table
from eightpost.api.shapes import bank_plan
from eightpost.app.exchange import _table as findings_table
from eightpost.app.study import _front_table, show_study
from eightpost.app.study_hardware import measure_table
from eightpost.corners import CORNERS
from eightpost.report.tables import ResultTable, result_table
from eightpost.shock.shape import CURVE_NUMBERS, Shape, Side
from eightpost.signals import TimeSeries
from eightpost.verdict import Verdict


def shown(table, width: int = 80) -> str:
    console = Console(file=io.StringIO(), width=width)
    console.print(table)
    text = console.file.getvalue()
    assert max(map(len, text.splitlines())) <= width and "…" not in text
    return text


def rows_of(text: str) -> list[list[str]]:
    return [[cell.strip() for cell in line.split("│")[1:-1]] for line in text.splitlines() if line.startswith("│")]


def test_a_target_of_shapes_has_a_whole_line_for_each_number():
    side = Side(8765.4, 3456.7, 0.2468, 2345.6, 987.65)
    shape = Shape(side, side, lag=0.000654321)
    numbers = shape.numbers()
    ranges = tuple(SimpleNamespace(name=name, low=numbers[name], high=numbers[name]) for name in CURVE_NUMBERS)
    alone = {name: (numbers[name], numbers[name]) for name in CURVE_NUMBERS}
    target = SimpleNamespace(name="lf+rf+lr+rr", shape=shape, at_limit=CURVE_NUMBERS, alone=alone)
    found = SimpleNamespace(curves=SimpleNamespace(space=SimpleNamespace(ranges=ranges)),
                            request=SimpleNamespace(keep=0.8))  # fmt: skip
    text = shown(result_table(number_table(target, found)))
    assert "Target at lf+rf+lr+rr; from, to: each number alone keeps 80 % of the assured" in text
    rows = rows_of(text)
    assert [row[0] for row in rows] == list(numbers) and rows[0][1] == "lbf/(in/s)"
    for heading in ("number", "unit", "target", "lower", "limit", "upper", "from", "to"):
        assert heading in text


def test_a_finding_has_half_as_much_space_again_as_its_advice():
    """A finding names files, variables and values; the advice is a sentence."""
    finding = Rule("M-1", Level.ERROR, "a rule", "2.1", "word " * 40).finding("word " * 60)
    report = SimpleNamespace(of=lambda level: (finding,) if level is Level.ERROR else ())
    cells = next(line for line in shown(findings_table(report)).splitlines() if "M-1" in line).split("│")[1:-1]
    own, advice = (len(cell) - 2 for cell in cells[2:])  # without the space around the text
    assert own + advice == 80 - len("│ error │ M-1  │  │  │") and own == pytest.approx(1.5 * advice, rel=0.1)


@pytest.mark.parametrize("width", [40, 60])
def test_in_a_narrow_terminal_numbers_and_names_are_broken_and_not_lost(width):
    heads = ("name of the record", "unit", "target", "lower limit", "upper limit", "from", "to", "")
    row = ("rebound of the left front", "", 12300.0, -1000.0, 20000.0, 11000.0, 13000.0, "fixed")
    rows = rows_of(shown(result_table(ResultTable.of("Target", heads, [row])), width))
    cells = ["".join(line[k] for line in rows) for k in range(len(heads))]
    assert cells[0].replace(" ", "") == row[0].replace(" ", "")
    assert cells[2:] == ["12300", "-1000", "20000", "11000", "13000", "fixed"]


def test_a_name_that_is_longer_than_a_line_is_broken_and_not_lost():
    name = "a_record_with_a_very_long_name_" * 4
    rows = rows_of(shown(result_table(ResultTable.of("Records", ("record", "RMS error [N]"), [(name, 1.0)]))))
    assert "".join(row[0] for row in rows) == name


@pytest.mark.parametrize(("setups", "left", "plan"), [
    (16, 3, "16 setups, 3 to be run; then the curves are searched"),
    (5001, 5001, "5001 setups, at most 400 to be evaluated; then the curves are searched"),
])  # fmt: skip
def test_shapes_says_how_many_setups_of_the_bank_it_runs_first(setups, left, plan):
    vehicle = SimpleNamespace(fmu="car.fmu", means_trusted=True)
    study = SimpleNamespace(name="a study", space=range(setups), bank={"A": None}, corners={"lf": ("A",)}, alike=(),
                            drives=(), measures=(), vehicle=vehicle)  # fmt: skip
    requested = SimpleNamespace(study=study, left=left)
    console = Console(file=io.StringIO(), width=80)
    show_study(console, requested, bank_plan(requested))
    assert f"{plan}: a study\n" in console.file.getvalue()


def test_the_front_of_optimise_has_the_builds_of_a_setup_in_one_cell():
    builds = dict.fromkeys(CORNERS, "C-/D-")
    result = SimpleNamespace(
        study=SimpleNamespace(corners=builds), setups=np.array([7, 2400]), display=lambda _name: "in",
        setup=lambda _row: SimpleNamespace(builds=builds), shown=lambda _name: np.array([0.1234567, 12345.6]),
        rows_of=lambda front, _by: np.arange(front.size),
    )  # fmt: skip
    optimum = Optimum(np.array([7, 2400]), np.array([[1.0, 2.0], [2.0, 1.0]]), np.empty((2, 0)), 0, "")
    text = shown(_front_table(result, optimum, ("front ride height, RMS", "total tire force, RMS")))
    assert "Pareto front" in text and "lf rf lr rr" in text
    assert [row[:2] for row in rows_of(text)] == [["7", " ".join(builds.values())], ["2400", " ".join(builds.values())]]


@pytest.mark.parametrize(("labels", "headings"), [
    (("soft", "stiff"), ("soft", "stiff")),
    (("out/the_first_of_the_runs", "out/the_second_of_the_runs"), ("run 1", "run 2")),
])  # fmt: skip
def test_compare_numbers_the_runs_whose_folders_are_too_long_for_a_heading(labels, headings):
    time = np.arange(100) / 100.0
    runs = {label: TimeSeries.from_channels(time, {"x": ("m", (1.0 + k) * np.sin(20.0 * time))})
            for k, label in enumerate(labels)}  # fmt: skip
    measures = tuple(
        Measure(name, ("x",), "rms", "in") for name in ("a measure [x]", "right front suspension travel " * 3)
    )
    text = shown(measure_table(RunComparison(runs, measures, Verdict([]))))
    assert all(heading in text for heading in (*headings, "measure", "unit", "change"))
    assert rows_of(text)[0][0] == "a measure [x]" and "+100.00 %" in text
