"""Fit of a shock over its adjusters and temperature: the shock file, the errors of each file, and the verdict."""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from eightpost.array_types import Array
from eightpost.errors import InputError, ParameterError
from eightpost.ident.shock.fit import fit_of, screened_runs
from eightpost.ident.shock.law_fit import Choices, has_own_recipe
from eightpost.ident.shock.problem import JointFit
from eightpost.ident.shock.result import ShockFit, Story, result_of
from eightpost.ident.shock.runs import Runs, prepare_runs
from eightpost.ident.shock.settings_table import SettingsTable
from eightpost.ident.shock.simulation import simulate
from eightpost.ident.shock.verdict import RULES, error_reason
from eightpost.report.console import Table, console_table, right, unbroken
from eightpost.rig.dyno_test import DynoTest
from eightpost.shock import LAWS, Axis, Settings, Shock, ShockLaw, StaticCurve, Term, fit_parameters, own_parameters
from eightpost.shock.curve import KNOTS
from eightpost.shock.file import setting_text
from eightpost.shock.settings import LAGGED_SLOPE, TEMPERATURE
from eightpost.validity import Validity, judged
from eightpost.verdict import Reason, Verdict

# ==== Division of the curves into effects of the adjusters: main effects, then those of combinations =================

#: Singular values of the effects below this share of the largest cannot be determined.
_NO_INFORMATION = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Effects:
    """Values at the reference setting and their changes."""

    reference: Array  #: Values (P,) at the reference setting.
    terms: tuple[Term, ...]  #: Changes with the settings.
    #: Remainder (G, P) that the terms do not describe, for each measured setting; 0 except in scattered tests.
    left: Array


def effects_of(axes: Sequence[Axis], settings: Sequence[tuple[float, ...]], values: Array) -> Effects:
    """Return the effects of axes on values.

    If every setting of each axis was measured with the others at their reference, these measurements are the main
    effects, and other combinations add terms of their own. Otherwise the main effects are fitted to all settings by
    least squares, and combinations add nothing.

    Raises:
        InputError: The settings do not separate the effects of the axes.
    """
    design = _design(axes, settings)
    one_at_a_time = np.array([len(_changed(axes, setting)) for setting in settings]) <= 1
    is_complete = int(one_at_a_time.sum()) == design.shape[1]
    used = one_at_a_time if is_complete else np.ones(len(settings), dtype=bool)
    _check_rank(axes, design[used])
    found, *_ = np.linalg.lstsq(design[used], values[used], rcond=None)
    terms, start = [], 1
    for axis in axes:
        rows = np.zeros((len(axis.nodes), values.shape[1]))
        others = [k for k, node in enumerate(axis.nodes) if node != axis.reference]
        rows[others] = found[start : start + len(others)]
        start += len(others)
        terms.append(_term((axis.name,), rows))
    left = values - design @ found
    if is_complete:
        left = np.where(one_at_a_time[:, None], 0.0, left)
        for size in range(2, len(axes) + 1):
            for places in itertools.combinations(range(len(axes)), size):
                terms += _combined(axes, places, settings, left)
    return Effects(found[0], tuple(terms), left)


def _design(axes: Sequence[Axis], settings: Sequence[tuple[float, ...]]) -> Array:
    """Return the matrix (G, 1 + nodes) of the main effects; the effect of a reference is 0."""
    columns = [np.ones(len(settings))]
    for number, axis in enumerate(axes):
        here = np.array([setting[number] for setting in settings])
        columns += [(here == node).astype(float) for node in axis.nodes if node != axis.reference]
    return np.array(columns).T


def _check_rank(axes: Sequence[Axis], design: Array) -> None:
    _, strength, directions = np.linalg.svd(design, full_matrices=True)
    rank = int(np.sum(strength > _NO_INFORMATION * strength[0]))
    if rank == design.shape[1]:
        return
    loose = np.abs(directions[rank:]).max(axis=0) > 1e-6
    owners = ["the reference", *(a.name for a in axes for node in a.nodes if node != a.reference)]
    names = list(dict.fromkeys(name for name, free in zip(owners, loose, strict=True) if free))
    raise InputError(
        f"these files do not separate the effects of {', '.join(names)}: they change together; measure each adjuster "
        "also with the others at their reference"
    )


def _combined(
    axes: Sequence[Axis], places: tuple[int, ...], settings: Sequence[tuple[float, ...]], left: Array
) -> list[Term]:
    """Return the term of a combination of axes, and subtract it from what is left; none if it was not measured."""
    nodes = [axes[place].nodes for place in places]
    combinations = list(itertools.product(*nodes))
    rows = np.zeros((len(combinations), left.shape[1]))
    owned = [k for k, setting in enumerate(settings) if _changed(axes, setting) == set(places)]
    if not owned:
        return []
    for k in owned:
        rows[combinations.index(tuple(settings[k][place] for place in places))] = left[k]
        left[k] = 0.0
    term = _term(tuple(axes[place].name for place in places), rows)
    _subtract(axes, places, combinations, rows, settings, left)
    return [term]


def _changed(axes: Sequence[Axis], setting: Sequence[float]) -> set[int]:
    """Return the numbers of the axes that are not at their reference."""
    return {i for i, (value, axis) in enumerate(zip(setting, axes, strict=True)) if value != axis.reference}


def _subtract(
    axes: Sequence[Axis],
    places: tuple[int, ...],
    combinations: Sequence[tuple[float, ...]],
    rows: Array,
    settings: Sequence[tuple[float, ...]],
    left: Array,
) -> None:
    """Subtract a term from what is left at settings in which further axes differ from their reference."""
    for k, setting in enumerate(settings):
        if set(places) < _changed(axes, setting):
            left[k] -= rows[combinations.index(tuple(setting[place] for place in places))]


def _term(names: tuple[str, ...], rows: Array) -> Term:
    return Term(names, tuple(tuple(row) for row in rows.tolist()))


# ==== The result =====================================================================================================

#: A file should reach this share of the highest speed of all files on each side.
_FAST = 0.8

#: Deviation of a file's level from that of the shock that is reported, as a share of the force's standard deviation.
_OTHER_LEVEL = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class SettingGroup:
    """All files of one setting."""

    setting: tuple[float, ...]  #: Value per axis.
    tests: tuple[DynoTest, ...]  #: Records.
    names: tuple[str, ...]  #: Names of the files.


@dataclass(frozen=True, slots=True, eq=False)
class SettingsFit:
    """A shock fitted over its settings."""

    shock: Shock  #: Shock that `write_shock` writes.
    groups: tuple[SettingGroup, ...]  #: Files of each setting.
    fits: tuple[ShockFit, ...]  #: Fit of each setting, in the order of `groups`.
    #: Error with which the other settings predict each setting's records, in percent of the force's standard deviation
    #: and without the level; None where the others do not surround it.
    predicted: tuple[float | None, ...]
    joint: JointFit  #: Joint fit.
    seconds: float  #: Computing time [s].

    @property
    def settings(self) -> Settings:
        """The settings section of the shock."""
        assert self.shock.settings is not None  # set by `fit_settings`
        return self.shock.settings

    @property
    def verdict(self) -> Verdict:
        """Whether the shock can be used, and why (docs/reference/verdict.md)."""
        assert self.shock.validity is not None
        return self.shock.validity.verdict


#: Laws that can be fitted: their parameters are numbers with bounds of their own, or the law has a recipe of its own.
_OVER_SETTINGS = tuple(
    name
    for name, law in LAWS.items()
    if own_parameters(law) == tuple(p.name for p in fit_parameters(law)) or has_own_recipe(name)
)


def fit_settings(
    table: SettingsTable,
    *,
    law: str | None = None,
    gas: str | None = None,
    robust: str = "auto",
    segment: tuple[float, float] | None = None,
    cutoff: float | None = None,
) -> SettingsFit:
    """Fit all files of a table together: one law, a curve on the same knots for each setting.

    Args:
        table: Files and settings.
        law: Name of the law; None: that of the table, else `hysteresis`.
        gas: Treatment of the gas force; None: that of the table.
        robust: Treatment of outliers.
        segment: Start and end [s] of each record.
        cutoff: Cutoff frequency of the low-pass [Hz].

    Raises:
        InputError: The settings do not separate the effects of the adjusters.
        ParameterError: An option is unknown or does not suit the records.
    """
    started = time.perf_counter()
    choices = Choices(gas=gas or table.gas, robust=robust)  # type: ignore[arg-type]
    law = choices.law(law or table.law)
    if law not in _OVER_SETTINGS:
        raise ParameterError(
            f"law {law!r} cannot be fitted over settings, because its file does not declare how its own parameters are "
            f"fitted; use one of {', '.join(_OVER_SETTINGS)}"
        )
    groups = _grouped(table)

    def prepared(tests: Sequence[DynoTest]) -> Runs:
        return prepare_runs(tests, segment=segment, cutoff=cutoff)

    with threadpool_limits(1, "blas"):
        screened = [
            screened_runs(list(g.tests), prepared) if choices.is_screened else (prepared(g.tests), 0, [])
            for g in groups
        ]
        fitted = fit_of([runs for runs, _, _ in screened], law, choices).fit
        joint = fitted.solution()
        joint = replace(joint, notes=(*fitted.notes, *joint.notes))
        fits = tuple(_fits(groups, joint, screened, choices.gas))
        parameters, values = _values(table.axes, groups, joint)
        effects = effects_of(table.axes, [group.setting for group in groups], values)
        settings = _settings(table.axes, groups, parameters, effects, joint)
        reference = _reference_law(joint, groups, table.axes, effects)
        predicted = tuple(_predicted(settings, reference, groups, k, values, joint) for k in range(len(groups)))
        shock = _shock(table, fits, groups, joint, settings, reference, values, predicted)
    return SettingsFit(shock, groups, fits, predicted, joint, time.perf_counter() - started)


def _grouped(table: SettingsTable) -> tuple[SettingGroup, ...]:
    groups = []
    for setting in sorted(set(table.settings)):
        here = [k for k, other in enumerate(table.settings) if other == setting]
        tests = tuple(test for k in here for test in table.tests[k])
        groups.append(SettingGroup(setting, tests, tuple(table.files[k].name for k in here)))
    return tuple(groups)


def _fits(
    groups: Sequence[SettingGroup], joint: JointFit, screened: Sequence[tuple[Runs, int, list[str]]], gas: str
) -> Iterator[ShockFit]:
    for number, (group, (runs, spikes, notes)) in enumerate(zip(groups, screened, strict=True)):
        story = Story("joint", gas, ", ".join(group.names), (*runs.changes, *notes), spikes)
        yield result_of(group.tests, joint.solution(number), story, 0.0)


# ---- From the curves to the effects of the adjusters ----------------------------------------------------------------


def _values(axes: Sequence[Axis], groups: Sequence[SettingGroup], joint: JointFit) -> tuple[tuple[str, ...], Array]:
    """Return the names of the varying parameters and the values (G, P) of each setting, as in `Settings.terms`."""
    numbers = range(len(groups))
    slopes = np.array([joint.slopes(number) for number in numbers])
    lagged = [found for number in numbers if (found := joint.lagged_slopes(number)) is not None]
    preload = _preload(axes, groups, np.array([joint.law(number).port.gas_preload for number in numbers]))
    names = (LAGGED_SLOPE,) if lagged else ()
    return names, np.hstack([slopes, *([np.array(lagged)] if lagged else []), preload[:, None]])


def _preload(axes: Sequence[Axis], groups: Sequence[SettingGroup], measured: Array) -> Array:
    """Return the gas preload (G,) [N]: a straight line over the temperature; adjusters do not change it."""
    for number, axis in enumerate(axes):
        if axis.name == TEMPERATURE:
            temperature = np.array([group.setting[number] for group in groups]) - axis.reference
            slope, at_reference = np.polyfit(temperature, measured, 1)
            return np.asarray(at_reference + slope * temperature)
    return np.full(measured.size, measured.mean())


def _settings(
    axes: Sequence[Axis], groups: Sequence[SettingGroup], parameters: tuple[str, ...], effects: Effects, joint: JointFit
) -> Settings:
    """Return the settings section; what the effects leave unexplained widens the band of its setting."""
    design = joint.model.basis.subdivided(np.zeros(joint.model.basis.count))[0]
    left = _knot_forces(design, effects.left[:, :KNOTS])
    widths = [np.hypot(joint.half_width(k), left[k]) for k in range(len(groups))]
    return Settings(
        axes=tuple(axes),
        parameters=parameters,
        terms=effects.terms,
        tested=tuple(group.setting for group in groups),
        half_width=tuple(tuple(np.nan_to_num(width, nan=0.0).tolist()) for width in widths),
    )


def _knot_forces(velocity: Array, slopes: Array) -> Array:
    """Return the forces (G, 25) [N] at the knots for slopes (G, 25) [N.s/m]."""
    rises = 0.5 * (slopes[:, 1:] + slopes[:, :-1]) * np.diff(velocity)
    forces = np.concatenate([np.zeros((len(slopes), 1)), np.cumsum(rises, axis=1)], axis=1)
    return np.asarray(forces - forces[:, KNOTS // 2, None])


def _reference_law(joint: JointFit, groups: Sequence[SettingGroup], axes: Sequence[Axis], effects: Effects) -> ShockLaw:
    """Return the law at the reference setting: that of its files, or without files that of the effects."""
    reference = tuple(axis.reference for axis in axes)
    own = [number for number, group in enumerate(groups) if group.setting == reference]
    law = joint.law(own[0] if own else 0)
    if not own:
        law = _law_with(law, effects.reference)
    return replace(law, port=replace(law.port, gas_preload=float(effects.reference[-1])))


def _shock(
    table: SettingsTable,
    fits: Sequence[ShockFit],
    groups: Sequence[SettingGroup],
    joint: JointFit,
    settings: Settings,
    law: ShockLaw,
    values: Array,
    predicted: Sequence[float | None],
) -> Shock:
    reference = min(range(len(groups)), key=lambda k: len(_changed(table.axes, groups[k].setting)))
    base = fits[reference].shock
    # What is left of each file's level when its preload is that of the settings.
    left = np.array([joint.law(k).port.gas_preload for k in range(len(groups))]) - values[:, -1]
    if table.gas == "included":
        law = replace(law, port=base.law.port)
    percent = [fit.percent for fit in fits]
    static = [fit.shock.fit["percent_of_static_curve"] for fit in fits]
    fit: dict[str, Any] = dict(base.fit) | {
        "recipe": "settings",
        "runs": sum(len(group.tests) for group in groups),
        "percent": float(np.sqrt(np.mean(np.square(percent)))),
        "percent_of_static_curve": float(np.sqrt(np.mean(np.square(static)))),
        "percent_of_settings": {_label(table.axes, g.setting): p for g, p in zip(groups, percent, strict=True)},
        "changes": [*dict.fromkeys((*joint.notes, *(c for f in fits for c in f.changes)))],
        "warnings": [*dict.fromkeys(w for f in fits for w in f.warnings)],
    }  # fmt: skip
    doubts = Verdict((*_doubts(table, groups, joint, settings, law, left), *_prediction(groups, predicted)))
    verdict = Verdict.combined([*(fit.verdict for fit in fits), doubts])
    assert base.validity is not None
    inputs = dict.fromkeys((i["name"], i["sha256"]) for f in fits for i in f.shock.inputs)
    shock = Shock(
        name=table.name,
        law=law,
        conditions=dict(base.conditions) | {"clicks": _label(table.axes, settings.reference)},
        fit=fit,
        inputs=tuple({"name": name, "sha256": digest} for name, digest in inputs),
        validity=Validity(verdict, base.validity.ranges),
        settings=settings,
    )
    return judged(shock)


def _label(axes: Sequence[Axis], setting: Sequence[float]) -> str:
    return ", ".join(f"{axis.name} {value:.4g}" for axis, value in zip(axes, setting, strict=True))


# ---- Doubts ---------------------------------------------------------------------------------------------------------


def _doubts(
    table: SettingsTable,
    groups: Sequence[SettingGroup],
    joint: JointFit,
    settings: Settings,
    law: ShockLaw,
    left: Array,
) -> Iterator[Reason]:
    """Yield reasons: adjusters that act against their counting, files of another level, and slower ones."""
    shares = [abs(level) / model.runs.deviation for level, model in zip(left, joint.model.models, strict=True)]
    if max(shares) > _OTHER_LEVEL:
        worst = int(np.argmax(shares))
        yield RULES.reason(
            "doubt of the fit",
            "the level of the force differs from file to file, but no adjuster changes the gas force",
            figure=f"{left[worst]:+.3g} N from the mean of the files, {100.0 * shares[worst]:.3g} % of the force's "
            "standard deviation: the shock has the mean",
            origin=", ".join(groups[worst].names),
            remedy="measure all settings with the same gas pressure, position and zero of the load cell",
        )
    for axis in table.axes:
        yield from _counting(axis, settings, law, table.name)
    knots = joint.model.basis.knots
    for group, model in zip(groups, joint.model.models, strict=True):
        velocity = model.runs.velocity[model.runs.inside]
        share = min(float(velocity.max()) / knots[-1], float(velocity.min()) / knots[0])
        if share < _FAST:
            figure = f"{', '.join(group.names)}: {100.0 * share:.0f} % of the highest speed of all files on one side"
            yield RULES.reason(
                "doubt of the fit",
                "a file is slower than others, so its curve is not known at their speeds",
                figure=figure,
                origin=", ".join(group.names),
                remedy="measure all settings with the same speeds",
            )


def _counting(axis: Axis, settings: Settings, law: ShockLaw, origin: str) -> Iterator[Reason]:
    """Yield a doubt if clicks counted from hard raise the force, or the reverse."""
    words = axis.counted.lower()
    expected = -1 if "hard" in words or "closed" in words else 1 if "soft" in words or "open" in words else 0
    if not expected or not axis.is_whole:
        return
    number = settings.axes.index(axis)
    ends = []
    for node in (axis.nodes[0], axis.nodes[-1]):
        setting = list(settings.reference)
        setting[number] = node
        ends.append(float(np.ptp(settings.law_at(law, tuple(setting)).curve.knot_force)))
    if expected * (ends[1] - ends[0]) < 0.0:
        yield RULES.reason(
            "doubt of the fit",
            f"{axis.name} acts against its counting, {axis.counted}",
            figure=f"the force range changes from {ends[0]:.0f} N at {axis.nodes[0]:g} to {ends[1]:.0f} N at "
            f"{axis.nodes[-1]:g} clicks",
            origin=origin,
            remedy="check the counting in the table, and the names of the files",
        )


# ---- Prediction of each setting by the others -----------------------------------------------------------------------


def _prediction(groups: Sequence[SettingGroup], predicted: Sequence[float | None]) -> Iterator[Reason]:
    """Yield the reason of the setting that the other ones predict worst, if they surround one."""
    known = [(error, group) for error, group in zip(predicted, groups, strict=True) if error is not None]
    if known:
        error, group = max(known, key=lambda pair: pair[0])
        figure = f"held-out error {error:.3g} % of the force's standard deviation"
        origin = ", ".join(group.names)
        yield error_reason(error, "the other settings predict a setting", figure=figure, origin=origin)


def _predicted(
    settings: Settings, reference: ShockLaw, groups: Sequence[SettingGroup], number: int, values: Array, joint: JointFit
) -> float | None:
    """Return the error [%] with which the other settings' curves predict a setting; None outside of them."""
    kept = [k for k in range(len(groups)) if k != number]
    axes = []
    for i, axis in enumerate(settings.axes):
        nodes = tuple(sorted({groups[k].setting[i] for k in kept}))
        if not nodes[0] <= groups[number].setting[i] <= nodes[-1]:
            return None
        axes.append(replace(axis, nodes=nodes, reference=min(nodes, key=lambda n, a=axis: abs(n - a.reference))))  # type: ignore[misc]
    try:
        effects = effects_of(axes, [groups[k].setting for k in kept], values[kept])
    except InputError:  # the others alone do not separate the effects
        return None
    tested = tuple(groups[k].setting for k in kept)
    others = replace(
        settings, axes=tuple(axes), terms=effects.terms, tested=tested, half_width=((0.0,) * KNOTS,) * len(kept)
    )
    law = others.law_at(_law_with(reference, effects.reference), groups[number].setting)
    return held_out_percent(law, joint.model.models[number].runs)


def _law_with(law: ShockLaw, values: Array) -> ShockLaw:
    """Return a law with other slopes at the knots (25,) [N.s/m], also of its lagged part; values as in `_values`."""
    velocity, slopes = np.array(law.curve.knot_velocity), np.maximum(values[:KNOTS], 0.0)
    force = _knot_forces(velocity, slopes[None])[0]
    curve = StaticCurve.through_knots(law.curve.knot_velocity, tuple(force.tolist()), tuple(slopes.tolist()))
    own: dict[str, Any] = {}
    if hasattr(law, LAGGED_SLOPE):
        own[LAGGED_SLOPE] = tuple(np.clip(values[KNOTS : 2 * KNOTS], 0.0, slopes).tolist())
    return replace(law, curve=curve, **own)


def held_out_percent(law: ShockLaw, runs: Runs) -> float:
    """Return the error of a law over records, without their level, in percent of the force's standard deviation."""
    squares, count = 0.0, 0
    for prepared in runs.prepared:
        error = prepared.filtered(simulate(law, prepared.record))[prepared.inside] - prepared.measured
        squares += float(np.sum((error - error.mean()) ** 2))
        count += error.size
    return 100.0 * float(np.sqrt(squares / count)) / runs.deviation


# ---- Console table ------------------------------------------------------------------------------------------------


def settings_table(fit: SettingsFit) -> Table:
    """Return a table of the measured settings: error of the fit, and error with which the other settings predict it."""
    columns = [*unbroken("setting"), "files", *right("fit, % of std", "predicted by the others, % of std")]
    rows = [
        (
            setting_text(fit.settings, group.setting),
            ", ".join(group.names),
            f"{one.percent:.2f}",
            "-" if predicted is None else f"{predicted:.2f}",
        )
        for group, one, predicted in zip(fit.groups, fit.fits, fit.predicted, strict=True)
    ]
    return console_table(columns, rows, title=f"{fit.shock.name}: {fit.shock.law_name} over its settings")
