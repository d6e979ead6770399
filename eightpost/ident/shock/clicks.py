"""The inverse problem: settings of the adjusters at which a shock's static curve comes closest to a target."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from eightpost import units
from eightpost.array_types import Array
from eightpost.errors import FileFormatError, InputError, MissingUnitError, ParameterError
from eightpost.ident.shock.curve import KnotBasis, curve_forces
from eightpost.report.console import Table, console_table, right, unbroken
from eightpost.shock import Axis, Settings, Shock, read_shock
from eightpost.shock.curve import KNOTS
from eightpost.shock.file import force_half_width, setting_text
from eightpost.shock.settings import is_tested, node_weights, setting_of
from eightpost.signals import read_record
from eightpost.signals.table_text import letters_of

# ---- A static curve to reach: from a table or from a shock file -----------------------------------------------------

#: Names of the columns of a curve, in lower case letters.
_COLUMNS = {
    "velocity": ({"v", "vel", "velocity", "speed", "dampervelocity", "shockvelocity"}, "m/s"),
    "force": ({"f", "force", "load", "damperforce", "shockforce"}, "N"),
}

#: Number of speeds at which the curve of a shock file is compared.
_POINTS = 121


@dataclass(frozen=True, slots=True, eq=False)
class TargetCurve:
    """A static curve to reach."""

    name: str  #: Name of the file.
    velocity: Array  #: Velocities (M,) [m/s], positive in compression.
    force: Array  #: Forces (M,) [N] without gas force.
    notes: tuple[str, ...] = ()  #: Notes on how it was read, one sentence each.


def read_target(path: str | Path) -> TargetCurve:
    """Read a target curve: a shock file, or a table with the columns velocity and force, with units.

    A force at zero velocity in a table is taken for gas force and subtracted.

    Raises:
        FileFormatError: The file has no such columns.
        MissingUnitError: A column has no unit.
        InputError: The velocities do not include both strokes.
    """
    path = Path(path)
    if path.suffix == ".json":
        curve = read_shock(path).law.curve
        velocity = np.linspace(-curve.rebound_speed, curve.compression_speed, _POINTS)
        return TargetCurve(path.name, velocity, curve_forces(curve, velocity))
    record = read_record(path)
    record.log_notes()
    found = {}
    for wanted, (names, unit) in _COLUMNS.items():
        places = [i for i, name in enumerate(record.names) if letters_of(name) in names]
        if not places:
            known = ", ".join(record.names)
            raise FileFormatError(f"has no column {wanted!r}; it has: {known}", path=path)
        given = record.units[places[0]]
        if given is None:
            raise MissingUnitError(
                f"has no unit; write it in the header, e.g. {wanted} [{unit}]", path=path, channel=wanted
            )
        values = np.asarray(record.column(places[0]), dtype=np.float64)
        found[wanted] = np.asarray(units.convert(values, given, unit), dtype=np.float64)
    return _target(path, found["velocity"], found["force"])


def _target(path: Path, velocity: Array, force: Array) -> TargetCurve:
    order = np.argsort(velocity, kind="stable")
    velocity, force = velocity[order], force[order]
    if not (np.isfinite(velocity).all() and np.isfinite(force).all()) or velocity.size < 3:
        raise FileFormatError("needs three or more points of finite numbers", path=path)
    if not velocity[0] <= 0.0 <= velocity[-1]:
        return TargetCurve(path.name, velocity, force)
    offset = float(np.interp(0.0, velocity, force))
    notes = (
        (f"{offset:.4g} N at zero velocity is taken for gas force and subtracted from the target",) if offset else ()
    )
    return TargetCurve(path.name, velocity, force - offset, notes)


# ---- Search for the settings ----------------------------------------------------------------------------------------

#: Whether a constant force over all speeds is left out of the errors, or counts.
Level = Literal["free", "kept"]

#: Maximum number of combinations; all are computed, this many at once.
MOST_COMBINATIONS, _CHUNK = 20_000_000, 20_000

#: Ends of the speed ranges [m/s] of the stated errors.
SPEEDS = (0.05, 0.15, 0.4)

#: Share of the mean square error above which a constant force is most of it.
_MOSTLY = 0.7

#: Deviation that counts as reached besides the band of the model, as a share of the target's largest force.
_TOLERANCE = 0.02


@dataclass(frozen=True, slots=True)
class RangeError:
    """Error of a setting over a range of speeds."""

    name: str  #: Name of the range, such as `compression 0.05 to 0.15 m/s`.
    mean: float  #: Mean of setting minus target [N].
    rms: float  #: RMS of setting minus target [N].
    percent: float  #: RMS in percent of the RMS of the target there.


@dataclass(frozen=True, slots=True)
class ClickChoice:
    """A setting of the adjusters and its distance from the target."""

    setting: tuple[float, ...]  #: Value per axis.
    text: str  #: Setting as text.
    rms: float  #: RMS error over the target's speeds [N].
    percent: float  #: The same, in percent of the RMS of the target.
    ranges: tuple[RangeError, ...]  #: Errors over ranges of speed.
    is_tested: bool  #: Whether the combination of the adjusters was measured.
    is_same: bool  #: Whether its curve is within the band of the best setting.


@dataclass(frozen=True, slots=True)
class ClickAnswer:
    """The answer to the inverse problem."""

    choices: tuple[ClickChoice, ...]  #: The best setting, then the next best ones.
    combinations: int  #: Number of possible settings.
    #: Sentences about speeds at which no setting reaches the target; empty if the best setting is within the model's
    #: band and 2 % of the largest force everywhere.
    unreachable: tuple[str, ...]
    notes: tuple[str, ...]  #: Further notes, one sentence each.

    @property
    def best(self) -> ClickChoice:
        """The best setting."""
        return self.choices[0]

    @property
    def is_reachable(self) -> bool:
        """Whether the best setting reaches the target."""
        return not self.unreachable


def answer_table(answer: ClickAnswer) -> Table:
    """Return a table of the best settings with their errors per range of speed [N]."""
    names = [part.name for part in answer.best.ranges]
    columns = [*unbroken("setting"), *right("RMS, N", "% of target"), *right(*names), "note"]
    rows = [
        (
            choice.text,
            f"{choice.rms:.0f}",
            f"{choice.percent:.1f}",
            *(f"{part.mean:+.0f}" for part in choice.ranges),
            _note(choice, answer.best),
        )
        for choice in answer.choices
    ]
    return console_table(columns, rows, title="Mean of setting minus target [N]; equal: within the band of the first")


def _note(choice: ClickChoice, best: ClickChoice) -> str:
    notes = {"untested": not choice.is_tested, "equal": choice.is_same and choice is not best}
    return ", ".join(note for note, holds in notes.items() if holds)


def best_clicks(
    shock: Shock,
    target: TargetCurve,
    *,
    level: Level = "kept",
    fixed: Mapping[str, float] | None = None,
    speeds: tuple[float, float] | None = None,
    count: int = 5,
) -> ClickAnswer:
    """Return the settings of the adjusters whose curves are closest to a target.

    The distance is the RMS of the force error over the target's speeds, each weighted by the range of velocity that it
    stands for. Speeds beyond the shock's measured ones are left out.

    Args:
        shock: Shock with settings.
        target: Curve to reach.
        level: `kept`: all errors count; `free`: a constant force over all speeds, such as gas force, does not.
        fixed: Settings by name of an axis that are not searched; the temperature is at its reference by default.
        speeds: Lowest and highest speed that count [m/s]; default all.
        count: Number of settings to return.

    Raises:
        ParameterError: The shock has no settings or too many combinations, or a fixed setting is unknown.
        InputError: No speed of the target is among the shock's measured ones.
    """
    if shock.settings is None:
        raise ParameterError(f"shock {shock.name!r} has no adjusters; fit files of several settings first")
    curve = shock.law.curve
    used = (target.velocity >= -curve.rebound_speed) & (target.velocity <= curve.compression_speed)
    if speeds is not None:
        used &= (np.abs(target.velocity) >= speeds[0]) & (np.abs(target.velocity) <= speeds[1])
    if not (used & (target.velocity != 0.0)).any():
        raise InputError(f"{target.name}: none of its speeds is among those of shock {shock.name!r} that count")
    left_out = int(target.velocity.size - used.sum())
    notes = list(target.notes)
    if left_out:
        notes.append(f"{left_out} of {target.velocity.size} points of the target are beyond the speeds that count")
    search = _Search.of(shock, TargetCurve(target.name, target.velocity[used], target.force[used]), fixed or {}, level)
    if search.combinations > MOST_COMBINATIONS:
        raise ParameterError(
            f"shock {shock.name!r} has {search.combinations} combinations of settings, more than {MOST_COMBINATIONS}; "
            "fix an adjuster (--fix NAME=CLICKS)"
        )
    found = search.best(count)
    choices = tuple(search.choice(setting, found[0]) for setting in found)
    notes += search.level_note(found[0])
    return ClickAnswer(choices, search.combinations, tuple(search.unreachable(found[0])), tuple(notes))


@dataclass(frozen=True, eq=False)
class _Search:
    """Search over all settings."""

    shock: Shock  #: Shock.
    settings: Settings  #: Effect of the adjusters on the shock.
    target: TargetCurve  #: Curve to reach.
    values: tuple[tuple[float, ...], ...]  #: Possible values of each axis.
    design: Array  #: Matrix (M, 25) from slopes at the knots to forces at the target's velocities.
    weight: Array  #: Weight (M,) of each velocity; they sum to 1.
    level: Level  #: Treatment of a constant force; see `best_clicks`.

    @classmethod
    def of(cls, shock: Shock, target: TargetCurve, fixed: Mapping[str, float], level: Level) -> _Search:
        settings = shock.settings
        assert settings is not None
        try:
            at = setting_of(settings, fixed)
        except ValueError as error:
            raise ParameterError(f"shock {shock.name!r}: {error}") from error
        values = tuple(
            (value,) if axis.name in fixed or axis.is_temperature else axis.choices()
            for axis, value in zip(settings.axes, at, strict=True)
        )
        velocity = target.velocity
        width = np.abs(np.gradient(velocity)) if velocity.size > 1 else np.ones(1)
        width = np.maximum(width, 1e-9)
        basis = KnotBasis(shock.law.curve.knot_velocity)
        return cls(shock, settings, target, values, basis.design(velocity), width / width.sum(), level)

    @property
    def combinations(self) -> int:
        """Number of settings."""
        return prod(len(values) for values in self.values)

    def forces(self, settings: Sequence[tuple[float, ...]]) -> Array:
        """Return the forces (S, M) [N] of settings (S) at the target's velocities; a free level is the target's."""
        slopes = np.tile(np.array(self.shock.law.curve.knot_slope), (len(settings), 1))
        columns = [np.array(column) for column in zip(*settings, strict=True)]
        weights = {
            axis.name: self._weights(axis, column) for axis, column in zip(self.settings.axes, columns, strict=True)
        }
        for term in self.settings.terms:
            share = np.ones((len(settings), 1))
            for name in term.axes:  # the last axis varies fastest
                share = (share[:, :, None] * weights[name][:, None, :]).reshape(len(settings), -1)
            slopes += share @ np.array(term.deviations)[:, :KNOTS]
        forces = np.maximum(slopes, 0.0) @ self.design.T
        if self.level == "free":
            forces += ((self.target.force - forces) @ self.weight)[:, None]
        return np.asarray(forces)

    def _weights(self, axis: Axis, column: Array) -> Array:
        found, places = np.unique(column, return_inverse=True)
        return np.array([node_weights(axis.nodes, value) for value in found.tolist()])[places.ravel()]

    def errors(self, settings: Sequence[tuple[float, ...]]) -> Array:
        """Return the weighted RMS errors (S,) [N] of settings."""
        return np.asarray(np.sqrt((self.forces(settings) - self.target.force) ** 2 @ self.weight))

    def best(self, count: int) -> list[tuple[float, ...]]:
        """Return the best settings among all."""
        best: list[tuple[float, tuple[float, ...]]] = []
        for chunk in self._chunks():
            errors = self.errors(chunk)
            order = np.argsort(errors, kind="stable")[:count]
            best = sorted([*best, *((float(errors[k]), chunk[k]) for k in order.tolist())])[:count]
        return [setting for _, setting in best]

    def _chunks(self) -> Iterator[list[tuple[float, ...]]]:
        every = itertools.product(*self.values)
        while chunk := list(itertools.islice(every, _CHUNK)):
            yield chunk

    def choice(self, setting: tuple[float, ...], best: tuple[float, ...]) -> ClickChoice:
        """Return a setting with its errors."""
        force, of_best = self.forces([setting, best])
        rms = float(self.errors([setting])[0])
        size = float(np.sqrt(self.target.force**2 @ self.weight)) or 1.0
        return ClickChoice(
            setting,
            setting_text(self.settings, setting),
            rms,
            100.0 * rms / size,
            tuple(self._ranges(force)),
            is_tested(self.settings, setting),
            bool((np.abs(force - of_best) <= self._band(best)).all()),
        )

    def level_note(self, best: tuple[float, ...]) -> list[str]:
        """Return a note if most of the best setting's error is a constant force."""
        error = self.forces([best])[0] - self.target.force
        level, square = float(error @ self.weight), float(error**2 @ self.weight)
        if self.level == "free" or level**2 < _MOSTLY * square or abs(level) < 0.01 * np.abs(self.target.force).max():
            return []
        return [
            f"most of the error is a constant force of {level:+.0f} N in compression and rebound, as of a gas force; "
            "--set level=free leaves it out"
        ]

    def _band(self, setting: tuple[float, ...]) -> Array:
        """Return the half-width (M,) [N] of the model's band at the target's velocities."""
        width = force_half_width(self.settings, self.shock.law, setting)
        return np.interp(self.target.velocity, self.shock.law.curve.knot_velocity, width)

    def _ranges(self, force: Array) -> Iterator[RangeError]:
        for name, here in self._parts():
            error, weight = force[here] - self.target.force[here], self.weight[here] / self.weight[here].sum()
            rms, size = (float(np.sqrt(values**2 @ weight)) for values in (error, self.target.force[here]))
            yield RangeError(name, float(error @ weight), rms, 100.0 * rms / size if size else 0.0)

    def _parts(self) -> Iterator[tuple[str, NDArray[np.bool_]]]:
        ends = (0.0, *SPEEDS, float("inf"))
        for side, sign in (("compression", 1.0), ("rebound", -1.0)):
            speed = sign * self.target.velocity
            for low, high in itertools.pairwise(ends):
                here = (speed > low) & (speed <= high)
                if here.any():
                    name = f"{side} {low:g} to {high:g} m/s" if high < float("inf") else f"{side} above {low:g} m/s"
                    yield name, here

    def unreachable(self, best: tuple[float, ...]) -> Iterator[str]:
        """Yield a sentence for each range of speeds in which the best setting misses the target."""
        force = self.forces([best])[0]
        allowed = self._band(best) + _TOLERANCE * float(np.abs(self.target.force).max())
        missed = np.abs(force - self.target.force) > allowed
        low, high = self._envelope()
        for name, here in self._parts():
            if not (missed & here).any():
                continue
            place = np.flatnonzero(here)[np.argmax(np.abs(force - self.target.force)[here])]
            velocity, wanted = self.target.velocity[place], self.target.force[place]
            text = (
                f"{name}: at {velocity:.3g} m/s the target is {wanted:.0f} N and the best setting {force[place]:.0f} N"
            )
            if low[place] <= wanted <= high[place]:
                yield f"{text}; other settings reach it there, but miss it elsewhere"
            else:
                yield f"{text}; all settings are between {low[place]:.0f} and {high[place]:.0f} N"

    def _envelope(self) -> tuple[Array, Array]:
        """Return the lowest and the highest forces (M,) [N] of all settings."""
        low, high = np.full(self.target.velocity.size, np.inf), np.full(self.target.velocity.size, -np.inf)
        for chunk in self._chunks():
            forces = self.forces(chunk)
            low, high = np.minimum(low, forces.min(axis=0)), np.maximum(high, forces.max(axis=0))
        return low, high
