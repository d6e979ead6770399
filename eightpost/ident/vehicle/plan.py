"""Plan of an identification: prepared records, baseline, static rating, the experiment, the verdict on the tests."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from operator import attrgetter
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import shift
from scipy.signal import resample_poly
from threadpoolctl import threadpool_limits

from eightpost.array_types import Array
from eightpost.corners import CORNERS, channel
from eightpost.errors import InputError, ParameterError
from eightpost.ident.preparation import Prepared
from eightpost.ident.vehicle.experiment import OTHER_SHOCK, Baseline, Experiment, find_baseline, port_slope, quantity
from eightpost.ident.vehicle.port_search import about_tests
from eightpost.ident.vehicle.simulation import law_force
from eightpost.ident.vehicle.static_rating import StaticRating, rate_tests
from eightpost.ident.vehicle.vehicle_fit import VehicleFit, with_validity
from eightpost.rig import RigTest
from eightpost.rig.motion import delay_of
from eightpost.shock import Shock
from eightpost.signals import TimeSeries
from eightpost.signals.filters import lowpass
from eightpost.verdict import Reason, Rules, listed

# ==== Agreement of rig tests: whether the car changed from test to test, or within a test ============================
# The balance of a wheel tells the parts of its suspension apart:
#
#     T = m a + m_o a_o + r F + r_o F_o + k2 x^2 + f_o s(v_o)  +  k x + k_o x_o + f s(v) + c,    s(v) = tanh(v / v_f)
#
# with the tire force T, hub accelerations a, shock forces F, displacements x and velocities v of the wheel and of the
# opposite one (o). The first terms are those of all tests. The springs k and k_o (an anti-roll bar), the friction f and
# the constant c are estimated for each half of each test; their covariance comes from the scatter of the balance over
# blocks of a few seconds, which are independent. No model of the car is needed, so every recipe has this check.
#
# Another shock at a wheel has another damping, part of which looks like friction or stiffness if rubber yields in
# series with it. So a wheel is compared between the tests that have the same shock there.

#: Velocity v_f of the friction [m/s], duration of a block [s], and smallest number of blocks in half a test.
_SLIDES, _BLOCK, _FEWEST = 0.006, 3.0, 16

#: Standard deviations above which a change is not noise [1]. It is high, as few blocks give the standard deviations.
SIGNIFICANT = 5.0

#: Friction is compared relative to at least this part of the RMS of the shock force [1].
_LEAST_FRICTION = 0.05

#: Number of terms of all tests, and of those of half a test: k, k_o, f, c.
_SHARED, _OWN = 6, 4

#: Channels of every wheel that a balance needs.
_NEEDED = ("tire_force", "hub_acceleration", "force", "displacement", "velocity")


class Limit(NamedTuple):
    """Relative changes [1] that matter."""

    tests: float  #: Between tests.
    halves: float  #: Between the halves of a test.
    unusable: float  #: Change from which the vehicle is not usable.


#: Limits by quantity. The change of an anti-roll bar is relative to the rate of the wheel.
LIMITS: Mapping[str, Limit] = {
    "friction": Limit(0.25, 0.10, 0.25),
    "spring rate": Limit(0.04, 0.04, 0.15),
    "anti-roll bar": Limit(0.03, 0.03, 0.15),
    "weight": Limit(0.01, 0.01, 0.10),
}


class Change(NamedTuple):
    """A change of a quantity of the car."""

    quantity: str  #: Key of `LIMITS`.
    where: str  #: Wheel or axle with the largest change.
    tests: tuple[int, ...]  #: Indices of the tests that differ from most tests, or in which the quantity changed.
    size: float  #: Largest relative change [1].
    within: bool  #: Whether the quantity changed within tests.

    @property
    def is_unusable(self) -> bool:
        """Whether the change is so large that the vehicle is not usable."""
        return abs(self.size) >= LIMITS[self.quantity].unusable


class Agreement(NamedTuple):
    """Comparison of tests."""

    changes: tuple[Change, ...]  #: Changes that are not noise and that matter.
    #: Friction relative to the RMS of the shock force [1] by wheel, median of the tests; empty if it is not known.
    rubbing: Mapping[str, float]


class _Relative(NamedTuple):
    """Relative values (tests, 2) of a quantity in the halves of the tests, and their standard deviations.

    `alike` tells which tests (tests,) can be compared with each other.
    """

    quantity: str
    where: str
    values: Array
    deviations: Array
    alike: NDArray[np.bool_]


def compare_tests(records: Sequence[TimeSeries], means: Sequence[Mapping[str, float]]) -> Agreement:
    """Compare the tests of a car, records without means, with each other, and the halves of each test."""
    relative, rubbing = list(_weights(records, means)), {}
    if all(channel(corner, name) in record for record in records for corner in CORNERS for name in _NEEDED):
        for place, corner in enumerate(CORNERS):
            values, rubbing[corner] = _relative(records, corner, CORNERS[place ^ 1])
            relative += values
    changes = []
    for name in LIMITS:
        if rows := [row for row in relative if row.quantity == name]:
            changes += [change for change in (_between(rows), _within(rows)) if change is not None]
    return Agreement(tuple(changes), rubbing)


def _between(rows: Sequence[_Relative]) -> Change | None:
    """Return the change of a quantity, known at several places, from the test that most tests agree with."""
    means = np.stack([np.where(row.alike, row.values.mean(axis=1), np.nan) for row in rows])
    deviations = np.stack([0.5 * np.hypot(*row.deviations.T) for row in rows])
    size = np.nan_to_num(means[:, :, None] - means[:, None, :])
    noise = np.hypot(deviations[:, :, None], deviations[:, None, :])
    size = _that_matters(size, noise, LIMITS[rows[0].quantity].tests)
    usual = int(np.argmin(size.any(axis=0).sum(axis=0)))
    return _largest(rows, size[:, :, usual], within=False)


def _within(rows: Sequence[_Relative]) -> Change | None:
    """Return the change of a quantity, known at several places, from the first to the second half of tests."""
    size = np.stack([row.values[:, 1] - row.values[:, 0] for row in rows])
    noise = np.stack([np.hypot(*row.deviations.T) for row in rows])
    return _largest(rows, _that_matters(size, noise, LIMITS[rows[0].quantity].halves), within=True)


def _that_matters(size: Array, noise: Array, least: float) -> Array:
    return np.where((np.abs(size) > least) & (np.abs(size) > SIGNIFICANT * noise), size, 0.0)


def _largest(rows: Sequence[_Relative], size: Array, *, within: bool) -> Change | None:
    """Return the largest of changes at places in tests (places, tests); None if all are 0."""
    place, test = divmod(int(np.argmax(np.abs(size))), size.shape[1])
    if size[place, test] == 0.0:
        return None
    tests = tuple(np.flatnonzero(size.any(axis=0)).tolist())
    return Change(rows[0].quantity, rows[place].where, tests, float(size[place, test]), within)


# ---- Weight on the axles --------------------------------------------------------------------------------------------


def _weights(records: Sequence[TimeSeries], means: Sequence[Mapping[str, float]]) -> Iterator[_Relative]:
    """Yield the weight on each axle: the mean tire forces without the mean loads.

    Tire forces whose means are below their standard deviations are changes from rest and cannot show it.
    """
    for axle, corners in (("front", CORNERS[:2]), ("rear", CORNERS[2:])):
        tires = [channel(corner, "tire_force") for corner in corners]
        known = [(record[name].std() if name in record else np.inf, mean.get(name, 0.0))
                 for record, mean in zip(records, means, strict=True) for name in tires]  # fmt: skip
        if any(mean <= deviation for deviation, mean in known):
            continue
        loads = [channel(corner, "aero") for corner in corners]
        held = np.array([sum(mean[n] for n in tires) - sum(mean.get(n, 0.0) for n in loads) for mean in means])
        halves = np.tile((held / np.median(held))[:, None], 2)
        yield _Relative("weight", axle, halves, np.zeros_like(halves), np.ones(len(means), dtype=np.bool_))


# ---- Balance of a wheel ---------------------------------------------------------------------------------------------


def _relative(records: Sequence[TimeSeries], corner: str, other: str) -> tuple[list[_Relative], float]:
    """Return the relative springs, anti-roll bar and friction of a wheel in the halves of the tests.

    Also return the median friction relative to the RMS of the shock force.
    """
    grams = [half for record in records for half in _halves(_terms(record, corner, other), record.sample_rate)]
    theta, covariance = _solved(grams)
    rate, opposite, friction, _ = np.median(theta, axis=0).tolist()
    force = float(np.mean([record[channel(corner, "force")].std() for record in records]))
    slopes = np.array([port_slope(record, corner) for record in records])
    alike = np.abs(slopes / np.median(slopes) - 1.0) < OTHER_SHOCK
    rubbing = math.copysign(max(abs(friction), _LEAST_FRICTION * force), rate)
    axle, rows = "front" if corner in CORNERS[:2] else "rear", []
    for term, where, weights, size in (
        ("spring rate", corner, (1.0, 1.0, 0.0, 0.0), rate + opposite),
        ("anti-roll bar", axle, (0.0, -1.0, 0.0, 0.0), rate),
        ("friction", corner, (0.0, 0.0, 1.0, 0.0), rubbing),
    ):
        w = np.array(weights) / size
        deviations = np.sqrt(np.einsum("kij,i,j->k", covariance, w, w))
        rows.append(_Relative(term, where, (theta @ w).reshape(-1, 2), deviations.reshape(-1, 2), alike))
    return rows, abs(friction) / force


def _terms(record: TimeSeries, corner: str, other: str) -> Array:
    """Return the terms of the balance (shared, own, tire force) as rows."""
    a, force, x, v = ([record[channel(place, name)] for place in (corner, other)] for name in _NEEDED[1:])
    shared = (*a, *force, x[0] ** 2, np.tanh(v[1] / _SLIDES))
    return np.stack([*shared, *x, np.tanh(v[0] / _SLIDES), np.ones(len(record)), record[channel(corner, "tire_force")]])


def _halves(terms: Array, rate: float) -> Iterator[Array]:
    """Yield the products of the terms in the blocks (B, n, n) of each half of a record."""
    for half in np.array_split(terms, 2, axis=1):
        blocks = max(_FEWEST, round(half.shape[1] / rate / _BLOCK))
        yield np.stack([block @ block.T for block in np.array_split(half, blocks, axis=1)])


def _solved(grams: Sequence[Array]) -> tuple[Array, Array]:
    """Return the own terms (H, 4) of H halves and their covariances (H, 4, 4), from products of the terms in blocks.

    The covariance is that of least squares with errors that are independent from block to block only (sandwich).
    """
    scale = np.sqrt(np.diag(sum(gram.sum(axis=0) for gram in grams)))
    count = _SHARED + _OWN * len(grams)
    normal, right = np.zeros((count, count)), np.zeros(count)
    parts = []
    for k, gram in enumerate(grams):
        at = np.r_[:_SHARED, _SHARED + _OWN * k : _SHARED + _OWN * (k + 1)]
        parts.append((at, gram / np.outer(scale, scale)))
        whole = parts[-1][1].sum(axis=0)
        normal[np.ix_(at, at)] += whole[:-1, :-1]
        right[at] += whole[:-1, -1]
    inverse = np.linalg.pinv(normal, hermitian=True)
    theta, scores = inverse @ right, []
    for at, blocks in parts:
        rows = np.zeros((len(blocks), count))
        rows[:, at] = blocks[:, :-1, -1] - blocks[:, :-1, :-1] @ theta[at]
        scores.append(rows * math.sqrt(len(blocks) / (len(blocks) - _OWN)))
    moved = np.concatenate(scores) @ inverse
    units = np.tile(scale[-1] / scale[_SHARED:-1], len(grams))
    own = (theta[_SHARED:] * units).reshape(-1, _OWN)
    moved = (moved[:, _SHARED:] * units).reshape(len(moved), -1, _OWN)
    return own, np.einsum("bki,bkj->kij", moved, moved)


# ==== Verdict on the tests: long and large enough, tires on the ground, always the same car ==========================
# They read the records only, so they are the same for every recipe.

ABOUT = "rig tests"

#: Equations per unknown that the response needs in a band; widths of the band [Hz] in which the response of a car
#: hardly varies, and in which it varies too much; correlation of an input of two tests above which it is the same [1].
_EQUATIONS, _WIDE, _TOO_WIDE, _SAME = 4.5, 0.8, 1.5, 0.7

#: Friction relative to the RMS of the shock force above which predictions are worse [1]; velocity below which a shock
#: hardly slides [m/s].
_RUBS, _SLOW = 0.25, 0.006

#: Friction relative to the RMS of the shock force, and share of a test in which the shock hardly slides, above which
#: tests cannot be compared, and above which friction holds the car [1].
_STICKS, _HOLDS = (0.3, 0.2), (0.6, 0.3)

#: Part of its mean load at which a tire has lifted [1]; share of a test that matters, and that is too large [1].
_LIFTED, _SHORTLY, _OFTEN = 0.01, 0.001, 0.01


def _limits(kind: str) -> str:
    return ", ".join(f"{name} {100 * getattr(limit, kind):g} %" for name, limit in LIMITS.items())


RULES = Rules.read(
    Path(__file__).with_suffix(".txt"), ABOUT, too_wide=_TOO_WIDE, equations=_EQUATIONS, wide=_WIDE,
    holds=100 * _HOLDS[0], slow=1000.0 * _SLOW, holds_time=100 * _HOLDS[1], rubs=100 * _RUBS,
    lifted=100 * _LIFTED, often=100 * _OFTEN, shortly=100 * _SHORTLY,
    significant=SIGNIFICANT, unusable=_limits("unusable"), tests=_limits("tests"), halves=_limits("halves"),
)  # fmt: skip


def reasons_of_tests(prepared: Prepared, experiment: Experiment) -> tuple[Reason, ...]:
    """Return the reasons that the rig tests of an identification give.

    Tests in which friction is large and the shocks hardly slide are not compared with each other.
    """
    agreement = compare_tests(prepared.records, prepared.means)
    corner, rubs = max(agreement.rubbing.items(), key=lambda item: item[1], default=("", 0.0))
    slow = _slow(prepared.records, corner) if rubs > _RUBS else 0.0
    held = _friction(prepared, corner, rubs, slow) if rubs > _RUBS else ()
    sticks = rubs > _STICKS[0] and slow > _STICKS[1]
    changes = () if sticks else tuple(_changed(change, prepared.names) for change in agreement.changes)
    return (*held, *changes, *_lifted(prepared), *_short(prepared, experiment))


def _changed(change: Change, names: Sequence[str]) -> Reason:
    least = LIMITS[change.quantity].halves if change.within else LIMITS[change.quantity].tests
    size = f"{change.where} {100 * change.size:+.0f} %"
    if change.quantity == "anti-roll bar":
        size += " of the wheel's rate"
    if change.within:
        where, count = "from the first to the second half", len(change.tests)
        between = f"within {count} tests" if count > 1 else "within a test"
    else:
        where = f"from {listed(name for k, name in enumerate(names) if k not in change.tests)}"
        between = "between tests"
    return RULES.reason(
        "the car changed much" if change.is_unusable else "the car changed",
        f"the {change.quantity} changed {between}",
        figure=f"{size} {where}; limit {100 * least:g} %",
        origin=listed(names[k] for k in change.tests),
    )


def _slow(records: Sequence[TimeSeries], corner: str) -> float:
    """Return the largest share of a test in which a shock hardly slides."""
    return max(float(np.mean(np.abs(record[channel(corner, "velocity")]) < _SLOW)) for record in records)


def _friction(prepared: Prepared, corner: str, rubs: float, slow: float) -> tuple[Reason]:
    share, origin = f"{corner}: friction {100 * rubs:.0f} % of the shock force", listed(prepared.names)
    if rubs > _HOLDS[0] and slow > _HOLDS[1]:
        figure = (
            f"{share}, slower than {1e3 * _SLOW:g} mm/s for {100 * slow:.0f} % of the time; limits {100 * _HOLDS[0]:g} "
            f"and {100 * _HOLDS[1]:g} %"
        )
        return (RULES.reason("friction holds the car", "friction holds the car", figure, origin=origin),)
    figure = f"{share}; limit {100 * _RUBS:g} %"
    return (RULES.reason("friction is large", "friction is large beside the shock force", figure, origin=origin),)


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
        rule = "tires often leave the ground" if share > _OFTEN else "tires leave the ground"
        figure = f"{tire} for {100 * share:.1f} % of the time; limits {100 * _SHORTLY:g} and {100 * _OFTEN:g} %"
        yield RULES.reason(rule, "tires leave the ground", figure, origin=listed(lifting))


def _short(prepared: Prepared, experiment: Experiment) -> Iterator[Reason]:
    records, count = prepared.records, len(experiment.inputs)
    shortest = min(records, key=lambda record: record.duration)
    same = sum(_is_same(records, name) for name in experiment.rig)
    equations = _EQUATIONS * (1.0 + max(count / len(records), same))
    if equations / shortest.duration > _WIDE:
        rule = "tests far too short" if equations / shortest.duration > _TOO_WIDE else "tests too short"
        repeated = f", {same} of them the same in all tests," if same else ""
        figure = (
            f"{shortest.duration:.0f} s; {len(records)} tests with {count} inputs{repeated} need "
            f"{math.ceil(equations / _WIDE)} s"
        )
        yield RULES.reason(rule, "the tests are too short", figure, origin=prepared.names[records.index(shortest)])


def _is_same(records: Sequence[TimeSeries], name: str) -> bool:
    """Return whether an input is the same in all tests."""
    if len(records) < 2 or not all(name in record for record in records):
        return False
    size = min(map(len, records))
    return bool(np.min(np.corrcoef(np.stack([record[name][:size] for record in records]))[0]) > _SAME)


# ==== Shock forces in step with the laws of their shocks, and hub accelerometers with the balance of their wheels ====
# A measured force is late if its logger is, or if rubber is in series with a shock whose potentiometer spans both. A
# study couples the law without this delay t to the car, where it then acts as a mass of -c t at a damping c.

#: Part of a force that the law of its shock leaves unexplained at most [1]; highest frequency of the comparison [Hz].
_UNEXPLAINED, _HIGHEST = 0.2, 25.0

#: Factor of the sample rate for the comparison: the parabola through three correlations at 125 Hz is off by a tenth.
_FINER = 8


class _Late(NamedTuple):
    """Delay of a force behind a law [s], and the part that remains in step [1]."""

    seconds: float
    left: float
    shock: str


def _advanced(record: TimeSeries, name: str, seconds: float) -> Array:
    """Return a channel (N,) without a delay."""
    return np.asarray(shift(record[name], -seconds * record.sample_rate, order=5, mode="nearest"))


def _late(record: TimeSeries, port: str, shock: Shock) -> _Late:
    force, rate = record[channel(port, "force")], record.sample_rate
    expected = law_force(record, port, shock.law)
    compared = lowpass(np.stack((force, expected)), rate, _HIGHEST)
    own, other = resample_poly(compared, _FINER, 1, axis=1)
    late = _Late(delay_of(own, other, _FINER * rate, band=_HIGHEST).seconds, 0.0, shock.name)
    rest = _advanced(record, channel(port, "force"), late.seconds) - expected
    return late._replace(left=float(rest.std() / force.std()))


def forces_in_step(prepared: Prepared, shocks: Sequence[Shock], baseline: int) -> tuple[Prepared, str]:
    """Return prepared tests with the shock forces in step with the laws of `shocks`, and a sentence on their delays.

    In each test, the law of a port is the one that explains its force best. Where none explains it, the force has the
    delay of the baseline test.

    Raises:
        InputError: No law explains the force of a port in the baseline test.
    """
    tests = [{port: min((_late(record, port, shock) for shock in shocks), key=attrgetter("left"))
              for port in prepared.corners} for record in prepared.records]  # fmt: skip
    usual, records = tests[baseline], []
    port, worst = max(usual.items(), key=lambda item: item[1].left)
    if worst.left > _UNEXPLAINED:
        raise InputError(
            f"{prepared.names[baseline]}: no given shock has the force of {channel(port, 'force')}; the nearest one, "
            f"{worst.shock}, leaves {100.0 * worst.left:.0f} % of it, more than {100.0 * _UNEXPLAINED:.0f} %: give the "
            "shocks of this test"
        )
    for record, found in zip(prepared.records, tests, strict=True):
        for port, late in found.items():
            name, right = channel(port, "force"), late if late.left <= _UNEXPLAINED else usual[port]
            record = record.with_channel(name, "N", _advanced(record, name, right.seconds))  # noqa: PLW2901
        records.append(record)
    delays = listed(f"{port} {1e3 * late.seconds:.2f} ms ({late.shock})".strip() for port, late in usual.items())
    return replace(prepared, records=tuple(records)), f"Shock forces were advanced to be in step with laws: {delays}."


#: Distance of the values whose difference is a derivative, in samples: neighbours at 125 Hz are too far apart.
_NEAR = 0.1


def hubs_in_step(prepared: Prepared) -> tuple[Prepared, str]:
    """Return prepared tests with the hub accelerometers in step with the other channels, and a sentence on their delay.

    It is the median over tests and wheels of the delay t in the balance of a wheel, with shock forces in step:

        T = m (a + t a') + r F + k x + c v

    A model of late accelerations has too low levels of them above its band, and less accurate poles. Tests without the
    channels, or in which the balance leaves more than a fifth of all tire forces, remain; the sentence is empty.
    """
    wheels = [(record, corner) for record in prepared.records for corner in prepared.corners
              if all(channel(corner, name) in record for name in _NEEDED)]  # fmt: skip
    delays = [late for late in (_hub_delay(*wheel) for wheel in wheels) if late is not None]
    if not delays:
        return prepared, ""
    seconds, records = float(np.median(delays)), []
    for record in prepared.records:
        for name in [name for name in record.names if quantity(name) == "hub_acceleration"]:
            record = record.with_channel(name, record.unit(name), _advanced(record, name, seconds))  # noqa: PLW2901
        records.append(record)
    note = f"Hub accelerometers were advanced by {1e3 * seconds:.2f} ms to be in step with the balance of the wheels."
    return replace(prepared, records=tuple(records)), note


def _hub_delay(record: TimeSeries, corner: str) -> float | None:
    """Return the delay of a hub accelerometer [s]; None if the balance of the wheel leaves too much unexplained."""
    rows = np.stack([record[channel(corner, name)] for name in _NEEDED])
    tire, *terms = lowpass(rows, record.sample_rate, _HIGHEST)
    near, far = (shift(terms[0], part, order=5, mode="nearest") for part in (_NEAR, -_NEAR))
    matrix = np.stack([*terms, (far - near) * (0.5 / _NEAR) * record.sample_rate], axis=1)
    found = np.linalg.lstsq(matrix, tire, rcond=None)[0]
    left = float(np.std(tire - matrix @ found) / np.std(tire))
    return float(found[-1] / found[0]) if left <= _UNEXPLAINED else None


# ==== Recipes ========================================================================================================

#: Modules of the recipes by name, each with its recipe as `RECIPE`; a module is imported when its recipe is requested.
#: `eightpost identify` repeats the names.
RECIPES = {
    "boggs": "eightpost.ident.vehicle.boggs",
    "common-poles": "eightpost.ident.vehicle.common_poles",
    "grey-box": "eightpost.ident.grey_box.recipe",
}


class VehicleRecipe(Protocol):
    """Method of identifying a vehicle from rig tests: a frozen dataclass of settings."""

    def identify(self, tests: Sequence[TimeSeries], experiment: Experiment) -> VehicleFit:
        """Identify a vehicle.

        Raises:
            InputError: Tests and experiment do not match, or the effects of the inputs cannot be separated.
        """
        ...


def recipe(name: str) -> VehicleRecipe:
    """Return the recipe with the given name and its default settings; ParameterError: the name is unknown."""
    if name not in RECIPES:
        raise ParameterError(f"there is no recipe {name!r}; use one of {', '.join(RECIPES)}")
    chosen: VehicleRecipe = import_module(RECIPES[name]).RECIPE
    return chosen


# ==== The plan =======================================================================================================


@dataclass(frozen=True, slots=True, eq=False)
class IdentificationPlan:
    """Everything that a recipe needs to identify a vehicle."""

    prepared: Prepared  #: Prepared records.
    baseline: Baseline  #: Baseline test and order of the others.
    experiment: Experiment  #: Inputs, outputs and baseline damping.
    rating: StaticRating | None = None  #: Static rating; None if there are no static tests.
    notes: tuple[str, ...] = ()  #: What was corrected in the records, a sentence each.

    def identify(self, name: str) -> VehicleFit:
        """Identify the vehicle with the recipe of this name; the vehicle carries the verdict.

        Raises:
            ParameterError: There is no recipe with this name.
            InputError: The effects of the inputs cannot be separated.
            TooShortError: The records have too few frequency bins.
        """
        records = [self.prepared.records[k] for k in self.baseline.order]
        with threadpool_limits(1, "blas"):  # threads that wait for each other would take longer than the work
            fit = recipe(name).identify(records, self.experiment)
        loads = {load: self.experiment.means.get(load, 0.0) for load in self.experiment.loads}
        fit = replace(fit, vehicle=about_tests(fit.vehicle, loads), notes=(*self.notes, *fit.notes))
        reasons = (*self.prepared.reasons, *reasons_of_tests(self.prepared, self.experiment))
        return with_validity(fit, reasons)


def plan_identification(
    prepared: Prepared,
    *,
    name: str = "vehicle",
    baseline: int | None = None,
    damping: float | None = None,
    outputs: Sequence[str] = (),
    static: Iterable[RigTest] = (),
    shocks: Sequence[Shock] = (),
) -> IdentificationPlan:
    """Plan an identification.

    The default baseline test is found from the damping of the shocks; the default damping about which the vehicle is
    identified [N.s/m] is the slope of each baseline shock; without `outputs` the model has all possible ones. With
    `shocks`, forces are brought in step with their laws, and hub accelerometers with the balance of their wheels.

    Raises:
        InputError: The effects of the shocks cannot be separated, or no given shock has the force of a port.
        ParameterError: The records lack a channel, or there is no such output.
    """
    reference, notes = find_baseline(prepared.records, prepared.corners, test=baseline), list[str]()
    if shocks:
        prepared, forces = forces_in_step(prepared, shocks, reference.test)
        prepared, hubs = hubs_in_step(prepared)
        reference = find_baseline(prepared.records, prepared.corners, test=reference.test)
        notes += filter(None, (forces, hubs))
    experiment = reference.experiment(prepared, name=name, damping=damping, outputs=outputs)
    held = list(static)
    if not held:
        return IdentificationPlan(prepared, reference, experiment, notes=tuple(notes))
    rating = rate_tests(held, list(experiment.loads))
    known = {n: v for n, v in rating.zero.items() if n in experiment.outputs}
    return IdentificationPlan(prepared, reference, replace(experiment, static=known), rating, tuple(notes))
