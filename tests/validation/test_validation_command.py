"""`eightpost validate` on files."""

import shutil

import pytest
from click.testing import CliRunner

from eightpost.__main__ import main
from eightpost.shock import write_shock
from eightpost.signals import write_csv


@pytest.fixture(scope="module")
def written(tmp_path_factory, lagged, static_curve, random_test, bump_test, sine_test):
    place = tmp_path_factory.mktemp("written")
    (place / "data").mkdir()
    write_shock(lagged, place / "lpf1.json")
    write_shock(static_curve, place / "static.json")
    for name, test in {"random": random_test(1), "bump": bump_test, "sine": sine_test(0.25, 10.0)}.items():
        write_csv(test.series, place / "data" / f"{name}.csv")
    return place


@pytest.fixture
def folder(written, tmp_path):
    return shutil.copytree(written, tmp_path / "here")


@pytest.fixture
def run(folder, monkeypatch):
    monkeypatch.chdir(folder)
    return lambda *words: CliRunner().invoke(main, ["validate", *words], env={"COLUMNS": "180"})


@pytest.mark.slow
def test_a_folder_of_records_and_two_laws_give_tables_and_a_page(run, folder):
    done = run("lpf1.json", "static.json", "data", "--limit", "30", "-o", "out/page.html", "-v")
    assert done.exit_code == 0, done.output
    for text in ("random: random", "bump: bump", "sine: sine", "Random records", "Sines of known", "Bump records"):
        assert text in done.output
    page = (folder / "out" / "page.html").read_text(encoding="utf-8")
    assert "known LPF1" in page
    assert "@media print" in page


@pytest.mark.nightly
def test_an_error_over_the_limit_exits_1_and_is_named(run):
    done = run("static.json", "data/random.csv", "--limit", "1")
    assert done.exit_code == 1
    assert done.output.count("Not usable: ") == 1
    assert "limit 1 %" in done.output
    assert run("lpf1.json", "data/random.csv", "--limit", "1").exit_code == 0


@pytest.mark.repeated(2)
@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("data",), "no shock file"),
        (("lpf1.json",), "no record"),
        (("none.json", "data"), "none.json"),
        (("lpf1.json", "none.csv"), "none.csv"),
        (("lpf1.json", "data", "--kind", "fast"), "fast"),
        (("lpf1.json", "data", "--kind", "run9=sine"), "run9"),
        (("lpf1.json", "data/random.csv", "--kind", "sine"), "no single frequency"),
        (("lpf1.json", "data", "--report", "page.pdf"), "page.html"),
        (("lpf1.json", "data", "--units", "force"), "CHANNEL=UNIT"),
    ],
)
def test_wrong_input_exits_2_with_a_message_and_writes_nothing(run, folder, words, message):
    before = sorted(folder.rglob("*"))
    done = run(*words)
    assert done.exit_code == 2, done.output
    assert message in done.output
    assert sorted(folder.rglob("*")) == before
