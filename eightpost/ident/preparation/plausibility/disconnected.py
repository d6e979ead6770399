"""Channels that carry noise: no other channel explains them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from eightpost.array_types import Array
from eightpost.corners import channel
from eightpost.ident.preparation.plausibility.finding import Finding
from eightpost.ident.preparation.plausibility.laws.pairs import across
from eightpost.ident.preparation.plausibility.rules import DISCONNECTED
from eightpost.ident.preparation.plausibility.spectra import Spectra, Spectrum

#: Largest explained share of a disconnected channel's power [1].
NOISE = 0.3
#: Smallest explained share of a sound channel's power [1], and share of the channels that must reach it.
SOUND, MOST = 0.6, 0.6
#: A corner, or an aeroloader, is not checked if its command or road moves less than this share of the largest [1].
RESTING = 0.2
#: A corner whose measured motion is above this share of the largest moves, whatever its command says [1].
DRIVEN = 0.5
#: Aeroloaders that move less than this share of the largest tire force are at rest [1].
UNLOADED = 0.02
#: Smallest number of neighbouring frequencies over which a response is taken as constant: 1 Hz.
NEIGHBOURS = 4
#: Number of degrees of freedom that must remain; short records need wider bands for it.
FREEDOM = 10

_OWN = ("road", "tire_force", "displacement", "force", "hub_acceleration", "chassis_acceleration")
_FAR = ("hub_acceleration", "chassis_acceleration")


def disconnected(spectra: Spectra, corners: Sequence[str]) -> tuple[Finding, ...]:
    """Return the channels that no other channel explains, if the others explain each other."""
    shares = {
        name: share
        for name, others in _predictors(spectra, corners).items()
        if (share := _explained(spectra.rows[name], [spectra.rows[other] for other in others])) is not None
    }
    sound = [name for name, share in shares.items() if share > SOUND]
    if len(sound) < MOST * len(shares):
        return ()
    return tuple(_finding(name, share) for name, share in shares.items() if share < NOISE)


def _finding(name: str, share: float) -> Finding:
    text = f"{name} is unrelated to the other channels, which explain {100.0 * max(share, 0.0):.0f} % of its power"
    return Finding(DISCONNECTED, (name,), text, DISCONNECTED.remedy)


def _predictors(spectra: Spectra, corners: Sequence[str]) -> Mapping[str, Sequence[str]]:
    """Return the channels that could explain each channel; a velocity does not explain its own potentiometer."""
    bodies = [channel(corner, "chassis_acceleration") for corner in corners]
    found: dict[str, list[str]] = {}
    for corner in _moving(spectra, corners, "road"):
        own = [channel(corner, name) for name in (*_OWN, "road_command")]
        other = across(corner)
        far = [] if other is None else [channel(other, name) for name in _FAR]
        for quantity in (*_OWN, "road_command", "velocity"):
            name = channel(corner, quantity)
            skipped = channel(corner, "displacement") if quantity == "velocity" else name
            found[name] = [n for n in (*own, *far) if n not in (name, skipped)]
    for corner in _moving(spectra, corners, "aero"):
        aero = [channel(corner, name) for name in ("aero", "aero_command", "aero_position")]
        for name in aero:
            found[name] = [n for n in (*aero, *bodies) if n != name]
    if len(_moving(spectra, corners, "road")) == len(corners):
        found |= dict.fromkeys(("cg.vertical_acceleration", "driver.acceleration"), bodies)
        roads = [channel(corner, "road") for corner in corners]
        found |= {name: [*bodies, *roads] for name in ("ride_height", "front.ride_height", "rear.ride_height")}
    known = {name: [other for other in others if other in spectra] for name, others in found.items() if name in spectra}
    return {name: others for name, others in known.items() if others}


def _moving(spectra: Spectra, corners: Sequence[str], quantity: str) -> list[str]:
    """Return the corners whose actuator moves by its command or by the measured motion.

    A command that is only noise is small within the band. Without commands, all roads move in a broadband record.
    """
    sizes, own = (_sizes(spectra, corners, name) for name in (f"{quantity}_command", quantity))
    largest = max((*sizes.values(), *own.values()), default=0.0)
    if quantity == "aero":
        if largest < UNLOADED * max(_sizes(spectra, corners, "tire_force").values(), default=0.0):
            return []
        sizes = own | sizes
    by_command, by_motion = (share * max(of.values(), default=0.0) for share, of in ((RESTING, sizes), (DRIVEN, own)))
    return [corner for corner in corners if sizes.get(corner, largest) > by_command or own.get(corner, 0.0) > by_motion]


def _sizes(spectra: Spectra, corners: Sequence[str], quantity: str) -> dict[str, float]:
    """Return the size of a quantity at each corner that has it."""
    names = {corner: channel(corner, quantity) for corner in corners}
    return {corner: float(np.linalg.norm(spectra.rows[name])) for corner, name in names.items() if name in spectra}


def _explained(output: Spectrum, inputs: Sequence[Spectrum]) -> float | None:
    """Return the share of an output's power that responses to the inputs explain, adjusted for their number."""
    # Neighbouring frequencies and overlapping segments of a Hann window are not independent.
    needed = 3.0 * (len(inputs) + FREEDOM) / len(output)
    width = max(NEIGHBOURS, int(np.ceil(needed)))
    samples = len(output) * width / 3.0
    bands = [slice(edge, edge + width) for edge in range(0, output.shape[1] - width + 1, width)]
    if not bands:
        return None
    parts = np.array([_residual(output[:, band], [x[:, band] for x in inputs]) for band in bands])
    left, power = parts.sum(axis=0)
    return 1.0 - float(left / power) * samples / (samples - len(inputs)) if power > 0.0 else None


def _residual(output: Spectrum, inputs: Sequence[Spectrum]) -> Array:
    """Return the residual of the best response in one band, and the power, both relative to the power."""
    y = output.ravel()
    columns = np.stack([x.ravel() for x in inputs], axis=1)
    sizes = np.linalg.norm(columns, axis=0)
    columns = columns[:, sizes > 0.0] / sizes[sizes > 0.0]
    power = float(np.vdot(y, y).real)
    if power == 0.0 or not columns.size:
        return np.array([1.0, 1.0])
    rest = y - columns @ np.linalg.lstsq(columns, y, rcond=1e-9)[0]
    return np.array([float(np.vdot(rest, rest).real), power])
