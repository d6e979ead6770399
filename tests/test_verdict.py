"""Verdicts: grades, order, combination and JSON."""

from __future__ import annotations

import ast
import json
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eightpost.errors import InputError
from eightpost.verdict import ORDER, Grade, Reason, Rule, Verdict

ROOT = Path(__file__).resolve().parents[1]
TEXT = st.text(min_size=1, max_size=12).filter(str.strip)
REASONS = st.lists(st.builds(Reason, TEXT, TEXT, st.sampled_from(ORDER), TEXT, TEXT, TEXT, TEXT), max_size=6)


def reason(grade: Grade, about: str = "coupling", origin: str = "bond lf") -> Reason:
    return Reason("a rule", about, grade, "something was found", "7 %", origin, "halve the step")


@pytest.mark.nightly
@given(REASONS)
def test_the_grade_is_the_worst_of_the_reasons(reasons: list[Reason]) -> None:
    grades = [each.grade for each in reasons]
    worst = next((grade for grade in ORDER if grade in grades), Grade.UNKNOWN)
    verdict = Verdict(reasons)
    assert verdict.grade is worst
    assert verdict.is_acceptable == (Grade.NOT_USABLE not in grades)
    assert verdict.summary().startswith(worst.value.capitalize())


@pytest.mark.nightly
@given(REASONS, REASONS)
def test_verdicts_combine_to_that_of_all_reasons(some: list[Reason], others: list[Reason]) -> None:
    both = Verdict.combined([Verdict(some), Verdict(others)])
    assert both == Verdict([*Verdict(some).reasons, *Verdict(others).reasons])
    if some or others:
        assert ORDER.index(both.grade) == min(ORDER.index(Verdict(each).grade) for each in (some, others) if each)


@given(REASONS)
def test_json_keeps_a_verdict(reasons: list[Reason]) -> None:
    verdict = Verdict(reasons)
    assert Verdict.from_json(json.loads(json.dumps(verdict.to_json()))) == verdict


def test_a_verdict_without_reasons_is_unknown() -> None:
    assert Verdict().grade is Grade.UNKNOWN


def test_reasons_that_differ_only_in_their_origin_are_merged() -> None:
    (found,) = Verdict(reason(Grade.LIMITED, origin=name) for name in ("lf", "rf", "lf")).reasons
    assert found.origin == "lf, rf"


def test_the_summary_lists_subjects_with_a_better_grade() -> None:
    verdict = Verdict([reason(Grade.USABLE), reason(Grade.UNKNOWN, "model of part", "part.fmu")])
    assert verdict.summary() == (
        "Unknown: something was found (7 %; part.fmu); usable: coupling."
    )  # fmt: skip


@pytest.mark.parametrize("field", ["statement", "figure", "origin", "remedy"])
def test_a_reason_without_figure_origin_or_remedy_is_refused(field: str) -> None:
    texts = {"rule": "r", "about": "a", "statement": "s", "figure": "f", "origin": "o", "remedy": "d"} | {field: " "}
    with pytest.raises(InputError, match=field):
        Reason(grade=Grade.USABLE, **texts)


def test_a_rule_gives_its_own_remedy_or_a_more_specific_one() -> None:
    rule = Rule("r", "coupling", Grade.LIMITED, "c", "w", "halve the step")
    assert rule.reason("s", figure="1 %", origin="o").remedy == "halve the step"
    assert rule.reason("s", figure="1 %", origin="o", remedy="look at bond lf").remedy == "look at bond lf"


def modules_with_tables() -> Iterator[tuple[str, Path]]:
    """Yield the names and the files of the modules that read a table of rules."""
    for package in ("builder", "cosim", "dissertation", "eightpost"):
        for path in (ROOT / package).rglob("*.py"):
            if "RULES = Rules.read(" in path.read_text(encoding="utf-8"):
                yield ".".join(path.relative_to(ROOT).with_suffix("").parts), path


def nodes_of(path: Path) -> list[ast.AST]:
    return list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))


def test_a_module_and_its_neighbours_name_every_rule_of_its_table_and_no_other() -> None:
    modules = dict(modules_with_tables())
    assert len(modules) > 10
    for module, path in modules.items():
        calls = [
            node for node in nodes_of(path) if isinstance(node, ast.Call) and ast.unparse(node.func) == "RULES.reason"
        ]
        named = {call.args[0].value for call in calls if isinstance(call.args[0], ast.Constant)}
        files = path.parent.glob("*.py") if "def fault(" in path.read_text(encoding="utf-8") else [path]
        texts = {node.value for file in files for node in nodes_of(file) if isinstance(node, ast.Constant)}
        assert named <= {rule.name for rule in import_module(module).RULES} <= texts, module


@pytest.mark.parametrize(
    "document", [None, [], {}, {"reasons": 1}, {"reasons": "x"}, {"reasons": [1]}, {"reasons": [{"rule": "r"}]},
                 {"reasons": [Verdict([reason(Grade.USABLE)]).to_json()["reasons"][0] | {"grade": "good"}]},
                 {"reasons": [Verdict([reason(Grade.USABLE)]).to_json()["reasons"][0] | {"figure": 3}]}]
)  # fmt: skip
def test_what_is_not_a_verdict_is_refused_with_a_message(document: object) -> None:
    with pytest.raises(InputError, match="verdict"):
        Verdict.from_json(document)
