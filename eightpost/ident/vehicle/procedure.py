"""Verdict rules on the rig tests of an identification: long and large enough, tires on the ground, always the same car.

They read the records only, so they are the same for every recipe.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from eightpost.corners import channel
from eightpost.ident.preparation import Prepared
from eightpost.ident.vehicle.agreement import LIMITS, SIGNIFICANT, Change, compare_tests
from eightpost.ident.vehicle.experiment import Experiment, quantity
from eightpost.signals import TimeSeries
from eightpost.verdict import Grade, Reason, Rules, listed

ABOUT = "rig tests"

#: Equations per unknown that the response needs in a band; widths of the band [Hz] in which the response of a car
#: hardly varies, and in which it varies too much; correlation of an input of two tests above which it is the same [1].
_EQUATIONS, _WIDE, _TOO_WIDE, _SAME = 4.5, 0.8, 1.5, 0.7

#: Friction relative to the RMS of the shock force, and share of a test in which the shock hardly slides, above which
#: friction changes the car, and above which it holds the car [1]; velocity below which a shock hardly slides [m/s].
_RUBS, _HOLDS, _SLOW = (0.3, 0.2), (0.6, 0.3), 0.006

#: Part of its mean load at which a tire has lifted [1]; share of a test that matters, and that is too large [1].
_LIFTED, _SHORTLY, _OFTEN = 0.01, 0.001, 0.01


def _limits(kind: str) -> str:
    return ", ".join(f"{name} {100 * getattr(limit, kind):g} %" for name, limit in LIMITS.items())


RULES = Rules()

TOO_SHORT = RULES.add("tests far too short", ABOUT, Grade.NOT_USABLE,
    condition=f"the inputs can be distinguished only in bands wider than {_TOO_WIDE:g} Hz: {_EQUATIONS:g} (1 + inputs "
    f"/ tests) / duration, or {_EQUATIONS:g} (1 + inputs that are the same in all tests) / duration",
    why="resonances of a body are narrower",
    remedy="repeat the tests with the stated duration, or with another drive in each test",
)  # fmt: skip
SHORT = RULES.add("tests too short", ABOUT, Grade.LIMITED,
    condition=f"the same above {_WIDE:g} Hz",
    why="resonances of a body are as narrow",
    remedy="repeat the tests with the stated duration, or with another drive in each test",
)  # fmt: skip
HELD = RULES.add("friction holds the car", ABOUT, Grade.NOT_USABLE,
    condition=f"at a wheel, friction is above {100 * _HOLDS[0]:g} % of the RMS of the shock force, and the shock is "
    f"slower than {1e3 * _SLOW:g} mm/s for more than {100 * _HOLDS[1]:g} % of a test",
    why="a car that sticks is stiffer than one that slides",
    remedy="repeat the tests with roads as large as those of the track",
)  # fmt: skip
GENTLE = RULES.add("tests are gentle", ABOUT, Grade.LIMITED,
    condition=f"the same above {100 * _RUBS[0]:g} % for more than {100 * _RUBS[1]:g} % of a test",
    why="a car that sticks is stiffer than one that slides",
    remedy="repeat the tests with roads as large as those of the track",
)  # fmt: skip
OFTEN_LIFTED = RULES.add("tires often leave the ground", ABOUT, Grade.NOT_USABLE,
    condition=f"a tire is at {100 * _LIFTED:g} % of its mean load or less for more than {100 * _OFTEN:g} % of a test",
    why="the model has no such tires and is softer instead",
    remedy="repeat the tests with smaller roads",
)  # fmt: skip
LIFTED = RULES.add("tires leave the ground", ABOUT, Grade.LIMITED,
    condition=f"the same for more than {100 * _SHORTLY:g} % of a test",
    why="the model has no such tires and is softer instead",
    remedy="repeat the tests with smaller roads",
)  # fmt: skip
OTHER_CAR = RULES.add("the car changed much", ABOUT, Grade.NOT_USABLE,
    condition="between tests, or between the halves of a test, a quantity of the car changed by more than "
    f"{SIGNIFICANT:g} standard deviations and by at least: {_limits('unusable')}",
    why="the model is a mean of different cars",
    remedy="restore the car and repeat these tests",
)  # fmt: skip
CHANGED = RULES.add("the car changed", ABOUT, Grade.LIMITED,
    condition=f"the same by at least, between tests: {_limits('tests')}; between halves: {_limits('halves')}",
    why="differences between setups contain those of the car; sound cars stay below half of each limit",
    remedy="restore the car and repeat these tests",
)  # fmt: skip


def reasons_of_tests(prepared: Prepared, experiment: Experiment) -> tuple[Reason, ...]:
    """Return the reasons that the rig tests of an identification give.

    Tests in which friction holds the car are not compared with each other.
    """
    agreement = compare_tests(prepared.records, prepared.means)
    held = tuple(_held(prepared, agreement.rubbing))
    changes = () if held else tuple(_changed(change, prepared.names) for change in agreement.changes)
    return (*held, *changes, *_lifted(prepared), *_short(prepared, experiment))


def _changed(change: Change, names: Sequence[str]) -> Reason:
    rule = OTHER_CAR if change.is_unusable else CHANGED
    size = f"{change.where} {100 * change.size:+.0f} %"
    if change.quantity == "anti-roll bar":
        size += " of the wheel's rate"
    if change.within:
        count = len(change.tests)
        where, least = f"within {count} tests" if count > 1 else "within a test", LIMITS[change.quantity].halves
        figure = f"{size} from the first to the second half; limit {100 * least:g} %"
    else:
        others = listed(name for k, name in enumerate(names) if k not in change.tests)
        where, least = "between tests", LIMITS[change.quantity].tests
        figure = f"{size} from {others}; limit {100 * least:g} %"
    origin = listed(names[k] for k in change.tests)
    return rule.reason(f"the {change.quantity} changed {where}", figure=figure, origin=origin)


def _held(prepared: Prepared, rubbing: Mapping[str, float]) -> Iterator[Reason]:
    """Yield a reason if friction holds the wheel that rubs most."""
    if not rubbing:
        return
    corner = max(rubbing, key=lambda name: rubbing[name])
    slow = max(float(np.mean(np.abs(record[channel(corner, "velocity")]) < _SLOW)) for record in prepared.records)
    for rule, (rubs, sticks) in ((HELD, _HOLDS), (GENTLE, _RUBS)):
        if rubbing[corner] > rubs and slow > sticks:
            figure = (
                f"{corner}: friction {100 * rubbing[corner]:.0f} % of the shock force, slower than "
                f"{1e3 * _SLOW:g} mm/s for {100 * slow:.0f} % of the time; limits {100 * rubs:g} and {100 * sticks:g} %"
            )
            yield rule.reason("friction holds the car", figure=figure, origin=listed(prepared.names))
            return


def _lifted(prepared: Prepared) -> Iterator[Reason]:
    """Yield a reason if a tire lifts. Forces with a mean below their standard deviation are changes from rest."""
    worst: dict[str, tuple[float, str]] = {}
    for name, record, means in zip(prepared.names, prepared.records, prepared.means, strict=True):
        for tire, mean in means.items():
            if quantity(tire) == "tire_force" and tire in record and mean > record[tire].std():
                share = float(np.mean(record[tire] <= (_LIFTED - 1.0) * mean))
                worst[name] = max(worst.get(name, (0.0, "")), (share, tire))
    lifting = {name: found for name, found in worst.items() if found[0] > _SHORTLY}
    if lifting:
        share, tire = max(lifting.values())
        rule = OFTEN_LIFTED if share > _OFTEN else LIFTED
        figure = f"{tire} for {100 * share:.1f} % of the time; limits {100 * _SHORTLY:g} and {100 * _OFTEN:g} %"
        yield rule.reason("tires leave the ground", figure=figure, origin=listed(lifting))


def _short(prepared: Prepared, experiment: Experiment) -> Iterator[Reason]:
    records, count = prepared.records, len(experiment.inputs)
    shortest = min(records, key=lambda record: record.duration)
    same = sum(_is_same(records, name) for name in experiment.rig)
    equations = _EQUATIONS * (1.0 + max(count / len(records), same))
    if equations / shortest.duration > _WIDE:
        rule = TOO_SHORT if equations / shortest.duration > _TOO_WIDE else SHORT
        repeated = f", {same} of them the same in all tests," if same else ""
        figure = (
            f"{shortest.duration:.0f} s; {len(records)} tests with {count} inputs{repeated} need "
            f"{math.ceil(equations / _WIDE)} s"
        )
        yield rule.reason("the tests are too short", figure=figure, origin=prepared.names[records.index(shortest)])


def _is_same(records: Sequence[TimeSeries], name: str) -> bool:
    """Return whether an input is the same in all tests."""
    if len(records) < 2 or not all(name in record for record in records):
        return False
    size = min(map(len, records))
    return bool(np.min(np.corrcoef([record[name][:size] for record in records])[0]) > _SAME)
