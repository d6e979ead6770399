"""The areas of benchmarks/mutants and their tests, and mutation testing: its changes, its trials and its lists."""

import compileall
import subprocess
from pathlib import Path
from types import SimpleNamespace

import pytest

from benchmarks.mutants.__main__ import Campaign, killed_share, report
from benchmarks.mutants.area_tests import PRODUCT, ROOT, Area, Equivalent, main, read_areas, read_equivalents
from benchmarks.mutants.mutant import Mutant, c_sites, mutants, python_sites
from benchmarks.mutants.trial import Outcome, Record, copy_tree


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


def files(*folders):
    """Return the sources in folders, relative to the root of the checkout."""
    found = (path for folder in folders for path in (ROOT / folder).rglob("*") if path.suffix in (".py", ".c", ".h"))
    return [path.relative_to(ROOT) for path in found]


def test_every_source_belongs_to_one_area_and_every_area_has_tests_and_existing_plugins():
    areas = read_areas()
    assert sorted(source for area in areas for source in area.sources) == sorted(files(*PRODUCT))
    assert len({area.name for area in areas}) == len(areas)
    for area in areas:
        assert area.tests
        for plugin in area.plugins:
            assert (ROOT / "benchmarks" / "mutants" / "plugins" / f"{plugin}.py").is_file()
        for test in area.tests + area.quick:
            file, _, name = test.partition("::")
            assert not name or f"def {name}(" in (ROOT / file).read_text(encoding="utf-8"), test


def test_make_quick_has_tests_of_every_area():
    for area in read_areas():
        named = [Path(test.partition("::")[0]) for test in area.tests]
        assert area.quick, area.name
        for test in area.quick:
            assert any(Path(test.partition("::")[0]).is_relative_to(path) for path in named), test


def test_an_area_names_every_test_file_but_those_of_the_documentation_benchmarks_and_the_release():
    named = {Path(test) for area in read_areas() for test in area.tests}
    other = ("tests/docs/*", "tests/*benchmark*.py", "tests/cosim/study/test_study_benchmark.py",
             "tests/test_fuzz.py", "tests/test_mutants.py", "tests/test_release.py", "tests/test_run_rules.py",
             "tests/test_unchanged.py", "tests/test_wheel.py", "tests/test_workflow.py")  # fmt: skip
    left = [file for file in files("tests") if file.name.startswith("test_") and not any(map(file.match, other))]
    assert [file for file in left if named.isdisjoint((file, *file.parents))] == []


AREAS = """
[engine]
sources = ["cosim/engine/march.py"]
tests = ["tests/engine/test_m*.py", "tests/engine/test_time.py::test_time"]
quick = ["tests/engine/test_time.py"]

[cosim]
sources = ["cosim", "fmus/*/*.c"]
tests = ["tests/engine"]
quick = []
"""


@pytest.fixture
def checkout(tmp_path):
    """A checkout with two areas."""
    names = ("cosim/engine/march.py", "cosim/engine/plan.py", "cosim/page.css", "fmus/law/model.c")
    for name in (*names, "tests/engine/test_master.py", "tests/engine/test_march.py", "tests/engine/test_time.py"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("")
    (tmp_path / "benchmarks" / "mutants").mkdir(parents=True)
    return tmp_path


def areas_of(checkout, text):
    (checkout / "benchmarks" / "mutants" / "areas.toml").write_text(text)
    return read_areas(checkout)


def test_a_source_belongs_to_the_first_area_that_matches_and_globs_of_tests_are_expanded(checkout):
    march, plan, model = map(Path, ("cosim/engine/march.py", "cosim/engine/plan.py", "fmus/law/model.c"))
    tests = tuple(f"tests/engine/test_{name}" for name in ("march.py", "master.py", "time.py::test_time"))
    assert areas_of(checkout, AREAS) == [
        Area("engine", (march,), tests, ("tests/engine/test_time.py",)),
        Area("cosim", (plan, model), ("tests/engine",)),
    ]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ((', "fmus/*/*.c"', ""), "fmus/law/model.c belongs to no area: add its folder to one"),
        (('"fmus/*/*.c"', '"fmus", "fmus/law"'), "cosim: 'fmus/law' matches no source that is left: move it up"),
        (("test_m*", "test_sweep*"), "engine: no test matches 'tests/engine/test_sweep[*].py': write where it is now"),
        (('k = ["tests/engine/test_time', 'k = ["tests/test_time'), "engine: no test matches 'tests/test_time.py'"),
    ],
)
def test_areas_that_do_not_fit_the_checkout_are_refused(checkout, change, message):
    with pytest.raises(ValueError, match=message):
        areas_of(checkout, AREAS.replace(*change))


@pytest.fixture
def ran(monkeypatch):
    """The commands that would run, which end with exit code 1."""
    commands = []
    monkeypatch.setattr(
        subprocess, "run", lambda command, **_: commands.append(command[3:]) or SimpleNamespace(returncode=1)
    )
    return commands


DAILY = ["-q", "-m", "not slow and not nightly"]
TWO = ["-n", "2", "--dist", "loadscope"]


def test_make_area_runs_the_tests_of_a_source_and_slow_ones_on_request(ran, capsys):
    assert main(["dissertation/verdict.py"]) == main(["--slow", "dissertation/verdict.py"]) == 1
    assert ran == [[*DAILY, *TWO, "tests/dissertation"], ["-q", "-m", "not nightly", *TWO, "tests/dissertation"]]
    assert "dissertation/verdict.py: dissertation\n" in capsys.readouterr().out


def test_make_area_of_a_folder_runs_the_tests_of_all_its_areas_with_the_plugins_that_they_share(ran):
    main(["cosim/engine"])
    areas = [area for area in read_areas() if area.name in ("schemes", "engine")]
    assert [set(area.plugins) for area in areas] == [{"interpreted"}, set()]
    assert ran == [[*DAILY, *TWO, *dict.fromkeys(areas[0].tests + areas[1].tests)]]
    main(["cosim/engine/sweep.py"])
    assert ran[1][len(DAILY + TWO) :] == ["-p", "benchmarks.mutants.plugins.interpreted", *areas[0].tests]


def test_make_area_of_a_test_runs_it(ran):
    main(["tests/test_units.py"])
    main(["tests/signals"])
    assert ran == [[*DAILY, "tests/test_units.py"], [*DAILY, *TWO, "tests/signals"]]


@pytest.mark.parametrize("file", ["docs/index.md", "tests/test_absent.py", "cosim/absent.py"])
def test_make_area_of_something_without_tests_says_what_has_some(ran, capsys, file):
    assert main([file]) == 2
    assert ran == []
    assert capsys.readouterr().err.startswith(
        f"{file}: no source (.py, .c, .h) of eightpost, builder, cosim, fmus, dissertation and no"
    )


def test_make_quick_runs_its_tests_of_every_area(ran):
    main(["--quick"])
    tests = dict.fromkeys(test for area in read_areas() for test in area.quick)
    assert ran == [[*DAILY, *TWO, *tests]]


def test_every_equivalent_mutant_has_an_existing_line_and_a_reason():
    for item in read_equivalents():
        lines = [line.strip() for line in (ROOT / item.file).read_text(encoding="utf-8").splitlines()]
        assert item.line in lines, f"{item.file} has no line {item.line!r}: drop its entry of equivalent.toml"
        assert item.mutant != item.line
        assert len(item.reason.split()) > 3


LAG = Area("lag", (Path("eightpost/shock/law.py"),), ("tests/shock/test_laws.py",))
SMALL = Area("small", (Path("eightpost/shock/lpnl2.py"),), ("tests/shock/test_laws.py",))


def test_a_sample_is_random_repeatable_and_grows_at_its_end():
    first, again = ([mutant.key for mutant in mutants([SMALL], seed)] for seed in (1, 1))
    assert first == again
    assert len(set(first)) == len(first) > 5
    assert first != [mutant.key for mutant in mutants([SMALL], 2)]


def test_a_sample_of_several_areas_has_the_shares_that_their_places_have():
    areas = [Area(name, (Path(f"fmus/common/{name}.c"),), LAG.tests) for name in ("step", "elementary")]
    found = [mutant.area for mutant in mutants(areas, 1)]
    places = [len(c_sites((ROOT / area.sources[0]).read_text(encoding="utf-8"))) for area in areas]
    assert [found.count(area.name) for area in areas] == places
    half = found[: len(found) // 2]
    assert half.count("step") / len(half) == pytest.approx(places[0] / sum(places), abs=0.05)


PROGRESS = Area("progress", (Path("eightpost/progress.py"),), ("tests/test_progress.py",))


def test_a_changed_source_is_killed_and_a_changed_comment_survives(tmp_path, monkeypatch):
    monkeypatch.setattr(compileall, "compile_dir", lambda *_, **__: None)  # two trials do not repay it
    tree, path = copy_tree(tmp_path / "tree", tmp_path / "cache"), "eightpost/progress.py"
    before = (ROOT / path).read_text(encoding="utf-8")
    outcomes = [
        tree.try_mutant(PROGRESS, Mutant("progress", path, 1, before, before.replace(*change)), 300.0).outcome
        for change in (("done / total if total", "done * total if total"), ('"""Yield items', '"""Yield the items'))
    ]
    assert outcomes == [Outcome.KILLED, Outcome.SURVIVED]
    assert (tree.folder / path).read_text(encoding="utf-8") == before


@pytest.mark.nightly
def test_records_are_kept_survivors_tried_again_when_tests_change_and_equivalents_never(tmp_path, monkeypatch):
    sample = list(mutants([LAG], 1))[:4]
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
