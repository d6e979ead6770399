"""The verdict of a fit is stored in the shock's FMU and repeated by every run (docs/reference/verdict.md)."""

from __future__ import annotations

import html
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from builder.build import _python_fmu
from builder.native_fmu import without_binaries
from builder.product import shock_product
from builder.reference import Disclosure, combined_member, validity_of
from cosim import FmuComponent
from cosim.session.result import SavedRun
from cosim.study.choice.compare import compare_runs
from eightpost.__main__ import main
from eightpost.archive import read_archive, write_archive
from eightpost.ident import fit_shock
from eightpost.rig import DynoTest, read_dyno_test
from eightpost.shock import Shock, read_shock, write_shock
from eightpost.signals import TimeSeries, read_series, write_series
from eightpost.validity import MEMBER, Validity
from eightpost.verdict import Grade, Verdict

EXAMPLES = Path(__file__).parents[1] / "examples"
QUARTER = """
schema = 1
name = "quarter car"

[components.corner]
fmu = "corner.fmu"
inputs = {{ aero_force = 0.0 }}

[components.shock]
fmu = "{shock}"

[[bond]]
between = ["corner", "shock"]

[scenario]
drivefile = "{track}"
stop = "4 s"
settling = "1 s"
record_step = "4 ms"
record = {record}

[scenario.targets]
"lf.road" = "corner.road"
"""


def late_and_slow(delay: float, size: float) -> DynoTest:
    """Return the demo record with the force delayed by `delay` [s] and all channels multiplied by `size`."""
    test = read_dyno_test(EXAMPLES / "data" / "dyno_A.csv")
    series, late = test.series.select(["velocity", "displacement", "force"]), round(delay * test.series.sample_rate)
    values = size * series.values
    values[2] = np.roll(values[2], late)
    moved = TimeSeries(series.time, values, series.names, series.units).window(1.0, 12.0)
    return replace(test, series=moved)


@pytest.fixture(scope="module")
def bad() -> Shock:
    """A shock whose record has a lag of 40 ms, and motions too small for a track."""
    return fit_shock(late_and_slow(0.040, 0.1), "lpf1", name="late").shock


@pytest.fixture(scope="module")
def folder(bad: Shock, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The shock's file, and FMUs of it and of a quarter car, built by the command."""
    folder = tmp_path_factory.mktemp("carried")
    write_shock(bad, folder / "late.json")
    car = CliRunner().invoke(main, ["build", str(EXAMPLES / "corner.toml"), "-o", str(folder)])
    shock = CliRunner().invoke(main, ["build", str(folder / "late.json"), "-o", str(folder)])
    assert car.exit_code == 0, car.output
    assert "Usable within limits: the car's parameters were stated" in car.output
    assert shock.exit_code == 1, shock.output
    assert shock.output.count("Not usable: ") == 1
    assert "the law describes its records poorly" in shock.output
    return folder


def run(folder: Path, shock: str, record: str = '["corner.velocity", "corner.displacement", "shock.force"]'):
    track = EXAMPLES / "data" / "track.parquet"
    (folder / "system.toml").write_text(QUARTER.format(shock=shock, track=track.as_posix(), record=record))
    out = folder / "out"
    words = ["run", str(folder / "system.toml"), "-o", str(out), "--algorithm", "gauss-seidel", "--step", "2 ms"]
    done = CliRunner().invoke(main, [*words, "--report"])
    return done, json.loads((out / "result.json").read_text()), (out / "report.html").read_text(encoding="utf-8")


@pytest.mark.nightly
def test_a_measurement_lag_and_an_exceeded_range_are_reported_from_the_fit_to_the_run(folder: Path) -> None:
    """A shock with a lag of 40 ms, and a run that is mostly outside the fitted velocities, must not be usable."""
    done, document, page = run(folder, "late.fmu")
    assert done.exit_code == 1, done.output
    verdict = Verdict.from_json(document["verdict"])
    found = {reason.rule: reason for reason in verdict.reasons}
    assert verdict.grade is Grade.NOT_USABLE
    assert found["large error"].figure.startswith("held-out error 9")
    assert found["large error"].origin == "late.fmu: record dyno_A.csv"
    assert found["mostly outside the fitted velocities"].origin == "component shock"
    assert found["energy residual small"].grade is Grade.USABLE  # the coupling is not to blame, and it says so
    assert 'class="verdict not-usable"' in page
    for reason in verdict.reasons:
        assert reason.statement in done.output
        assert reason.statement in html.unescape(page)


@pytest.mark.nightly
def test_a_shock_that_was_edited_is_unknown_where_it_is_built_and_where_it_runs(
    bad: Shock, folder: Path, tmp_path: Path
) -> None:
    write_shock(bad, tmp_path / "stiff.json")
    content = json.loads((tmp_path / "stiff.json").read_text())
    content["curve"]["knot_force" if "knot_force" in content["curve"] else "inner"][1] *= 1.1
    (tmp_path / "stiff.json").write_text(json.dumps(content))
    built = CliRunner().invoke(main, ["build", str(tmp_path / "stiff.json"), "-o", str(folder)])
    assert built.exit_code == 0, built.output
    said = "edited after the fit or run: its numbers are not those that were judged"
    assert f"Unknown: {said}" in built.output and "stiff.fmu: stiff.json" in built.output
    done, document, page = run(folder, "stiff.fmu")
    assert said in done.output and said in page
    reasons = Verdict.from_json(document["verdict"]).reasons
    assert not any(reason.about == "fit of the shock" for reason in reasons)


@pytest.mark.nightly
def test_a_run_whose_result_was_edited_is_unknown_in_comparisons(folder: Path, tmp_path: Path) -> None:
    run(folder, "late.fmu")
    original = SavedRun.load(folder / "out")
    assert original.verdict.grade is Grade.NOT_USABLE
    content = json.loads((folder / "out" / "result.json").read_text())
    last = content["verdict"]["reasons"][-1:]
    better = {**content["verdict"], "grade": "usable", "summary": "Usable", "reasons": last}
    series = read_series(folder / "out" / "series.parquet")
    quieter = series.with_channel("shock.force", "N", 0.9 * series["shock.force"])
    for number, (document, samples, grade) in enumerate((
        (content, series, Grade.NOT_USABLE),
        (content | {"tool": "eightpost 99.0.0"}, series, Grade.NOT_USABLE),
        (content | {"verdict": better}, series, Grade.UNKNOWN),
        (content | {"steps": content["steps"] + 1}, series, Grade.UNKNOWN),
        (content, quieter, Grade.UNKNOWN),
        ({name: value for name, value in content.items() if name not in ("judged", "series_sha256")}, quieter,
         Grade.NOT_USABLE),
    )):  # fmt: skip
        place = tmp_path / str(number)
        write_series(samples, place / "series.parquet")
        (place / "result.json").write_text(json.dumps(document))
        found = SavedRun.load(place)
        assert found.verdict.grade is grade, number
        assert compare_runs({"a": found, "b": found}).verdict.grade is grade
    assert "edited after" in repr(SavedRun.load(tmp_path / "2"))


def test_an_fmu_without_a_verdict_is_unknown_and_its_coupling_is_still_judged(folder: Path) -> None:
    members = read_archive(folder / "late.fmu")
    del members[MEMBER]
    write_archive(folder / "silent.fmu", members)
    _, document, _ = run(folder, "silent.fmu")
    verdict = Verdict.from_json(document["verdict"])
    unknown = [reason for reason in verdict.reasons if reason.rule == "validity of a model unknown"]
    assert [reason.origin for reason in unknown] == ["component shock (silent.fmu)"]
    assert verdict.grades["energy"] is Grade.USABLE


@pytest.mark.repeated(1)
@pytest.mark.parametrize(
    "content", [b"{", b"[]", b'{"schema": 9}', b'{"schema": 1, "verdict": 3}', b"\xff", b"[" * 9000]
)
def test_a_damaged_member_is_unknown_and_not_an_error(folder: Path, content: bytes) -> None:
    members = read_archive(folder / "late.fmu")
    write_archive(folder / "damaged.fmu", members | {MEMBER: content})
    assert FmuComponent(folder / "damaged.fmu", "shock").validity is None


def test_the_fit_reports_its_verdict_and_its_file_contains_it(bad: Shock, tmp_path: Path) -> None:
    assert bad.validity is not None
    rules = {reason.rule for reason in bad.validity.verdict.reasons}
    assert "large error" in rules
    write_shock(bad, tmp_path / "shock.json")
    assert bad.validity.judged is not None
    assert read_shock(tmp_path / "shock.json").validity == bad.validity
    kinds = {(covered.variable, covered.kind) for covered in bad.validity.ranges}
    assert {("displacement", "amplitude"), ("velocity", "frequency")} <= kinds


def test_the_fit_of_a_shock_file_without_a_verdict_is_unknown(bad: Shock, tmp_path: Path) -> None:
    write_shock(replace(bad, validity=None), tmp_path / "old.json")
    old = read_shock(tmp_path / "old.json")
    assert old.validity is None
    verdict = validity_of(old).verdict
    assert verdict.grade is Grade.UNKNOWN
    assert "fit the record again" in verdict.reasons[0].remedy


def test_every_type_of_fmu_contains_it(bad: Shock) -> None:
    product = shock_product(bad, "late")
    python, native = _python_fmu(product), without_binaries(product, Disclosure.FULL).members
    assert python[MEMBER] == native[MEMBER]
    found = Validity.from_json(json.loads(native[MEMBER]))
    assert replace(found, uncertainty=None) == replace(bad.validity, judged=None)
    assert found.uncertainty is not None and found.uncertainty.parameters  # from the fit in the shock file


def test_a_confidential_fmu_contains_the_verdict_without_file_names(bad: Shock) -> None:
    members = without_binaries(shock_product(bad, "late"), Disclosure.CONFIDENTIAL).members
    carried = Validity.from_json(json.loads(members[MEMBER]))
    assert carried.verdict.grade is Grade.NOT_USABLE
    assert b"dyno_A" not in members[MEMBER]


def test_an_assembly_has_the_verdicts_of_its_parts_and_the_ranges_of_its_own_variables(bad: Shock) -> None:
    parts = {"car": None, "lf": without_binaries(shock_product(bad, "late"), Disclosure.FULL).members[MEMBER]}
    fed = {"lf.displacement": "car.lf.displacement", "lf.velocity": "car.lf.velocity"}
    (content,) = combined_member(parts, fed, frozenset({"car.lf.displacement"})).values()
    whole = Validity.from_json(json.loads(content))
    assert whole.verdict.grade is Grade.NOT_USABLE
    assert any(reason.grade is Grade.UNKNOWN and "car" in reason.origin for reason in whole.verdict.reasons)
    assert all(reason.origin.startswith(("lf: ", "car")) for reason in whole.verdict.reasons)
    assert [covered.variable for covered in whole.ranges if covered.kind != "condition"] == ["car.lf.displacement"]


@pytest.mark.nightly
def test_validation_writes_its_verdict_into_the_shock_when_asked(tmp_path: Path) -> None:
    fitted = fit_shock(read_dyno_test(EXAMPLES / "data" / "dyno_A.csv"), "polylinear", name="A").shock
    write_shock(fitted, tmp_path / "A.json")
    words = ["validate", str(tmp_path / "A.json"), str(EXAMPLES / "data" / "dyno_C.csv"), "--limit", "10"]
    before = (tmp_path / "A.json").read_bytes()
    assert CliRunner().invoke(main, words).exit_code == 1  # C is another shock
    assert (tmp_path / "A.json").read_bytes() == before
    done = CliRunner().invoke(main, [*words, "--keep"])
    assert done.exit_code == 1, done.output
    kept = read_shock(tmp_path / "A.json")
    assert kept.validity is not None
    assert kept.validity.verdict.grade is Grade.NOT_USABLE
    assert kept.validity.ranges == fitted.validity.ranges
    assert kept.validity.judged not in (None, fitted.validity.judged)
    CliRunner().invoke(main, [*words[:-1], "1000", "--keep"])
    again = read_shock(tmp_path / "A.json").validity.verdict
    assert again.grade is not Grade.NOT_USABLE  # it took the place of the earlier one
