"""The screens Run and Study: couple a car with shocks and look at traces; run every setup and see what to bolt on."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from nicegui import ui

from eightpost.corners import CORNERS
from eightpost.errors import EightpostError
from eightpost.files import write_text
from eightpost.report.charts import COLORS, Axis, Figure, grid_figure
from eightpost.report.tables import Display, figure
from eightpost.window.parts import (
    Area,
    Window,
    drop_area,
    job_card,
    quoted,
    show_error,
    show_figure,
    show_files,
    show_table,
    show_verdict,
)

if TYPE_CHECKING:
    from cosim.session.result import SavedRun


# ==== The screen Run: couple a car with shocks, swap a corner, look at traces with two cursors =======================


#: Number of samples of a trace that are drawn.
_DRAWN = 3000

#: Channels of the car that are recorded at each corner, those of the whole car, and those of each shock.
_CAR, _WHOLE, _SHOCK = ("velocity", "tire_force"), ("front.ride_height", "rear.ride_height"), ("force",)


async def show_system(window: Window) -> None:
    """Build the screen."""
    await _Screen(window).traces.refresh()


class _Screen:
    """The screen of one browser; `chosen` is shared by all."""

    def __init__(self, window: Window) -> None:
        self.window, folder = window, window.folder
        self.chosen = window.chosen.setdefault("run", {"name": "run", "runs": [], "channels": [], "stop": 10.0})
        with ui.row().classes("w-full no-wrap screen"):
            with ui.column().classes("side"):
                drop_area(window, "tracks", "Drop a drive file here", self.dropped)
                self.drives()
                _choice(
                    self.chosen, "car", {folder.name(path): path.name for path in folder.documents("vehicle")}, "Car"
                )
                shocks = {folder.name(path): path.stem for path in folder.documents("shock")}
                for corner in CORNERS:
                    _choice(self.chosen, corner, shocks, f"Shock {corner}")
                ui.input("Name of the run").bind_value(self.chosen, "name").classes("w-full")
                ui.number("Length [s]", min=0.1).bind_value(self.chosen, "stop").classes("w-full")
                ui.button("Run", on_click=self.couple).props("no-caps").classes("w-full")
            with ui.column().classes("main"):
                job_card(window, "run", self.ended)
                self.traces = Area(lambda: _runs(window, self.chosen), self.build)

    @ui.refreshable_method
    def drives(self) -> None:
        """List the drive files."""
        _choice(self.chosen, "drive", self.window.folder.drives(), "Drive file")

    async def dropped(self, path: Path) -> None:
        """Choose a dropped drive file."""
        self.chosen["drive"] = self.window.folder.name(path)
        self.drives.refresh()

    def couple(self) -> None:
        """Build the FMUs and run the system."""
        if missing := [name for name in ("car", "drive", *CORNERS) if not self.chosen.get(name)]:
            ui.notify(f"choose {', '.join(missing)} first")
            return
        folder = self.window.folder.path / "runs" / str(self.chosen["name"])
        sources = list(dict.fromkeys([self.chosen["car"], *(self.chosen[corner] for corner in CORNERS)]))
        _write_system(folder / "system.toml", self.chosen, self.window.folder.path)
        product = self.window.folder.name(folder)
        commands = [["build", *sources, "-o", "fmus"], ["run", f"{product}/system.toml", "-o", product, "--report"]]
        self.window.start("run", f"Run {self.chosen['name']}", commands, folder)

    async def ended(self) -> None:
        """Show the run that has ended."""
        job = self.window.jobs["run"]
        if job.state in ("done", "not acceptable") and job.product.name not in self.chosen["runs"]:
            self.chosen["runs"] = [*self.chosen["runs"], job.product.name]
        await self.traces.refresh()

    def build(self, content: tuple[list[str], dict[str, SavedRun], EightpostError | None]) -> None:
        """Show the traces of the chosen runs."""
        names, runs, error = content
        if error is not None:
            show_error(error)
        if not runs:
            ui.label("Choose a car, a shock for each corner and a drive file, and run them.").classes("text-base")
            return
        first = next(iter(runs.values()))
        channels = list(first.series.names)
        self.chosen["channels"] = [name for name in self.chosen["channels"] if name in channels] or channels[:1]
        with ui.row().classes("w-full no-wrap"):
            for key, options in (("runs", names), ("channels", channels)):
                box = ui.select(options, label=key.capitalize(), value=self.chosen[key], multiple=True).classes("w-1/2")
                box.props("use-chips dense").on("popup-hide", self.traces.refresh)
                box.on_value_change(lambda event, key=key: self.chosen.update({key: event.value}))
        for name, saved in runs.items():
            ui.label(name).classes("text-base")
            show_verdict(saved.verdict)
        show_figure(_traces(runs, self.chosen["channels"]))
        _cursors(runs, self.chosen["channels"])
        pages = self.window.folder.path / "runs"
        show_files(self.window, [(f"page of {name}", pages / name / "report.html") for name in runs])


def _choice(chosen: dict[str, Any], key: str, options: Mapping[str, str], label: str) -> None:
    """Show a list whose choice is kept; what is not in the list any more is not chosen."""
    if chosen.get(key) not in options:
        chosen[key] = next(iter(options), None)
    ui.select(dict(options), label=label).bind_value(chosen, key).classes("w-full").props("dense")


def _write_system(path: Path, chosen: Mapping[str, Any], root: Path) -> None:
    """Write the system file of a car with a shock at each corner."""

    def fmu(source: str) -> str:
        return quoted((root / "fmus" / f"{Path(source).stem}.fmu").as_posix())

    lines = ["schema = 1", f"name = {quoted(chosen['name'])}", ""]
    lines += ["[components.car]", f"fmu = {fmu(chosen['car'])}", ""]
    for corner in CORNERS:
        lines += [f"[components.{corner}]", f"fmu = {fmu(chosen[corner])}", ""]
        lines += ["[[bond]]", f'between = ["car.{corner}", "{corner}"]', ""]
    recorded = [f"car.{corner}.{name}" for name in _CAR for corner in CORNERS] + [f"car.{name}" for name in _WHOLE]
    recorded += [f"{corner}.{name}" for name in _SHOCK for corner in CORNERS]
    drive = root / chosen["drive"]
    lines += ["[scenario]", f"drivefile = {quoted(drive.as_posix())}", f"stop = {float(chosen['stop'])}"]
    lines += _driving(drive) if drive.parent.name == "rig" else []
    lines += ['record_step = "2 ms"', f"record = {json.dumps(recorded)}", ""]
    write_text(path, "\n".join(lines))


def _driving(record: Path) -> list[str]:
    """Return the lines with which a rig record drives the car: by its roads and loads, not by what was measured."""
    from eightpost.signals import ChannelMap, read_records
    from eightpost.signals.raw_record import MAP_BESIDE

    beside = record.with_name(MAP_BESIDE)
    names = ChannelMap.read(beside).channels if beside.is_file() else read_records(record)[0].names
    targets = [f'"{name}" = "car.{name}"' for name in names if name.rpartition(".")[2] in ("road", "aero")]
    mapped = [f"channel_map = {json.dumps(beside.as_posix())}"] if beside.is_file() else []
    return [*mapped, f"targets = {{ {', '.join(targets)} }}"]


def _runs(window: Window, chosen: dict[str, Any]) -> tuple[list[str], dict[str, SavedRun], EightpostError | None]:
    """Return the names of all runs, the chosen ones, by default the last, and why one cannot be read."""
    folders = {path.parent.name: path.parent for path in sorted(window.folder.path.glob("runs/*/result.json"))}
    chosen["runs"] = [name for name in chosen["runs"] if name in folders] or list(folders)[-1:]
    try:
        runs = {name: _saved(folders[name], folders[name].stat().st_mtime_ns) for name in chosen["runs"]}
    except EightpostError as error:
        return list(folders), {}, error
    return list(folders), runs, None


@lru_cache(maxsize=8)
def _saved(folder: Path, _stamp: int) -> SavedRun:
    from cosim.session.result import SavedRun

    return SavedRun.load(folder)


def _traces(runs: Mapping[str, SavedRun], channels: Sequence[str]) -> Figure:
    """Return a panel for each channel with a line for each run."""
    units = next(iter(runs.values())).series
    panels = [(Axis("time", "s"), Axis(name, units.unit(name)), "") for name in channels]
    drawn = grid_figure("traces of the chosen runs", 120 + 190 * len(panels), panels, 1, gap=(0.0, 0.09))
    for (label, saved), color in zip(runs.items(), COLORS, strict=False):
        part = slice(None, None, max(1, len(saved.series) // _DRAWN))
        for panel, name in enumerate(channels):
            if name in saved.series.names:
                drawn.line(panel, saved.series.time[part], saved.series[name][part], name=label, color=color)
    return drawn


def _cursors(runs: Mapping[str, SavedRun], channels: Sequence[str]) -> None:
    """Show two cursors over the time, and the values at them."""
    time = next(iter(runs.values())).series.time
    low, high = float(time[0]), float(time[-1])
    cursors: list[ui.slider] = []

    def read() -> None:
        first, last = (float(cursor.value or 0.0) for cursor in cursors)
        rows.clear()
        with rows:
            columns = ["run", "channel", f"at {first:.3f} s", f"at {last:.3f} s", "difference"]
            show_table(columns, list(_values(runs, channels, first, last)))

    with ui.row().classes("w-full"):
        for name, part in (("first cursor", 1.0 / 3.0), ("second cursor", 2.0 / 3.0)):
            start, step = low + part * (high - low), (high - low) / 1000.0
            cursor = ui.slider(min=low, max=high, step=step, value=start).props(f'label aria-label="{name}"')
            cursors.append(cursor.classes("grow").on_value_change(read))
    rows = ui.column().classes("w-full")
    read()


def _values(runs: Mapping[str, SavedRun], channels: Sequence[str], *times: float) -> Any:
    for label, saved in runs.items():
        for name in channels:
            if name in saved.series.names:
                display = Display.of(saved.series.unit(name))
                first, last = (display(float(np.interp(t, saved.series.time, saved.series[name]))) for t in times)
                yield label, f"{name} [{display.unit}]", figure(first), figure(last), figure(last - first)


# ==== The screen Study: choose shocks, corners and an objective, run every setup =====================================


#: What can be minimised, with the unit of the objective.
OBJECTIVES = {
    "total tire force, RMS": "N", "front ride height, RMS": "m", "rear ride height, RMS": "m",
    "lf tire force, RMS": "N", "rf tire force, RMS": "N", "lr tire force, RMS": "N", "rr tire force, RMS": "N",
}  # fmt: skip


async def show_study(window: Window) -> None:
    """Build the screen."""
    chosen = window.chosen.setdefault("study", {"name": "study", "bank": [], "alike": True, "stop": 10.0})
    cars = {window.folder.name(path): path.name for path in window.folder.documents("vehicle")}
    shocks = {window.folder.name(path): path.stem for path in window.folder.documents("shock")}
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
            said = "Fit two or more shocks, drop a drive file on the screen Run, and run the study."
            ui.label(said).classes("text-base")
            return
        show_files(window, [(f"page of {path.parent.name}", path) for path in reversed(pages)])
        address = f"/file/{window.folder.name(pages[-1])}?{pages[-1].stat().st_mtime_ns}"
        frame = f'<iframe src="{address}" title="page of the study" style="width:100%;height:80vh;border:0"></iframe>'
        ui.html(frame, sanitize=False).classes("w-full")

    with ui.row().classes("w-full no-wrap screen"):
        with ui.column().classes("side"):
            _choice(chosen, "car", cars, "Car")
            _choice(chosen, "drive", window.folder.drives(), "Drive file")
            bank = ui.select(shocks, label="Shocks to choose from", multiple=True).bind_value(chosen, "bank")
            bank.classes("w-full").props("use-chips dense")
            _choice(chosen, "baseline", shocks, "On the car today")
            ui.checkbox("left and right alike").bind_value(chosen, "alike")
            _choice(chosen, "objective", {name: name for name in OBJECTIVES}, "Make small")
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
