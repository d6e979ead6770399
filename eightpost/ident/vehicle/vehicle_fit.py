"""An identified vehicle with all that a person wants to know of how it came about: what every recipe returns."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from eightpost import __version__
from eightpost.errors import FileFormatError
from eightpost.files import MALFORMED, atomic_path, json_content, sha256_of
from eightpost.ident.response import FrequencyResponse, read_response, write_response
from eightpost.ident.vehicle.trust import Trust
from eightpost.vehicle import IdentifiedVehicle, read_vehicle, write_vehicle

if TYPE_CHECKING:
    from collections.abc import Sequence

#: The newest layout of the files of fits that is understood, and the one written.
SCHEMA = 1


@dataclass(frozen=True, slots=True, eq=False)
class VehicleFit:
    """An identified vehicle and how good it is.

    Attributes:
        vehicle: What `write_vehicle` writes: model, baseline damping, digests of the input files.
        recipe: The name of the recipe.
        response: What the model was fitted to, conditioned, around the baseline damping.
        residual: By output, how far the model's response is from `response`, weighted by frequency as the fit was [1].
        notes: What a person must know, a sentence each: what was dropped, replaced, reduced, is doubtful.
        seconds: Processor time of estimate and fit [s].
        stable: Whether the vehicle settles with the baseline dampers and with every other damping that was tried.
        ranges: What the tests covered: smallest and largest value by channel, SI, and of `frequency` [Hz]; empty where
            the recipe does not say.
        trust: What the fit says of itself: deviations, friction, flags, orders; None where the recipe does not.
    """

    vehicle: IdentifiedVehicle
    recipe: str
    response: FrequencyResponse
    residual: Mapping[str, float]
    notes: tuple[str, ...] = ()
    seconds: float = 0.0
    stable: bool = True
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    trust: Trust | None = None

    @property
    def sources(self) -> Mapping[str, str]:
        """SHA-256 digests of the input files, by name."""
        return self.vehicle.sources

    @property
    def states(self) -> int:
        """The number of states of the model."""
        return len(self.vehicle.state_space.A)


def response_path(path: str | Path) -> Path:
    """Return where the response of a fit lies, beside its vehicle: car.json has car.response.npz."""
    return Path(path).with_suffix(".response.npz")


def story_path(path: str | Path) -> Path:
    """Return where what was said of a fit lies, beside its vehicle: car.json has car.fit.json."""
    return Path(path).with_suffix(".fit.json")


def write_fit(path: str | Path, fit: VehicleFit) -> tuple[Path, ...]:
    """Write a fit: the vehicle as .json, its response and what was said of it beside it.

    Returns:
        The files written.
    """
    path = Path(path)
    write_vehicle(path, fit.vehicle)
    write_response(response_path(path), fit.response, sources=fit.sources)
    content = {
        "kind": "vehicle_fit",
        "schema": SCHEMA,
        "tool": f"eightpost {__version__}",
        "vehicle_sha256": sha256_of(path),
        "recipe": fit.recipe,
        "residual": dict(fit.residual),
        "notes": list(fit.notes),
        "seconds": fit.seconds,
        "stable": fit.stable,
        "ranges": {name: list(span) for name, span in fit.ranges.items()},
        "trust": None if fit.trust is None else fit.trust.as_json(),
    }
    with atomic_path(story_path(path)) as temporary:
        temporary.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    return path, response_path(path), story_path(path)


def read_fit(path: str | Path) -> VehicleFit:
    """Read a fit that `write_fit` wrote, by the path of its vehicle.

    Raises:
        FileFormatError: A file is missing, no fit of ours, of a newer schema, or of another vehicle.
    """
    path = Path(path)
    vehicle = read_vehicle(path)
    if not isinstance(vehicle, IdentifiedVehicle):
        raise FileFormatError("is no identified vehicle", path=path)
    story = _story(story_path(path))
    if story.get("vehicle_sha256") != sha256_of(path):
        raise FileFormatError(f"tells of another vehicle than {path} now holds; identify again", path=story_path(path))
    try:
        return VehicleFit(
            vehicle,
            str(story["recipe"]),
            read_response(response_path(path)),
            {str(name): float(value) for name, value in story["residual"].items()},
            tuple(_words(story["notes"])),
            float(story["seconds"]),
            bool(story["stable"]),
            {str(name): (float(low), float(high)) for name, (low, high) in story.get("ranges", {}).items()},
            None if story.get("trust") is None else Trust.of_json(story["trust"]),
        )
    except MALFORMED as error:
        what = f"does not hold a fit as this version writes it ({error})"
        raise FileFormatError(what, path=story_path(path)) from error


def _words(notes: Sequence[Any]) -> list[str]:
    return [str(note) for note in notes]


def _story(path: Path) -> dict[str, Any]:
    content = json_content(path, advice="the vehicle has no fit beside it", finite=False)
    if not isinstance(content, dict) or content.get("kind") != "vehicle_fit":
        raise FileFormatError("is no fit of ours: its kind says something else", path=path)
    schema = content.get("schema")
    if not isinstance(schema, int) or schema > SCHEMA:
        what = f"it has schema {schema}, this eightpost {__version__} reads up to {SCHEMA}; update eightpost"
        raise FileFormatError(what, path=path)
    return content
