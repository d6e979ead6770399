"""The screen Car: drop rig records, name their channels, identify the car, validate it on other records."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from nicegui import ui

from eightpost.errors import EightpostError
from eightpost.signals.raw_record import MAP_BESIDE
from eightpost.window.channels import RIG, Columns, columns_of, name_channels
from eightpost.window.parts import (
    Area,
    Window,
    chosen_with,
    drop_area,
    job_card,
    show_error,
    show_files,
    show_table,
    show_verdict,
)

if TYPE_CHECKING:
    from eightpost.ident.vehicle.vehicle_fit import VehicleFit


async def show(window: Window) -> None:
    """Build the screen."""
    screen = _Screen(window)
    await screen.records.refresh()
    await screen.result.refresh()


class _Screen:
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
                self.records = Area(lambda: _records(window), self.build_records)
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
                name_channels(self.window, columns, RIG, files[0].with_name(MAP_BESIDE), self.records.refresh)

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


def _records(window: Window) -> tuple[list[Path], EightpostError | None, Columns | None]:
    """Return the rig records; if the first cannot be read, also why and its columns."""
    import eightpost as ep

    files = window.folder.records("rig")
    try:
        if files:
            ep.read(files[0], "rig")
    except EightpostError as error:
        try:
            return files, error, columns_of(files[0])
        except EightpostError:
            return files, error, None
    return files, None, None


def _fit(path: Path) -> VehicleFit | EightpostError | None:
    """Return the identified car; an error if its file is something else, None without a file."""
    from eightpost.ident.vehicle.vehicle_fit import read_fit

    try:
        return read_fit(path) if path.is_file() else None
    except EightpostError as error:
        return error
