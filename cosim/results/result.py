"""Result of a run: recorded signals, coupling error, verdict, notes."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cosim.results.run_data import RunData
from cosim.results.run_verdict import verdict_of
from eightpost import __version__
from eightpost.array_types import Array
from eightpost.completion import warn_of_earlier_results
from eightpost.display import Summary
from eightpost.errors import FileFormatError
from eightpost.files import atomic_path, json_content
from eightpost.signals import Recording, TimeSeries, read_series, write_series
from eightpost.verdict import Verdict, edited, is_intact, sealed

if TYPE_CHECKING:
    import xarray as xr

# ---- Result of a run ------------------------------------------------------------------------------------------------

SCHEMA = 1

#: Entry of result.json with the digest of the recorded channels.
_SERIES = "series_sha256"


class RunChannels(Recording):
    """Channels of a run: by name, as tables and as a picture."""

    __slots__ = ()

    if TYPE_CHECKING:

        @property
        def order(self) -> tuple[str, ...]:
            """Components in the order of stepping."""

    def _title(self) -> str:
        return ", ".join(self.order)

    def __getitem__(self, name: str) -> Array:
        """Return a recorded channel (N,) in its SI unit.

        Raises:
            MissingChannelError: The channel was not recorded.
        """
        return self.series[name]


@dataclass(frozen=True, repr=False)
class Result(RunData, RunChannels):
    """Result of one run: its data, which `RunData` describes, with verdict, pictures and files."""

    @cached_property
    def verdict(self) -> Verdict:
        """Verdict on whether the run can be used, with its reasons (docs/reference/verdict.md)."""
        return verdict_of(self)

    @property
    def acceptable(self) -> bool:
        """Whether the verdict is anything but "not usable"; `eightpost run` sets its exit code by this."""
        return self.verdict.is_acceptable

    def _summary(self) -> Summary:
        scheme = f"{self.algorithm}: {self.scheme}" if self.scheme else self.algorithm
        largest = "" if self.has_equal_steps else f" to {1e3 * self.largest_step:.3g}"
        error, energies = self.coupling_error, [abs(energy.relative) for energy in self.energy.values()]
        return Summary.of(
            "Result of a run",
            ("verdict", self.verdict.headline + (" (ended early)" if self.partial else "")),
            ("reason", str(self.verdict.decisive[0]) if self.verdict.reasons else ""),
            ("components", ", ".join(self.order)),
            ("steps", f"{self.steps} of {1e3 * self.step:.3g}{largest} ms, {scheme}"),
            ("coupling error", "not stated" if error is None else f"{error:.2g} %"),
            ("energy residual", f"up to {max(energies):.1e} of the energy transferred" if energies else ""),
            *self.series.summary_rows(),
            ("notes", f"{len(self.notes)}; see .notes" if self.notes else ""),
        )

    def to_xarray(self) -> xr.Dataset:
        """Return the recorded channels, in SI, over `time` [s]; the attributes state verdict, scheme and step.

        Raises:
            MissingExtraError: xarray is not installed.
        """
        stated = {"verdict": self.verdict.grade.value, "algorithm": self.scheme or self.algorithm, "step": self.step}
        return self.series.to_xarray().assign_attrs(stated)

    def write(self, folder: str | Path) -> tuple[Path, ...]:
        """Write series.parquet, series.csv and result.json; an old file is replaced only by a complete one."""
        folder = Path(folder)
        paths = (folder / "series.parquet", folder / "series.csv", folder / "result.json")
        write_series(self.series, paths[0])
        write_series(self.series, paths[1])
        with atomic_path(paths[2]) as temporary:
            temporary.write_text(json.dumps(sealed(self._document()), indent=2) + "\n", encoding="utf-8")
        return paths

    def _document(self) -> dict[str, object]:
        document = {
            name: getattr(self, name)
            for name in self.__dataclass_fields__
            if name not in ("series", "energy", "coupled", "decisive", "models")
        }
        coupled = {name: asdict(c) | {"percent": c.percent} for name, c in self.coupled.items()}
        energy = {name: asdict(e) | {"relative": e.relative} for name, e in self.energy.items()}
        heading = {"schema": SCHEMA, "kind": "result", "tool": f"eightpost {__version__}"}
        extra = {"decisive": sorted(self.decisive), "energy": energy, "coupled": coupled}
        extra |= {"channels": list(self.series.names), _SERIES: _digest_of(self.series)}
        return heading | {"verdict": self.verdict.to_json()} | document | extra


# ---- A run in a folder -----------------------------------------------------------------------------------------------


@dataclass(frozen=True, repr=False)
class SavedRun(RunChannels):
    """A run that `Result.write` wrote."""

    series: TimeSeries  #: Recorded channels without the settling time.
    #: Content of result.json. Its verdict is "unknown" if it or the series were edited after the run.
    document: Mapping[str, Any]
    sources: str  #: FMUs and parameters of the run in words.

    @cached_property
    def verdict(self) -> Verdict:
        """Verdict of the run.

        Raises:
            InputError: The document has none, or a damaged one.
        """
        return Verdict.from_json(self.document.get("verdict"))

    @property
    def order(self) -> tuple[str, ...]:
        """Components in the order of stepping; those with a recorded channel if the document does not state it."""
        stated = self.document.get("order")
        recorded = dict.fromkeys(name.partition(".")[0] for name in self.series.names)
        return tuple(map(str, stated if isinstance(stated, list) else recorded))

    def _summary(self) -> Summary:
        stated = self.document.get("verdict")
        verdict = stated.get("summary") if isinstance(stated, Mapping) else None
        return Summary.of(
            "Run in a folder",
            ("verdict", str(verdict or "not stated")),
            ("components", ", ".join(self.order)),
            ("sources", self.sources),
            *self.series.summary_rows(),
        )

    @classmethod
    def load(cls, folder: str | Path) -> SavedRun:
        """Read the folder of a run.

        Raises:
            FileFormatError: It is not the folder of a run, or a file is damaged.
        """
        path = Path(folder) / "result.json"
        if not path.is_file():
            raise FileFormatError("there is no run here; name a folder that `eightpost run` wrote", path=folder)
        warn_of_earlier_results(folder)
        series = read_series(path.with_name("series.parquet"))
        document = json_content(path, advice="name a folder that `eightpost run` wrote", finite=False)
        if not isinstance(document, dict) or document.get("kind") != "result":
            raise FileFormatError("is not the result of a run", path=path)
        if not (is_intact(document) and document.get(_SERIES) in (None, _digest_of(series))):
            document |= {"verdict": edited(path.name).to_json()}
        settling = document.get("settling", 0.0)
        if type(settling) not in (int, float) or not 0.0 <= settling < series.duration:
            message = f"settling is {settling!r}, but must be a time [s] within the run of {series.duration:g} s"
            raise FileFormatError(message, path=path)
        settled = series.window(settling, float(series.time[-1])) if settling else series
        return cls(settled, document, _sources(document, path))


def _digest_of(series: TimeSeries) -> str:
    """Return the SHA-256 of the names, units and samples of a series."""
    found = hashlib.sha256(json.dumps([series.names, series.units]).encode())
    for samples in (series.time, *series.values):
        found.update(samples.tobytes())
    return found.hexdigest()


def _sources(document: Mapping[str, Any], path: Path) -> str:
    sources, parameters = document.get("sources", {}), document.get("parameters", {})
    if not isinstance(sources, dict) or not isinstance(parameters, dict):
        raise FileFormatError("sources and parameters must be objects", path=path)
    parts = [f"{name} = {source}" for name, source in sources.items()]
    for name, values in parameters.items():
        if not isinstance(values, dict):
            raise FileFormatError(f"parameters.{name} must be an object", path=path)
        parts += [f"{name}.{parameter} = {value}" for parameter, value in values.items()]
    return ", ".join(parts)
