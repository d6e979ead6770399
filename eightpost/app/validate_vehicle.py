"""Validation of an identified vehicle on other rig records, for `eightpost validate`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.markup import escape

from eightpost.app.progress import each
from eightpost.app.show import show_verdict
from eightpost.app.validate_paths import RecordChoices, show_table
from eightpost.ident.validation.record import Kind
from eightpost.ident.validation.rig_record import rig_record
from eightpost.ident.validation.vehicle_tables import friction_table, mode_table, overview, port_table, trend_table
from eightpost.ident.validation.vehicle_verdict import Limits, vehicle_verdict
from eightpost.ident.validation.vehicles import VehicleValidation, validate_vehicle
from eightpost.ident.vehicle import read_fit, write_fit
from eightpost.ident.vehicle.verdict import trust_table
from eightpost.rig.post import read_rig_test
from eightpost.shock import read_shock
from eightpost.validity import Validity
from eightpost.vehicle import read_vehicle

if TYPE_CHECKING:
    from rich.console import Console

    from eightpost.signals import ChannelMap
    from eightpost.verdict import Verdict

_KINDS = ("random", "sine", "bump", "static")


@dataclass(frozen=True, slots=True)
class VehicleOptions:
    """Options of `eightpost validate` for a vehicle.

    Attributes:
        kinds: Kinds of records, each `KIND` or `FILE=KIND`.
        shocks: Shock file of each corner or name.
        against: File of another car whose modes are listed for comparison.
        limits: Limits above which the vehicle is not usable.
        settling: Settling time that is left out at the start of each record [s].
        units: Units by channel.
        channel_map: Channel map of all records.
        flip: Channels whose sign is reversed.
        keep: Whether to write the verdict into the vehicle file.
    """

    kinds: tuple[str, ...]
    shocks: dict[str, str]
    against: Path | None
    limits: Limits
    settling: float
    units: dict[str, str]
    channel_map: ChannelMap | None
    flip: tuple[str, ...]
    keep: bool = False


def limits_of(level: float | None, error: float | None) -> Limits:
    """Return the limits from percentages; None keeps the default."""
    limits = Limits()
    limits = limits if level is None else replace(limits, level=level / 100.0)
    return limits if error is None else replace(limits, error=error / 100.0)


def validate_one(
    console: Console, path: Path, records: list[Path], options: VehicleOptions, report: Path | None
) -> Verdict:
    """Validate a vehicle, print the tables, write the report, and return the verdict."""
    fit = read_fit(path)
    kind_of = RecordChoices(records).of(options.kinds, "--kind")
    shocks = {name: read_shock(file).law for name, file in options.shocks.items()}
    against = read_vehicle(options.against) if options.against else None
    held_out = []
    for record in each(console, records, "reading", len(records)):
        test = read_rig_test(record, channel_map=options.channel_map, units=options.units, flip=options.flip)
        held_out.append(rig_record(test, fit.vehicle.state_space, kind=_kind(kind_of.get(record))))
    with console.status("predicting"):
        study = validate_vehicle(fit, held_out, shocks=shocks, against=against, settling=options.settling)
    _show(console, study, options.limits)
    if report:
        from eightpost.ident.validation.vehicle_page import write_vehicle_page

        title = f"Validation of {fit.vehicle.name}"
        written = write_vehicle_page(report, study, limits=options.limits, title=title)
        console.print(f"wrote {written}", soft_wrap=True, highlight=False)
    verdict = vehicle_verdict(study, options.limits)
    if options.keep:
        validity = Validity.with_verdict(fit.vehicle.validity, verdict)
        write_fit(path, replace(fit, vehicle=replace(fit.vehicle, validity=validity)))
        console.print(f"wrote the verdict into {path}", soft_wrap=True, highlight=False)
    return verdict


def _show(console: Console, study: VehicleValidation, limits: Limits) -> None:
    for case in study.cases:
        text = f"{escape(case.record.name)}: {case.record.kind}, {escape(case.record.reason)}"
        console.print(text, soft_wrap=True, highlight=False)
    for table in (overview(study), trend_table(study), friction_table(study), port_table(study.fit), mode_table(study)):
        show_table(console, table)
    if study.fit.trust is not None and study.fit.trust.outputs:
        console.print(trust_table(study.fit.trust))
    for note in (note for case in study.cases for note in case.extrapolations + case.notes):
        console.print(f"[yellow]note[/] {escape(note)}", highlight=False, soft_wrap=True)
    show_verdict(console, vehicle_verdict(study, limits))
    console.print(limits.summary(), highlight=False, soft_wrap=True)


def _kind(word: str | None) -> Kind | None:
    if word is not None and word not in _KINDS:
        raise click.BadParameter(f"{word!r}: the kind must be one of {', '.join(_KINDS)}", param_hint="--kind")
    return word  # type: ignore[return-value]
