"""The numbers of whole fits over settings: shock, click map, the search for clicks, and their tables."""

import io
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from shutil import copyfile
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from eightpost.ident.shock.clicks import TargetCurve, answer_table, best_clicks, read_target
from eightpost.ident.shock.plots import plot_answer, plot_click_map
from eightpost.ident.shock.settings import SettingsFit, fit_settings, settings_table
from eightpost.ident.shock.settings_table import joined_temperatures, read_settings_table, settings_of_names
from eightpost.shock import Axis, Shock, write_shock
from tests.drawn import compact, rounded

from .test_settings import EXAMPLES, forces, record, table, true_law, two_adjusters


def printed(found: Any) -> str:
    console = Console(file=io.StringIO(), width=160)
    console.print(found)
    return console.file.getvalue()  # type: ignore[attr-defined]


@pytest.fixture(scope="module")
def adjuster() -> SettingsFit:
    axis = Axis("rebound", (0.0, 7.0, 14.0, 28.0), 14.0, counted="from full soft", lowest=0.0, highest=28.0)
    tests = [record(true_law(clicks), k) for k, clicks in enumerate(axis.nodes)]
    return fit_settings(table([axis], [(clicks,) for clicks in axis.nodes], tests))


@pytest.fixture(scope="module")
def warmed() -> SettingsFit:
    axes = (Axis("rebound", (0.0, 14.0, 28.0), 14.0), Axis("temperature", (300.0, 320.0, 350.0), 320.0, unit="K"))
    settings = [(0.0, 320.0), (14.0, 320.0), (28.0, 320.0), (14.0, 300.0), (14.0, 350.0), (28.0, 350.0)]
    tests = [record(true_law(*setting), k, temperature=setting[1]) for k, setting in enumerate(settings)]
    return fit_settings(table(axes, settings, tests), law="polylinear")


@pytest.mark.parametrize("name", ["adjuster", "warmed"])
def test_a_fit_over_settings(
    name: str, request: pytest.FixtureRequest, tmp_path: Path, pictures: list[dict[str, Any]],
    unchanged: Callable[..., None],
) -> None:  # fmt: skip
    fit: SettingsFit = request.getfixturevalue(name)
    write_shock(fit.shock, tmp_path / "shock.json")
    document = json.loads((tmp_path / "shock.json").read_text())
    document.pop("validity", None)
    document["fit"].pop("status", None)
    if name == "warmed":  # offsets of the curves and preload are one parameter: its standard error is that of rounding
        document["fit"]["parameters"].pop("gas_preload")
    plot_click_map(fit.shock, tmp_path / "map.png")
    reasons = [f"{reason.grade}: {reason}: {reason.figure}: {reason.remedy}" for reason in fit.verdict.reasons]
    unchanged({
        "file": compact(document), "verdict": reasons, "predicted": fit.predicted,
        "table": printed(settings_table(fit)),
        "fits": np.array([(one.rms, one.percent) for one in fit.fits]), "changes": fit.shock.fit.get("changes"),
    }, relative=1e-2)  # fmt: skip
    if name == "warmed":
        unchanged(pictures, "map", relative=1e-3)


def target_of(shock: Shock, rebound: float, compression: float) -> TargetCurve:
    velocity = np.linspace(-0.7, 0.7, 41)
    law = shock.at(clicks={"rebound": rebound, "compression": compression}).law
    return TargetCurve("target", velocity, forces(law, velocity))


@pytest.mark.parametrize("level", ["free", "fixed"])
@pytest.mark.parametrize("gap", [0.0, 90.0, 700.0])
def test_the_clicks_of_a_target(
    level: Any, gap: float, tmp_path: Path, pictures: list[dict[str, Any]], unchanged: Callable[..., None]
) -> None:
    shock = two_adjusters()
    target = target_of(shock, 6, 15)
    bump = gap * np.exp(-(((target.velocity - 0.3) / 0.1) ** 2))
    answer = best_clicks(shock, replace(target, force=1.02 * target.force + bump + 25.0), level=level)
    plot_answer(shock, target, answer, tmp_path / "answer.png")
    unchanged({
        "best": rounded(str(answer.best)), "unreachable": answer.unreachable, "notes": answer.notes,
        "number": answer.combinations, "reachable": answer.is_reachable, "table": printed(answer_table(answer)),
        "picture": pictures if gap == 90.0 else None,
    }, relative=1e-3)  # fmt: skip


def test_a_target_of_a_file(tmp_path: Path, unchanged: Callable[..., None]) -> None:
    time = np.linspace(0.0, 2.0 * np.pi, 400)
    loop = zip(200.0 * np.sin(time), 0.8 * np.sin(time) + 0.1 + 0.02 * np.cos(time), strict=True)
    head = "Velocity [mm/s],Force [kN]\n"
    (tmp_path / "loop.csv").write_text(head + "".join(f"{v:.6g},{f:.6g}\n" for v, f in loop))
    (tmp_path / "points.csv").write_text("velocity [in/s],force [lbf]\n-5,-60\n-1,-20\n1,30\n4,80\n")
    write_shock(Shock("law", true_law(14.0)), tmp_path / "law.json")
    unchanged({name: read_target(tmp_path / name) for name in ("loop.csv", "points.csv", "law.json")})


def test_the_table_of_the_examples(tmp_path: Path, unchanged: Callable[..., None]) -> None:
    found = read_settings_table(EXAMPLES / "rebound.toml")
    for clicks in (0, 28):
        copyfile(EXAMPLES / f"rebound_{clicks:02}.csv", tmp_path / f"front_{clicks}clicks.csv")
    by_name = settings_of_names(sorted(tmp_path.glob("*.csv")))
    unchanged({
        "axes": found.axes, "settings": found.settings, "law": found.law, "gas": found.gas,
        "of names": {"axes": by_name.axes, "settings": by_name.settings, "notes": by_name.notes},
        "temperatures": joined_temperatures([300.0, 302.9, 306.1, 290.0, 309.0, 312.2]),
    })  # fmt: skip


def test_of_two_columns_of_a_target_the_first_is_read(tmp_path: Path) -> None:
    rows = "-200,-20,-400,-4\n-100,-9,-200,-3\n200,20,400,4\n"
    (tmp_path / "two.csv").write_text(f"Velocity [mm/s],Velocity [in/s],Force [N],Force [lbf]\n{rows}")
    found = read_target(tmp_path / "two.csv")
    assert found.velocity == pytest.approx([-0.2, -0.1, 0.2])
    assert np.ptp(found.force) == pytest.approx(800.0)
