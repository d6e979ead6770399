"""The screen Dyno: drop records, see the loop, fit a law, save its FMU."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING, Any

from nicegui import ui

from eightpost.errors import EightpostError, WrongSignError
from eightpost.report.charts import COLORS, Axis, Figure, grid_figure
from eightpost.window.channels import DYNO, Columns, columns_of, name_channels
from eightpost.window.parts import (
    Area,
    Window,
    chosen_with,
    drop_area,
    job_card,
    show_error,
    show_figure,
    show_files,
    show_verdict,
)

if TYPE_CHECKING:
    from eightpost.shock import Shock

#: Number of samples of a loop that are drawn.
_DRAWN = 4000

LAWS = {"hysteresis": "Hysteresis (default)", "lpnl2": "LPNL2", "lpf1": "LPF1", "polylinear": "Polylinear"}
GAS = {
    "estimate": "is in the record, and belongs to the shock",
    "included": "is in the record, and the car's static load already has it",
    "subtracted": "was subtracted by the dynamometer",
}


@dataclass(frozen=True)
class _Read:
    """A record: the test, or why it cannot be read and its columns."""

    path: Path  #: Its file.
    test: Any = None  #: Test, if it can be read.
    error: EightpostError | None = None  #: Why it cannot be read.
    columns: Columns | None = None  #: Columns of a record that cannot be read, if its table can.


async def show(window: Window) -> None:
    """Build the screen."""
    await _Screen(window).area.refresh()


class _Screen:
    """The screen of one browser; `chosen` is shared by all."""

    def __init__(self, window: Window) -> None:
        self.window = window
        self.chosen = window.chosen.setdefault(
            "dyno", {"records": [], "law": "hysteresis", "gas": "estimate", "shock": None}
        )
        with ui.row().classes("w-full no-wrap screen"):
            with ui.column().classes("side"):
                drop_area(window, "dyno", "Drop dynamometer files here", self.dropped)
                self.records()
                ui.select(LAWS, label="Law").bind_value(self.chosen, "law").classes("w-full")
                ui.select(GAS, label="The gas force").bind_value(self.chosen, "gas").classes("w-full")
                ui.button("Fit", on_click=self.fit).props("no-caps").classes("w-full")
            with ui.column().classes("main"):
                job_card(window, "fit", self.fitted)
                self.area = Area(self.read, self.build)
                job_card(window, "build", self.area.refresh)

    @ui.refreshable_method
    def records(self) -> None:
        """List the records of the folder."""
        for path in self.window.folder.records("dyno"):
            box = ui.checkbox(path.name, value=path.name in self.chosen["records"])
            box.on_value_change(lambda event, name=path.name: self.choose(name, event.value))

    def paths(self) -> list[Path]:
        """Return the chosen records in the order of the choice."""
        listed = {path.name: path for path in self.window.folder.records("dyno")}
        return [listed[name] for name in self.chosen["records"] if name in listed]

    def read(self) -> tuple[list[_Read], Shock | None]:
        """Read the chosen records and the fitted shock."""
        return [_record(self.window, path) for path in self.paths()], _shock(self.window, self.chosen)

    def build(self, content: tuple[list[_Read], Shock | None]) -> None:
        """Show the loops and the shock with its verdict."""
        records, shock = content
        for record in records:
            if record.error is not None:
                show_error(record.error)
                _offer(self.window, record, self.area.refresh)
        if tests := [(record.path, record.test) for record in records if record.test is not None]:
            show_figure(_loops(tests, shock))
        elif not records:
            ui.label("Drop the file of a dynamometer test, or choose one, to see its force.").classes("text-base")
        if shock is not None and shock.validity is not None:
            path = self.window.folder.path / self.chosen["shock"]
            fmu = self.window.folder.path / "fmus" / f"{path.stem}.fmu"
            show_verdict(shock.validity.verdict)
            with ui.row().classes("items-center"):
                ui.button("Save FMU", on_click=lambda: self.save(path, fmu)).props("no-caps")
                show_files(self.window, [("shock file", path), ("FMU", fmu)])

    async def dropped(self, path: Path) -> None:
        """Choose a dropped record."""
        self.chosen["records"] = [*self.chosen["records"], path.name]
        self.records.refresh()
        await self.area.refresh()

    async def choose(self, name: str, on: bool) -> None:
        """Choose a record, or leave it out."""
        self.chosen["records"] = chosen_with(self.chosen["records"], name, on)
        await self.area.refresh()

    def fit(self) -> None:
        """Fit a law to the chosen records."""
        if not (paths := self.paths()):
            ui.notify("choose a record first")
            return
        name = self.window.folder.name
        try:
            reading = self.window.folder.words(paths)
        except EightpostError as error:
            ui.notify(str(error), type="negative")
            return
        product = self.window.folder.path / "shocks" / f"{paths[0].stem}.json"
        words = ["fit", *map(name, paths), "--law", self.chosen["law"], "--gas", self.chosen["gas"], *reading]
        title = f"Fit of {', '.join(path.name for path in paths)}"
        self.window.start("fit", title, [[*words, "-o", name(product)]], product)

    async def fitted(self) -> None:
        """Show the fitted shock."""
        job = self.window.jobs["fit"]
        if job.state in ("done", "not acceptable") and job.product.is_file():
            self.chosen["shock"] = self.window.folder.name(job.product)
        await self.area.refresh()

    def save(self, shock: Path, fmu: Path) -> None:
        """Build the FMU of a shock."""
        self.window.start(
            "build", f"FMU of {shock.stem}", [["build", self.window.folder.name(shock), "-o", "fmus"]], fmu
        )


def _offer(window: Window, record: _Read, done: Callable[[], Awaitable[None]]) -> None:
    """Offer what may make a record readable: another sign, or names of its columns."""

    async def flip(channel: str) -> None:
        before = window.folder.readings.get(window.folder.name(record.path), {}).get("flip", [])
        window.folder.read_as(record.path, flip=sorted({*before} ^ {channel}))
        await done()

    if isinstance(record.error, WrongSignError):
        with ui.row():
            for channel in ("force", "displacement"):
                ui.button(f"Reverse the {channel}", on_click=lambda name=channel: flip(name)).props("no-caps outline")
    elif record.columns is not None:
        path = record.path.with_name(f"{record.path.stem}.map.toml")
        name_channels(window, record.columns, DYNO, path, done)


# ---- Reading, once for each content of a file ------------------------------------------------------------------------


def _record(window: Window, path: Path) -> _Read:
    reading = window.folder.reading(path)
    files = [path, *filter(None, [reading.get("channel_map")])]
    stamp = tuple((file.stat().st_mtime_ns, file.stat().st_size) for file in files)
    try:
        return _Read(path, _read(path, stamp, tuple(sorted(reading.items()))))
    except EightpostError as error:
        try:
            columns = columns_of(path)
        except EightpostError:
            return _Read(path, error=error)
        return _Read(path, error=error, columns=columns)


@lru_cache(maxsize=32)
def _read(path: Path, _stamp: object, reading: tuple[tuple[str, Any], ...]) -> Any:
    import eightpost as ep

    return ep.read(path, "dyno", **dict(reading))


def _shock(window: Window, chosen: Mapping[str, Any]) -> Shock | None:
    import eightpost as ep

    path = window.folder.path / (chosen["shock"] or "")
    return ep.read(path, "shock") if path.is_file() else None


def _loops(tests: list[tuple[Path, Any]], shock: Shock | None) -> Figure:
    """Return force over velocity and over displacement, with the force of a fitted shock in the same motion."""
    force = Axis("force", "N")
    panels = [(Axis("velocity, positive in compression", "m/s"), force, ""), (Axis("displacement", "m"), force, "")]
    figure = grid_figure("force over velocity and over displacement", 430, panels, 2, gap=(0.09, 0.0))
    colors = cycle([COLORS[0], *COLORS[2:]])
    lines = [(test.series, test.series["force"], path.name, next(colors)) for path, test in tests]
    if shock is not None:
        import eightpost as ep

        for number, (_, test) in enumerate(tests):
            name = f"{shock.name}, fitted" if number == 0 else ""
            lines.append((test.series, ep.simulate(shock, test)["force"], name, COLORS[1]))
    for series, forces, label, color in lines:
        part = slice(None, None, max(1, len(series) // _DRAWN))
        for panel, name in enumerate(("velocity", "displacement")):
            if name in series.names:
                figure.line(panel, series[name][part], forces[part], name=label, color=color)
    return figure
