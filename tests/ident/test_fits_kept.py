"""The numbers of whole fits: every law by both recipes, treatments of gas, outliers, builds, slow and short records."""

import io
import json
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from eightpost.ident import fit_shock, fit_table, parameter_table, plot_force_velocity
from eightpost.ident.shock.result import ShockFit
from eightpost.rig import DynoConditions, DynoTest
from eightpost.shock import Lpf1, Lpnl2, Port, StaticCurve, write_shock
from tests.drawn import compact

from .dyno_records import record_of
from .settings.test_hysteresis_over_settings import STOP
from .settings.test_hysteresis_over_settings import true_law as lagging

GAS = Port(gas_preload=204.6, gas_stiffness=700.0)


def printed(table: Any) -> str:
    console = Console(file=io.StringIO(), width=160)
    console.print(table)
    return console.file.getvalue()  # type: ignore[attr-defined]


def spiked(test: DynoTest) -> DynoTest:
    """Return a record with a dropout, three spikes of the force and one of the displacement."""
    force, path = test.series["force"].copy(), test.series["displacement"].copy()
    force[700:720] = force.max()
    force[[900, 1200, 1500]] += 4000.0
    path[1000] += 0.01
    series = test.series.with_channel("force", "N", force).with_channel("displacement", "m", path)
    return replace(test, series=series)


def drifting(test: DynoTest) -> DynoTest:
    series, share = test.series, np.linspace(0.0, 1.0, len(test.series))
    series = series.with_channel("force", "N", (1.0 - 0.06 * share) * series["force"])
    return replace(test, series=series.with_channel("temperature", "K", 300.0 + 25.0 * share))


@pytest.fixture(scope="module")
def fit(law_record: Callable[..., DynoTest], rising: StaticCurve, curve: StaticCurve) -> Callable[[str], ShockFit]:
    """Fit one of the cases by its name."""
    smooth = cache(lambda seed=1, slower=1.0: law_record(Lpf1(rising, 2e-3, port=GAS), seed, rate=500.0, slower=slower))
    fading = cache(lambda: law_record(Lpnl2(rising, 2e-3, 300.0, 900.0, port=GAS), 1, rate=500.0))

    def scaled(test: DynoTest, factor: float, build: str) -> DynoTest:
        series = test.series.with_channel("force", "N", factor * test.series["force"])
        return replace(test, series=series, conditions=DynoConditions(build=build))

    def builds() -> list[DynoTest]:
        return [scaled(smooth(seed), factor, build) for seed in (1, 2) for factor, build in ((1.0, "A"), (1.06, "B"))]

    short: dict[str, Any] = {"segment": (1.0, 4.0)}
    cases: dict[str, Callable[[], ShockFit]] = {
        "polylinear": lambda: fit_shock(smooth(), "polylinear", name="build 1", **short),
        "lpf1": lambda: fit_shock(smooth(), "lpf1", **short),
        "lpnl2": lambda: fit_shock(fading(), "lpnl2", **short),
        "hysteresis": lambda: fit_shock(record_of(lagging(14.0, STOP), 1), "hysteresis", **short),
        "polylinear, boggs": lambda: fit_shock(smooth(), "polylinear", recipe="boggs", **short),
        "lpf1, boggs": lambda: fit_shock(smooth(), "lpf1", recipe="boggs", **short),
        "lpnl2, boggs": lambda: fit_shock(fading(), "lpnl2", recipe="boggs", **short),
        "slow, boggs": lambda: fit_shock(smooth(1, 2.2), "lpf1", recipe="boggs", **short),
        "very slow, boggs": lambda: fit_shock(smooth(1, 4.0), "lpf1", recipe="boggs", **short),
        "gas included": lambda: fit_shock(smooth(), "lpf1", gas="included", **short),
        "gas subtracted": lambda: fit_shock(smooth(), "lpf1", gas="subtracted", recipe="boggs", **short),
        "spikes": lambda: fit_shock(spiked(smooth()), "lpf1", **short),
        "drift and heat": lambda: fit_shock(drifting(smooth()), "lpf1", **short),
        "a falling curve": lambda: fit_shock(law_record(Lpf1(curve, 2e-3), 1, rate=500.0), "lpf1", **short),
        "two runs": lambda: fit_shock([smooth(1), smooth(2)], "lpf1", **short),
        "builds": lambda: fit_shock(builds(), "lpf1", **short),
    }
    return cache(lambda name: cases[name]())


CASES = (
    "polylinear", "lpf1", "lpnl2", pytest.param("hysteresis", marks=pytest.mark.slow), "polylinear, boggs",
    "lpf1, boggs", "lpnl2, boggs", "slow, boggs", "very slow, boggs", "gas included", "gas subtracted",
    "spikes", "drift and heat", "a falling curve", "two runs", "builds",
)  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_a_fit(name: str, fit: Callable[[str], ShockFit], tmp_path: Path, unchanged: Callable[..., None]) -> None:
    found = fit(name)
    write_shock(found.shock, tmp_path / "shock.json")
    document = json.loads((tmp_path / "shock.json").read_text())
    document.pop("validity", None)
    document["fit"].pop("status")
    unchanged({
        "file": compact(document),
        "verdict": [f"{reason.grade}: {reason}: {reason.figure}: {reason.remedy}" for reason in found.verdict.reasons],
        "predicted": found.predicted.values,
        "parameters": printed(parameter_table(found)),
    }, relative=2e-3)  # fmt: skip


def test_tables_and_pictures_of_fits(
    fit: Callable[[str], ShockFit], tmp_path: Path, pictures: list[dict[str, Any]], unchanged: Callable[..., None]
) -> None:
    fits = [replace(fit(name), seconds=1.5) for name in ("polylinear, boggs", "lpf1, boggs", "lpf1")]
    plot_force_velocity(fits, tmp_path / "fits.png")
    unchanged({
        "table": printed(fit_table(fits)), "summary": str(fits[1]), "frame": fits[1].to_pandas().round(9).to_string(),
        "picture": pictures,
    }, relative=1e-3)  # fmt: skip
