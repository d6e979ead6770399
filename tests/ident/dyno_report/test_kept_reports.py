"""The numbers of whole reports: of the examples, and of a day at the dynamometer with every kind of entry."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eightpost.ident.dyno_report.builds import CarCorner, DynoReport, Reading, dyno_report, read_entries, read_limits
from eightpost.ident.dyno_report.entry import Entry, entry_of_shock, entry_of_test, with_gas_of_slow_runs
from eightpost.ident.dyno_report.figures import branches_figure, curves_figure, loops_figure
from eightpost.ident.dyno_report.page import report_verdict, write_report
from eightpost.rig.dyno_test import DynoTest
from eightpost.shock import read_shock
from eightpost.signals import TimeSeries
from eightpost.virtual.dynamometer import random_multisine
from tests.drawn import plotted, rounded, rows_of_page

from .conftest import run, sine, two_lines, valve

BANK = sorted((Path(__file__).parents[3] / "examples" / "bank").glob("*.json"))


def digressive(gain: float, *, gas: float = 180.0, held: float = 0.0) -> Callable[..., Any]:
    compression, rebound = two_lines(5000.0 * gain, 1500.0 * gain, 0.1), two_lines(9000.0 * gain**0.5, 2500.0, 0.07)
    return valve(compression, rebound, gas=gas + held, stiffness=600.0, friction=12.0)


def noisy(series: TimeSeries) -> TimeSeries:
    force = series["force"] + 4.0 * np.random.default_rng(2).standard_normal(len(series))
    return series.with_channel("force", "N", force)


def random_motion() -> DynoTest:
    series = random_multisine(1, duration=10.0).series
    x = series[series.names[0]]
    v = np.gradient(x, series.time)
    force = np.interp(series.time - 1.5e-3, series.time, digressive(1.0)(v, x))
    channels = {"velocity": ("m/s", v), "displacement": ("m", x), "force": ("N", force)}
    return run(noisy(TimeSeries.from_channels(series.time, channels)))


@pytest.fixture(scope="module")
def entries(tmp_path_factory: pytest.TempPathFactory) -> list[Entry]:
    """Fast runs of three settings, repeated and warm ones, a slow run, a random motion, a table and two laws."""

    def fast(gain: float, **changes: Any) -> TimeSeries:
        return noisy(sine(digressive(gain, held=25.0), **{"duration": 3.0, "lag": 2e-3} | changes))

    warm = fast(0.95, heat=lambda t: 320.0 + 0.8 * t)
    cold = fast(1.0, heat=lambda t: 300.0 + 0.2 * t)
    slow = sine(digressive(1.0), amplitude=0.02, frequency=0.08, duration=26.0, rate=200.0)
    folder = tmp_path_factory.mktemp("tables")
    rows = "".join(f"{v:g},{400 * v**0.5:g},{-700 * v**0.5:g}\n" for v in np.linspace(0.02, 0.5, 13))
    (folder / "points.csv").write_text(f"speed [m/s],compression [N],rebound [N]\n{rows}")
    found = [
        entry_of_test(run(cold, clicks="4", gas_pressure=1e6), "cold", "A"),
        entry_of_test(run(warm, clicks="4", gas_pressure=1e6), "warm", "A"),
        entry_of_test(run(slow, clicks="4", gas_pressure=1e6), "slow", "A"),
        entry_of_test(run(fast(1.3), clicks="8"), "stiff", "A", cycle="last"),
        entry_of_test(run(fast(0.7, frequency=1.0)), "soft", "B", cycle=2),
        entry_of_test(random_motion(), "random", "B"),
        *read_entries([folder / "points.csv"], Reading()),
        *(entry_of_shock(read_shock(path), path.stem, build) for path, build in zip(BANK[:2], "BC", strict=False)),
    ]
    return list(with_gas_of_slow_runs(found))


@pytest.fixture(scope="module")
def report(entries: list[Entry], tmp_path_factory: pytest.TempPathFactory) -> DynoReport:
    path = tmp_path_factory.mktemp("limits") / "master.csv"
    rows = "".join(f"{v:g},{400 * v**0.5:g},{-700 * v**0.5:g},{t}\n" for v, t in ((0.05, 30), (0.1, 60), (0.3, 60)))
    path.write_text(f"speed [m/s],compression [N],rebound [N],tolerance [N]\n{rows}")
    track = 0.2 * np.random.default_rng(5).standard_normal(5000)
    corners = [CarCorner("lf", 300.0, 40e3, 0.8), CarCorner("rr", 280.0, 35e3)]
    return dyno_report(
        entries, corners=corners, fitted_to={"lf": "A, 4", "rr": "B"}, limits=read_limits(path, Reading(), ()),
        track={"lap.csv": track},
    )  # fmt: skip


def test_the_page_of_every_kind_of_entry(report: DynoReport, tmp_path: Path, unchanged: Callable[..., None]) -> None:
    unchanged(rows_of_page(write_report(tmp_path / "page.html", report)), relative=1e-3)


def test_the_figures_of_every_kind_of_entry(entries: list[Entry], unchanged: Callable[..., None]) -> None:
    texts = ("setting", "strokes", "offset", "level", "lag", "slow", "warming", "notes")
    arrays = ("curve", "branches", "band", "cycles")
    unchanged([{"name": entry.name, "figures": [rounded(f"{name} {getattr(entry, name)}") for name in texts],
                **{name: getattr(entry, name) for name in arrays}} for entry in entries], relative=1e-3)  # fmt: skip
    unchanged([str(reason) for reason in report_verdict(entries).reasons], "verdict")


@pytest.mark.parametrize("figure", [curves_figure, branches_figure, loops_figure])
def test_the_plots(report: DynoReport, figure: Callable[..., Any], unchanged: Callable[..., None]) -> None:
    unchanged("\n".join(plotted(figure(report).content())), relative=1e-3)


def test_the_plots_of_short_runs_without_temperature(unchanged: Callable[..., None]) -> None:
    half = sine(digressive(1.0), duration=0.75, amplitude=0.03)
    slower = sine(digressive(1.2), duration=3.0, frequency=0.3, rate=200.0).select(["velocity", "force"])
    report = dyno_report([entry_of_test(run(half), "half", "A"), entry_of_test(run(slower), "slower", "B")])
    unchanged("\n".join(plotted(loops_figure(report).content())[:-9]), relative=1e-3)
