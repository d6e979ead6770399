"""Probe of velocity/force ports: a shock has input velocity and output force, a vehicle the reverse."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from builder.check.probes.bench import Bench, Results, Skip, Values, inside, step
from builder.check.rules import RULES, Finding
from eightpost.fmi.description import Variable

_FREQUENCY, _POINTS, _CYCLES = 4.0, 250, 3
_AMPLITUDES = (0.05, 0.2, 0.5)  # m/s
_FORCE = 200.0  # N
_TOLERANCE = 1e-3


@dataclass(frozen=True)
class _Port:
    """The velocity and force of one port, and its displacement if there is one."""

    velocity: Variable
    force: Variable
    displacement: Variable | None


def probe_ports(bench: Bench) -> Results:
    """Find the ports and excite them."""
    shocks = list(_ports(bench, "input", "output"))
    vehicles = list(_ports(bench, "output", "input"))
    if not shocks and not vehicles:
        yield Skip("there is no pair of velocity [m/s] and force [N]")
    for port in shocks:
        for size in _AMPLITUDES:
            yield from _cycle(bench, port, size)
    for port in vehicles:
        yield from _push(bench, port)


def _ports(bench: Bench, velocity: str, force: str) -> Iterator[_Port]:
    by_name = bench.description.by_name
    for v in bench.description.of(velocity):
        prefix, dot, last = v.name.rpartition(".")
        other = by_name.get(f"{prefix}{dot}force")
        if last == "velocity" and v.unit == "m/s" and other and other.causality == force and other.unit == "N":
            beside = by_name.get(f"{prefix}{dot}displacement")
            yield _Port(v, other, beside if beside and beside.causality == velocity else None)


def _cycle(bench: Bench, port: _Port, size: float) -> Iterator[Finding]:
    """Drive a shock through closed cycles and check the last one."""
    h = 1 / (_FREQUENCY * _POINTS)
    if not bench.description.can("canHandleVariableCommunicationStepSize"):
        h = bench.timing.step
    velocities, forces = _driven(bench, port, size, h)
    up = [f for v, f in zip(velocities, forces, strict=True) if v > 0.5 * size]
    down = [f for v, f in zip(velocities, forces, strict=True) if v < -0.5 * size]
    if up and down and sum(up) / len(up) <= sum(down) / len(down):
        yield RULES["shock-sign"].finding(
            f"{port.force.name} is {sum(up) / len(up):.4g} N in compression at {size:g} m/s, "
            f"{sum(down) / len(down):.4g} N in rebound"
        )
    powers = [v * f for v, f in zip(velocities, forces, strict=True)]
    energy, scale = sum(powers) * h, sum(map(abs, powers)) * h
    if energy < -_TOLERANCE * scale:
        yield RULES["passive"].finding(f"{port.force.name} produced {-energy:.4g} J in a cycle of {size:g} m/s")


def _driven(bench: Bench, port: _Port, size: float, h: float) -> tuple[Values, Values]:
    """Return velocity and force over the last cycle; the force is that at the end of the step with that velocity."""
    velocities: Values = []
    forces: Values = []
    rate = 2 * math.pi / (_POINTS * h)
    with bench.running() as instance:
        for point in range(_CYCLES * _POINTS):
            phase = rate * h * point
            velocity = inside(port.velocity, size * math.sin(phase))
            inputs, values = [port.velocity], [velocity]
            if port.displacement is not None:
                inputs.append(port.displacement)
                values.append(inside(port.displacement, -size / rate * math.cos(phase)))
            instance.set_reals(inputs, values)
            step(instance, bench.timing.start + point * h, h)
            velocities.append(velocity)
            forces += instance.reals([port.force])
    return velocities[-_POINTS:], forces[-_POINTS:]


def _push(bench: Bench, port: _Port) -> Iterator[Finding]:
    """Apply a positive force at one port of a vehicle from the start of a run: the shock there must extend."""
    ends = []
    for force in (0.0, _FORCE):
        with bench.running() as instance:
            instance.set(port.force, (port.force.number("start") or 0.0) + force)
            for point in range(5):
                step(instance, bench.timing.at(point), bench.timing.step)
            ends += instance.reals([port.velocity])
    if ends[1] >= ends[0]:
        yield RULES["vehicle-sign"].finding(
            f"{_FORCE:g} N on {port.force.name} moved {port.velocity.name} by {ends[1] - ends[0]:+.3g} m/s"
        )
