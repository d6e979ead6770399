"""The matrix of tools and interface kinds: the tools that are always installed run every kind that they offer."""

import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.interface_matrix.__main__ import cell
from benchmarks.interface_matrix.direct import Subject, co_simulation, difference, euler, exchange
from benchmarks.interface_matrix.tools import KINDS, TOOLS

ROOT = Path(__file__).parents[2]
LIGHT = {
    tool.name: tool for tool in TOOLS if tool.name in ("FMPy", "FMPy, Euler", "`eightpost run`", "`cosim.HeldForce`")
}
#: Tolerances of integrators with error control; every other run equals the direct one to the bit.
TOLERANCES = {("FMPy", "2.0 ME"): 2e-5, ("FMPy", "3.0 ME"): 2e-5}


@pytest.fixture(scope="module", params=["lpnl2", "quarter_car"])
def subjects(fmus, fmus3, request):
    """An FMU of both versions, in the form that the matrix takes, for 64 steps."""
    name = request.param
    return {(name, 2): Subject(fmus[name], 2, 64), (name, 3): Subject(fmus3[name], 3, 64)}


@pytest.mark.repeated
@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("tool", LIGHT)
def test_a_tool_gives_the_results_of_the_fmu_stepped_directly(subjects, tool, kind):
    found = cell(LIGHT[tool], kind, subjects)
    if isinstance(LIGHT[tool].run(kind), str):
        assert found == {"not_run": LIGHT[tool].run(kind)}
    else:
        ((name, value),) = found.items()
        if (tool, name) == ("`cosim.HeldForce`", "quarter_car"):
            assert value is None
        else:
            assert value <= TOLERANCES.get((tool, kind), 0.0)


@pytest.mark.repeated(2)
@pytest.mark.parametrize("run", [co_simulation, euler, exchange])
def test_the_direct_results_of_both_versions_are_equal(subjects, run):
    one, other = (run(subject) for subject in subjects.values())
    assert difference(other, one) == 0.0


def test_a_difference_is_relative_to_the_change_of_each_output_and_refuses_incomplete_results():
    expected = np.array([[100.0, 1.0], [110.0, 1.0], [95.0, 1.0]])
    found = expected + np.array([[0.0, 0.0], [0.1, 0.0], [0.0, 0.02]])
    assert difference(found, expected) == pytest.approx(0.02)
    assert difference(found[:, :1], expected[:, :1]) == pytest.approx(0.01)
    for wrong in (found[:2], np.full((3, 2), np.nan)):
        with pytest.raises(ValueError, match="shape"):
            difference(wrong, expected)


def test_the_table_has_every_result_and_no_cell_is_empty():
    spec = importlib.util.spec_from_file_location("make_hosts", ROOT / "docs" / "make" / "make_hosts.py")
    make_hosts = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(make_hosts)
    rows = json.loads((ROOT / "docs" / "data" / "hosts" / "matrix.json").read_text(encoding="utf-8"))
    table = make_hosts.matrix_table(rows)
    assert table in (ROOT / "docs" / "evidence" / "hosts_tools.md").read_text(encoding="utf-8")
    assert {tool.name for tool in TOOLS} <= {row["name"] for row in rows}
    assert all(set(row["cells"]) == set(KINDS) for row in rows) and "|  |" not in table
    assert "| not run: FMI 2.0 only |" in table and "| 0 / 0 |" in table
