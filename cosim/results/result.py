"""Result of a run: recorded signals, coupling error, verdict, notes."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cosim.results import rules
from cosim.results.run_verdict import verdict_of
from cosim.results.validity import Model
from eightpost import __version__
from eightpost.array_types import Array
from eightpost.display import Summarized, Summary
from eightpost.errors import FileFormatError
from eightpost.files import atomic_path, json_content
from eightpost.signals import TimeSeries, read_series, write_series
from eightpost.verdict import Verdict

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from eightpost.report.pictures import Picture

# ---- Result of a run ------------------------------------------------------------------------------------------------

SCHEMA = 1


@dataclass(frozen=True, slots=True)
class Coupled:
    """Local errors of the values that the ends of one bond assumed of each other, root mean squares in SI.

    Attributes:
        velocity_error: Local error of the velocity given to the shock [m/s].
        velocity_spread: Standard deviation of that velocity [m/s].
        force_error: Local error of the force given to the vehicle [N].
        force_spread: Standard deviation of that force [N].
        velocity_scale: Scale of the velocity's error [m/s]; see cosim.results.error_estimate.judged_by.
        force_scale: Scale of the force's error [N].
    """

    velocity_error: float
    velocity_spread: float
    force_error: float
    force_spread: float
    velocity_scale: float
    force_scale: float

    @property
    def percent(self) -> float:
        """Larger of both local errors, in percent of its scale."""
        return 100.0 * max(self.velocity_error / self.velocity_scale, self.force_error / self.force_scale)


@dataclass(frozen=True, slots=True)
class BondEnergy:
    """Energy through one bond over a run.

    Attributes:
        residual: Energy given at the velocity end minus energy received at the force end [J]; 0 in exact coupling.
        transferred: Sum of the magnitudes of the energy received at the force end in each step [J].
    """

    residual: float
    transferred: float

    @property
    def relative(self) -> float:
        """Residual as a share of the energy transferred [1]."""
        return self.residual / self.transferred if self.transferred else 0.0

    @property
    def acceptable(self) -> bool:
        """Whether the coupling adds or loses at most 5 % of the energy transferred."""
        return abs(self.relative) <= rules.LARGEST_RESIDUAL


@dataclass(frozen=True, repr=False)
class Result(Summarized):
    """Result of one run.

    Attributes:
        series: Recorded variables by `component.variable`, SI.
        converged: Whether the equilibrium start was found and all steps converged; see `notes`.
        notes: Notes for the reader, in sentences.
        algorithm: Name of the algorithm.
        order: Components in the order of stepping.
        step: Coupling step [s].
        steps: Number of coupling steps.
        seconds: Wall time from the start of initialization [s]; for the default, of all its runs.
        equilibrium_sweeps: Number of evaluations until the equilibrium start converged.
        energy: Energy residual and energy transferred [J] per bond.
        held_direct: Recorded outputs with a direct term in an input that was held over each step: first order in it.
        identities: GUID of each component.
        sources: File of each component.
        parameters: Values that differ from the components' defaults, by component; in their own units.
        settling: Time at the start that is excluded from response measures [s].
        share_beyond_fit: Share of time beyond the fitted velocities, per shock.
        share_beyond_settings: Share of time beyond the measured settings of clicks and temperature, per such shock.
        share_far_beyond_settings: The same, beyond them by more than the nearest interval between them.
        share_untested_settings: Share of time at a combination of settings that was not measured, per such shock.
        share_tire_off: Share of time below zero load, per tire force; None if no static load is known.
        coupled: Local errors of the values that the ends assumed of each other, per bond.
        iterations: Total number of iterations of implicit steps.
        rejected_steps: Number of steps that an adaptive run repeated with a smaller step.
        largest_step: Largest coupling step [s].
        partial: Whether the run was interrupted or given up before its stop time.
        ended_by: Component that ended the simulation before its stop time, as an FMU may; empty if none did.
        ended_at: Time at which it did [s]; None if none did.
        stepping_seconds: Wall time of the steps alone [s]; for the default, of all its runs.
        stated_error: Estimated coupling error per recorded variable and per decisive channel, in percent of its scale
            (cosim.results.error_estimate.scales) after settling; empty if only one run was made.
        scheme: Algorithm that the default chose; empty if an algorithm was given.
        decisive: Channels whose coupling error the verdict judges: velocities and forces of bonds, tire forces.
        models: Components with the information that the verdict uses.
        tolerance: Coupling error that the default aimed at, in percent; 0 if the step was given.
        unsettled_steps: Number of implicit steps that did not converge.
        steps_of_all_runs: Number of coupling steps of this run and of those that it was compared with.
    """

    series: TimeSeries
    converged: bool
    notes: tuple[str, ...]
    algorithm: str
    order: tuple[str, ...]
    step: float
    steps: int
    seconds: float
    equilibrium_sweeps: int
    energy: Mapping[str, BondEnergy]
    held_direct: tuple[str, ...]
    identities: Mapping[str, str]
    sources: Mapping[str, str] = field(default_factory=dict)
    parameters: Mapping[str, Mapping[str, float | bool | str]] = field(default_factory=dict)
    settling: float = 0.0
    share_beyond_fit: Mapping[str, float] = field(default_factory=dict)
    share_beyond_settings: Mapping[str, float] = field(default_factory=dict)
    share_far_beyond_settings: Mapping[str, float] = field(default_factory=dict)
    share_untested_settings: Mapping[str, float] = field(default_factory=dict)
    share_tire_off: Mapping[str, float | None] = field(default_factory=dict)
    coupled: Mapping[str, Coupled] = field(default_factory=dict)
    iterations: int = 0
    rejected_steps: int = 0
    largest_step: float = 0.0
    partial: bool = False
    stepping_seconds: float = 0.0
    stated_error: Mapping[str, float] = field(default_factory=dict)
    scheme: str = ""
    decisive: frozenset[str] = frozenset()
    models: Mapping[str, Model] = field(default_factory=dict)
    tolerance: float = 0.0
    ended_by: str = ""
    ended_at: float | None = None
    unsettled_steps: int = 0
    steps_of_all_runs: int = 0

    @cached_property
    def verdict(self) -> Verdict:
        """Verdict on whether the run can be used, with its reasons (docs/reference/verdict.md)."""
        return verdict_of(self)

    @property
    def acceptable(self) -> bool:
        """Whether the verdict is anything but "not usable"; `eightpost run` sets its exit code by this."""
        return self.verdict.is_acceptable

    @property
    def coupling_error(self) -> float | None:
        """Largest stated error of the decisive channels, or of all channels if none is decisive [%].

        None if only one run was made.
        """
        chosen = [self.stated_error[name] for name in self.decisive if name in self.stated_error]
        return max(chosen or self.stated_error.values(), default=None)

    @property
    def has_equal_steps(self) -> bool:
        """Whether all coupling steps have the same size, except for rounding."""
        return self.largest_step <= self.step * (1.0 + 1e-9)

    @property
    def is_clean(self) -> bool:
        """Whether the run reached its stop time, every step converged, and no bond's local error is too large."""
        local = max((c.percent for c in self.coupled.values()), default=0.0)
        return not self.partial and self.unsettled_steps == 0 and local <= rules.LARGEST_ERROR

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

    def to_pandas(self) -> pd.DataFrame:
        """Return the recorded channels, in SI, over the time [s]; units are in `attrs["units"]`.

        Raises:
            MissingExtraError: pandas is not installed.
        """
        return self.series.to_pandas()

    def to_xarray(self) -> xr.Dataset:
        """Return the recorded channels, in SI, over `time` [s]; the attributes state verdict, scheme and step.

        Raises:
            MissingExtraError: xarray is not installed.
        """
        stated = {"verdict": self.verdict.grade.value, "algorithm": self.scheme or self.algorithm, "step": self.step}
        return self.series.to_xarray().assign_attrs(stated)

    def plot(
        self, channels: str | Sequence[str] = (), *, start: float | None = None, stop: float | None = None
    ) -> Picture:
        """Return a picture of recorded channels over time.

        Args:
            channels: Names of the channels; default: the first twelve.
            start: Start of the shown part [s]; default: so that a long run shows its middle.
            stop: End of the shown part [s].

        Raises:
            MissingChannelError: A channel was not recorded.
        """
        from eightpost.report.traces import picture  # noqa: PLC0415 -- matplotlib takes long to load

        return picture(self.series, channels, start=start, stop=stop, title=", ".join(self.order))

    def __getitem__(self, name: str) -> Array:
        """Return a recorded channel (N,) in its SI unit.

        Raises:
            MissingChannelError: The channel was not recorded.
        """
        return self.series[name]

    def settled(self) -> TimeSeries:
        """Return the series without the settling time; the whole series if the run ended within it."""
        last = float(self.series.time[-1])
        return self.series.window(self.settling, last) if 0.0 < self.settling < last else self.series

    def write(self, folder: str | Path) -> tuple[Path, ...]:
        """Write series.parquet, series.csv and result.json; an old file is replaced only by a complete one."""
        folder = Path(folder)
        paths = (folder / "series.parquet", folder / "series.csv", folder / "result.json")
        write_series(self.series, paths[0])
        write_series(self.series, paths[1])
        with atomic_path(paths[2]) as temporary:
            temporary.write_text(json.dumps(self._document(), indent=2) + "\n", encoding="utf-8")
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
        return heading | {"verdict": self.verdict.to_json()} | document | extra | {"channels": list(self.series.names)}


# ---- A run in a folder -----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class SavedRun:
    """A run that `Result.write` wrote.

    Attributes:
        series: Recorded channels without the settling time.
        document: Content of result.json.
        sources: FMUs and parameters of the run in words.
    """

    series: TimeSeries
    document: Mapping[str, Any]
    sources: str

    @classmethod
    def load(cls, folder: str | Path) -> SavedRun:
        """Read the folder of a run.

        Raises:
            FileFormatError: It is not the folder of a run, or a file is damaged.
        """
        path = Path(folder) / "result.json"
        if not path.is_file():
            raise FileFormatError("there is no run here; name a folder that `eightpost run` wrote", path=folder)
        series = read_series(path.with_name("series.parquet"))
        document = json_content(path, advice="name a folder that `eightpost run` wrote", finite=False)
        if not isinstance(document, dict) or document.get("kind") != "result":
            raise FileFormatError("is not the result of a run", path=path)
        settling = document.get("settling", 0.0)
        if type(settling) not in (int, float) or not 0.0 <= settling < series.duration:
            message = f"settling is {settling!r}, but must be a time [s] within the run of {series.duration:g} s"
            raise FileFormatError(message, path=path)
        settled = series.window(settling, float(series.time[-1])) if settling else series
        return cls(settled, document, _sources(document, path))


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
