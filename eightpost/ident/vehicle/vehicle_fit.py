"""Fit of a vehicle, the result of every recipe: its misfit, notes, uncertainty and verdict, and what they permit."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NamedTuple, NotRequired

import numpy as np
from pydantic import with_config
from typing_extensions import TypedDict  # pydantic needs it before Python 3.12

from eightpost import __version__
from eightpost.corners import CORNERS, channel
from eightpost.display import Summarized, Summary, some
from eightpost.errors import FileFormatError, ParameterError, suggestion
from eightpost.files import atomic_path, json_content, sha256_of
from eightpost.ident.vehicle.frequency_response import (
    KEY_OUTPUTS,
    FrequencyResponse,
    read_response,
    response_of,
    write_response,
)
from eightpost.ident.vehicle.trust import UNUSABLE, OutputTrust, Trust, level_errors
from eightpost.labelled import Labelled, data_frame, dataset
from eightpost.report.console import Table, console_table, right
from eightpost.schema import REPORT, document_of
from eightpost.uncertainty import TOTAL, MeasureUncertainty, separation
from eightpost.validity import ModelUncertainty, Range, Validity, judged
from eightpost.vehicle import IdentifiedVehicle, read_vehicle, write_vehicle
from eightpost.verdict import Reason, Rules, Verdict, edited, is_intact, listed, sealed

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from eightpost.report.pictures import Picture


# ---- Verdict --------------------------------------------------------------------------------------------------------

ABOUT = "fit of the vehicle"

#: Misfit of an output, weighted by frequency as in the fit, from which a vehicle is not usable [1].
POOR_FIT = 0.3

#: Quantities whose levels are judged.
_JUDGED = ("velocity", "tire_force", "ride_height", TOTAL)

#: Errors of levels up to which a vehicle is usable, and from which it is not: RMS over the measures, and worst one [1].
GOOD_LEVELS, POOR_LEVELS = (0.01, 0.02), (0.03, 0.05)

RULES = Rules.read(
    Path(__file__).with_suffix(".txt"), ABOUT, poor_fit=100 * POOR_FIT, poor_rms=100 * POOR_LEVELS[0],
    poor_worst=100 * POOR_LEVELS[1], good_rms=100 * GOOD_LEVELS[0], good_worst=100 * GOOD_LEVELS[1],
)  # fmt: skip


def fit_verdict(fit: VehicleFit) -> Verdict:
    """Return the verdict on a fit."""
    return Verdict(_reasons(fit))


def _reasons(fit: VehicleFit) -> Iterator[Reason]:
    origin = f"{fit.recipe} fit to {listed(fit.sources) or 'records in memory'}"
    if not fit.stable:
        yield RULES.reason(
            "vehicle not stable", "the car is not stable with every damper", figure="1 damper or more", origin=origin
        )
    flags, measures = ({}, {}) if fit.trust is None else (fit.trust.flags, fit.trust.measures)
    errors = {n: error for n, error in level_errors(measures).items() if n.rpartition(".")[2] in _JUDGED}
    if UNUSABLE in flags:
        yield RULES.reason(
            "vehicle cannot be simulated",
            "the car cannot be simulated",
            figure=flags[UNUSABLE].rstrip("."),
            origin=origin,
        )
    worst = max(fit.residual, key=lambda name: fit.residual[name])
    value = fit.residual[worst]
    figure = f"{worst} {100 * value:.1f} %; limit {100 * POOR_FIT:g} %"
    if value >= POOR_FIT:
        yield RULES.reason("large misfit of the vehicle", "the model does not reproduce its tests", figure, origin)
    if errors:
        yield _level_reason(errors, origin)
    elif value < POOR_FIT:
        yield RULES.reason("tests not simulated", "the errors of levels are not known", figure, origin)


def _level_reason(errors: Mapping[str, float], origin: str) -> Reason:
    worst = max(errors, key=lambda name: errors[name])
    both = (math.sqrt(sum(value**2 for value in errors.values()) / len(errors)), errors[worst])
    figure = f"RMS {100 * both[0]:.1f} %, worst {worst} {100 * both[1]:.1f} %"
    if all(error <= limit for error, limit in zip(both, GOOD_LEVELS, strict=True)):
        return RULES.reason("own tests predicted", "the car predicts the levels of its own tests", figure, origin)
    poor = any(error >= limit for error, limit in zip(both, POOR_LEVELS, strict=True))
    rule, limits = ("own tests predicted wrong", POOR_LEVELS) if poor else ("own tests predicted roughly", GOOD_LEVELS)
    figure += f"; limits {100 * limits[0]:g} and {100 * limits[1]:g} %"
    return RULES.reason(rule, "the car predicts wrong levels of its own tests", figure, origin)


# ---- The fit: the vehicle with its response, misfit, notes and uncertainty ------------------------------------------

#: Schema version of the files that are written, and the newest one that can be read.
SCHEMA = 1


class FittedParameter(NamedTuple):
    """A physical parameter of a vehicle: name, unit, value, 95 % interval, and whether it is at a bound of the fit."""

    name: str
    unit: str
    value: float
    low: float
    high: float
    at_bound: bool = False


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class VehicleFit(Summarized):
    """An identified vehicle and the quality of its fit."""

    vehicle: IdentifiedVehicle  #: Identified vehicle: model, baseline damping, digests of the input files.
    recipe: str  #: Name of the recipe.
    response: FrequencyResponse  #: Response that the model was fitted to, preconditioned, around the baseline damping.
    #: Relative error of the model's response against `response`, weighted by frequency as in the fit [1], by output.
    residual: Mapping[str, float]
    #: Notes for the user, one sentence each: what was dropped, replaced or reduced, and what is doubtful.
    notes: tuple[str, ...] = ()
    seconds: float = 0.0  #: Processor time of estimate and fit [s].
    #: Whether the vehicle is stable with the baseline dampers and with all other dampers that were tried.
    stable: bool = True
    #: Ranges that the tests covered: smallest and largest value by channel, SI, and of `frequency` [Hz]; empty if the
    #: recipe does not give them.
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    #: Uncertainty, friction, flags and choice of the order; None if the recipe does not give them.
    trust: Trust | None = None
    #: Physical parameters with 95 % intervals; empty if the recipe has none.
    parameters: tuple[FittedParameter, ...] = ()

    @property
    def sources(self) -> Mapping[str, str]:
        """SHA-256 digests of the input files, by name."""
        return self.vehicle.sources

    @property
    def states(self) -> int:
        """Number of states of the model."""
        return len(self.vehicle.state_space.A)

    @property
    def verdict(self) -> Verdict:
        """Whether the vehicle can be used, and why (docs/reference/verdict.md)."""
        if self.vehicle.validity is not None:
            return self.vehicle.validity.verdict
        return fit_verdict(self)

    def _summary(self) -> Summary:
        worst = max(self.residual, key=lambda name: self.residual[name], default="")
        frequency = self.response.frequency
        inputs, outputs = self.response.input_names, self.response.output_names
        return Summary.of(
            f"Identified vehicle {self.vehicle.name}, recipe {self.recipe}",
            ("verdict", self.verdict.headline),
            ("reason", str(self.verdict.decisive[0]) if self.verdict.reasons else ""),
            ("model", f"{self.states} states, {'stable' if self.stable else 'not stable'}"),
            ("response", f"{frequency[0]:.3g} to {frequency[-1]:.3g} Hz"),
            ("misfit", f"up to {100.0 * self.residual[worst]:.2g} % ({worst})" if worst else ""),
            ("inputs", some(inputs)),
            ("outputs", some(outputs)),
            ("notes", f"{len(self.notes)}; see .notes" if self.notes else ""),
        )

    def to_pandas(self) -> pd.DataFrame:
        """Return the outputs, one row each: misfit [1], and if known the uncertainties of `OutputTrust` [1].

        Raises:
            MissingExtraError: pandas is not installed.
        """
        names, trusted = list(self.residual), {} if self.trust is None else self.trust.outputs
        columns = {"misfit": [self.residual[name] for name in names]}
        for figure in ("response", "measure") if trusted else ():
            values = [getattr(trusted[name], figure) if name in trusted else np.nan for name in names]
            columns[f"{figure}_deviation"] = values
        return data_frame(columns, names, "output", dict.fromkeys(columns, "1"))

    def to_xarray(self) -> xr.Dataset:
        """Return the frequency responses of estimate and model over output, input and frequency [Hz].

        Raises:
            MissingExtraError: xarray is not installed.
        """
        response = self.response
        model = response_of(self.vehicle.state_space.select(outputs=response.output_names), response.frequency)
        paths, channels = ("output", "input", "frequency"), (response.outputs, response.inputs)
        variables: dict[str, Labelled] = {"estimate": (paths, response.H, ""), "model": (paths, model.H, "")}
        if response.coherence is not None:
            variables["coherence"] = (("output", "frequency"), response.coherence, "1")
        coordinates: dict[str, Labelled] = {
            "output": (("output",), list(response.output_names), ""),
            "input": (("input",), list(response.input_names), ""),
            "frequency": (("frequency",), response.frequency, "Hz"),
        }
        for dimension, known in zip(("output", "input"), channels, strict=True):
            coordinates[f"{dimension}_unit"] = ((dimension,), [channel.unit for channel in known], "")
        return dataset(variables, coordinates, {"vehicle": self.vehicle.name, "recipe": self.recipe})

    def plot(self, output: str | None = None) -> Picture:
        """Return a picture of the responses of one output to all inputs: estimate and model.

        The default output is that with the largest misfit.

        Raises:
            ParameterError: There is no such output.
        """
        from eightpost.ident.vehicle.plots import magnitudes  # noqa: PLC0415 -- matplotlib takes long to load
        from eightpost.report.pictures import Picture  # noqa: PLC0415

        shown = output or max(self.residual, key=lambda name: self.residual[name])
        if shown not in self.response.output_names:
            advice = suggestion(shown, self.response.output_names)
            raise ParameterError(f"{self.vehicle.name} has no output {shown!r}; {advice}")
        estimate = self.response.select(outputs=[shown])
        model = response_of(self.vehicle.state_space.select(outputs=[shown]), estimate.frequency)
        return Picture(magnitudes({"estimate": estimate, "model": model}, shown))

    def write_plots(self, folder: Path, outputs: Literal["none", "main", "all"]) -> list[Path]:
        """Write PNGs of the key outputs (main) or of all, and the stabilisation diagram; return their paths."""
        from eightpost.ident.vehicle.plots import plot_fits, plot_stabilisation  # noqa: PLC0415 -- as in `plot`

        names = [n for n in self.residual if outputs == "all" or (outputs == "main" and n.endswith(KEY_OUTPUTS))]
        model = self.vehicle.state_space.select(outputs=names)
        drawn = plot_fits(self.response.select(outputs=names), model, self.recipe, folder)
        if outputs != "none" and self.trust is not None and self.trust.orders is not None:
            drawn.append(folder / "stabilisation.png")
            plot_stabilisation(self.trust.orders, drawn[-1])
        return drawn

    def write(self, path: str | Path) -> Path:
        """Write the vehicle file (.json) that `build` makes an FMU of, with response and report beside it."""
        return write_fit(path, self)[0]


def _response_path(path: str | Path) -> Path:
    """Return the path of a fit's response, given that of its vehicle: car.response.npz for car.json."""
    return Path(path).with_suffix(".response.npz")


def fit_path(path: str | Path) -> Path:
    """Return the path of a fit's report, given that of its vehicle: car.fit.json for car.json."""
    return Path(path).with_suffix(".fit.json")


def fit_files(path: str | Path) -> tuple[Path, Path, Path]:
    """Return the files of a fit, given the path of its vehicle: vehicle, response and report."""
    return Path(path), _response_path(path), fit_path(path)


@with_config(REPORT)
class _Report(TypedDict):
    """Entries of the report of a fit; an undetermined figure is infinite."""

    vehicle_sha256: str
    vehicle_judged: NotRequired[str | None]
    recipe: str
    residual: dict[str, float]
    notes: tuple[str, ...]
    seconds: float
    stable: bool
    ranges: NotRequired[dict[str, tuple[float, float]]]
    trust: NotRequired[Trust | None]
    parameters: NotRequired[tuple[FittedParameter, ...]]


def write_fit(path: str | Path, fit: VehicleFit) -> tuple[Path, ...]:
    """Write a fit: the vehicle as .json and, in the same folder, its response and its report."""
    path = Path(path)
    write_vehicle(path, fit.vehicle)
    write_response(_response_path(path), fit.response, sources=fit.sources)
    content = {
        "kind": "vehicle_fit",
        "schema": SCHEMA,
        "tool": f"eightpost {__version__}",
        "vehicle_sha256": sha256_of(path),
        "vehicle_judged": fit.vehicle.validity.judged if fit.vehicle.validity else None,
        "recipe": fit.recipe,
        "residual": dict(fit.residual),
        "notes": list(fit.notes),
        "seconds": fit.seconds,
        "stable": fit.stable,
        "ranges": {name: list(span) for name, span in fit.ranges.items()},
        "trust": None if fit.trust is None else asdict(fit.trust),
        "parameters": [parameter._asdict() for parameter in fit.parameters],
    }
    with atomic_path(fit_path(path)) as temporary:
        temporary.write_text(json.dumps(sealed(content), indent=1) + "\n", encoding="utf-8")
    return fit_files(path)


def read_fit(path: str | Path) -> VehicleFit:
    """Read a fit that `write_fit` wrote, given the path of its vehicle.

    The verdict is "unknown" if the vehicle or the report of its fit was edited; the uncertainty is then left out.

    Raises:
        FileFormatError: A file is missing or not part of a fit, has a newer schema, or belongs to another vehicle.
    """
    path = Path(path)
    vehicle = read_vehicle(path)
    if not isinstance(vehicle, IdentifiedVehicle):
        raise FileFormatError("is not an identified vehicle", path=path)
    for part, meaning in ((fit_path(path), "report of its fit"), (_response_path(path), "responses of its tests")):
        if not part.is_file():
            what = f"needs the {meaning}, {part.name}, in the same folder; copy it there, or identify again"
            raise FileFormatError(what, path=path)
    stated = json_content(fit_path(path), finite=False)
    content = document_of(_Report, stated, fit_path(path), "vehicle_fit", SCHEMA, "identify again")
    judged_numbers = vehicle.validity.judged if vehicle.validity else None
    is_of_file = content["vehicle_sha256"] == sha256_of(path)
    if not is_of_file and (judged_numbers is None or content.get("vehicle_judged") != judged_numbers):
        raise FileFormatError(f"belongs to another vehicle than the one in {path}; identify again", path=fit_path(path))
    if not is_intact(stated):
        vehicle = replace(vehicle, validity=Validity(edited(fit_path(path).name)))
    is_edited = vehicle.validity is not None and bool(vehicle.validity.edits)
    return VehicleFit(
        vehicle,
        content["recipe"],
        read_response(_response_path(path)),
        content["residual"],
        content["notes"],
        content["seconds"],
        content["stable"],
        content.get("ranges", {}),
        None if is_edited else content.get("trust"),
        content.get("parameters", ()),
    )


# ---- What the vehicle may be used for: verdict, covered ranges and uncertainty, as `build` ships them ---------------


def with_validity(fit: VehicleFit, further: Iterable[Reason] = ()) -> VehicleFit:
    """Return the fit with its verdict, further reasons, the covered ranges and the uncertainty added to the vehicle."""
    verdict = Verdict((*further, *fit_verdict(fit).reasons))
    stated = fit.trust.measures if fit.trust is not None else {}
    uncertainty = ModelUncertainty(measures=stated) if stated else None
    model = fit.vehicle.coupled()
    units = {one.name: one.unit for one in (*model.inputs, *model.outputs)}
    ranges = [Range(name, "amplitude", *span, units[name]) for name, span in fit.ranges.items() if name in units]
    if "frequency" in fit.ranges:
        low, high = fit.ranges["frequency"]  # the band of a velocity has a lower end; other outputs may be static
        lows = {one.name: low if one.name.rpartition(".")[2] == "velocity" else 0.0 for one in model.outputs}
        ranges += [Range(name, "frequency", lowest, high, "Hz") for name, lowest in lows.items()]
    return replace(fit, vehicle=judged(fit.vehicle, validity=Validity(verdict, tuple(ranges), uncertainty)))


# ---- Console tables: misfit, uncertainty, accuracy of measures, friction --------------------------------------------

#: Columns of the uncertainty table and their values; the last one is shown only if friction was estimated.
_FIGURES: tuple[tuple[str, Callable[[OutputTrust], float]], ...] = (
    ("response, %", lambda one: 100.0 * one.response),
    ("RMS of setups, %", lambda one: 100.0 * one.measure),
    ("misfit, standard deviations", lambda one: one.misfit),
    ("unexplained, % of the value without friction", lambda one: 100.0 * (one.with_friction or 0.0)),
)


def residual_table(fit: VehicleFit) -> Table:
    """Return the misfit of the model's response [%]: one row per quantity, one column per corner."""
    quantities = dict.fromkeys(name.rpartition(".")[2] for name in fit.residual)
    shown = {name: f"{100.0 * value:.2g}" for name, value in fit.residual.items()}
    places = ("", *CORNERS, "front", "rear", "driver")
    ports = [port for port in places if any(channel(port, quantity) in shown for quantity in quantities)]
    return console_table(
        ["output", *right(*(port or "misfit" for port in ports))],
        [(q, *(shown.get(channel(port, q), "") for port in ports)) for q in quantities],
        title=f"{fit.vehicle.name}, recipe {fit.recipe}: misfit of the model's response, %",
    )


def trust_table(trust: Trust) -> Table:
    """Return the uncertainty of each quantity: that of its worst output."""
    figures = _FIGURES if any(one.with_friction is not None for one in trust.outputs.values()) else _FIGURES[:-1]
    rows = []
    for quantity in dict.fromkeys(name.rpartition(".")[2] for name in trust.outputs):
        outputs = [one for name, one in trust.outputs.items() if name.rpartition(".")[2] == quantity]
        rows.append((quantity, *(f"{max(map(figure, outputs)):.2g}" for _, figure in figures)))
    title = (
        f"uncertainty of the worst output of each quantity; one standard deviation, from {trust.samples} drawn models"
    )
    return console_table(["quantity", *right(*(head for head, _ in figures))], rows, title=title)


#: Separation of the two setups of the table, whose predictions differ by 10 %, RMS over all measures and in the measure
#: itself.
TENTH = separation(0.1, 0.1)


def measure_table(trust: Trust) -> Table:
    """Return 95 % intervals of predicted RMS values of untested setups: the worst output of each quantity."""
    rows = []
    for quantity, worst in worst_measures(trust):
        halves = (worst.half_width(0.0), MeasureUncertainty(0.0, worst.own).half_width(TENTH))
        rows.append((quantity, *(f"{100.0 * half:.2g}" for half in halves)))
    title = "accuracy of predicted RMS values of setups that were not tested; 95 % intervals of the worst outputs"
    columns = right("error that all setups share, +- %", "error between two setups 10 % apart, +- %")
    return console_table(["quantity", *columns], rows, title=title)


def worst_measures(trust: Trust) -> Iterator[tuple[str, MeasureUncertainty]]:
    """Yield each quantity with the largest common and the largest own error of its measures."""
    names = {name: name.rpartition(".")[2] for name in trust.measures}
    for quantity in dict.fromkeys(names.values()):
        found = [one for name, one in trust.measures.items() if names[name] == quantity]
        yield quantity, MeasureUncertainty(max(one.common for one in found), max(one.own for one in found))


def friction_table(fit: VehicleFit, trust: Trust) -> Table:
    """Return the estimated friction of every port and the friction that the vehicle has."""
    rows = []
    for port, force in trust.friction.items():
        used, law = ("none", "", ""), fit.vehicle.friction.get(port)
        if law is not None:
            velocity = f"{1e3 * law.velocity:.2g}" if law.force or not law.bristle.force else ""
            reach = f"{1e3 * law.bristle.reach:.2g}" if law.bristle.force else ""
            used = (f"{law.sliding_force:.1f}", velocity, reach)
        rows.append((port or "port", f"{force.value:.1f}", f"{force.deviation:.2f}", *used))
    columns = right("estimate, N", "standard deviation, N", "vehicle, N", "velocity, mm/s", "reach, mm")
    return console_table(["port", *columns], rows, title="friction at the ports")


def damping_sentence(fit: VehicleFit) -> str:
    """Return the baseline damping and the number of states as a sentence."""
    rates = ", ".join(f"{port} {rate:.0f}".strip() for port, rate in fit.vehicle.baseline_damping.items())
    return f"around a baseline damping of {rates} N.s/m; {fit.states} states"
