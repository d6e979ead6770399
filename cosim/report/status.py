"""What a reader should know of a run before its numbers: whether it can be used, its coupling error, the notes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from math import isfinite

from cosim.automatic import LARGEST_ERROR, decisive
from cosim.energy import LIMIT
from cosim.report.figures import figure, listed, percent
from cosim.result import Coupled, Result
from cosim.system import System

_HOW_TO_KNOW = "the default algorithm halves the step until two runs agree"


@dataclass(frozen=True, slots=True)
class Verdict:
    """Whether a result can be used, in one sentence.

    Args:
        kind: good; open where the coupling error is not stated; bad where the result is not to be used.
        answer: The answer in a few words.
        reason: What goes on from it, up to the full stop.
    """

    kind: str
    answer: str
    reason: str


@dataclass(frozen=True, slots=True)
class Tile:
    """One figure of the page's head: what, how much, and of what or against what."""

    what: str
    value: str
    detail: str


@dataclass(frozen=True, slots=True)
class Worst:
    """The largest stated error of some channels, in percent of that channel's standard deviation."""

    channel: str
    percent: float


@dataclass(frozen=True, slots=True)
class BondRow:
    """One bond's accounts.

    Args:
        name: Of the bond.
        transferred: Energy through it [J].
        residual: Energy that the coupling made (+) or lost [J].
        percent: The residual in percent of the energy transferred.
        acceptable: Whether the residual is small enough.
        coupled: Local errors of what its ends assumed of each other; None where the run has none.
    """

    name: str
    transferred: float
    residual: float
    percent: float
    acceptable: bool
    coupled: Coupled | None


def bond_rows(result: Result) -> tuple[BondRow, ...]:
    """Return the accounts of every bond."""
    return tuple(
        BondRow(name, e.transferred, e.residual, 100.0 * e.relative, e.acceptable, result.coupled.get(name))
        for name, e in result.energy.items()
    )


def verdict(result: Result, system: System, stop: float) -> Verdict:
    """Return whether a run that should have come to `stop` [s] can be used, and how large its coupling error is."""
    ports, any_channel = worst(result.stated_error, decisive(system)), worst(result.stated_error)
    stated = _stated(ports, any_channel)
    if faults := [*_faults(result, ports or any_channel, stop)]:
        return Verdict("bad", "This result is not to be used:", f"{'; '.join(faults)}{stated and f'; {stated}'}.")
    if not result.acceptable:
        return Verdict("bad", "This result is not to be used:", f"see the notes{stated and f'; {stated}'}.")
    if not stated:
        reason = f"its coupling error is not stated, because one run at one step cannot tell it ({_HOW_TO_KNOW})."
        return Verdict("open", "This result passed the run's own checks, but is to be used with care:", reason)
    return Verdict("good", "This result can be used:", f"{stated}.")


def worst(stated: Mapping[str, float], among: Iterable[str] | None = None) -> Worst | None:
    """Return the largest error that is known, among some channels; None where there is none."""
    chosen = stated if among is None else stated.keys() & set(among)
    known = {name: stated[name] for name in chosen if isfinite(stated[name])}
    return max(
        (Worst(name, value) for name, value in known.items()), key=lambda w: (w.percent, w.channel), default=None
    )


def tiles(result: Result, system: System) -> tuple[Tile, ...]:
    """Return the figures of the page's head."""
    return tuple(_tiles(result, worst(result.stated_error, decisive(system)), worst(result.stated_error)))


def _tiles(result: Result, ports: Worst | None, any_channel: Worst | None) -> Iterator[Tile]:
    if ports and ports != any_channel:
        yield Tile("Coupling error (bonds, tires)", percent(ports.percent), ports.channel)
    if any_channel:
        yield Tile("Coupling error (all channels)", percent(any_channel.percent), any_channel.channel)
    else:
        yield Tile("Coupling error", "not stated", "one run at one step")
    if result.energy:
        name = max(result.energy, key=lambda bond: abs(result.energy[bond].relative))
        share = percent(100.0 * result.energy[name].relative)
        yield Tile("Energy residual, worst bond", share, f"{name}; limit {100.0 * LIMIT:g} %")
    yield Tile("Coupling step", _step(result), f"{result.scheme or result.algorithm}, steps: {result.steps}")
    yield Tile("Simulated", f"{float(result.series.time[-1]):g} s", f"in {figure(result.seconds, 3)} s")


def notes(result: Result) -> tuple[str, ...]:
    """Return what else the reader should know; the run's own notes first."""
    return tuple(note.replace(" %", "\N{NO-BREAK SPACE}%") for note in (*result.notes, *_notes(result)))


def _stated(ports: Worst | None, any_channel: Worst | None) -> str:
    if any_channel is None:
        return ""
    begin = "the stated coupling error is at most"
    if ports is None or ports == any_channel:
        return f"{begin} {percent(any_channel.percent)} of a channel's standard deviation ({any_channel.channel})"
    return (
        f"{begin} {percent(ports.percent)} of a signal's standard deviation in bonds and tire forces "
        f"({ports.channel}), and {percent(any_channel.percent)} in the worst of all channels ({any_channel.channel})"
    )


def _faults(result: Result, ports: Worst | None, stop: float) -> Iterator[str]:
    if result.partial:
        yield f"the run ended early, at {float(result.series.time[-1]):g} s of {stop:g} s"
    too_large = ports is not None and ports.percent > LARGEST_ERROR
    if too_large:
        yield f"the coupling error is above {LARGEST_ERROR:g} %"
    elif not result.converged:
        yield "it did not converge (see the notes)"
    bad = [row for row in bond_rows(result) if not row.acceptable]
    if bad:
        row = max(bad, key=lambda row: abs(row.percent))
        others = f", and {len(bad) - 1} more bonds are beyond the limit" if len(bad) > 1 else ""
        yield f"the coupling made or lost {percent(abs(row.percent))} of the energy through bond {row.name}{others}"


def _notes(result: Result) -> Iterator[str]:
    if result.settling and result.series.time[-1] <= result.settling:
        yield f"the run ended within its settling time ({result.settling:g} s): statistics and spectra are of all of it"
    for shock, share in result.share_beyond_fit.items():
        if share > 0.0:
            yield f"{shock} is beyond its fitted velocities {share:.1%} of the time"
    for tire, off in result.share_tire_off.items():
        if off:
            yield f"{tire} is below zero load {off:.1%} of the time: the tire lifts off"
    if unknown := [tire for tire, off in result.share_tire_off.items() if off is None]:
        yield f"no static load is given for {listed(unknown)}: lift-off cannot be told"
    if result.held_direct:
        yield (
            "outputs that follow, without delay, an input that was held over each step: "
            f"{listed(result.held_direct)}; their error is proportional to the step"
        )


def facts(result: Result) -> tuple[tuple[str, str], ...]:
    """Return how the run went, as pairs of what and how much."""
    return tuple(_facts(result))


def _facts(result: Result) -> Iterator[tuple[str, str]]:
    first, last = float(result.series.time[0]), float(result.series.time[-1])
    yield "Time", f"{first:g} to {last:g} s{', ended early (partial)' if result.partial else ''}"
    yield "Settling, left out of statistics and spectra", f"{result.settling:g} s"
    yield "Algorithm", f"{result.algorithm}, which took {result.scheme}" if result.scheme else result.algorithm
    yield "Order of the components", listed(result.order)
    yield "Converged", "yes" if result.converged else "no"
    yield "Coupling step", f"{_step(result)}; the largest was {1e3 * (result.largest_step or result.step):g} ms"
    yield "Steps", f"{result.steps}, {result.rejected_steps} more rejected"
    yield "Iterations of implicit steps", f"{result.iterations}"
    yield "Evaluations until the coupled start agreed", f"{result.equilibrium_sweeps}"
    yield "Recorded", f"{len(result.series.names)} channels, {len(result.series)} samples each"
    yield "Computed in", f"{figure(result.seconds, 3)} s, of which {figure(result.stepping_seconds, 3)} s in steps"


def _step(result: Result) -> str:
    return f"{1e3 * result.step:.4g} ms"
