"""The screen Study: choose shocks, corners and an objective, run every setup, see what to bolt on."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from nicegui import ui

from eightpost.files import write_text
from eightpost.window.folder import quoted
from eightpost.window.parts import Area, Window, job_card, show_files

#: What can be minimised, with the unit of the objective.
OBJECTIVES = {
    "total tire force, RMS": "N", "front ride height, RMS": "m", "rear ride height, RMS": "m",
    "lf tire force, RMS": "N", "rf tire force, RMS": "N", "lr tire force, RMS": "N", "rr tire force, RMS": "N",
}  # fmt: skip


async def show(window: Window) -> None:
    """Build the screen."""
    chosen = window.chosen.setdefault(
        "study", {"name": "study", "bank": [], "objective": next(iter(OBJECTIVES)), "alike": True, "stop": 10.0}
    )
    cars = {window.folder.name(path): path.name for path in window.folder.documents("vehicle")}
    shocks = {window.folder.name(path): path.stem for path in window.folder.documents("shock")}
    tracks = window.folder.drives()
    for key, options in (("car", cars), ("drive", tracks), ("baseline", shocks)):
        if chosen.get(key) not in options:
            chosen[key] = next(iter(options), None)
    chosen["bank"] = [path for path in chosen["bank"] if path in shocks]

    def start() -> None:
        bank = list(dict.fromkeys([*chosen["bank"], *filter(None, [chosen["baseline"]])]))
        if not chosen["car"] or not chosen["drive"] or len(bank) < 2:
            ui.notify("choose a car, a drive file and at least two shocks")
            return
        folder = window.folder.path / "studies" / str(chosen["name"])
        _write_study(folder / "study.toml", {**chosen, "bank": bank}, window.folder.path)
        product = window.folder.name(folder)
        window.start("study", f"Study {chosen['name']}", [["study", f"{product}/study.toml", "-o", product]], folder)

    def read() -> list[Path]:
        return sorted(window.folder.path.glob("studies/*/report.html"), key=lambda path: path.stat().st_mtime_ns)

    def build(pages: list[Path]) -> None:
        if not pages:
            ui.label("Fit two or more shocks, drop a drive file on the screen Run, and run the study.").classes(
                "text-base"
            )
            return
        show_files(window, [(f"page of {path.parent.name}", path) for path in reversed(pages)])
        address = f"/file/{window.folder.name(pages[-1])}?{pages[-1].stat().st_mtime_ns}"
        frame = f'<iframe src="{address}" title="page of the study" style="width:100%;height:80vh;border:0"></iframe>'
        ui.html(frame, sanitize=False).classes("w-full")

    with ui.row().classes("w-full no-wrap screen"):
        with ui.column().classes("side"):
            ui.select(cars, label="Car").bind_value(chosen, "car").classes("w-full").props("dense")
            ui.select(tracks, label="Drive file").bind_value(chosen, "drive").classes("w-full").props("dense")
            bank = ui.select(shocks, label="Shocks to choose from", multiple=True).bind_value(chosen, "bank")
            bank.classes("w-full").props("use-chips dense")
            ui.select(shocks, label="On the car today").bind_value(chosen, "baseline").classes("w-full").props("dense")
            ui.checkbox("left and right alike").bind_value(chosen, "alike")
            ui.select(list(OBJECTIVES), label="Make small").bind_value(chosen, "objective").classes("w-full").props(
                "dense"
            )
            ui.number("Length of the drive [s]", min=1.0).bind_value(chosen, "stop").classes("w-full").props("dense")
            ui.input("Name of the study").bind_value(chosen, "name").classes("w-full").props("dense")
            ui.button("Run the study", on_click=start).props("no-caps").classes("w-full")
        with ui.column().classes("main"):
            result = Area(read, build)
            job_card(window, "study", result.refresh)
    await result.refresh()


def _write_study(path: Path, chosen: Mapping[str, Any], root: Path) -> None:
    """Write a study file."""

    def place(source: str) -> str:
        return quoted((root / source).as_posix())

    lines = ["schema = 1", f"name = {quoted(chosen['name'])}", 'families = ["ride"]', 'settling = "1 s"']
    lines += [f"baseline = {quoted(Path(chosen['baseline']).stem)}"]
    lines += ['alike = [["lf", "rf"], ["lr", "rr"]]'] if chosen["alike"] else []
    lines += ["", "[vehicle]", f"fmu = {place(chosen['car'])}", "", "[bank]"]
    lines += [f"{quoted(Path(source).stem)} = {place(source)}" for source in chosen["bank"]]
    lines += ["", "[[drive]]", f"file = {place(chosen['drive'])}", f"stop = {float(chosen['stop'])}", ""]
    lines += ["[[objective]]", f"measure = {quoted(chosen['objective'])}", "weight = 1.0"]
    lines += [f"unit = {quoted(OBJECTIVES[chosen['objective']])}", ""]
    write_text(path, "\n".join(lines))
