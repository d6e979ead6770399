"""Measures, tables and verdicts of studies, kept number by number, and the limits of what a study accepts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.signal

from cosim.study import measures as measures_module
from cosim.study.definition import Constraint, Drive, SetupSpace, Study, Term
from cosim.study.measures import (
    FAMILIES,
    STATISTICS,
    AboveBand,
    Car,
    Filtered,
    Measure,
    Response,
    above_band,
    band_pass,
    channel_measures,
    family,
    options_for,
    power_above,
    sections_of,
    shares_of,
)
from cosim.study.table import StudyResult
from cosim.study.verdict import study_verdict
from eightpost.corners import CORNERS
from eightpost.errors import InputError
from eightpost.signals import TimeSeries
from eightpost.verdict import Grade
from tests.drawn import drawn
from tests.unchanged import refusals

from .constructed import cells, edited, result, study

Unchanged = Callable[..., None]

TIME = np.arange(0.0, 4.0, 0.004)
UNITS = {"tire_force": "N", "hub_acceleration": "m/s2", "chassis_acceleration": "m/s2", "acceleration": "m/s2",
         "velocity": "m/s", "displacement": "m", "ride_height": "m", "force": "N"}  # fmt: skip
CHANNELS = (
    *(f"car.{corner}.{name}" for corner in CORNERS for name in [*list(UNITS)[:3], "velocity", "displacement"]),
    *(f"{corner}.force" for corner in CORNERS), "car.front.ride_height", "car.rear.ride_height",
    "car.driver.acceleration",
)  # fmt: skip


def lap() -> TimeSeries:
    """Return four seconds of tones and an offset in every channel, in other phases."""
    rows = {}
    for k, name in enumerate(CHANNELS):
        waves = [np.sin(2.0 * np.pi * f * TIME + 0.7 * k + f) / f for f in (0.8, 1.9, 5.0, 11.0, 23.0)]
        unit = UNITS[name.rpartition(".")[2]]
        size = {"N": 800.0, "m/s2": 20.0, "m/s": 0.2, "m": 0.02}[unit]
        rows[name] = (unit, size * (sum(waves) + 0.3 * k))
    return TimeSeries.from_channels(TIME, rows)


def test_measures_of_every_family_are_unchanged(unchanged: Unchanged) -> None:
    run, car = lap(), Car("car", CORNERS, CHANNELS)
    filtered = Filtered(run)
    unchanged([
        f"{name} | {m.name} | {' '.join(m.channels)} | {m.statistic} {m.band} {m.weights} {dict(m.options)} | "
        f"{m.drawn_from(filtered, start=0.5):.7g} {m.unit(run)} {m.display} {m.absolute}"
        for name in FAMILIES for m in family(name, car)
    ])  # fmt: skip
    quarter = Car("car", ("lf",), ("car.velocity", "car.tire_force", "lf.force"))
    unchanged([f"{m.name}: {m.channels}" for name in ("ride", "energy", "velocities") for m in family(name, quarter)],
              "quarter car")  # fmt: skip
    unchanged([f"{m.name} {m.statistic} {m.display}" for m in channel_measures(run.select(CHANNELS[:4]))], "channels")


@pytest.mark.parametrize("name", STATISTICS)
def test_a_statistic_is_that_of_its_formula(name: str) -> None:
    a, b = np.random.default_rng(2).normal(1.0, 2.0, (2, 51))
    total, values = a + b, {"percent": 20.0} if name == "percentile" else {"from": 0.5, "to": 2.5}
    given = values if name in ("percentile", "share") else {}
    found = STATISTICS[name].of(Response(np.stack([a, b]), 0.1, options_for(name, given)))
    center = total - total.mean()
    expected = {
        "rms": np.sqrt(np.mean(center**2)), "rms_with_mean": np.sqrt(np.mean(total**2)), "mean": total.mean(),
        "joint_rms": np.sqrt(0.5 * (a.var() + b.var())), "peak": np.abs(center).max(),
        "range": total.max() - total.min(),
        "maximum": total.max(), "minimum": total.min(), "percentile": np.percentile(total, 20.0),
        "variation": np.sqrt(np.mean(center**2)) / abs(total.mean()),
        "work": 0.05 * np.sum(a[1:] * b[1:] + a[:-1] * b[:-1]),
        "share": np.mean((total >= 0.5) & (total < 2.5)),
    }  # fmt: skip
    assert found == pytest.approx(expected[name], rel=1e-12)


@pytest.mark.parametrize("band", [(0.0, 20.0), (2.0, np.inf), (2.0, 20.0)])
def test_a_band_is_a_filter_of_fourth_order_forward_and_backward(
    band: tuple[float, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(measures_module, "recall", lambda *_: None)
    kept: list[bytes] = []
    monkeypatch.setattr(measures_module, "keep", lambda *given: kept.append(given[-1]))
    sections_of.cache_clear()
    values = np.random.default_rng(1).normal(3.0, 1.0, 400)
    given = {"btype": "lowpass", "Wn": band[1]} if not band[0] else {"btype": "highpass", "Wn": band[0]}
    given = {"btype": "bandpass", "Wn": band} if band[0] and np.isfinite(band[1]) else given
    rows = scipy.signal.butter(4, fs=100.0, output="sos", **given)
    pad = 3 * (2 * len(rows) + 1)
    expected = scipy.signal.sosfiltfilt(rows, values, padtype="odd", padlen=pad)
    assert band_pass(values, 100.0, band, "m") == pytest.approx(expected, rel=1e-9)
    monkeypatch.setattr(measures_module, "recall", lambda *_: kept[0])
    sections_of.cache_clear()
    assert band_pass(values, 100.0, band, "m") == pytest.approx(expected, rel=1e-9)
    assert band_pass(values[: pad + 1], 100.0, band, "m").shape == (pad + 1,)
    with pytest.raises(InputError, match=f"{pad} samples are too few .* it needs {pad + 1}"):
        band_pass(values[:pad], 100.0, band, "m")
    sections_of.cache_clear()


@pytest.mark.parametrize(("band", "fits"), [
    ((1.0, 49.999), True), ((1.0, 50.0), False), ((50.0, np.inf), False), ((49.999, np.inf), True),
    ((0.0, np.inf), True),
])  # fmt: skip
def test_a_band_ends_below_half_the_sample_rate(band: tuple[float, float], fits: bool) -> None:
    values = np.sin(np.arange(200.0))
    if fits:
        assert band_pass(values, 100.0, band, "m").shape == values.shape
        return
    with pytest.raises(InputError, match="exceeds half the sample rate of 100 Hz"):
        band_pass(values, 100.0, band, "m")


def test_power_above_a_frequency_and_in_bands_is_that_of_the_windowed_spectrum(unchanged: Unchanged) -> None:
    run = lap()
    signals = run.values[:2]
    windowed = (signals - signals.mean(axis=1, keepdims=True)) * np.hanning(signals.shape[1])
    power, lines = (np.abs(np.fft.rfft(windowed)) ** 2).sum(axis=0), np.fft.rfftfreq(TIME.size, 0.004)
    for high in (lines[40], lines[40] - 1e-6):
        assert power_above(signals, 250.0, high) == pytest.approx(power[lines > high].sum() / power.sum())
    assert power_above(np.ones((1, 100)), 100.0, 10.0) == 0.0
    ends = {name: 4.0 + k for k, name in enumerate(CHANNELS[:6])}
    measures = (
        Measure("a", CHANNELS[:2]), Measure("m", CHANNELS[:1], "mean"), Measure("j", CHANNELS[2:4], "joint_rms"),
        Measure("none", CHANNELS[7:8]), Measure("s", CHANNELS[:1], "share"),
    )  # fmt: skip
    found = above_band(Filtered(run), measures, ends, 0.5)
    unchanged({"above": {name: one._asdict() for name, one in found.items()}, "shares": shares_of(signals, 250.0)})


# ---- Tables and verdicts --------------------------------------------------------------------------------------------

BUILDS = ("A", "B", "C")


def table(**fields: Any) -> StudyResult:
    given = {"builds": BUILDS, "baseline": dict.fromkeys(CORNERS, "B"), "objective": (Term("a", 2.0, "in"),),
             "constraints": (Constraint("b", at_most=1.3, at_least=1.02),)}  # fmt: skip
    responses = {
        "a": lambda d: 2.0 + 0.1 * d[:, 0] - 0.05 * d[:, 3],
        "b": lambda d: 1.0 + 0.02 * d[:, 1] + 0.2 * d[:, 2],
    }
    return result(responses, failed=(17,), marks={5: "tire off the ground: lf", 70: "beyond"}, **given | fields)


def test_a_table_and_its_picture_are_unchanged(tmp_path: Path, unchanged: Unchanged) -> None:
    found = table()
    unchanged({"summary": repr(found), "costs": found.cost(),
               "figure": drawn(found.plot().figure), "ranking": found.ranking(), "by b": found.ranking("b"),
               "rows": found.rows_of(np.array([3, 60, 12]), "b"), "marked": found.marked("tire"),
               "seconds": found.seconds,
               "shown": found.shown("a"), "difference": found.shown_difference("a", 0.0254),
               "factor": found.factor(found.study.objective[0]), "infeasible": found.infeasible})  # fmt: skip
    unchanged(drawn(table(objective=(), baseline={}).plot("b", "a").figure), "other picture")
    found = replace(found, provenance=replace(found.provenance, above_band={"a": AboveBand(20.0, 0.31)}))
    found.save(tmp_path / "results.parquet")
    loaded = StudyResult.load(tmp_path / "results.parquet")
    assert cells(loaded.table) == cells(found.table)
    assert loaded.study == found.study and loaded.provenance == found.provenance


@pytest.mark.parametrize(("best", "others", "rule", "grade"), [
    (0.2, 0.2, "errors of all setups small", Grade.USABLE),
    (0.1, 0.21, "error of a setup above the tolerance", Grade.LIMITED),
    (5.0, 0.1, "error of a setup above the tolerance", Grade.LIMITED),
    (5.01, 0.1, "error of a setup too large", Grade.NOT_USABLE),
    (0.1, 9.0, "error of a setup above the tolerance", Grade.LIMITED),
    (None, 0.1, "error of setups not stated", Grade.UNKNOWN), (0.1, None, "errors of all setups small", Grade.USABLE),
    (None, None, "error of setups not stated", Grade.UNKNOWN),
])  # fmt: skip
def test_limits_of_the_coupling_error_of_a_study(
    best: float | None, others: float | None, rule: str, grade: Grade
) -> None:
    found = table()
    errors = [best if row == found.ranking()[0] else others for row in range(len(found))]
    (reason,) = study_verdict(edited(found, coupling_error_percent=errors)).about("coupling").reasons
    assert (reason.rule, reason.grade) == (f"coupling {rule}", grade)


@pytest.mark.parametrize(("share", "rule"), [
    (0.1, "measures within the identified band"), (0.101, "measures above the identified band"),
])  # fmt: skip
def test_a_tenth_of_the_power_above_the_band_is_the_limit(share: float, rule: str) -> None:
    found = table()
    source = replace(found.provenance, above_band={"a": AboveBand(20.0, share), "b": AboveBand(25.0, 0.01)})
    assert rule in [reason.rule for reason in study_verdict(replace(found, provenance=source)).reasons]


def test_reasons_of_a_study_are_unchanged(unchanged: Unchanged) -> None:
    found = table()
    source = replace(found.provenance, above_band={"a": AboveBand(20.0, 0.31), "b": AboveBand(25.0, 0.01)})
    least = replace(source, above_band={"a": AboveBand(20.0, 0.05), "b": AboveBand(25.0, 0.01)})
    blank, count = {"marks": [""] * len(found)}, len(found)
    kinds = {
        "marked": replace(found, provenance=source, partial=True),
        "clean": replace(edited(found, **blank), provenance=least),
        "all failed": edited(found, status=["failed"] * count, a=[None] * count, b=[None] * count),
        "infeasible": replace(found, study=replace(found.study, constraints=(Constraint("a", at_most=0.1),))),
    }  # fmt: skip
    unchanged({name: [f"{one.about} | {one}" for one in study_verdict(one_result).reasons]
               for name, one_result in kinds.items()})  # fmt: skip


# ---- Definitions ----------------------------------------------------------------------------------------------------


def test_measures_without_a_drive_belong_to_the_first_one() -> None:
    drives = tuple(Drive(name, Path("lap.parquet"), 30.0) for name in ("dry", "wet"))
    measures = (Measure("a", ("x",)), Measure("b", ("x",), drive="wet"), Measure("c", ("x",), drive="dry"))
    made: Study = replace(study(("front",)), drives=drives, measures=measures)
    assert [[m.name for m in made.measures_of(drive)] for drive in drives] == [["a", "c"], ["b"]]
    assert made.named_measures == ("a", "b", "c") and Study.from_json(made.to_json()) == made


def test_measures_studies_and_spaces_that_cannot_be_are_refused(unchanged: Unchanged) -> None:
    measures: list[dict[str, Any]] = [
        {"channels": ()}, {"weights": (1.0,)}, {"band": (2.0, 2.0)}, {"band": (-0.1, 2.0)}, {"section": (3.0, 1.0)},
        {"statistic": "work", "channels": ("a",)}, {"statistic": "rmss"}, {"options": {"percent": 1.0}},
    ]  # fmt: skip
    studies: list[dict[str, Any]] = [
        {"corners": {}}, {"corners": {"lf": ()}}, {"corners": {"lf": ("AA/AX",)}}, {"measures": ()}, {"drives": ()},
        {"measures": (Measure("m", ("x",)),) * 2}, {"settling": 30.0}, {"settling": -0.1}, {"baseline": {"lf": "B/B"}},
        {"measures": (Measure("m", ("x",), drive="wet"),)}, {"objective": (Term("frnt", 1.0),)},
        {"objective": (Term("x", 1.0),)}, {"baseline": dict.fromkeys(CORNERS, "B/X")},
    ]  # fmt: skip
    pair = {"lf": ("A",), "rf": ("A",)}
    spaces: list[tuple[Any, Any]] = [
        ({"lf": ("A", "A")}, ()), ({"lf": ()}, ()), (pair | {"rf": ("B",)}, (("lf", "rf"),)), (pair, (("lf",),)),
        (pair, (("lf", "rx"),)),
    ]  # fmt: skip
    calls: dict[str, Callable[[], object]] = {
        **{f"measure {k}": partial(Measure, **{"name": "m", "channels": ("a", "b")} | fields)
           for k, fields in enumerate(measures)},
        **{f"study {k}": partial(replace, study(("front",)), **fields) for k, fields in enumerate(studies)},
        **{f"space {k}": partial(SetupSpace, *given) for k, given in enumerate(spaces)},
        **{f"setup {k}": partial(SetupSpace(pair).setup, k) for k in (-1, 1)},
    }  # fmt: skip
    unchanged(refusals(calls))
    assert Measure("m", ("a", "b"), band=(0.0, 1.0), section=(0.0, 1.0), weights=(1.0, 2.0)).weights == (1.0, 2.0)
    assert study(("front",), settling=29.9).settling == 29.9
