"""The screens of the window, built without a browser: none of their words, choices and figures changes unseen."""

from __future__ import annotations

import asyncio
import shutil
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eightpost.window.parts import Folder

EXAMPLES = Path(__file__).parents[2] / "examples"
FILES = {
    "dyno/dyno_A.csv": "data/dyno_A.csv", "rig/lap.parquet": "identified/lap.parquet",
    "tracks/track.parquet": "data/track.parquet", "car.json": "identified/car.json", "corner.toml": "corner.toml",
    "shocks/AA_B.json": "bank/AA_B.json", "shocks/B_B.json": "bank/B_B.json",
}  # fmt: skip
ROWS = "".join(f"{0.01 * k:.2f},{k % 7},{3 * k % 11}\n" for k in range(60))

_FIT, _RUN = {"law": "lpnl2", "gas": "included"}, {"name": "run", "runs": [], "channels": [], "stop": 10.0}
#: Screens, and what is chosen on them.
SCREENS: dict[str, tuple[str, dict[str, Any]]] = {
    "an empty folder": ("Dyno", {}),
    "a record and a shock": ("Dyno", {"dyno": {**_FIT, "records": ["dyno_A.csv"], "shock": "shocks/AA_B.json"}}),
    "a record without names": ("Dyno", {"dyno": {**_FIT, "records": ["other.csv"], "shock": None}}),
    "a car": ("Car", {}),
    "a run": ("Run", {"run": {**_RUN, "car": "car.json", "lf": "shocks/AA_B.json"}}),
    "a study": ("Study", {}),
}


def _lines(element: Any) -> Iterator[str]:
    """Yield what is kept of an element: its classes, properties and text, and the curves of a figure."""
    given = {key: one for key, one in element.props.items() if isinstance(one, str | int | float) and key != "url"}
    text = getattr(element, "text", "") or getattr(element, "content", "")
    shown = " ".join(f"{key}={value}" for key, value in sorted(given.items()))
    yield f"{element.tag} .{' .'.join(element.classes)} {shown} {text if isinstance(text, str) else ''}"[:600]
    options = element.props.get("options")
    if isinstance(options, list):
        yield f"  options {[one.get('label') for one in options]}"
    for curve in options.get("data", ()) if isinstance(options, Mapping) else ():
        sizes = {axis: np.asarray(curve[axis], float) for axis in "xy" if len(curve.get(axis) or ())}
        ranges = (f"{axis}: {len(one)} in {np.nanmin(one):.6g} to {np.nanmax(one):.6g}" for axis, one in sizes.items())
        drawn = {name: one for name, one in curve.items() if isinstance(one, str | int) or name in ("line", "marker")}
        yield f"  curve {drawn} {' '.join(ranges)}"


async def _screen(folder: Folder, name: str, chosen: dict[str, Any]) -> list[str]:
    from nicegui import ui  # noqa: PLC0415 -- an extra
    from nicegui.testing import user_simulation  # noqa: PLC0415

    from eightpost.window import parts, server  # noqa: PLC0415

    window, built = parts.Window(folder), asyncio.Event()
    window.chosen = {"screen": name, **chosen}

    async def page() -> None:
        await server._page(window)
        built.set()

    async with user_simulation() as user:
        ui.page("/", response_timeout=60.0)(page)
        await user.open("/")
        await asyncio.wait_for(built.wait(), 60.0)
        assert user.client is not None
        return [line for element in [*user.client.elements.values()] for line in _lines(element)]


@pytest.mark.parametrize("name", SCREENS)
def test_a_screen_shows_the_same(name: str, tmp_path: Path, unchanged: Callable[..., None]) -> None:
    pytest.importorskip("nicegui.testing")
    folder = Folder.opened(tmp_path / "work")
    if name != "an empty folder":
        for place, source in FILES.items():
            (folder.path / place).parent.mkdir(exist_ok=True)
            shutil.copy(EXAMPLES / source, folder.path / place)
        (folder.path / "dyno" / "other.csv").write_text("Test,7\nTime [s],Pot 1 [in],Load 2 [lbf]\n" + ROWS)
        (folder.path / "studies" / "first").mkdir(parents=True)
        (folder.path / "studies" / "first" / "report.html").write_text("<p>")
    shown = asyncio.run(_screen(folder, *SCREENS[name]))
    unchanged([line.replace(str(folder.path), "") for line in shown][13:70])
