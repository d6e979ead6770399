"""Tests of `eightpost validate` on a vehicle: recognition of the file, exit codes and page."""

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from eightpost.__main__ import main
from eightpost.files import sha256_of
from eightpost.ident.vehicle.vehicle_fit import VehicleFit, read_fit, with_validity, write_fit
from eightpost.shock import Shock, write_shock
from eightpost.vehicle import shipped
from eightpost.verdict import Grade

from .conftest import softer
from .test_page_parts import TRUST

Run = Callable[..., Result]


@pytest.fixture(scope="module")
def folder(
    corner: VehicleFit, rig_files: Path, shocks: dict[str, Shock], tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """Folder with vehicles and a shock."""
    place = tmp_path_factory.mktemp("cars")
    write_fit(place / "corner.json", corner)
    write_fit(place / "slow.json", softer(corner))
    known = replace(corner.vehicle, sources={"soft.parquet": sha256_of(rig_files / "soft.parquet")})
    write_fit(place / "own.json", replace(corner, vehicle=known))
    write_shock(shocks["lpf1"], place / "shock.json")
    return place


@pytest.fixture
def run(folder: Path, rig_files: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    monkeypatch.chdir(folder)

    def call(car: str, *words: object, records: tuple[str, ...] = ("soft", "base")) -> Result:
        files = [str(rig_files / f"{name}.parquet") for name in records]
        return CliRunner().invoke(main, ["validate", car, *files, *map(str, words), "-v"], env={"COLUMNS": "180"})

    return call


@pytest.fixture(scope="module")
def done(folder: Path, rig_files: Path) -> tuple[Result, Path]:
    """Result of a validation on all records, and its page."""
    page = folder / "out" / "page.html"
    words = [
        "validate",
        str(folder / "corner.json"),
        str(rig_files),
        "-v",
        "--set",
        f"against={shipped('quarter_car')}",
    ]
    return CliRunner().invoke(main, [*words, "-o", str(page)], env={"COLUMNS": "180"}), page


def test_a_good_car_exits_0_with_a_summary(done: tuple[Result, Path]) -> None:
    result, _ = done
    assert result.exit_code == 0, result.output
    for text in ("The worst outputs of each record", "Trends of RMS", "MAC", "7 records that it was not fitted to"):
        assert text in result.output, text


def test_the_page_begins_with_the_verdict_and_is_self_contained(done: tuple[Result, Path]) -> None:
    text = done[1].read_text(encoding="utf-8")
    assert text.index('id="verdict"') < text.index("<nav>") < text.index('id="records"')
    assert not re.findall(r'(?:src|href)="(?!#)', text)
    for section in ("records", "trends", "random", "sine", "bump", "responses", "modes", "notes", "what"):
        assert f'<section id="{section}">' in text, section


@pytest.mark.nightly
def test_a_bad_car_exits_1_with_the_reason(run: Run) -> None:
    result = run("slow.json")
    assert result.exit_code == 1, result.output
    assert "Not usable: " in result.output
    assert "the RMS of an output is wrong" in result.output


@pytest.mark.nightly
def test_the_user_can_set_the_limits(run: Run) -> None:
    assert run("slow.json", "--level", "500", "--limit", "500").exit_code == 0
    assert run("corner.json", "--limit", "0.01").exit_code == 1


@pytest.mark.nightly
def test_a_record_of_the_fit_is_recognised_by_its_digest(run: Run) -> None:
    result = run("own.json")
    assert re.search(r"the car was fitted to a record.*\(soft[.)]", result.output)
    assert run("own.json", records=("soft",)).exit_code == 1


def test_friction_is_printed_in_newtons_as_identify_does(folder: Path, run: Run, corner: VehicleFit) -> None:
    write_fit(folder / "rubbing.json", replace(corner, trust=TRUST))
    shown = run("rubbing.json", records=("soft",)).output
    assert "friction at the ports" in shown and "61.2" in shown and "estimate, N" in shown


def test_an_edited_car_is_predicted_but_unknown(folder: Path, run: Run, corner: VehicleFit) -> None:
    """A validation does not make it usable again."""
    write_fit(folder / "judged.json", with_validity(corner))
    path = folder / "judged.json"
    content = json.loads(path.read_text())
    content["C"][0][2] *= 1.0001
    path.write_text(json.dumps(content))
    result = run("judged.json", "--keep")
    assert result.exit_code == 0, result.output
    assert "edited after the fit or run: its numbers are not those that were judged" in result.output
    kept = read_fit(path)
    assert {reason.about for reason in kept.verdict.reasons} == {"file", "validation of the vehicle"}
    assert kept.verdict.grade is Grade.UNKNOWN


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--cutoff", "40 Hz"), "it does not apply to a vehicle"),
        (("--shock", "soft"), "write it as NAME=SHOCK.json"),
        (("--kind", "track"), "must be one of random, sine, bump, static"),
        (("--kind", "other.csv=sine"), "not one of the records"),
        (("--report", "page.pdf"), "a page ends in .html or .htm"),
        (("shock.json",), "is a vehicle: validate it alone"),
    ],
)
def test_unusable_arguments_exit_2(run: Run, words: tuple[str, ...], said: str) -> None:
    result = run("corner.json", *words)
    assert result.exit_code == 2, result.output
    assert said in " ".join(re.sub(r"[│╭╰╮╯─]", " ", result.output + (result.stderr or "")).split())


def test_options_of_vehicles_are_rejected_for_shocks(run: Run) -> None:
    result = run("shock.json", "--level", "3")
    assert result.exit_code == 2
    assert "it does not apply to a shock" in result.output


@pytest.mark.slow
def test_the_page_draws_every_figure_in_both_unit_systems(browser: Any, done: tuple[Result, Path]) -> None:
    browser.call("Page.navigate", url=done[1].as_uri())
    browser.until("document.body && document.body.dataset.drawn === 'all'")
    assert browser.evaluate("document.getElementById('trouble').hidden")
    places = browser.evaluate("document.querySelectorAll('.plot').length")
    browser.evaluate("document.querySelectorAll('details').forEach((folded) => { folded.open = true; })")
    browser.until("document.querySelectorAll('.js-plotly-plot').length === document.querySelectorAll('.plot').length")
    assert places >= 9
    assert browser.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
    titles = "JSON.stringify([...document.querySelectorAll('.plot')].map((p) => p.layout.yaxis.title.text))"
    assert "RMS [in]" in json.loads(browser.evaluate(titles))
    browser.evaluate("document.querySelector('input[value=si]').click()")
    assert "RMS [m]" in json.loads(browser.evaluate(titles))
    complaints = [e for e in browser.events if e.get("method") in ("Runtime.exceptionThrown", "Log.entryAdded")]
    assert not complaints
