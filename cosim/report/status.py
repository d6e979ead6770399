"""Information about a run other than its verdict: figures, notes, status."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from math import isfinite

from cosim.energy import LIMIT
from cosim.report.figures import figure, listed, percent
from cosim.result import Coupled, Result


@dataclass(frozen=True, slots=True)
class Tile:
    """Figure in the page's head: its name, its value, and a detail such as the channel or the limit."""

    what: str
    value: str
    detail: str


@dataclass(frozen=True, slots=True)
class Worst:
    """Largest stated error of several channels, in percent of that channel's scale."""

    channel: str
    percent: float


@dataclass(frozen=True, slots=True)
class BondRow:
    """Energy and local errors of one bond.

    Args:
        name: Name of the bond.
        transferred: Energy through it [J].
        residual: Energy that the coupling added (+) or lost (-) [J].
        percent: Residual in percent of the energy transferred.
        acceptable: Whether the residual is small enough.
        coupled: Local errors of the values that its ends assumed of each other; None if not estimated.
    """

    name: str
    transferred: float
    residual: float
    percent: float
    acceptable: bool
    coupled: Coupled | None


def bond_rows(result: Result) -> tuple[BondRow, ...]:
    """Return energy and local errors of every bond."""
    return tuple(
        BondRow(name, e.transferred, e.residual, 100.0 * e.relative, e.acceptable, result.coupled.get(name))
        for name, e in result.energy.items()
    )


def worst(stated: Mapping[str, float], among: Iterable[str] | None = None) -> Worst | None:
    """Return the largest known error among some channels; None if no error is known."""
    chosen = stated if among is None else stated.keys() & set(among)
    known = {name: stated[name] for name in chosen if isfinite(stated[name])}
    return max(
        (Worst(name, value) for name, value in known.items()), key=lambda w: (w.percent, w.channel), default=None
    )


def tiles(result: Result) -> tuple[Tile, ...]:
    """Return the figures of the page's head."""
    return tuple(_tiles(result, worst(result.stated_error, result.decisive), worst(result.stated_error)))


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
    """Return all notes for the reader; the run's own notes first."""
    return tuple(note.replace(" %", "\N{NO-BREAK SPACE}%") for note in (*result.notes, *_notes(result)))


def _notes(result: Result) -> Iterator[str]:
    if result.settling and result.series.time[-1] <= result.settling:
        yield f"the run ended within its settling time ({result.settling:g} s): statistics and spectra use all of it"
    if result.held_direct:
        yield (
            "outputs that follow, without delay, an input that was held over each step: "
            f"{listed(result.held_direct)}; their error is proportional to the step"
        )


def facts(result: Result) -> tuple[tuple[str, str], ...]:
    """Return facts about the run, as pairs of name and value."""
    return tuple(_facts(result))


def _facts(result: Result) -> Iterator[tuple[str, str]]:
    first, last = float(result.series.time[0]), float(result.series.time[-1])
    yield "Time", f"{first:g} to {last:g} s{', ended early (partial)' if result.partial else ''}"
    yield "Settling, excluded from statistics and spectra", f"{result.settling:g} s"
    yield "Algorithm", f"{result.algorithm}, which used {result.scheme}" if result.scheme else result.algorithm
    yield "Order of the components", listed(result.order)
    yield "Converged", "yes" if result.converged else "no"
    yield "Coupling step", f"{_step(result)}; the largest was {1e3 * (result.largest_step or result.step):g} ms"
    yield "Steps", f"{result.steps}, {result.rejected_steps} more rejected"
    yield "Iterations of implicit steps", f"{result.iterations}"
    yield "Evaluations until the equilibrium start converged", f"{result.equilibrium_sweeps}"
    yield "Recorded", f"{len(result.series.names)} channels, {len(result.series)} samples each"
    yield "Computed in", f"{figure(result.seconds, 3)} s, of which {figure(result.stepping_seconds, 3)} s in steps"


def _step(result: Result) -> str:
    return f"{1e3 * result.step:.4g} ms"
