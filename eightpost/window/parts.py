"""The folder that the window works in, and parts of every screen: drop areas, verdicts, figures, commands."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import tempfile
import time
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Generic, TypeVar

from nicegui import events, run, ui

from eightpost.errors import InputError
from eightpost.files import document_kind, json_content, write_text
from eightpost.report.charts import Figure
from eightpost.report.tables import Display
from eightpost.schema import checked
from eightpost.signals.formats import SUFFIXES
from eightpost.verdict import Grade, Verdict
from eightpost.workers.process import kill, own_group, python_command

# ==== The folder =====================================================================================================


#: Folders of the files that people drop, by their kind.
DROPPED = ("dyno", "rig", "tracks")

#: Characters of a file's name that are kept; the others become an underscore.
_NAME = re.compile(r"[^\w.+ -]+")


@dataclass(frozen=True)
class _Reading:
    """How a record is read."""

    flip: tuple[str, ...] = ()
    map: str = ""


@dataclass(frozen=True)
class _State:
    """Entries of window.json."""

    readings: dict[str, _Reading] = field(default_factory=dict)


@dataclass
class Folder:
    """A folder of work, which may already contain files; nothing in it is hidden from the terminal."""

    path: Path  #: The folder.
    #: Reading of each record by its path in the folder: `flip`, the channels whose sign is changed, and `map`, the
    #: channel map in the folder.
    readings: dict[str, dict[str, Any]] = field(default_factory=dict)

    @classmethod
    def opened(cls, path: Path) -> Folder:
        """Open a folder, which is made if it does not exist.

        Raises:
            InputError: It is a file, or its `window.json` is damaged.
        """
        if path.exists() and not path.is_dir():
            raise InputError(f"{path} is a file; name a folder for your files")
        for name in ("", *DROPPED):
            (path / name).mkdir(parents=True, exist_ok=True)
        state = path / "window.json"
        content = json_content(state, advice="delete it") if state.is_file() else {}
        checked(_State, content, path=state)
        return cls(path.resolve(), content.get("readings", {}))

    def place(self, kind: str, name: str) -> Path:
        """Return the path for a dropped file; an existing one with another content keeps its place."""
        clean = _NAME.sub("_", Path(name.replace("\\", "/")).name).strip(". ") or "file"
        path = self.path / kind / clean
        number = 2
        while path.exists():
            path = path.with_name(f"{Path(clean).stem} {number}{Path(clean).suffix}")
            number += 1
        return path

    def records(self, kind: str) -> list[Path]:
        """Return the records of a kind, by name."""
        files = (self.path / kind).iterdir()
        return sorted(file for file in files if file.suffix.lower() in SUFFIXES and file.is_file())

    def documents(self, kind: str) -> list[Path]:
        """Return the shock or vehicle files (`shock`, `vehicle`) of the folder and its folders, by name."""
        files = sorted([*self.path.glob("*.json"), *self.path.glob("shocks/*.json")])
        found = [file for file in files if _kind(file) == kind]
        cars = sorted(self.path.glob("*.toml")) if kind == "vehicle" else []
        return found + [file for file in cars if _table(file) == "vehicle"]

    def drives(self) -> dict[str, str]:
        """Return what can drive a car by path in the folder: drive files, and rig records with roads and loads."""
        return {self.name(path): path.name for kind in ("tracks", "rig") for path in self.records(kind)}

    def reading(self, record: Path) -> dict[str, Any]:
        """Return how a record is read: arguments of `ep.read`."""
        stated = self.readings.get(self.name(record), {})
        given = {"channel_map": self.path / stated["map"]} if stated.get("map") else {}
        return given | ({"flip": tuple(stated["flip"])} if stated.get("flip") else {})

    def read_as(self, record: Path, **changes: Any) -> None:
        """Change how a record is read, and keep it in the folder's `window.json`."""
        name = self.name(record)
        self.readings[name] = {**self.readings.get(name, {}), **changes}
        write_text(self.path / "window.json", json.dumps({"readings": self.readings}, indent=1))

    def words(self, records: list[Path]) -> list[str]:
        """Return the options with which a command reads records.

        Raises:
            InputError: They are read in different ways.
        """
        ways = {json.dumps(self.readings.get(self.name(record), {}), sort_keys=True) for record in records}
        if len(ways) > 1:
            raise InputError("these files have different channel names or signs; take them one after the other")
        given: dict[str, Any] = json.loads(ways.pop()) if ways else {}
        stated = [*(f"{channel}=-" for channel in given.get("flip", ())), given.get("map")]
        return [word for text in stated if text for word in ("--channel", text)]

    def name(self, path: Path) -> str:
        """Return a file's path in the folder, with slashes."""
        return path.resolve().relative_to(self.path).as_posix()

    def served(self, name: str) -> Path | None:
        """Return the file with a path in the folder; None if it does not exist, or is outside."""
        path = (self.path / name).resolve()
        return path if path.is_relative_to(self.path) and path.is_file() else None


def quoted(text: object) -> str:
    """Return a text in the form of a TOML file, with its quotes."""
    return json.dumps(str(text), ensure_ascii=False)


def _table(file: Path) -> str:
    from eightpost.api.reading import toml_kind

    try:
        return toml_kind(file)
    except (InputError, OSError):
        return ""


def _kind(file: Path) -> str:
    try:
        return document_kind(file) or ""
    except (InputError, OSError):
        return ""


# ==== Commands =======================================================================================================

#: Time for a command to end by itself after it was cancelled [s].
PATIENCE = 20.0

#: A line of progress: "setups: 120 of 2401, 5%, about 0:01:10 left".
_PROGRESS = re.compile(r"^[^:\n]+: (?:[\d.e+]+ of [\d.e+]+, )?(?P<percent>\d+)%.*$", re.MULTILINE)


@dataclass
class Job:
    """Commands that run one after the other, until one does not end with 0. They end when this program ends."""

    title: str  #: What it does, for people.
    commands: Sequence[Sequence[str]]  #: Words of each command after `eightpost`.
    folder: Path  #: Working folder.
    product: Path  #: File or folder that it writes.
    _cancelled: float | None = None

    def __post_init__(self) -> None:
        handle, name = tempfile.mkstemp(prefix="eightpost_", suffix=".log")
        os.close(handle)
        self._log, self._left = Path(name), list(self.commands)
        self._process = self._start(self._left.pop(0))

    def _start(self, words: Sequence[str]) -> subprocess.Popen[bytes]:
        with self._log.open("ab") as log:
            return subprocess.Popen(
                python_command("eightpost", *words),
                cwd=self.folder,
                env={**os.environ, "EIGHTPOST_PROGRESS": "0.5", "NO_COLOR": "1", "COLUMNS": "100"},
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                **own_group(),
            )

    @property
    def code(self) -> int | None:
        """Exit code of the last command; None while one runs."""
        return self.advance()

    def advance(self) -> int | None:
        """Start the next command if one has ended, or kill one that does not stop; return the exit code of the last."""
        code = self._process.poll()
        if code == 0 and self._left and self._cancelled is None:
            self._process = self._start(self._left.pop(0))
            return None
        if code is None and self._cancelled is not None and time.monotonic() - self._cancelled > PATIENCE:
            kill(self._process, tree=True)
            code = self._process.poll()
        return code

    @property
    def state(self) -> str:
        """`running`, `stopping`, `cancelled`, `done`, `not acceptable` (exit code 1) or `failed`."""
        code = self.code
        if code is None:
            return "running" if self._cancelled is None else "stopping"
        if self._cancelled is not None:
            return "cancelled"
        return {0: "done", 1: "not acceptable"}.get(code, "failed")

    def cancel(self) -> None:
        """Ask the command to stop, as Ctrl-C does; it is killed if it takes longer than `PATIENCE`."""
        if self.code is None and self._cancelled is None:
            self._cancelled = time.monotonic()
            if os.name == "nt":
                kill(self._process, tree=True)
            else:
                os.killpg(self._process.pid, signal.SIGINT)

    def close(self) -> None:
        """End the command at once, and all that it started."""
        if self._process.poll() is None:
            kill(self._process, tree=True)
        self._log.unlink(missing_ok=True)

    @property
    def log(self) -> str:
        """All that it printed, without the lines of progress."""
        return "\n".join(line for line in self._printed().splitlines() if not _PROGRESS.match(line)).strip()

    @property
    def progress(self) -> tuple[float | None, str]:
        """Share of the work that is done, None if it is not known, and its last line of progress."""
        found = list(_PROGRESS.finditer(self._printed()))
        if not found:
            return None, ""
        return int(found[-1]["percent"]) / 100.0, found[-1].group().strip()

    def _printed(self) -> str:
        return self._log.read_bytes().decode("utf-8", "replace")


# ==== Parts ==========================================================================================================

Content = TypeVar("Content")

#: Colours of the grades, with white letters on them.
_COLORS = {
    Grade.USABLE: "green-9", Grade.LIMITED: "deep-orange-10", Grade.UNKNOWN: "blue-grey-8", Grade.NOT_USABLE: "red-9",
}  # fmt: skip

#: What an ended command is called.
_ENDS = {
    "done": "done", "not acceptable": "done", "cancelled": "cancelled", "failed": "not done", "running": "running",
    "stopping": "stopping",
}  # fmt: skip


#: The head of a place to drop files, which also opens the list of files.
_HEADER = """
<label class="row items-center justify-center q-pa-md cursor-pointer text-base relative-position" tabindex="0"
 @keydown.enter="props.pickFiles"><q-icon name="upload_file" size="sm" class="q-mr-sm" />TEXT<q-uploader-add-trigger />
</label>"""


class Window:
    """What all screens share, whichever browser shows them: the folder, commands and chosen files."""

    def __init__(self, folder: Folder) -> None:
        self.folder = folder
        self.jobs: dict[str, Job] = {}  #: Last command of each screen, by the screen's name for it.
        self.chosen: dict[str, Any] = {}  #: What is chosen on each screen, by the name of the choice.

    def start(self, key: str, title: str, commands: Sequence[Sequence[str]], product: Path) -> None:
        """Start commands, one after the other, unless those with this key still run."""
        if (old := self.jobs.get(key)) is not None:
            if old.code is None:
                ui.notify(f"{old.title} is still running")
                return
            old.close()
        self.jobs[key] = Job(title, commands, self.folder.path, product)

    def cancel(self, key: str) -> None:
        """Cancel the command with a key."""
        self.jobs[key].cancel()

    def advance(self) -> None:
        """Start the next command of each job whose last one has ended, also while no browser is open."""
        for job in self.jobs.values():
            job.advance()

    def close(self) -> None:
        """End all commands."""
        for job in self.jobs.values():
            job.close()


class Area(Generic[Content]):
    """Part of a screen that is read and built again when something changed; the last change wins.

    Args:
        read: Function that reads what is shown, in a thread.
        build: Function that builds it.
    """

    def __init__(self, read: Callable[[], Content], build: Callable[[Content], None]) -> None:
        self._read, self._build, self._turn = read, build, 0
        self._box = ui.column().classes("w-full")

    async def refresh(self) -> None:
        """Read and build it again."""
        self._turn += 1
        turn = self._turn
        content = await run.io_bound(self._read)
        if content is not None and turn == self._turn and not self._box.is_deleted:
            self._box.clear()
            with self._box:
                self._build(content)


def chosen_with(names: Sequence[str], name: str, on: bool) -> list[str]:
    """Return chosen names with another one at the end, or without it."""
    others = [other for other in names if other != name]
    return [*others, name] if on else others


def drop_area(window: Window, kind: str, text: str, dropped: Callable[[Path], Awaitable[None]]) -> None:
    """Show an area onto which files are dropped; they are copied to the folder of their kind."""

    async def keep(event: events.UploadEventArguments) -> None:
        path = window.folder.place(kind, event.file.name)
        if path.suffix.lower() not in SUFFIXES:
            ui.notify(f"{event.file.name}: no reader for {path.suffix or 'a file without a suffix'}", type="negative")
            return
        await event.file.save(path)
        await dropped(path)

    area = ui.upload(multiple=True, auto_upload=True, on_upload=keep).classes("w-full drop")
    area.props(f"flat bordered color=blue-grey-8 data-kind={kind}")
    area.add_slot("header", _HEADER.replace("TEXT", text))


def show_verdict(verdict: Verdict) -> None:
    """Show a verdict: its first sentence; what to do only where something must be done, the rest folded."""
    with ui.row().classes("items-center no-wrap"):
        ui.badge(verdict.grade.value, color=_COLORS[verdict.grade]).classes("text-sm q-pa-sm verdict")
        ui.label(verdict.detail).classes("text-base")
    if verdict.grade is not Grade.USABLE:
        for reason in verdict.decisive:
            ui.label(f"{reason.statement} ({reason.figure}): {reason.remedy}").classes("text-sm")
    with ui.expansion("All reasons").classes("w-full"):
        for reason in verdict.reasons:
            ui.label(f"{reason.grade.value}: {reason}").classes("text-sm")


def show_error(error: Exception) -> None:
    """Show why something could not be done."""
    ui.label(str(error)).classes("text-red-9 text-sm error bg-white q-pa-xs")


def show_figure(figure: Figure) -> None:
    """Draw a figure of the report kit, in the display units."""
    content = figure.content()
    displays = {axis: Display.of(unit) for axis, unit in content["units"].items() if unit}
    for trace in content["data"]:
        for axis in ("x", "y"):
            if display := displays.get(trace[f"{axis}axis"]):
                trace[axis] = [display(value) for value in trace[axis]]
    layout = {name: value for name, value in content["layout"].items() if name != "width"}
    for axis, display in displays.items():
        layout[f"{axis[0]}axis{axis[1:]}"]["title"]["text"] += f" [{display.unit}]"
    layout |= {"autosize": True, "paper_bgcolor": "#ffffff", "plot_bgcolor": "#ffffff", "hovermode": "closest"}
    options = {"displaylogo": False, "responsive": True}
    plot = ui.plotly({"data": content["data"], "layout": layout, "config": options})
    plot.classes("w-full figure").style(f"height: {figure.height}px")


def show_table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Show a table of texts."""
    heads = [{"name": str(k), "label": title, "field": str(k), "align": "left"} for k, title in enumerate(columns)]
    table = ui.table(columns=heads, rows=[{str(k): cell for k, cell in enumerate(row)} for row in rows])
    table.props("dense flat bordered hide-pagination").classes("w-full")


def show_files(window: Window, files: Sequence[tuple[str, Path]]) -> None:
    """Show links to files: pages open in a tab, others are saved."""
    with ui.row():
        for text, path in files:
            if path.is_file():
                ui.link(text, f"/file/{window.folder.name(path)}", new_tab=path.suffix == ".html").classes("product")


def job_card(window: Window, key: str, ended: Callable[[], Awaitable[None]]) -> None:
    """Show the command with a key while it runs, with a button to cancel it, or why it failed; then call `ended`."""
    seen: dict[str, Any] = {"job": window.jobs.get(key), "state": ""}
    with ui.card().classes("w-full job") as card:
        title = ui.label().classes("text-base")
        line = ui.label().classes("text-sm")
        bar = ui.linear_progress(0.0, show_value=False).props('aria-label="progress"')
        cancel = ui.button("Cancel", on_click=lambda: window.cancel(key)).props("flat dense no-caps")
        with ui.expansion("What it printed").classes("w-full") as more:
            printed = ui.label().classes("text-xs whitespace-pre-wrap font-mono")

    async def look() -> None:
        job = window.jobs.get(key)
        state = "none" if job is None else job.state
        card.set_visibility(state not in ("none", "done", "not acceptable"))
        if job is None:
            return
        running = state in ("running", "stopping")
        share, text = job.progress if running else (1.0, "")
        title.set_text(f"{job.title}: {_ENDS[state]}")
        line.set_text(text if running else _last_words(job, state))
        bar.props(add="" if share is not None else "indeterminate", remove="indeterminate" if share is not None else "")
        bar.set_value(share or 0.0)
        bar.set_visibility(running)
        cancel.set_visibility(state == "running")
        more.set_visibility(not running)
        if (job, state) != (seen["job"], seen["state"]):
            was_running = seen["job"] is job and seen["state"] in ("running", "stopping")
            seen.update(job=job, state=state)
            printed.set_text("" if running else job.log)
            if was_running and not running:
                await ended()

    ui.timer(0.4, look)


def _last_words(job: Job, state: str) -> str:
    """Return the message of a command that failed, or the end of what it printed."""
    return job.log.rpartition("error: ")[2][-600:] if state == "failed" else ""
