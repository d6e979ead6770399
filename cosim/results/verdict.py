"""Verdict on a run, from its coupling, energies, convergence and limits."""

from __future__ import annotations

from collections.abc import Iterator
from math import isfinite
from typing import TYPE_CHECKING

from cosim.results.validity import LARGEST_SHARE, NOTABLE_SHARE, model_reasons
from eightpost.verdict import Grade, Reason, Rule, Verdict

if TYPE_CHECKING:
    from cosim.results.result import Result
    from eightpost.signals import TimeSeries

#: Largest coupling error of a result that can be used [% of the scale].
LARGEST_ERROR = 5.0

#: Residual, as a share of the energy transferred, above which a second run at half the step is recommended.
DOUBTFUL_RESIDUAL = 1e-2

#: Largest residual, as a share of the energy transferred, of a result that can be used. With ramped values the residual
#: was about the error of the shock velocity: 0.25 % at 1 ms, 0.9 % at 2 ms, 3.4 % at 4 ms (docs/coupling.md).
LARGEST_RESIDUAL = 0.05

#: Coupling error up to which a run without a tolerance of its own is good [% of the scale].
GOOD_ERROR = 1.0

COUPLING_ERROR = Rule(
    "coupling error too large", "coupling", Grade.NOT_USABLE,
    condition=f"stated error of a bond's velocity or force or of a tire force above {LARGEST_ERROR:g} % of its "
    "scale (its standard deviation, with a floor)",
    why="setups of one car differ by a few percent in these signals: a larger error ranks the scheme, not the setups",
    remedy="give a smaller coupling step, or use the default algorithm",
)  # fmt: skip
COUPLING_TOLERANCE = Rule(
    "coupling tolerance not met", "coupling", Grade.LIMITED,
    condition="the same error above the tolerance (default 0.2 %); for a run at a given step above "
    f"{GOOD_ERROR:g} %",
    why="the error is known, but it is larger than requested",
    remedy="compare only differences of several times this error, or give a smaller step",
)  # fmt: skip
COUPLING_GOOD = Rule(
    "coupling error small", "coupling", Grade.USABLE,
    condition="the same error within the tolerance",
    why="the error is known and as small as requested",
    remedy="nothing",
)  # fmt: skip
COUPLING_UNKNOWN = Rule(
    "coupling error not stated", "coupling", Grade.UNKNOWN,
    condition="the run states no error",
    why="a single run at one step does not show the error of the coupling",
    remedy="leave out --no-comparison (compared=False), or use the default algorithm; both state the error",
)  # fmt: skip
COUPLING_NONE = Rule(
    "nothing is coupled", "coupling", Grade.USABLE,
    condition="the system has no bonds and no error is stated",
    why="components that only follow a drive, or feed each other one way, have no coupling loop",
    remedy="nothing",
)  # fmt: skip
LOCAL_ERROR = Rule(
    "local error of a bond", "coupling", Grade.NOT_USABLE,
    condition=f"the values that the ends of a bond assume of each other are wrong by more than {LARGEST_ERROR:g} % of "
    "their scale in each step",
    why="two runs that alternate from step to step can agree at the recorded points; the error within the steps shows "
    "this, and therefore overrides the stated error",
    remedy="give a smaller coupling step, or use the implicit algorithm",
)  # fmt: skip
CHANNEL_ERROR = Rule(
    "coupling error of other channels", "coupling", Grade.LIMITED,
    condition=f"stated error of any other recorded channel above {LARGEST_ERROR:g} %",
    why="accelerations contain the jumps of forces from step to step, which forces and velocities average out",
    remedy="do not use these channels, or give a smaller coupling step",
)  # fmt: skip
ENERGY_RESIDUAL = Rule(
    "energy residual too large", "energy", Grade.NOT_USABLE,
    condition=f"the coupling adds or loses more than {100 * LARGEST_RESIDUAL:g} % of the energy through a bond",
    why="the residual was about the error of the shock velocity: 0.25 % at 1 ms, 3.4 % at 4 ms (docs/coupling.md)",
    remedy="give a smaller coupling step",
)  # fmt: skip
ENERGY_DOUBTFUL = Rule(
    "energy residual notable", "energy", Grade.LIMITED,
    condition=f"the coupling adds or loses more than {100 * DOUBTFUL_RESIDUAL:g} % of the energy through a bond",
    why="sound runs stay under 1 % (docs/coupling.md)",
    remedy="halve the coupling step and compare",
)  # fmt: skip
ENERGY_GOOD = Rule(
    "energy residual small", "energy", Grade.USABLE,
    condition=f"no bond adds or loses more than {100 * DOUBTFUL_RESIDUAL:g} % of its energy",
    why="sound runs stay under 1 % (docs/coupling.md)",
    remedy="nothing",
)  # fmt: skip
NOT_CONVERGED = Rule(
    "not converged", "convergence", Grade.NOT_USABLE,
    condition="the equilibrium start was not found, or steps did not converge",
    why="the result starts from, or contains, values that do not satisfy the equations of the system",
    remedy="give a smaller coupling step; the notes say which part did not converge",
)  # fmt: skip
ENDED_EARLY = Rule(
    "ended early", "convergence", Grade.NOT_USABLE,
    condition="the run was interrupted, or could not continue",
    why="means, RMS values and spectra are those of a shorter part of the drive than requested",
    remedy="run it again; if the step became too small, allow a smaller step or a larger tolerance",
)  # fmt: skip
CONVERGED = Rule(
    "converged", "convergence", Grade.USABLE,
    condition="the equilibrium start was found, every step converged, and the run reached its stop time",
    why="the run is complete",
    remedy="nothing",
)  # fmt: skip
MOSTLY_BEYOND_FIT = Rule(
    "mostly outside the fitted velocities", "range of the models", Grade.NOT_USABLE,
    condition=f"a shock spends more than {100 * LARGEST_SHARE:g} % of the time outside the velocities that it was "
    "fitted on, or dissipates that share of its energy there",
    why="outside the record the curve is a straight continuation that no measurement supports: if the forces there are "
    "wrong by half, a tenth of the dissipated energy is wrong, which is more than setups of one car differ by",
    remedy="measure the shock at the velocities of this drive and fit it again",
)  # fmt: skip
BEYOND_FIT = Rule(
    "outside the fitted velocities", "range of the models", Grade.LIMITED,
    condition=f"the same, above {100 * NOTABLE_SHARE:g} %",
    why="peaks depend on the continuation of the curve; below 1 %, forces that are wrong by half there change the "
    "dissipated energy by less than 0.5 %, which is about how far two runs of one shock on a rig differ",
    remedy="do not use peak forces; measure the shock at the velocities of this drive for more",
)  # fmt: skip
WITHIN_FIT = Rule(
    "within the fitted velocities", "range of the models", Grade.USABLE,
    condition=f"at most {100 * NOTABLE_SHARE:g} % of the time and of the energy is outside",
    why="see above",
    remedy="nothing",
)  # fmt: skip
MOSTLY_TIRE_OFF = Rule(
    "tire mostly off the ground", "range of the models", Grade.NOT_USABLE,
    condition=f"a tire is below zero load for more than {100 * LARGEST_SHARE:g} % of the time",
    why="a linear car pulls on the road there: the motion of that corner is not real meanwhile",
    remedy="use a smaller drive, or a car model whose tires can lift off",
)  # fmt: skip
TIRE_OFF = Rule(
    "tire off the ground", "range of the models", Grade.LIMITED,
    condition="a tire is below zero load at all",
    why="a linear car pulls on the road there",
    remedy="do not use tire forces and motions near these times",
)  # fmt: skip
STATIC_LOAD_UNKNOWN = Rule(
    "static tire force not given", "range of the models", Grade.LIMITED,
    condition="a car states no static tire force",
    why="lift-off of a tire cannot be detected, and tire forces are changes about an unknown load",
    remedy="give the car's static tire forces (parameter static_tire_force)",
)  # fmt: skip

RULES: tuple[Rule, ...] = tuple(value for value in list(globals().values()) if isinstance(value, Rule))


def verdict_of(result: Result) -> Verdict:
    """Return the verdict on a run."""
    return Verdict(
        (
            *_coupling(result),
            *_energy(result),
            *_convergence(result),
            *_fitted(result),
            *_tires(result),
            *model_reasons(result.models, _settled(result)),
        )
    )


def _coupling(result: Result) -> Iterator[Reason]:
    yield from _local(result)
    known = result.stated_error
    decisive = {name: error for name, error in known.items() if name in result.decisive} or known
    if not decisive or not all(map(isfinite, decisive.values())):
        yield _not_stated(result)
        return
    yield _stated(result, *max(decisive.items(), key=lambda item: item[1]))
    others = {name: e for name, e in known.items() if name not in decisive and e > LARGEST_ERROR}
    if others:
        name = max(others, key=lambda each: others[each])
        yield CHANNEL_ERROR.reason(
            f"the coupling error of {_counted(len(others), 'other channel')} is too large; largest: {name}",
            figure=f"{_percent(others[name])}; limit {LARGEST_ERROR:g} %",
            origin="coupling error per channel",
        )


def _local(result: Result) -> Iterator[Reason]:
    for bond, coupled in result.coupled.items():
        if not coupled.percent <= LARGEST_ERROR:
            yield LOCAL_ERROR.reason(
                "the values that the ends of a bond assume of each other are wrong in every step",
                figure=f"{_percent(coupled.percent)} of the scale; limit {LARGEST_ERROR:g} %",
                origin=f"bond {bond}",
            )


def _not_stated(result: Result) -> Reason:
    if not result.energy and not result.coupled:
        return COUPLING_NONE.reason("there is no coupling loop", figure="0 bonds", origin="the system")
    return COUPLING_UNKNOWN.reason(
        "the coupling error is not stated",
        figure=f"known for 0 of {len(result.series.names)} channels",
        origin=f"{result.algorithm} at {1e3 * result.step:g} ms",
    )


def _stated(result: Result, name: str, error: float) -> Reason:
    limit = result.tolerance or GOOD_ERROR
    origin = f"channel {name}, {result.scheme or result.algorithm} at {1e3 * result.step:g} ms"
    if error > LARGEST_ERROR:
        figure = f"{_percent(error)} of the scale; limit {LARGEST_ERROR:g} %"
        return COUPLING_ERROR.reason("the coupling error is too large", figure=figure, origin=origin)
    named = "tolerance" if result.tolerance else "good up to"
    figure = f"{_percent(error)} of the scale; {named} {limit:g} %"
    if error > limit:
        return COUPLING_TOLERANCE.reason("the coupling error is larger than requested", figure=figure, origin=origin)
    return COUPLING_GOOD.reason("the coupling error is small", figure=figure, origin=origin)


def _energy(result: Result) -> Iterator[Reason]:
    shares = {bond: abs(energy.relative) for bond, energy in result.energy.items()}
    bad = {bond: share for bond, share in shares.items() if not share <= DOUBTFUL_RESIDUAL}
    for bond, share in bad.items():
        rule = ENERGY_DOUBTFUL if share <= LARGEST_RESIDUAL else ENERGY_RESIDUAL
        yield rule.reason(
            "the coupling adds or loses energy",
            figure=f"{share:.2%} of the energy transferred; limit {LARGEST_RESIDUAL:.0%}",
            origin=f"bond {bond}",
        )
    if shares and not bad:
        worst = max(shares, key=lambda bond: shares[bond])
        yield ENERGY_GOOD.reason(
            "the coupling conserves energy",
            figure=f"{shares[worst]:.2%}; limit {LARGEST_RESIDUAL:.0%}",
            origin=f"bond {worst}",
        )


def _convergence(result: Result) -> Iterator[Reason]:
    end = f"{float(result.series.time[-1]):g} s" if len(result.series) else "0 s"
    if result.partial:
        yield ENDED_EARLY.reason("the run ended early", figure=f"at {end}", origin=result.algorithm)
    if not result.converged:
        notes = result.notes[0] if result.notes else "no note"
        yield NOT_CONVERGED.reason("the run did not converge", figure=notes, origin=result.algorithm)
    if result.converged and not result.partial:
        yield CONVERGED.reason("the run reached its stop time", figure=f"{result.steps} steps, {end}", origin="the run")


def _fitted(result: Result) -> Iterator[Reason]:
    for shock, time in result.share_beyond_fit.items():
        energy = _energy_beyond(result, shock)
        share = max(time, energy or 0.0)
        rule = WITHIN_FIT if share <= NOTABLE_SHARE else BEYOND_FIT if share <= LARGEST_SHARE else MOSTLY_BEYOND_FIT
        within = "stays within" if rule is WITHIN_FIT else "leaves"
        dissipated = "" if energy is None else f", {energy:.1%} of its energy"
        yield rule.reason(
            f"the shock {within} the velocities that it was fitted on",
            figure=f"outside {time:.1%} of the time{dissipated}; limits {NOTABLE_SHARE:.0%} and {LARGEST_SHARE:.0%}",
            origin=f"component {shock}",
        )


def _energy_beyond(result: Result, shock: str) -> float | None:
    """Return the share of a shock's dissipated energy outside its fitted velocities; None if not recorded."""
    names = (f"{shock}.dissipated_power", f"{shock}.beyond_fit")
    if not set(names) <= set(result.series.names):
        return None
    settled = _settled(result)
    power, beyond = (abs(settled[name]) for name in names)
    total = float(power.sum())
    return float(power[beyond > 0.5].sum()) / total if total else 0.0


def _settled(result: Result) -> TimeSeries:
    return result.settled() if result.series.time[-1] > result.settling else result.series


def _tires(result: Result) -> Iterator[Reason]:
    for tire, off in result.share_tire_off.items():
        if off is None:
            yield STATIC_LOAD_UNKNOWN.reason(
                "lift-off of tires cannot be detected: no static tire force is given", figure="0 N", origin=tire
            )
        elif off > 0.0:
            rule = TIRE_OFF if off <= LARGEST_SHARE else MOSTLY_TIRE_OFF
            figure = f"{off:.1%} of the time; limit {LARGEST_SHARE:.0%}"
            yield rule.reason("a tire is off the ground", figure=figure, origin=tire)


def _counted(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"


def _percent(value: float) -> str:
    return f"{value:.2g} %" if abs(value) < 10.0 else f"{value:.0f} %"
