"""Result of a run: recorded signals with verdict and files, and its coupling error, estimated from several runs."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Collection, Hashable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from itertools import pairwise
from math import inf, log2
from pathlib import Path
from typing import TYPE_CHECKING, Any, NotRequired, TypeVar

import numpy as np
from pydantic import with_config
from typing_extensions import TypedDict  # pydantic needs it before Python 3.12

from cosim.session.verdict import Coupled, RunData, verdict_of
from eightpost import __version__
from eightpost.array_types import Array
from eightpost.completion import warn_of_earlier_results
from eightpost.display import Summary
from eightpost.errors import FileFormatError
from eightpost.files import atomic_path, json_content
from eightpost.schema import REPORT, document_of
from eightpost.signals import Recording, TimeSeries, read_series, write_series
from eightpost.verdict import Reason, Verdict, edited, is_intact, sealed

if TYPE_CHECKING:
    import xarray as xr

# ---- Result of a run ------------------------------------------------------------------------------------------------

SCHEMA = 1

#: Entry of result.json with the digest of the recorded channels.
_SERIES = "series_sha256"


class _RunChannels(Recording):
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
class Result(RunData, _RunChannels):
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


@with_config(REPORT)
class _Verdict(TypedDict):
    """Entries of a verdict that are read."""

    reasons: NotRequired[tuple[Reason, ...]]


@with_config(REPORT)
class _Document(TypedDict):
    """Entries of result.json that are read."""

    verdict: NotRequired[_Verdict]
    order: NotRequired[tuple[str, ...]]
    settling: NotRequired[float]
    sources: NotRequired[dict[str, str]]
    parameters: NotRequired[dict[str, dict[str, float | bool | str]]]
    series_sha256: NotRequired[str | None]


@dataclass(frozen=True, repr=False)
class SavedRun(_RunChannels):
    """A run that `Result.write` wrote."""

    series: TimeSeries  #: Recorded channels without the settling time.
    #: Verdict of the run; it is "unknown" if result.json or the series were edited after the run. It has no reasons if
    #: result.json states none.
    verdict: Verdict
    order: tuple[str, ...]  #: Components in the order of stepping.
    sources: str  #: FMUs and parameters of the run in words.

    def _summary(self) -> Summary:
        return Summary.of(
            "Run in a folder",
            ("verdict", self.verdict.summary() if self.verdict.reasons else "not stated"),
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
        stated = json_content(path, finite=False)
        document = document_of(_Document, stated, path, "result", SCHEMA, "name a folder that `eightpost run` wrote")
        is_edited = not (is_intact(stated) and document.get(_SERIES) in (None, _digest_of(series)))
        settling = document.get("settling", 0.0)
        if not 0.0 <= settling < series.duration:
            message = f"settling is {settling!r}, but must be a time [s] within the run of {series.duration:g} s"
            raise FileFormatError(message, path=path)
        return cls(
            series.window(settling, float(series.time[-1])) if settling else series,
            edited(path.name) if is_edited else Verdict(document.get("verdict", {}).get("reasons", ())),
            document.get("order") or tuple(dict.fromkeys(name.partition(".")[0] for name in series.names)),
            _sources(document),
        )


def _digest_of(series: TimeSeries) -> str:
    digest = hashlib.sha256(json.dumps([series.names, series.units]).encode())
    for samples in (series.time, *series.values):
        digest.update(samples.tobytes())
    return digest.hexdigest()


def _sources(document: _Document) -> str:
    parts = [f"{name} = {source}" for name, source in document.get("sources", {}).items()]
    for name, values in document.get("parameters", {}).items():
        parts += [f"{name}.{parameter} = {value}" for parameter, value in values.items()]
    return ", ".join(parts)


# ---- Difference of two runs of one system at different steps, in percent of each channel's scale --------------------

Signal = TypeVar("Signal", bound=Hashable)

#: Smallest scale of a channel by SI unit, far below the resolution of sensors; used for a signal at rest.
FLOORS: Mapping[str, float] = {"m/s": 1e-6, "m": 1e-8, "N": 1e-3, "m/s2": 1e-3}

#: Smallest scale of a channel whose unit has no floor above.
_OTHER_FLOOR = 1e-9

#: Smallest scale of a channel as a share of the largest standard deviation of all channels of its unit [1].
_SHARE_OF_LARGEST = 1e-2


def scales(series: TimeSeries) -> dict[str, float]:
    """Return the scale of each channel, to which its percentages refer, in its SI unit.

    The scale is the standard deviation; at least 1 % of the largest standard deviation among channels of that unit, and
    at least the unit's floor. A signal that is nearly at rest therefore gets a scale from other signals of its unit.
    """
    spread = {name: float(np.std(series[name])) for name in series.names}
    return judged_by(spread, {name: series.unit(name) for name in series.names})


def judged_by(spread: Mapping[Signal, Any], units: Mapping[Signal, str]) -> dict[Signal, Any]:
    """Return the scale of each signal, of one run or of n runs.

    Args:
        spread: Standard deviation of each signal, in its SI unit (n,).
        units: SI unit of each signal.
    """
    largest: dict[str, Any] = {}
    for name, value in spread.items():
        largest[units[name]] = np.maximum(value, largest.get(units[name], 0.0))
    largest["1"] = 0.0  # signals without a unit may be of different kinds
    floors = {
        unit: np.maximum(_SHARE_OF_LARGEST * most, FLOORS.get(unit, _OTHER_FLOOR)) for unit, most in largest.items()
    }
    return {name: np.maximum(value, floors[units[name]]) for name, value in spread.items()}


def difference(coarse: TimeSeries, fine: TimeSeries) -> dict[str, float]:
    """Return the root mean square difference of each channel that both have, in percent of the finer run's scale.

    Args:
        coarse: Series of one run, without its settling time.
        fine: Series of the finer run. Times of both runs are compared; the result is infinite without such times.
    """
    names = [name for name in fine.names if name in coarse.names]
    before, after = (np.round(series.time, 12) for series in (coarse, fine))  # equal except for rounding
    _, first, second = np.intersect1d(before, after, assume_unique=True, return_indices=True)
    if first.size == 0:
        return dict.fromkeys(names, float("inf"))
    scale = scales(fine)
    return {
        name: 100.0 * float(np.sqrt(np.mean((coarse[name][first] - fine[name][second]) ** 2))) / scale[name]
        for name in names
    }


# ---- Coupling error of a run, estimated from how differences between runs fall as the step halves -------------------

#: Smallest order that the error is assumed to have [1].
_SLOWEST = 0.38

#: Largest order that the error is assumed to have [1]: if the channel's differences showed at least that, and if only
#: the bonds' local errors did, because a difference may fall fast by chance.
_FASTEST, _FASTEST_UNSEEN = 2.0, 1.5

#: Largest order of everything coupled with a component that holds its inputs [1]: if the channel's differences showed
#: at least that, and if not.
_OF_HELD, _OF_HELD_UNSEEN = 1.0, 0.5

#: Smallest value of a difference as a share of the one before [1], because it may be small by chance.
_LUCK = 1.0 / 8.0

#: Local errors below this share of the largest one are not used for the order [1].
_NEGLIGIBLE = 1e-2


@dataclass(frozen=True, slots=True)
class Comparison:
    """Two runs, the finer one at half the step of the coarser."""

    difference: Mapping[str, float]  #: Difference of both runs per channel, in percent of its scale.
    reliable: bool  #: Whether both runs passed the check of their bonds' local errors.
    #: Order at which the bonds' local errors fell from one run to the other [1]; None without bonds.
    local_order: float | None


def compare(coarse: Result, fine: Result) -> Comparison:
    """Compare two runs of one system at all times that both recorded after settling."""
    return Comparison(
        difference=difference(coarse.settled(), fine.settled()),
        reliable=coarse.is_clean and fine.is_clean,
        local_order=_local_order(coarse.coupled, fine.coupled),
    )


def stated_error(comparisons: Sequence[Comparison], held: Collection[str] = ()) -> dict[str, float]:
    """Return per channel the coupling error of the finest run, in percent of the channel's scale.

    The error is the last difference divided by 2^p - 1. The order p is the smallest that the last comparisons showed,
    from the channel's differences and from the bonds' local errors. It is at least 0.38, at most 2 if the channel's
    differences were compared, else at most 1.5; 1 if nothing was observed. For a channel of `held` it is at most 1 if
    the channel's differences were compared, else at most 0.5.

    Args:
        comparisons: Comparisons of runs at steps that halve, the coarsest first; at least one.
        held: Components that hold their inputs, and all components coupled with them.
    """
    return {name: _stated(name, comparisons, held) for name in comparisons[-1].difference}


def _stated(name: str, comparisons: Sequence[Comparison], held: Collection[str]) -> float:
    differences = [c.difference.get(name, inf) for c in comparisons]
    last = differences[-1]
    if len(differences) > 1 and comparisons[-2].reliable and differences[-2] < inf:
        last = max(last, _LUCK * differences[-2])
    seen = _orders_seen(differences, comparisons)
    if name.partition(".")[0] in held:
        fastest = _OF_HELD if seen else _OF_HELD_UNSEEN
    else:
        fastest = _FASTEST if seen else _FASTEST_UNSEEN
    local = comparisons[-1].local_order if comparisons[-1].reliable else None
    order = min([*seen, *([] if local is None else [local])], default=1.0)
    return last / (float(2.0 ** min(max(order, _SLOWEST), fastest)) - 1.0)


def _orders_seen(differences: Sequence[float], comparisons: Sequence[Comparison]) -> list[float]:
    """Return the orders at which a channel's last differences fell, between comparisons that are reliable."""
    recent = list(zip(comparisons, differences, strict=True))[-3:]
    return [
        log2(before / after)
        for (coarser, before), (finer, after) in pairwise(recent)
        if coarser.reliable and finer.reliable and 0.0 < before < inf and after > 0.0
    ]


def _local_order(coarse: Mapping[str, Coupled], fine: Mapping[str, Coupled]) -> float | None:
    """Return the smallest order at which a bond's local error fell, among the errors that are not negligible."""
    pairs = [(coarse[name].percent, fine[name].percent) for name in fine if name in coarse]
    largest = max((after for _, after in pairs), default=0.0)
    orders = [log2(before / after) for before, after in pairs if after > _NEGLIGIBLE * largest and before > 0.0]
    return min(orders, default=None)
