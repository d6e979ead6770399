"""Exact rig records of the dissertation's linear cars, computed from the spectra of periodic drives."""

import numpy as np
from numpy.typing import NDArray

from eightpost.corners import CORNERS
from eightpost.rig import RigTest
from eightpost.signals import TimeSeries
from eightpost.units import convert
from eightpost.vehicle import add_port_damping, read_vehicle, shipped

Array = NDArray[np.float64]

RATE = 1250.0
DAMPING = convert(17.5, "lbf/(in/s)", "N.s/m")
PORTS = {"quarter_car": ("",), "seven_dof": CORNERS}


def car(name, damping=None):
    """Return a car of the dissertation with linear dampers; `damping` replaces `DAMPING` at its ports."""
    model = read_vehicle(shipped(name)).coupled()  # type: ignore[arg-type]
    return add_port_damping(model, dict.fromkeys(PORTS[name], DAMPING) | dict(damping or {}))


def spectrum(samples, highest, generator):
    """Return a random spectrum, constant up to 2 Hz, decreasing up to `highest` [Hz]; standard deviation 1."""
    lines = np.fft.rfftfreq(samples, 1.0 / RATE)
    shape = np.where((lines > 0.0) & (lines < highest), 1.0 / np.maximum(lines / 2.0, 1.0), 0.0)
    drawn = shape * (generator.normal(size=lines.size) + 1j * generator.normal(size=lines.size))
    return np.asarray(drawn / np.fft.irfft(drawn, samples).std())


def record(name, *, seconds=10.0, seed=1, damping=None, active=(), size=1.0, noise=1e-3):
    """Return a random test at 1250 Hz; `noise` is relative to the standard deviation of each channel."""
    model, generator = car(name, damping), np.random.default_rng(seed)
    samples = round(seconds * RATE)
    drive = np.zeros((len(model.inputs), samples // 2 + 1), dtype=complex)
    for i, channel in enumerate(model.inputs):
        if channel.name.endswith("road"):
            drive[i] = 0.004 * spectrum(samples, 30.0, generator)
        elif not channel.name.endswith("force") or channel.name in ("aero_force", "heave_force"):
            drive[i] = 500.0 * spectrum(samples, 5.0, generator)
        if active and channel.name not in active:
            drive[i] = 0.0
    drive *= size
    driven = np.flatnonzero(np.any(drive != 0.0, axis=0))
    H = model.frequency_response(driven * RATE / samples)
    answer = np.zeros((len(model.outputs), samples // 2 + 1), dtype=complex)
    answer[:, driven] = np.einsum("pmk,mk->pk", H, drive[:, driven])
    channels = {c.name: (c.unit, np.fft.irfft(drive[i], samples)) for i, c in enumerate(model.inputs)}
    channels |= {c.name: (c.unit, np.fft.irfft(answer[i], samples)) for i, c in enumerate(model.outputs)}
    for port in PORTS[name]:
        corner, rate = f"{port}." if port else "", (damping or {}).get(port, DAMPING)
        channels[f"{corner}force"] = ("N", rate * channels[f"{corner}velocity"][1])
    channels = {n: c for n, c in channels.items() if not n.endswith(("position", "spring_force"))}
    measured = {n: (u, v + noise * v.std() * generator.standard_normal(samples)) for n, (u, v) in channels.items()}
    return RigTest(TimeSeries.from_channels(np.arange(samples) / RATE, measured))
