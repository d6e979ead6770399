"""Tables of a validation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from eightpost.ident.validation.bump import BumpValidation
from eightpost.ident.validation.evaluation import RandomValidation
from eightpost.ident.validation.record import CONFIGURATIONS, TABLE_3_4, TABLE_3_4_CONFIGURATION, printed_configuration
from eightpost.ident.validation.sine import SineValidation
from eightpost.ident.validation.static import StaticValidation
from eightpost.ident.validation.study import law_title, names_of
from eightpost.ident.validation.verdict import prediction_of
from eightpost.units import conversion, convert

if TYPE_CHECKING:
    from eightpost.ident.validation.record import Record
    from eightpost.ident.validation.study import Case, ValidationStudy


# ---- Conversion of SI amounts to the units used in the field --------------------------------------------------------

#: Field unit by SI unit; other units are shown unchanged.
_FIELD = {"N": "lbf", "m": "in", "m/s": "in/s", "N/m": "lbf/in", "J": "in.lbf", "N2/Hz": "lbf2/Hz"}

_SQUARED = {"N2/Hz": "N"}


def field_unit(unit: str) -> str:
    """Return the field unit for an SI unit."""
    return _FIELD.get(unit, unit)


def field_factor(unit: str) -> float:
    """Return the factor from an SI unit to its field unit."""
    if unit in _SQUARED:
        return field_factor(_SQUARED[unit]) ** 2
    return conversion(unit, _FIELD[unit])[0] if unit in _FIELD else 1.0


def shown(value: float, digits: int) -> str:
    """Return a number with the given significant digits, without an exponent if that is as short.

    >>> shown(0.123456, 3), shown(1234.5, 3), shown(-2.0, 3)
    ('0.123', '1230', '-2.00')
    """
    text = f"{value:#.{digits}g}"
    if "e" in text and 1.0 <= abs(value) < 1e6:
        text = f"{float(f'{value:.{digits}g}'):.0f}"
    return text.rstrip(".")


# ---- The figures of a validation as tables, for both the command line and the report --------------------------------


@dataclass(frozen=True, slots=True)
class Amount:
    """A value with its SI unit (`1` and `%` for plain numbers) and the number of significant digits to show."""

    value: float
    unit: str
    digits: int = 3


Cell = Amount | str

#: Text of a cell without a value.
NONE = "–"


@dataclass(frozen=True, slots=True)
class ResultTable:
    """A table.

    Attributes:
        title: Heading of the table.
        heads: Column headers: text, and the SI unit of the amounts below or an empty text.
        rows: Rows with a cell for each column.
    """

    title: str
    heads: tuple[tuple[str, str], ...]
    rows: tuple[tuple[Cell, ...], ...]

    @property
    def numeric(self) -> tuple[bool, ...]:
        """Whether each column contains amounts."""
        return tuple(any(isinstance(row[k], Amount) for row in self.rows) for k in range(len(self.heads)))


def random_table(study: ValidationStudy) -> ResultTable:
    """Return the errors on the random records (Table 3.5, with percentages as in Table 3.4)."""
    heads = (
        ("record", ""), ("shock", ""), ("RMS error", "N"), ("% of std", ""), ("% less than static", ""),
        ("offset", "N"), ("beyond fit, %", ""), ("coherent, %", ""),
    )  # fmt: skip
    rows = []
    for record, cases in study.of_kind("random"):
        for case in cases:
            outcome = case.outcome
            assert isinstance(outcome, RandomValidation)
            residual = outcome.residual
            rows.append((
                record.name,
                case.label,
                Amount(outcome.rms, "N"),
                _percent(outcome.percent),
                _optional(reduction(case, cases), "%"),
                Amount(outcome.prediction.offset, "N", 2),
                _percent(100.0 * outcome.beyond, 2),
                _optional(residual and 100.0 * residual.share, "%", 2),
            ))  # fmt: skip
    return ResultTable("Random records", heads, tuple(rows))


def sine_groups(study: ValidationStudy) -> dict[tuple[int | None, tuple[str, ...]], list[tuple[Case, ...]]]:
    """Return the cases of each sine record by configuration and shocks; the largest first, then the slowest."""
    groups: dict[tuple[int | None, tuple[str, ...]], list[tuple[Case, ...]]] = {}
    for record, cases in study.of_kind("sine"):
        groups.setdefault((record.configuration, tuple(case.label for case in cases)), []).append(cases)
    for rows in groups.values():
        rows.sort(key=lambda cases: (-round(sine(cases[0]).amplitude, 4), sine(cases[0]).speed))
    return groups


def sine(case: Case) -> SineValidation:
    """Return the outcome of a case on a sine record."""
    assert isinstance(case.outcome, SineValidation)
    return case.outcome


def sine_table(rows: list[tuple[Case, ...]]) -> ResultTable:
    """Return the error at each amplitude and velocity (Table 3.3, Fig 3.20), for each shock."""
    heads = [("record", ""), ("amplitude", "m"), ("peak speed", "m/s"), ("frequency, Hz", "")]
    for name in names_of(rows[0]):
        heads += [(f"{name}: RMS", "N"), ("% of std", "")]
    body: list[tuple[Cell, ...]] = []
    for cases in rows:
        cells: list[Cell] = list(_where(cases))
        for case in cases:
            cells += [Amount(sine(case).rms, "N"), _percent(sine(case).percent)]
        body.append(tuple(cells))
    return ResultTable(f"Sines of {_dampers(rows)}: error", tuple(heads), tuple(body))


def loop_table(rows: list[tuple[Case, ...]]) -> ResultTable:
    """Return hysteresis and energy of each loop, measured and by each shock."""
    quantities = {"hysteresis": ("hysteresis", "N"), "energy": ("energy per period", "J")}
    return _loops(rows, "hysteresis and energy", quantities)


def peak_table(rows: list[tuple[Case, ...]]) -> ResultTable:
    """Return the peak forces of each loop, measured and by each shock."""
    quantities = {"compression_peak": ("peak in compression", "N"), "rebound_peak": ("peak in rebound", "N")}
    return _loops(rows, "peak forces", quantities)


def _loops(rows: list[tuple[Case, ...]], title: str, quantities: dict[str, tuple[str, str]]) -> ResultTable:
    heads = [("record", "")]
    for name, unit in quantities.values():
        heads += [(f"{name}: measured", unit), *((law, unit) for law in names_of(rows[0]))]
    body: list[tuple[Cell, ...]] = []
    for cases in rows:
        loops = [sine(cases[0]).measured, *(sine(case).predicted for case in cases)]
        amounts = [Amount(getattr(loop, name), unit) for name, (_, unit) in quantities.items() for loop in loops]
        body.append((cases[0].record.name, *amounts))
    return ResultTable(f"Sines of {_dampers(rows)}: {title}", tuple(heads), tuple(body))


def _dampers(rows: list[tuple[Case, ...]]) -> str:
    return ", ".join(dict.fromkeys(case.shock.name for case in rows[0]))


def static_table(study: ValidationStudy) -> ResultTable:
    """Return rates and drag of the static records (3.4.3)."""
    heads = (
        ("record", ""), ("holds", ""), ("rate in compression", "N/m"), ("in rebound", "N/m"), ("gas rate", "N/m"),
        ("hysteresis", "N"), ("seal drag", "N"), ("shock", ""), ("predicted gas rate", "N/m"), ("RMS error", "N"),
    )  # fmt: skip
    rows = []
    for record, cases in study.of_kind("static"):
        for case in cases:
            found = case.outcome
            assert isinstance(found, StaticValidation)
            rows.append((
                record.name,
                Amount(len(found.holds), "1", 1),
                _optional(found.compression_rate, "N/m"),
                _optional(found.rebound_rate, "N/m"),
                Amount(found.gas_rate, "N/m"),
                _optional(found.hysteresis, "N"),
                _optional(found.seal_drag, "N"),
                case.label,
                Amount(found.predicted_rate, "N/m"),
                Amount(found.rms, "N"),
            ))  # fmt: skip
    return ResultTable("Static records", heads, tuple(rows))


def bump_table(study: ValidationStudy) -> ResultTable:
    """Return peak forces and errors of the bumps (3.4.4)."""
    heads = (
        ("record", ""), ("at, s", ""), ("speed", "m/s"), ("measured peak", "N"), ("shock", ""),
        ("predicted peak", "N"), ("peak error, %", ""), ("RMS error", "N"), ("whole record: % of std", ""),
    )  # fmt: skip
    rows = []
    for record, cases in study.of_kind("bump"):
        for case in cases:
            found = case.outcome
            assert isinstance(found, BumpValidation)
            rows += [
                (
                    record.name,
                    Amount(event.start, "s"),
                    Amount(event.speed, "m/s"),
                    Amount(event.measured_peak, "N"),
                    case.label,
                    Amount(event.predicted_peak, "N"),
                    _percent(event.peak_error, 2),
                    Amount(event.rms, "N"),
                    _percent(found.percent),
                )
                for event in found.events
            ]
    return ResultTable("Bump records", heads, tuple(rows))


def table_3_4(study: ValidationStudy) -> ResultTable:
    """Return our fits below the printed ones (Table 3.4); the times are of two machines 20 years apart."""
    heads = (
        ("", ""), ("law", ""), ("fit error", "N"), ("% less than static", ""), ("% of std", ""), ("fit, s", ""),
        ("evaluation, s", ""),
    )  # fmt: skip
    title = printed_configuration(TABLE_3_4_CONFIGURATION).title
    rows: list[tuple[Cell, ...]] = [
        (
            f"printed: {title}",
            law_title(law),
            _pounds(row.rms_lbf),
            _optional(row.percent_less_than_static, "%"),
            _percent(row.percent_of_deviation),
            Amount(row.fit_seconds, "s", 2),
            Amount(row.evaluation_seconds, "s", 2),
        )
        for law, row in TABLE_3_4.items()
    ]
    static = {s.name: s.fit.get("rms [N]") for s in study.shocks.values() if s.law_name == "polylinear"}
    for label, shock in study.shocks.items():
        rms, floor = shock.fit.get("rms [N]"), static.get(shock.name)
        less = 100.0 * (1.0 - rms / floor) if rms and floor and shock.law_name != "polylinear" else None
        seconds = shock.fit.get("seconds", shock.fit.get("seconds [s]"))
        rows.append((
            f"ours: {shock.name}",
            law_title(shock.law_name),
            _optional(rms, "N"),
            _optional(less, "%"),
            _optional(shock.fit.get("percent"), "%"),
            _optional(seconds, "s", 2),
            _optional(_evaluation(study, label), "s", 2),
        ))  # fmt: skip
    return ResultTable("Fits, as Table 3.4", heads, tuple(rows))


def table_3_5(study: ValidationStudy) -> ResultTable:
    """Return the random errors of each configuration, printed and ours (Table 3.5)."""
    ours = _by_configuration(study)
    laws = list(dict.fromkeys([*TABLE_3_4, *(law for found in ours.values() for law in found)]))
    heads = [("no.", ""), ("configuration", "")]
    for law in laws:
        heads += [(f"{law_title(law)}: printed", "N"), ("ours", "N")]
    heads += [(f"{law_title(law)} % less: {which}", "") for law in laws[1:] for which in ("printed", "ours")]
    rows: list[tuple[Cell, ...]] = []
    for printed in CONFIGURATIONS:
        mine, reference = ours.get(printed.number, {}), {law: _pounds(v).value for law, v in printed.rms_lbf.items()}
        cells: list[Cell] = [str(printed.number), printed.title]
        for law in laws:
            cells += [_optional(reference.get(law), "N"), _optional(mine.get(law), "N")]
        for law in laws[1:]:
            cells += [_optional(_less(reference, law), "%"), _optional(_less(mine, law), "%")]
        rows.append(tuple(cells))
    return ResultTable("RMS errors on random records, as Table 3.5", tuple(heads), tuple(rows))


def beside_printed(study: ValidationStudy) -> ResultTable:
    """Return Table 3.5 for a terminal: a row for each configuration and law that was validated."""
    heads = (("configuration", ""), ("law", ""), ("printed", "N"), ("ours", "N"), ("% less: printed", ""), ("ours", ""))
    rows: list[tuple[Cell, ...]] = []
    for number, mine in sorted(_by_configuration(study).items()):
        printed = printed_configuration(number)
        reference = {law: _pounds(v).value for law, v in printed.rms_lbf.items()}
        for law, rms in mine.items():
            errors = _optional(reference.get(law), "N"), Amount(rms, "N")
            less = (NONE, NONE) if law == "polylinear" else (_optional(_less(e, law), "%") for e in (reference, mine))
            rows.append((f"{number}: {printed.title}", law_title(law), *errors, *less))
    return ResultTable("Random records compared with Table 3.5", heads, tuple(rows))


def reduction(case: Case, cases: tuple[Case, ...]) -> float | None:
    """Return the reduction of a case's error from that of the static curve of the same shock [percent]."""
    static = [c for c in cases if c.shock.law_name == "polylinear" and c.shock.name == case.shock.name]
    if not static or case.shock.law_name == "polylinear":
        return None
    return 100.0 * (1.0 - case.outcome.rms / static[0].outcome.rms)


def _by_configuration(study: ValidationStudy) -> dict[int, dict[str, float]]:
    """Return RMS errors [N] by configuration and law, on the first record that the law was not fitted to."""
    found: dict[int, dict[str, float]] = {}
    for record, cases in study.of_kind("random"):
        if record.configuration is None:
            continue
        for case in cases:
            if not case.is_fit_record:
                found.setdefault(record.configuration, {}).setdefault(case.shock.law_name, case.outcome.rms)
    return found


def _less(errors: dict[str, float], law: str) -> float | None:
    if law not in errors or "polylinear" not in errors:
        return None
    return 100.0 * (1.0 - errors[law] / errors["polylinear"])


def _evaluation(study: ValidationStudy, label: str) -> float | None:
    """Return the shortest evaluation time of a random record [s]."""
    found = [
        prediction.seconds
        for case in study.cases
        if case.label == label and case.record.kind == "random" and (prediction := prediction_of(case.outcome))
    ]
    return min(found, default=None)


def _where(cases: tuple[Case, ...]) -> tuple[Cell, ...]:
    record: Record = cases[0].record
    found = sine(cases[0])
    place = Amount(found.amplitude, "m", 2), Amount(found.speed, "m/s"), Amount(found.frequency, "Hz")
    return (record.name, *place)


def _pounds(value: float) -> Amount:
    return Amount(convert(value, "lbf", "N"), "N")


def _percent(value: float, digits: int = 3) -> Amount:
    return Amount(value, "%", digits)


def _optional(value: Any, unit: str, digits: int = 3) -> Cell:
    return NONE if value is None else Amount(float(value), unit, digits)
