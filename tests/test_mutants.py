"""The mutation testing of benchmarks/mutants: its changes, its trials, and the agreement of its lists with sources."""

import compileall

import pytest

from benchmarks.mutants.areas import ROOT, Area, Equivalent, read_areas, read_equivalents
from benchmarks.mutants.c_sites import c_sites
from benchmarks.mutants.campaign import Campaign
from benchmarks.mutants.mutant import Mutant, mutants
from benchmarks.mutants.python_sites import python_sites
from benchmarks.mutants.records import Record
from benchmarks.mutants.report import killed_share, report
from benchmarks.mutants.trial import Outcome, copy_tree


def changed(sites, source):
    return {change(source) for site in sites(source) for change in site.changes}


def test_a_c_source_is_changed_in_operators_signs_bounds_and_constants_and_nowhere_else():
    source = "double *f(double *x) /* 1 - 2 */\n{\n    return x[1] <= -0.5 ? *x : x->y * 2.0; // 3 + 4\n}\n"
    line = "    return x[1] <= -0.5 ? *x : x->y * 2.0; // 3 + 4"
    lines = {text.splitlines()[2] for text in changed(c_sites, source)}
    assert lines == {
        line.replace(*change)
        for change in (
            ("[1]", "[2]"), ("[1]", "[0]"), ("<=", "<"), ("<=", ">"), ("-0.5", "0.5"), ("0.5", "1.5"), ("0.5", "-0.5"),
            (" * 2.0", " / 2.0"), (" * 2.0", " + 2.0"), ("2.0;", "3.0;"), ("2.0;", "1.0;"),
        )
    }  # fmt: skip


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("#define A 1 + 2\n", set()),
        ('say("1 + 2");\n', set()),
        ("a->b--;\n", set()),
        ("i += 2;\n", {"i -= 2;\n", "i += 3;\n", "i += 1;\n"}),
        ("if (!a && b != c)\n", {"if (a && b != c)\n", "if (!a || b != c)\n", "if (!a && b == c)\n"}),
        ("x = 0x1p-1;\n", {"x = 1.5;\n", "x = -0.5;\n"}),
        ("x = a\n    - b;\n", {"x = a\n    + b;\n", "x = a\n    * b;\n"}),
    ],
)
def test_places_of_c(source, expected):
    assert changed(c_sites, source) == expected


def test_a_python_source_is_changed_in_operators_signs_bounds_and_constants():
    source = '"""1 + 2."""\nx = -a if b < 3 and not c else d / e  # 1 + 2\n'
    found = {text.splitlines()[1].replace("  #", " #") for text in changed(python_sites, source)}
    for part in ("x = a if", "b <= 3", "b > 3", "b < 4", "b < 2", "3 or not c", "and  c", "d * e", "d - e"):
        assert any(part in text for text in found), part
    assert all(text.endswith("# 1 + 2") for text in found)


def test_the_stars_of_parameters_and_arguments_are_not_multiplications():
    assert (
        python_sites("def f(*a, **b):\n    return f(*a, **b), [*a], {**b}\n\n\ndef g(a, *, b):\n    return a\n") == []
    )
    assert len(python_sites("a = b * c\n")) == len(python_sites("a = f(b * c)\n")) == 1


@pytest.mark.repeated
@pytest.mark.parametrize("area", read_areas(), ids=lambda area: area.name)
def test_every_area_has_sources_places_to_change_and_tests(area):
    assert len(area.files()) > 0
    mutant = next(mutants(area, seed=3))
    assert mutant.lines[0] != mutant.lines[1]
    paths = [test.partition("::")[0] for test in area.tests if test.startswith("tests/")]
    assert paths
    assert [path for path in paths if not (ROOT / path).exists()] == []
    for plugin in area.plugins:
        assert (ROOT / "benchmarks" / "mutants" / "plugins" / f"{plugin}.py").is_file()


def test_every_equivalent_mutant_has_an_existing_line_and_a_reason():
    for item in read_equivalents():
        lines = [line.strip() for line in (ROOT / item.file).read_text(encoding="utf-8").splitlines()]
        assert item.line in lines, f"{item.file} has no line {item.line!r}: drop its entry of equivalent.toml"
        assert item.mutant != item.line
        assert len(item.reason.split()) > 3


LAG = Area("lag", ("eightpost/shock/lag.py",), ("tests/shock/test_laws.py",))


def test_a_sample_is_random_repeatable_and_grows_at_its_end():
    first, again = ([mutant.key for mutant in mutants(LAG, seed)] for seed in (1, 1))
    assert first == again
    assert len(set(first)) == len(first) > 5
    assert first != [mutant.key for mutant in mutants(LAG, 2)]


def test_a_changed_law_is_killed_and_a_changed_comment_survives(tmp_path, monkeypatch):
    monkeypatch.setattr(compileall, "compile_dir", lambda *_, **__: None)  # two trials do not repay it
    tree, path = copy_tree(tmp_path / "tree", tmp_path / "cache"), "eightpost/shock/lag.py"
    before = (ROOT / path).read_text(encoding="utf-8")
    outcomes = [
        tree.try_mutant(LAG, Mutant("lag", path, 1, before, before.replace(*change)), 300.0).outcome
        for change in (("-expm1(-ratio)", "expm1(-ratio)"), ('"""The first', '"""A first'))
    ]
    assert outcomes == [Outcome.KILLED, Outcome.SURVIVED]
    assert (tree.folder / path).read_text(encoding="utf-8") == before


def test_records_are_kept_survivors_tried_again_when_tests_change_and_equivalents_never(tmp_path, monkeypatch):
    sample = list(mutants(LAG, 1))[:4]
    known = {sample[0].key: Outcome.KILLED, sample[1].key: Outcome.SURVIVED}
    listed = [Equivalent(sample[2].file, *sample[2].lines, "a reason")]
    campaign = Campaign([LAG], listed, tmp_path, seed=1, workers=1, report=lambda line: None)
    records = {
        mutant.key: Record.of(mutant, known[mutant.key], tests="as they were")
        for mutant in sample
        if mutant.key in known
    }
    must = [[campaign._must_try(mutant, records, tests) for mutant in sample] for tests in ("as they were", "new")]
    assert must == [[False, False, False, True], [False, True, False, True]]


def record(outcome, area="laws"):
    return Record("0", area, "a.py", 3, outcome, 1.0, "", "-a\n+b")


def test_the_report_counts_time_limits_as_killed_and_leaves_equivalents_out():
    found = [*map(record, (Outcome.KILLED, Outcome.TIMEOUT, Outcome.SURVIVED, Outcome.EQUIVALENT, Outcome.INVALID))]
    found.append(record(Outcome.KILLED, "engine"))
    assert killed_share(found) == 0.75
    text = report(found, 7)
    assert "| laws | 3 | 2 | 1 | 1 | 66.7 | 1 | 1 |" in text
    assert "| engine | 1 | 1 | 0 | 0 | 100.0 | 0 | 0 |" in text
    assert "| all | 4 | 3 | 1 | 1 | 75.0 | 1 | 1 |" in text
    assert text.count("```diff\n-a\n+b\n```") == 1
    assert "Survived: a.py:3 (laws)" in text
