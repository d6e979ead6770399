"""Verdict on a drive file iteration."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from eightpost.drivefile.iteration import PATIENCE, REJECTED, Outcome, Problem, Status
from eightpost.drivefile.pass_errors import PassErrors
from eightpost.verdict import Grade, Reason, Rules, Verdict

ABOUT = "drive file"

#: Error of a mean displacement, relative to the RMS of the displacement, above which it is reported [1].
_MEAN = 0.5

RULES = Rules()

REPRODUCED = RULES.add("target reproduced", ABOUT, Grade.USABLE,
    condition="the best pass has errors within the accepted ones (default: accelerations 2.5 %, displacements 1 % of "
    "their RMS)",
    why="two runs of the same drive file on the virtual rig differ by about 1 %, because friction drifts",
    remedy="use best_drive for all setups; repeat it once to see how far two runs of it differ",
)  # fmt: skip
RUNNING = RULES.add("not finished", ABOUT, Grade.UNKNOWN,
    condition="the best pass has larger errors than the accepted ones, and the last passes reduced the error",
    why="the error still decreases from pass to pass",
    remedy="play the next drive file and give its record (eightpost drivefile next --record)",
)  # fmt: skip
STALLED = RULES.add("no progress", ABOUT, Grade.NOT_USABLE,
    condition="the last three passes reduced the smallest error by less than 5 %, and it is above the accepted one",
    why="further passes will not help: a limit, noise, drift or an unreachable channel determines the error",
    remedy="see the bands with the largest errors; remove unreachable channels (--channels), lower --high, or accept a "
    "larger error",
)  # fmt: skip
DIVERGED = RULES.add("divergence", ABOUT, Grade.NOT_USABLE,
    condition=f"{PATIENCE} passes in a row have more than {REJECTED:g} times the smallest error, although the gain was "
    "halved after each",
    why="the response of the car differs too much from the model for any gain",
    remedy="check sensors, signs and channel map; identify the car on this rig with these shocks; start with a lower "
    "--gain",
)  # fmt: skip
AT_LIMIT = RULES.add("limit of an actuator", ABOUT, Grade.LIMITED,
    condition="a limit of stroke, velocity or force changed the drive of the best pass or the next drive",
    why="the target is not reachable at these times",
    remedy="check the limits (--stroke, --velocity, --force), slow trends of the track record, and --high",
)  # fmt: skip
MEANS = RULES.add("mean displacement", ABOUT, Grade.LIMITED,
    condition=f"a mean displacement of the best pass differs from the target by more than {100.0 * _MEAN:g} % of the "
    "RMS displacement",
    why="progressive springs and stops respond differently about another mean",
    remedy="set the potentiometers on the rig to zero in the same state of the car as on the track",
)  # fmt: skip


_OF_STATUS = {
    Status.CONVERGED: REPRODUCED, Status.RUNNING: RUNNING, Status.STALLED: STALLED, Status.DIVERGED: DIVERGED,
}  # fmt: skip


def iteration_verdict(problem: Problem, outcome: Outcome, hits: Sequence[str] = ()) -> Verdict:
    """Return the verdict on an iteration.

    Args:
        problem: Target, response and settings.
        outcome: State of the iteration.
        hits: Sentences on the limits that changed the drive of the best pass.
    """
    return Verdict(_reasons(problem, outcome, hits))


def _reasons(problem: Problem, outcome: Outcome, hits: Sequence[str]) -> Iterator[Reason]:
    rule, number = _OF_STATUS[outcome.status], outcome.best + 1
    place = f"best pass {number} of {len(outcome.errors)}" if number else f"{len(outcome.errors)} passes"
    statement = {
        Status.CONVERGED: "the rig reproduces the target",
        Status.RUNNING: "the target is not reproduced yet",
        Status.STALLED: "the target is not reproduced, and the error no longer decreases",
        Status.DIVERGED: "the iteration diverged",
    }[outcome.status]
    figure = error_summary(outcome.errors[outcome.best]) if number else "no pass is better than a rig at rest"
    yield rule.reason(statement, figure=figure, origin=place)
    for hit in dict.fromkeys((*hits, *map(str, outcome.hits))):
        yield AT_LIMIT.reason("the drive is limited", figure=hit, origin="drive file")
    if number and problem.settings.has_means:
        yield from _mean_reasons(problem, outcome.errors[outcome.best], place)


def _mean_reasons(problem: Problem, errors: PassErrors, place: str) -> Iterator[Reason]:
    for name, unit in zip(problem.target.names, problem.target.units, strict=True):
        if unit == "m" and abs(errors.means[name]) > _MEAN:
            figure = f"{name} {100.0 * errors.means[name]:+.0f} % of its RMS; limit {100.0 * _MEAN:g} %"
            yield MEANS.reason("a mean displacement is not reproduced", figure=figure, origin=place)


def error_summary(errors: PassErrors) -> str:
    """Return the error of each quantity and the worst channel as a phrase."""
    quantities = dict.fromkeys(name.rpartition(".")[2] for name in errors.channels)
    parts = [f"{q.replace('_', ' ')} {100.0 * (errors.of_quantity(q) or 0.0):.2f} %" for q in quantities]
    name, value = errors.worst
    return f"{', '.join(parts)}; worst {name} {100.0 * value:.2f} %"
