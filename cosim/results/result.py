"""Result of a run: recorded signals, coupling error, notes, and the verdict."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cosim.results import rules
from cosim.results.run_data import RunData
from cosim.results.validity import LARGEST_SHARE, NOTABLE_SHARE, model_reasons
from eightpost import __version__
from eightpost.array_types import Array
from eightpost.completion import warn_of_earlier_results
from eightpost.display import Summary
from eightpost.errors import FileFormatError
from eightpost.files import atomic_path, json_content
from eightpost.signals import Recording, TimeSeries, read_series, write_series
from eightpost.verdict import Reason, Verdict, edited, is_intact, sealed

if TYPE_CHECKING:
    import xarray as xr


# ==== Reasons from limits that are watched at every step: velocities, settings, tires off the ground =================


def limit_reasons(run: RunData) -> Iterator[Reason]:
    """Yield the reasons from the shares of time beyond the limits of shocks and tires."""
    yield from _fitted(run)
    yield from _settings(run)
    yield from _tires(run)


def _fitted(run: RunData) -> Iterator[Reason]:
    for shock, time in run.share_beyond_fit.items():
        energy = _energy_beyond(run, shock)
        share = max(time, energy or 0.0)
        beyond = rules.BEYOND_FIT if share <= LARGEST_SHARE else rules.MOSTLY_BEYOND_FIT
        rule, within = (rules.WITHIN_FIT, "stays within") if share <= NOTABLE_SHARE else (beyond, "leaves")
        dissipated = "" if energy is None else f", {energy:.1%} of its energy"
        yield rule.reason(
            f"the shock {within} the velocities that it was fitted on",
            figure=f"outside {time:.1%} of the time{dissipated}; limits {NOTABLE_SHARE:.0%} and {LARGEST_SHARE:.0%}",
            origin=f"component {shock}",
        )


def _settings(run: RunData) -> Iterator[Reason]:
    """Yield the reasons about the settings of shocks that have them."""
    for shock, beyond in run.share_beyond_settings.items():
        far = run.share_far_beyond_settings.get(shock, 0.0)
        untested = run.share_untested_settings.get(shock, 0.0)
        origin = f"component {shock}"
        if beyond > 0.0:
            yield (rules.FAR_BEYOND_SETTINGS if far > 0.0 else rules.BEYOND_SETTINGS).reason(
                "the shock is set beyond the settings that were measured",
                figure=f"{beyond:.0%} of the time, by more than an interval between measured settings {far:.0%}",
                origin=origin,
            )
        if untested > 0.0:
            figure = f"{untested:.0%} of the time"
            yield rules.UNTESTED_SETTINGS.reason(
                "the shock is at a combination of settings that was not measured", figure=figure, origin=origin
            )
        if not beyond and not untested:
            figure = "0 % of the time beyond or at an untested combination"
            yield rules.WITHIN_SETTINGS.reason("the shock is at measured settings", figure=figure, origin=origin)


def _energy_beyond(run: RunData, shock: str) -> float | None:
    """Return the share of a shock's dissipated energy outside its fitted velocities; None if not recorded."""
    names = (f"{shock}.dissipated_power", f"{shock}.beyond_fit")
    if not set(names) <= set(run.series.names):
        return None
    settled = run.settled()
    power, beyond = (abs(settled[name]) for name in names)
    total = float(power.sum())
    return float(power[beyond > 0.5].sum()) / total if total else 0.0


def _tires(run: RunData) -> Iterator[Reason]:
    for tire, off in run.share_tire_off.items():
        if off is None:
            yield rules.STATIC_LOAD_UNKNOWN.reason(
                "lift-off of tires cannot be detected: no static tire force is given", figure="0 N", origin=tire
            )
        elif off > 0.0:
            rule = rules.TIRE_OFF if off <= LARGEST_SHARE else rules.MOSTLY_TIRE_OFF
            figure = f"{off:.1%} of the time; limit {LARGEST_SHARE:.0%}"
            yield rule.reason("a tire is off the ground", figure=figure, origin=tire)


# ==== Verdict: coupling error, energy, convergence, and the limits of the models =====================================


def verdict_of(run: RunData) -> Verdict:
    """Return the verdict on a run."""
    return Verdict(
        (
            *_coupling(run),
            *_energy(run),
            *_convergence(run),
            *limit_reasons(run),
            *model_reasons(run.models, run.settled()),
        )
    )


def _coupling(run: RunData) -> Iterator[Reason]:
    yield from _local(run)
    known = run.stated_error
    decisive = {name: error for name, error in known.items() if name in run.decisive} or known
    if not decisive or not all(map(isfinite, decisive.values())):
        yield _not_stated(run)
        return
    yield _stated(run, *max(decisive.items(), key=lambda item: item[1]))
    others = {name: e for name, e in known.items() if name not in decisive and e > rules.LARGEST_ERROR}
    if others:
        name = max(others, key=lambda each: others[each])
        yield rules.CHANNEL_ERROR.reason(
            f"the coupling error of {_counted(len(others), 'other channel')} is too large; largest: {name}",
            figure=f"{_percent(others[name])}; limit {rules.LARGEST_ERROR:g} %",
            origin="coupling error per channel",
        )


def _local(run: RunData) -> Iterator[Reason]:
    for bond, coupled in run.coupled.items():
        if not coupled.percent <= rules.LARGEST_ERROR:
            yield rules.LOCAL_ERROR.reason(
                "the values that the ends of a bond assume of each other are wrong in every step",
                figure=f"{_percent(coupled.percent)} of the scale; limit {rules.LARGEST_ERROR:g} %",
                origin=f"bond {bond}",
            )


def _not_stated(run: RunData) -> Reason:
    if not run.energy and not run.coupled:
        return rules.COUPLING_NONE.reason("there is no coupling loop", figure="0 bonds", origin="the system")
    return rules.COUPLING_UNKNOWN.reason(
        "the coupling error is not stated",
        figure=f"known for 0 of {len(run.series.names)} channels",
        origin=f"{run.algorithm} at {1e3 * run.step:g} ms",
    )


def _stated(run: RunData, name: str, error: float) -> Reason:
    limit = run.tolerance or rules.GOOD_ERROR
    origin = f"channel {name}, {run.scheme or run.algorithm} at {1e3 * run.step:g} ms"
    if error > rules.LARGEST_ERROR:
        figure = f"{_percent(error)} of the scale; limit {rules.LARGEST_ERROR:g} %"
        return rules.COUPLING_ERROR.reason("the coupling error is too large", figure=figure, origin=origin)
    named = "tolerance" if run.tolerance else "good up to"
    figure = f"{_percent(error)} of the scale; {named} {limit:g} %"
    if error > limit:
        return rules.COUPLING_TOLERANCE.reason(
            "the coupling error is larger than requested", figure=figure, origin=origin
        )
    return rules.COUPLING_GOOD.reason("the coupling error is small", figure=figure, origin=origin)


def _energy(run: RunData) -> Iterator[Reason]:
    shares = {bond: abs(energy.relative) for bond, energy in run.energy.items()}
    bad = {bond: share for bond, share in shares.items() if not share <= rules.DOUBTFUL_RESIDUAL}
    for bond, share in bad.items():
        rule = rules.ENERGY_DOUBTFUL if share <= rules.LARGEST_RESIDUAL else rules.ENERGY_RESIDUAL
        yield rule.reason(
            "the coupling adds or loses energy",
            figure=f"{share:.2%} of the energy transferred; limit {rules.LARGEST_RESIDUAL:.0%}",
            origin=f"bond {bond}",
        )
    if shares and not bad:
        worst = max(shares, key=lambda bond: shares[bond])
        yield rules.ENERGY_GOOD.reason(
            "the coupling conserves energy",
            figure=f"{shares[worst]:.2%}; limit {rules.LARGEST_RESIDUAL:.0%}",
            origin=f"bond {worst}",
        )


def _convergence(run: RunData) -> Iterator[Reason]:
    end = f"{float(run.series.time[-1]):g} s" if len(run.series) else "0 s"
    if run.partial:
        yield rules.ENDED_EARLY.reason("the run ended early", figure=f"at {end}", origin=run.algorithm)
    if not run.converged:
        notes = run.notes[0] if run.notes else "no note"
        yield rules.NOT_CONVERGED.reason("the run did not converge", figure=notes, origin=run.algorithm)
    if run.converged and not run.partial:
        figure = f"{run.steps} steps, {end}"
        yield rules.CONVERGED.reason("the run reached its stop time", figure=figure, origin="the run")


def _counted(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"


def _percent(value: float) -> str:
    return f"{value:.2g} %" if abs(value) < 10.0 else f"{value:.0f} %"


# ==== Result =========================================================================================================

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
