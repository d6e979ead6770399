"""Simulation of rig tests of cars with linear shocks, mode by mode with scipy's recursive filter."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.signal import lfilter

from eightpost.signals import TimeSeries
from eightpost.units import convert
from eightpost.vehicle import StateSpace, add_port_damping, read_vehicle, shipped

Array = NDArray[np.float64]

RATE, FINE = 250.0, 2000.0
BASELINE, ALTERNATE = convert(17.5, "lbf/(in/s)", "N.s/m"), convert(8.0, "lbf/(in/s)", "N.s/m")
HIGHEST = 30.0


class Rig(NamedTuple):
    """Car, its tests and its true parameters."""

    model: StateSpace
    rig: tuple[str, ...]
    forces: tuple[str, ...]
    outputs: tuple[str, ...]
    records: tuple[TimeSeries, ...]
    damping: Mapping[str, float]

    @property
    def inputs(self):
        return self.rig + self.forces

    @property
    def truth(self):
        """Exact model around the baseline damping, with the channels of the estimates."""
        return add_port_damping(self.model, self.damping).select(inputs=self.inputs, outputs=self.outputs)

    def input_power(self, frequency, width=0.2):
        """Return the power of each input around each frequency, summed over all records."""
        total = np.zeros((len(self.inputs), frequency.size))
        for record in self.records:
            channels = []
            for name in self.inputs:
                values = record[name]
                if name in self.forces:
                    port = name.removesuffix("force").rstrip(".")
                    values = values - self.damping[port] * record[name.removesuffix("force") + "velocity"]
                channels.append(values - values.mean())
            lines = np.fft.rfftfreq(len(record), 1.0 / record.sample_rate)
            power = np.abs(np.fft.rfft(np.stack(channels))) ** 2
            total += np.stack([power[:, np.abs(lines - f) <= width].mean(axis=1) for f in frequency], axis=1)
        return total


def noise(generator, samples, rate, highest=HIGHEST):
    """Return white noise up to `highest` [Hz], not periodic in the samples."""
    lines = np.fft.rfftfreq(2 * samples, 1.0 / rate)
    spectrum = generator.normal(size=lines.size) + 1j * generator.normal(size=lines.size)
    spectrum[(lines == 0.0) | (lines > highest)] = 0.0
    values = np.fft.irfft(spectrum)[:samples]
    return np.asarray(values / values.std())


def respond(model, u, rate, every):
    """Return every n-th sample of a model's outputs, from rest, for inputs (m, N) that are linear between samples."""
    h = 1.0 / rate
    poles, V = np.linalg.eig(model.A)
    B, C = np.linalg.solve(V, model.B.astype(complex)), model.C @ V
    y = (model.D @ u[:, ::every]).astype(complex)
    for pole, b, c in zip(poles, B, C.T, strict=True):
        big = expm(np.array([[pole, 1.0, 0.0], [0.0, 0.0, 1.0 / h], [0.0, 0.0, 0.0]], dtype=complex) * h)
        decay, held, ramp = big[0]
        if pole.imag < 0.0:
            continue
        drive = (b if pole.imag == 0.0 else 2.0 * b) @ u
        x = lfilter([ramp, held - ramp], [1.0, -decay], drive)
        x -= ramp * drive[0] * decay ** np.arange(drive.size)  # at rest in the first sample
        y += np.outer(c, x[::every])
    return np.asarray(y.real)


def rig_test(model, damping, drive):
    """Return a test with linear shocks: the drive, all outputs and the shock forces, at `RATE`."""
    loop = add_port_damping(model, damping)
    samples = next(iter(drive.values())).size
    u = np.stack([drive.get(name, np.zeros(samples)) for name in loop.input_names])
    every = round(FINE / RATE)
    y = respond(loop, u, FINE, every)
    channels = {c.name: (c.unit, u[i, ::every]) for i, c in enumerate(loop.inputs) if c.name in drive}
    channels |= {c.name: (c.unit, y[i]) for i, c in enumerate(loop.outputs)}
    for port, c in damping.items():
        prefix = f"{port}." if port else ""
        channels[f"{prefix}force"] = ("N", c * channels[f"{prefix}velocity"][1])
    return TimeSeries.from_channels(np.arange(y.shape[1]) / RATE, channels)


def rig(name, seconds, sizes, outputs):
    model = read_vehicle(shipped(name)).coupled()  # type: ignore[arg-type]
    generator = np.random.default_rng(4)
    samples = round(seconds * FINE)
    drive = {channel: size * noise(generator, samples, FINE) for channel, size in sizes.items()}
    ports = [n.removesuffix("force").rstrip(".") for n in model.input_names if n == "force" or n.endswith(".force")]
    baseline = dict.fromkeys(ports, BASELINE)
    setups = [baseline, *({**baseline, port: ALTERNATE} for port in ports)]
    records = tuple(rig_test(model, setup, drive) for setup in setups)
    forces = tuple(f"{port}.force" if port else "force" for port in ports)
    return Rig(model, tuple(sizes), forces, outputs, records, baseline)
