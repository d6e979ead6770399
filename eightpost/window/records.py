"""The screens Dyno and Car: drop records, name their channels, fit a law or identify the car, validate it."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING, Any

from nicegui import ui

from eightpost.corners import CORNERS
from eightpost.errors import EightpostError, WrongSignError
from eightpost.files import write_text
from eightpost.report.charts import COLORS, Axis, Figure, grid_figure
from eightpost.signals.raw_record import MAP_BESIDE
from eightpost.window.parts import (
    Area,
    Window,
    chosen_with,
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
    from eightpost.ident.vehicle.vehicle_fit import VehicleFit
    from eightpost.shock import Shock
    from eightpost.signals.raw_record import RawRecord


# ==== Naming of a record's columns by choosing from lists: a channel map, which the terminal reads too ===============


#: Quantities of a corner, with what people call them.
_CORNER = {
    "road": "wheelloader position", "tire_force": "wheelloader load", "force": "shock force",
    "displacement": "shock displacement", "velocity": "shock velocity", "aero": "aeroloader load",
    "hub_acceleration": "hub acceleration", "chassis_acceleration": "chassis acceleration",
}  # fmt: skip

#: Channels of a rig record in the order of the lists, and of a dynamometer record.
RIG = (*(f"{corner}.{name}" for name in _CORNER for corner in CORNERS), "front.ride_height", "rear.ride_height")
DYNO = ("force", "displacement", "velocity")


Columns = tuple["RawRecord", Mapping[str, str]]


def columns_of(record: Path) -> Columns | None:
    """Return a record as it is in its file, and the column of each rig channel that only one could be.

    It is None if the file cannot be read.
    """
    from eightpost.rig.columns import propose_map
    from eightpost.signals import read_records

    try:
        raw = read_records(record)[0]
        proposal = propose_map(raw)
    except EightpostError:
        return None
    return raw, {name: found[0] for name, found in proposal.columns.items() if len(found) == 1} if proposal else {}


def _name_channels(
    window: Window, columns: Columns, channels: Sequence[str], path: Path, done: Callable[[], Awaitable[None]]
) -> None:
    """Show a list for each channel, from which its column is chosen, and its sign."""
    raw, guess = columns
    record = Path(raw.origin.path or "")
    labels = {name: f"{name} [{unit}]" if unit else name for name, unit in zip(raw.names, raw.units, strict=True)}
    lists, signs = {}, {}
    with ui.card().classes("w-full channels"):
        ui.label(f"Which column of {record.name} is which channel?").classes("text-base")
        with ui.grid(columns=max(1, min(4, len(channels)))).classes("w-full"):
            for channel in channels:
                with ui.row().classes("items-center no-wrap"):
                    choice = ui.select({"": "-", **labels}, label=_title(channel), value=guess.get(channel, ""))
                    lists[channel] = choice.classes("channel").props(f'dense options-dense data-channel="{channel}"')
                    signs[channel] = ui.checkbox("-").tooltip("reverse the sign: compression, up and load are positive")
                    signs[channel].props(f'dense aria-label="reverse {channel}"')

        async def keep() -> None:
            columns = {name: choice.value for name, choice in lists.items() if choice.value}
            write_map(path, columns, {name for name, sign in signs.items() if sign.value})
            window.folder.read_as(record, map=window.folder.name(path))
            await done()

        ui.button("Use these channels", on_click=keep).props("no-caps")


def write_map(path: Path, columns: Mapping[str, str], reversed_channels: set[str]) -> None:
    """Write a channel map."""
    lines = []
    for channel, column in columns.items():
        lines += [f"[channels.{quoted(channel)}]", f"source = {quoted(column)}"]
        lines += ["gain = -1.0", ""] if channel in reversed_channels else [""]
    write_text(path, "\n".join(lines))


def _title(channel: str) -> str:
    place, _, quantity = channel.rpartition(".")
    return f"{place} {_CORNER.get(quantity, quantity.replace('_', ' '))}".strip()


# ==== The screen Dyno: drop records, see the loop, fit a law, save its FMU ===========================================


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


async def show_dyno(window: Window) -> None:
    """Build the screen."""
    await _DynoScreen(window).area.refresh()


class _DynoScreen:
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
        _name_channels(window, record.columns, DYNO, path, done)


# ---- Reading, once for each content of a file ------------------------------------------------------------------------


def _record(window: Window, path: Path) -> _Read:
    reading = window.folder.reading(path)
    files = [path, *filter(None, [reading.get("channel_map")])]
    stamp = tuple((file.stat().st_mtime_ns, file.stat().st_size) for file in files)
    try:
        return _Read(path, _read(path, stamp, tuple(sorted(reading.items()))))
    except EightpostError as error:
        return _Read(path, error=error, columns=columns_of(path))


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


# ==== The screen Car: drop rig records, identify the car, validate it on other records ===============================


async def show_car(window: Window) -> None:
    """Build the screen."""
    screen = _CarScreen(window)
    await screen.records.refresh()
    await screen.result.refresh()


class _CarScreen:
    """The screen of one browser; `chosen` is shared by all."""

    def __init__(self, window: Window) -> None:
        self.window = window
        self.chosen = window.chosen.setdefault("car", {"records": [], "held": [], "file": "car.json"})
        self.car = window.folder.path / self.chosen["file"]
        self.page = self.car.with_name(f"{self.car.stem}_validation.html")
        with ui.row().classes("w-full no-wrap screen"):
            with ui.column().classes("side"):
                drop_area(window, "rig", "Drop rig tests here", self.dropped)
                ui.button("Identify", on_click=self.identify).props("no-caps").classes("w-full")
                ui.button("Validate", on_click=self.validate).props("no-caps outline").classes("w-full")
            with ui.column().classes("main"):
                self.records = Area(lambda: _car_records(window), self.build_records)
                self.result = Area(lambda: _fit(self.car), self.build_result)
                job_card(window, "identify", self.result.refresh)
                job_card(window, "validate", self.result.refresh)

    def build_records(self, content: tuple[list[Path], EightpostError | None, Columns | None]) -> None:
        """List the records with their uses; ask for the channels of records that have other names."""
        files, error, columns = content
        if not files:
            ui.label("One test with baseline shocks, and one with another shock at each corner.").classes("text-base")
            return
        with ui.grid(columns="auto auto auto").classes("items-center gap-0"):
            for text in ("test", "identify", "validate"):
                ui.label(text).classes("text-xs q-pr-sm")
            for path in files:
                ui.label(path.name).classes("text-sm q-pr-sm")
                for use in ("records", "held"):
                    box = ui.checkbox(value=path.name in self.chosen[use]).props(
                        f'dense aria-label="{use} {path.name}"'
                    )
                    box.on_value_change(lambda event, use=use, name=path.name: self.choose(use, name, event.value))
        if error is not None:
            show_error(error)
            if columns is not None:
                _name_channels(self.window, columns, RIG, files[0].with_name(MAP_BESIDE), self.records.refresh)

    def build_result(self, fit: VehicleFit | EightpostError | None) -> None:
        """Show the identified car: verdict, errors of its outputs, files and plots."""
        if isinstance(fit, EightpostError):
            show_error(fit)
        elif fit is not None:
            show_verdict(fit.verdict)
            show_files(self.window, [("car file", self.car), ("validation", self.page)])
            largest = sorted(fit.residual.items(), key=lambda row: -row[1])
            rows = [(name, f"{100.0 * error:.2g}") for name, error in largest]
            show_table(["output", "error [% of its standard deviation]"], rows)
            with ui.row():
                for picture in sorted(self.car.with_name(f"{self.car.stem}_plots").glob("*.png"))[:6]:
                    image = ui.image(f"/file/{self.window.folder.name(picture)}").style("width: 28rem")
                    image.props(f'alt="{picture.stem}"')

    async def dropped(self, path: Path) -> None:
        """Choose a dropped record for the identification."""
        self.chosen["records"] = [*self.chosen["records"], path.name]
        await self.records.refresh()

    def choose(self, use: str, name: str, on: bool) -> None:
        """Choose a record for a use, or leave it out."""
        self.chosen[use] = chosen_with(self.chosen[use], name, on)

    def names(self, use: str) -> list[str]:
        """Return the records that are chosen for a use."""
        folder = self.window.folder
        return [folder.name(path) for path in folder.records("rig") if path.name in self.chosen[use]]

    def identify(self) -> None:
        """Identify the car."""
        words = ["identify", *self.names("records"), "-o", self.chosen["file"], "--plot", "main"]
        self.window.start("identify", "Identification", [words], self.car)

    def validate(self) -> None:
        """Validate the car on the records that are held out, and keep the verdict in its file."""
        words = ["validate", self.chosen["file"], *self.names("held"), "-o", self.page.name, "--keep"]
        self.window.start("validate", "Validation", [words], self.page)


def _car_records(window: Window) -> tuple[list[Path], EightpostError | None, Columns | None]:
    """Return the rig records; if the first cannot be read, also why and its columns."""
    import eightpost as ep

    files = window.folder.records("rig")
    try:
        if files:
            ep.read(files[0], "rig")
    except EightpostError as error:
        return files, error, columns_of(files[0])
    return files, None, None


def _fit(path: Path) -> VehicleFit | EightpostError | None:
    """Return the identified car; an error if its file is something else, None without a file."""
    from eightpost.ident.vehicle.vehicle_fit import read_fit

    try:
        return read_fit(path) if path.is_file() else None
    except EightpostError as error:
        return error
