"""Verdict on a run: coupling error, energy, convergence, and the limits of its models."""

from __future__ import annotations

from collections.abc import Iterator
from math import isfinite

from cosim.results import rules
from cosim.results.limits import limit_reasons
from cosim.results.run_data import RunData
from cosim.results.validity import model_reasons
from eightpost.verdict import Reason, Verdict


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
