"""Fit of a vehicle, the result of every recipe: the vehicle with its response, misfit, notes and uncertainty."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from eightpost import __version__
from eightpost.display import Summarized, Summary, some
from eightpost.errors import FileFormatError, ParameterError, suggestion
from eightpost.files import MALFORMED, atomic_path, check_schema, json_content, sha256_of
from eightpost.ident.response import FrequencyResponse, read_response, response_of, write_response
from eightpost.ident.vehicle.trust import Trust
from eightpost.ident.vehicle.verdict import fit_verdict
from eightpost.judged import edited, is_intact, sealed
from eightpost.labelled import Labelled, data_frame, dataset
from eightpost.validity import Validity
from eightpost.vehicle import IdentifiedVehicle, read_vehicle, write_vehicle
from eightpost.verdict import Verdict

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from eightpost.report.pictures import Picture

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
        columns: dict[str, list[float]] = {"misfit": [self.residual[name] for name in names]}
        for figure in ("response", "measure") if trusted else ():
            columns[f"{figure}_deviation"] = [
                getattr(trusted[name], figure) if name in trusted else np.nan for name in names
            ]
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

        Args:
            output: Name of the output; default: the one with the largest misfit.

        Raises:
            ParameterError: There is no such output.
        """
        from eightpost.ident.vehicle.magnitude_plots import magnitudes  # noqa: PLC0415 -- matplotlib takes long to load
        from eightpost.report.pictures import Picture  # noqa: PLC0415

        shown = output or max(self.residual, key=lambda name: self.residual[name])
        if shown not in self.response.output_names:
            advice = suggestion(shown, self.response.output_names)
            raise ParameterError(f"{self.vehicle.name} has no output {shown!r}; {advice}")
        estimate = self.response.select(outputs=[shown])
        model = response_of(self.vehicle.state_space.select(outputs=[shown]), estimate.frequency)
        return Picture(magnitudes({"estimate": estimate, "model": model}, shown))

    def write(self, path: str | Path) -> Path:
        """Write the vehicle file (.json) that `build` makes an FMU of, with response and report beside it.

        Returns:
            Path of the vehicle file.
        """
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


def write_fit(path: str | Path, fit: VehicleFit) -> tuple[Path, ...]:
    """Write a fit: the vehicle as .json and, in the same folder, its response and its report.

    Returns:
        Paths of the files written.
    """
    path = Path(path)
    write_vehicle(path, fit.vehicle)
    write_response(_response_path(path), fit.response, sources=fit.sources)
    content = {
        "kind": "vehicle_fit",
        "schema": SCHEMA,
        "tool": f"eightpost {__version__}",
        "vehicle_sha256": sha256_of(path),
        "vehicle_judged": _judged(fit.vehicle),
        "recipe": fit.recipe,
        "residual": dict(fit.residual),
        "notes": list(fit.notes),
        "seconds": fit.seconds,
        "stable": fit.stable,
        "ranges": {name: list(span) for name, span in fit.ranges.items()},
        "trust": None if fit.trust is None else fit.trust.as_json(),
        "parameters": [parameter._asdict() for parameter in fit.parameters],
    }
    with atomic_path(fit_path(path)) as temporary:
        temporary.write_text(json.dumps(sealed(content), indent=1) + "\n", encoding="utf-8")
    return fit_files(path)


def _judged(vehicle: IdentifiedVehicle) -> str | None:
    """Return the digest of the numbers that the vehicle's verdict is about; None if it states none."""
    return vehicle.validity.judged if vehicle.validity else None


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
    content = _fit_content(fit_path(path))
    is_of_file = content.get("vehicle_sha256") == sha256_of(path)
    if not is_of_file and (_judged(vehicle) is None or content.get("vehicle_judged") != _judged(vehicle)):
        raise FileFormatError(f"belongs to another vehicle than the one in {path}; identify again", path=fit_path(path))
    if not is_intact(content):
        vehicle = replace(vehicle, validity=Validity(edited(fit_path(path).name)))
    is_edited = vehicle.validity is not None and bool(vehicle.validity.edits)
    try:
        return VehicleFit(
            vehicle,
            str(content["recipe"]),
            read_response(_response_path(path)),
            {str(name): float(value) for name, value in content["residual"].items()},
            tuple(str(note) for note in content["notes"]),
            float(content["seconds"]),
            bool(content["stable"]),
            {str(name): (float(low), float(high)) for name, (low, high) in content.get("ranges", {}).items()},
            None if is_edited or content.get("trust") is None else Trust.of_json(content["trust"]),
            tuple(FittedParameter(**row) for row in content.get("parameters", [])),
        )
    except MALFORMED as error:
        what = f"is not a complete fit as this version writes it ({error}); identify again"
        raise FileFormatError(what, path=fit_path(path)) from error


def _fit_content(path: Path) -> dict[str, Any]:
    content = json_content(path, advice="there is no fit next to the vehicle file; identify again", finite=False)
    if not isinstance(content, dict) or content.get("kind") != "vehicle_fit":
        raise FileFormatError('is not a fit written by eightpost: its kind must be "vehicle_fit"', path=path)
    check_schema(content, SCHEMA, path)
    return content
