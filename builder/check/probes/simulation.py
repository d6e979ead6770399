"""Probes of valid runs: simulation, steps, first outputs, ports, reference results."""

from __future__ import annotations

import csv
import hashlib
import itertools
import math
import random
import re
import struct
from bisect import bisect_right
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from builder.check.probes.bench import (
    REACH,
    Bench,
    CallError,
    Instance,
    Measured,
    Message,
    Results,
    Skip,
    TerminatedError,
    Value,
    Values,
    differ,
    inside,
    other_value,
    refused,
    status_name,
    wrong_times,
)
from builder.check.probes.library import DISCARD, ERROR, MissingFunctionError
from builder.check.rules import Fault, listed, some
from eightpost.fmi import Variable

# ---- Runs with constant and with varying inputs ---------------------------------------------------------------------

_WHOLE = re.compile(r"[+-]?[0-9]{1,20}")
_MOST_READ = 500  # variables
_OTHER = 0.01  # of the outputs' size: above the error of a solver that plans its steps up to the stop time
_MOST_LATE = 1000  # communication steps within one internal step of an FMU
_CONVERSION = re.compile(rb"%[-+ #0]*\d*(\.\d+)?(l|ll|h|z)?[diufFeEgGxXsScp]")


def probe_simulation(bench: Bench) -> Results:
    """Simulate and check start values, outputs, repeatability and log messages."""
    yield from _versions(bench)
    with bench.instance() as instance, suppress(MissingFunctionError):
        if refused(instance.call("SetDebugLogging", 1, 0, None)):
            yield "debug-logging", instance.last_message().removeprefix(": ") or "it is refused without a message"
    with bench.running(birth=replace(bench.birth, logging=True)) as instance:
        reached = _count_steps(bench, instance, bench.held)
        if reached == bench.timing.count:
            yield from _time_variable(bench, instance)
            instance.need("Terminate")
    if bench.inputs:
        with bench.running() as instance, suppress(CallError):  # reported as a finding below
            reached = min(reached, _count_steps(bench, instance, bench.excitation))
    if reached < bench.timing.count:
        yield Measured(REACH, str(reached))
        bench.timing = replace(bench.timing, count=reached)
    yield from _start_values(bench)
    yield from _reads(bench)
    try:
        runs = [_recorded(bench, logging) for logging in (True, False)]
    except CallError as error:
        yield "simulates-excited", str(error)
        return
    (first, messages), (second, unasked) = runs
    yield from _finite(bench, first)
    if (count := sum(m.status == 0 for m in unasked)) > 0.5 * bench.timing.count:
        yield "log-flood", f"{count} messages of the status OK in {bench.timing.count} steps"
    if first and differ(first, second):
        yield "deterministic", "a second run in the same process gave different outputs"
    else:
        yield from _with_stop(bench, first)
        yield from _unread(bench, first)
    yield from _messages(messages)


def _with_stop(bench: Bench, rows: list[Values]) -> Iterator[Fault]:
    """Compare a run that ends at a stop time with one that has none, whose outputs are given."""
    last = bench.timing.count - 1
    with suppress(CallError):  # other probes report this
        limited, _ = _recorded(bench, False, stop=bench.timing.at(last) + bench.timing.step)
        before = differ(rows[:-1], limited[:-1])
        if before > _OTHER or (before == 0.0 and differ(rows[-1:], limited[-1:])):
            where = "at the stop time" if before == 0.0 else "before the stop time"
            yield "stop-independent", f"outputs {where} differ from those of a run without one"


def _versions(bench: Bench) -> Iterator[Fault]:
    """Compare what the binary says about itself with the description."""
    stated = bench.description.attributes.get("fmiVersion", "")
    returned = {name: (bench.library.native(name)() or b"").decode("utf-8", "replace")
                for name in ("GetVersion", "GetTypesPlatform")[: 4 - bench.description.fmi]}  # fmt: skip
    version = returned["GetVersion"]
    if version != stated and (bench.description.fmi == 2 or version.split(".")[:2] != stated.split(".")[:2]):
        yield "version-string", f"it returns {version!r}, the description states {stated!r}"
    if returned.get("GetTypesPlatform", "default") != "default":
        yield "types-platform", f"it returns {returned['GetTypesPlatform']!r}"


def _count_steps(bench: Bench, instance: Instance, signal: Callable[[float], Values]) -> int:
    """Step until the end, or until the FMU ends the simulation itself; return the number of completed steps."""
    for point in bench.all_points():
        try:
            bench.run(instance, signal, range(point, point + 1))
        except TerminatedError as error:
            if point == 0:
                raise CallError(str(error)) from None
            return point
    return bench.timing.count


def _recorded(bench: Bench, logging: bool, stop: float | None = None) -> tuple[list[Values], list[Message]]:
    with bench.running(birth=replace(bench.birth, logging=logging), stop=stop) as instance:
        rows = bench.trace(instance, bench.all_points())
        instance.need("Terminate")
        return rows, instance.messages


def _time_variable(bench: Bench, instance: Instance) -> Iterator[Fault]:
    times = bench.description.of("independent")
    if not times:
        return
    point = bench.timing.count
    last = min(bench.timing.whole, point + _MOST_LATE)
    while (late := _lateness(bench, instance, times[0], point)) and point < last:
        bench.run(instance, bench.held, range(point, point + 1))  # the FMU may have longer internal steps
        point += 1
    if late:
        side = "behind" if late > 0.0 else "ahead"
        yield "time-variable", f"{times[0].name} is {abs(late)!r} s {side} at {bench.timing.at(point)!r} s"


def _lateness(bench: Bench, instance: Instance, time: Variable, point: int) -> float:
    """Return the difference [s] between the time of a point and the time variable; 0 if it is only rounding."""
    (found,), there = instance.reals([time]), bench.timing.at(point)
    return 0.0 if abs(found - there) <= 1e-9 * max(1.0, abs(there)) else there - found


def _reads(bench: Bench) -> Iterator[Fault]:
    """Read variables twice after some steps, the second time in reverse order."""
    variables = [v for v in bench.description.variables if v.is_callable][:_MOST_READ]
    with bench.running() as instance, suppress(CallError):  # other probes report this
        bench.run(instance, bench.held, range(min(_FEW, bench.timing.count)))
        first = [instance.get(variable) for variable in variables]
        again = [instance.get(variable) for variable in reversed(variables)][::-1]
        changed = (v.name for v, one, other in zip(variables, first, again, strict=True) if repr(one) != repr(other))
        yield "reads-repeatable", some(changed, "different when they are read again: ")
        alone = [(v, value) for v, (_, value) in zip(variables, first, strict=True) if v.type == "Real"][::-1]
        together = zip(alone, instance.reals([v for v, _ in alone]), strict=True)
        changed = (v.name for (v, one), other in together if repr(one) != repr(other))
        yield "reads-repeatable", some(changed, "different when they are read together: ")


def _unread(bench: Bench, rows: list[Values]) -> Iterator[Fault]:
    """Compare the last outputs with those of steps between which none are read."""
    with bench.running() as instance:
        for point in bench.all_points():
            bench.drive(instance, bench.excitation(bench.timing.at(point)))
            instance.advance(bench.timing.at(point), bench.timing.step)
        if differ(rows[-1:], [instance.reals(bench.outputs)]):
            yield "reads-repeatable", "outputs differ after steps between which none are read"


def _start_values(bench: Bench) -> Iterator[Fault]:
    wrong = []
    stated = (v for v in bench.description.variables if v.start is not None and v.is_callable)
    with bench.initializing() as instance:
        for variable in (v for v in stated if v.causality == "input" or v.effective_initial == "exact"):
            status, value = instance.get(variable)
            if refused(status):
                why = f"in initialization mode was rejected{instance.last_message()}"
                raise CallError(f"fmi2Get of {variable.name} {why}")
            if not _agrees(variable, value):
                wrong.append(f"{variable.name} is {value!r}, but {variable.start} in the XML")
    yield "start-agrees", "; ".join(wrong[:5]) + (" ..." if len(wrong) > 5 else "")


def _agrees(variable: Variable, value: Value) -> bool:
    start = variable.start or ""
    if isinstance(value, str):
        return value == start
    if variable.type == "Boolean":
        return bool(value) == (start.strip() in ("true", "1"))
    stated = variable.number("start")
    if variable.type in ("Integer", "Enumeration") and _WHOLE.fullmatch(start.strip()):
        return value == int(start)  # as a float, a number of 64 bits loses its last digits
    rounding = 1e-6 if variable.native == "Float32" else 1e-12
    return stated is None or math.isclose(float(value), stated, rel_tol=rounding)


def _finite(bench: Bench, rows: list[Values]) -> Iterator[Fault]:
    columns = zip(bench.outputs, zip(*rows, strict=True), strict=True)
    yield "finite-outputs", some((v.name for v, c in columns if not all(map(math.isfinite, c))), "not finite: ")


def _messages(messages: list[Message]) -> Iterator[Fault]:
    errors = (m.text.decode("utf-8", "replace").strip()[:200] for m in messages if m.status >= ERROR)
    yield "error-logged-while-fine", some(dict.fromkeys(errors), "it logged ", most=2)
    if wrong := next((m for m in messages if _is_unformatted(m)), None):
        yield "log-text", f"it logged {wrong.text[:200]!r}"


def _is_unformatted(message: Message) -> bool:
    try:
        text = message.text.decode("utf-8")
    except UnicodeDecodeError:
        return True
    return bool(_CONVERSION.search(message.text)) or not all(c.isprintable() or c in "\n\t\r" for c in text)


# ---- Inputs and tunable parameters ----------------------------------------------------------------------------------

_FEW, _SOME, _MOST_TUNED = 5, 50, 20  # steps, steps, parameters


def probe_inputs(bench: Bench) -> Results:
    """Set inputs once, and tunable parameters between steps."""
    yield from _kept(bench)
    parameters = [v for v in bench.description.of("parameter") if v.variability == "tunable"][:_MOST_TUNED]
    idle = (variable.name for variable in parameters if _is_idle(bench, variable))
    yield "tunable-used", some(idle, "without effect between steps, but with one before: ")


def _kept(bench: Bench) -> Iterator[Fault]:
    """Compare steps after inputs that are set in initialization mode only with steps before each of which they are."""
    values = [other_value(variable, random.Random(4)) for variable in bench.inputs]
    rows: list[list[Values]] = []
    read: list[Values] = []
    try:
        for is_repeated in (True, False):
            with bench.running(values) as instance:
                read = [instance.reals(bench.inputs)]
                rows.append([])
                for point in range(min(_FEW, bench.timing.count)):
                    if is_repeated:
                        bench.drive(instance, values)
                    instance.advance(bench.timing.at(point), bench.timing.step)
                    rows[-1].append(instance.reals(bench.outputs))
                read.append(instance.reals(bench.inputs))
    except CallError:
        return  # other probes report this
    for when, found in zip(("at the end of initialization", "in a step"), read, strict=True):
        if lost := [v.name for v, a, b in zip(bench.inputs, values, found, strict=True) if abs(a - b) > 1e-6 * abs(a)]:
            yield "inputs-kept", f"changed {when}: {listed(lost)}"
            return
    if differ(*rows) > _EQUAL:
        yield "inputs-kept", "outputs differ from those after the same inputs are set before each step"


_EQUAL = 1e-9


def _is_idle(bench: Bench, variable: Variable) -> bool:
    """Return whether a parameter has an effect if it is set before the first step, and none if it is set after two."""
    value = next(
        (v for k in range(9) if (v := other_value(variable, random.Random(k))) != variable.number("start")), 0.0
    )
    try:
        plain, early, late = (_tuned(bench, variable, value, at) for at in (None, 0, 2))
    except CallError:
        return False  # it contradicts another parameter
    return differ(plain, early) > _EQUAL and plain == late


def _tuned(bench: Bench, variable: Variable, value: float, at: int | None) -> list[Values]:
    """Return the outputs of a run in which a parameter is set in initialization mode (0) or after some steps."""
    rows = []
    with bench.instance() as instance:
        bench.enter(instance)
        for point in range(min(_SOME, bench.timing.count) + 1):
            if point == 1:
                instance.need("ExitInitializationMode")
            if point == at and refused(instance.set(variable, value)):
                raise CallError(f"{variable.name} was rejected")
            if point:
                rows += bench.run(instance, bench.excitation, range(point - 1, point))
    return rows


# ---- Steps of irregular length, also from other start times ---------------------------------------------------------

_LENGTHS = (1e-3, 1e-7, 0.05, 3.3e-4, 1e-6, 7e-3, 1e-5, 1 / 3 * 1e-2, 0.02, 1.1e-7)
_LATER = (0.0, 12.5, 1234.5)  # s after the start of the default experiment


def probe_steps(bench: Bench) -> Results:
    """Step with irregular lengths from several start times."""
    if not bench.description.can("canHandleVariableCommunicationStepSize"):
        yield Skip("canHandleVariableCommunicationStepSize is not true")
        return
    for later in _LATER:
        start = bench.timing.start + later
        with bench.instance() as instance:
            try:
                bench.enter(instance, start=start)
                instance.need("ExitInitializationMode")
            except CallError as error:
                yield "start-time", f"at {start!r} s, {error}"
                return
            yield from wrong_times(bench, instance, start)
            yield from _walk(bench, instance, start)


def _walk(bench: Bench, instance: Instance, start: float) -> Iterator[Fault]:
    time = start
    for round_number in range(4):
        for length in _LENGTHS:
            bench.drive(instance, bench.excitation(time, 0.5))
            status = instance.step(time, length)
            if status == DISCARD and instance.has_terminated():
                return
            if refused(status):
                is_usual = start == bench.timing.start  # after the end of its experiment an FMU may have no data
                rule = "irregular-steps" if status >= ERROR and is_usual else "irregular-discarded"
                yield rule, f"from {time!r} s by {length:g} s: {status_name(status)}{instance.last_message()}"
                return
            time += length
            if not all(map(math.isfinite, instance.reals(bench.outputs))):
                yield "finite-outputs", f"after irregular steps up to {length:g} s, at {time:g} s, round {round_number}"
                return


# ---- Outputs before the first step, from which that step must continue ----------------------------------------------

_TINY = (1e-7, 1e-6)  # s
_ELSEWHERE = 12.5  # s: another start time, at which an internal input of the FMU does not jump again
#: Minimum jump relative to the change in a tiny step, and relative to the output's size (rounding).
_TIMES, _ROUNDING = 30.0, 1e-9


def probe_first_outputs(bench: Bench) -> Results:
    """Compare the outputs at the start values and with other inputs.

    A jump at the start time only is not a defect: it may come from an internal input of the FMU.
    """
    if not bench.description.can("canHandleVariableCommunicationStepSize") or not bench.outputs:
        yield Skip("it has no Real outputs, or only supports a fixed step size")
        return
    for inputs in (bench.held(0.0), [other_value(v, random.Random(2)) for v in bench.inputs]):
        jumps = elsewhere = _jumps(bench, inputs, bench.timing.start)
        with suppress(CallError):  # the FMU cannot start at the other time
            elsewhere = _jumps(bench, inputs, bench.timing.start + _ELSEWHERE) if jumps else {}
        yield "first-outputs", some((jump for name, jump in jumps.items() if name in elsewhere), most=3)


def _jumps(bench: Bench, inputs: Values, start: float) -> dict[str, str]:
    """Return a description, by name, of each output that jumps in a tiny step."""
    before, *after = (_outputs(bench, inputs, start, h) for h in (0.0, *_TINY))
    if after[0] == after[1] and not _is_at_rest(bench, inputs, start, after[0]):
        return {}  # the FMU has longer internal steps: the change may be that of a whole internal step
    found = {}
    for variable, old, new, later in zip(bench.outputs, before, *after, strict=True):
        size = max(abs(old), abs(new), variable.number("nominal") or 1.0)  # default of FMI: 1
        jump, rate = abs(new - old), abs(later - new)
        if variable.variability == "continuous" and jump > max(_TIMES * rate, _ROUNDING * size):
            found[variable.name] = f"{variable.name} is {old:.6g} before the first step, {new:.6g} {_TINY[0]:g} s later"
    return found


def _outputs(bench: Bench, inputs: Values, start: float, h: float) -> Values:
    """Return the outputs after a step of h [s], or before any step."""
    with bench.running(inputs, start=start) as instance:
        if h > 0.0:
            bench.drive(instance, inputs)
            instance.advance(start, h)
        return instance.reals(bench.outputs)


def _is_at_rest(bench: Bench, inputs: Values, start: float, outputs: Values) -> bool:
    """Return whether the outputs do not change over long steps either."""
    return all(_outputs(bench, inputs, start, n * bench.timing.step) == outputs for n in (1, 2, 4))


# ---- Digest of the outputs, to compare a run with the same run elsewhere --------------------------------------------


def probe_surroundings(bench: Bench) -> Results:
    """Run and yield the digest of the outputs."""
    with bench.running() as instance:
        flat = [value for row in bench.trace(instance, bench.all_points()) for value in row]
    yield Measured("outputs", hashlib.sha256(struct.pack(f"<{len(flat)}d", *flat)).hexdigest())


# ==== Probe of velocity/force ports: a shock has input velocity and output force, a vehicle the reverse ==============

_FREQUENCY, _POINTS, _CYCLES = 4.0, 250, 3
_AMPLITUDES = (0.05, 0.2, 0.5)  # m/s
_FORCE = 200.0  # N
_ENERGY_TOLERANCE = 1e-3


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


def _cycle(bench: Bench, port: _Port, size: float) -> Iterator[Fault]:
    """Drive a shock through closed cycles and check the last one."""
    h = 1 / (_FREQUENCY * _POINTS)
    if not bench.description.can("canHandleVariableCommunicationStepSize"):
        h = bench.timing.step
    velocities, forces = _driven(bench, port, size, h)
    up = [f for v, f in zip(velocities, forces, strict=True) if v > 0.5 * size]
    down = [f for v, f in zip(velocities, forces, strict=True) if v < -0.5 * size]
    if up and down and (high := sum(up) / len(up)) <= (low := sum(down) / len(down)):
        text = f"{port.force.name} is {high:.4g} N in compression at {size:g} m/s, {low:.4g} N in rebound"
        yield "shock-sign", text
    powers = [v * f for v, f in zip(velocities, forces, strict=True)]
    energy, scale = sum(powers) * h, sum(map(abs, powers)) * h
    if energy < -_ENERGY_TOLERANCE * scale:
        yield "passive", f"{port.force.name} produced {-energy:.4g} J in a cycle of {size:g} m/s"


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
            instance.advance(bench.timing.start + point * h, h)
            velocities.append(velocity)
            forces += instance.reals([port.force])
    return velocities[-_POINTS:], forces[-_POINTS:]


def _push(bench: Bench, port: _Port) -> Iterator[Fault]:
    """Apply a positive force at one port of a vehicle from the start of a run: the shock there must extend."""
    ends = []
    for force in (0.0, _FORCE):
        with bench.running() as instance:
            instance.set(port.force, (port.force.number("start") or 0.0) + force)
            for point in range(5):
                instance.advance(bench.timing.at(point), bench.timing.step)
            ends += instance.reals([port.velocity])
    if ends[1] >= ends[0]:
        text = f"{_FORCE:g} N on {port.force.name} moved {port.velocity.name} by {ends[1] - ends[0]:+.3g} m/s"
        yield "vehicle-sign", text


# ==== Probe of the reference results in extra/ (files of the FMI cross-check: NAME_ref.csv, NAME_in.csv, NAME_ref.opt)

_TOLERANCE = 1e-3
Columns = Mapping[str, list[float]]


def probe_reference(bench: Bench) -> Results:
    """Compute every reference result again and compare."""
    found = sorted(bench.folder.glob("extra/**/*_ref.csv"))
    if not found:
        yield Skip("there are no reference results in extra/")
    for path in found:
        try:
            yield from _compare_file(bench, path)
        except (CallError, ValueError, KeyError, IndexError, OSError) as error:
            yield "reference-results", f"{path.name}: {error}"


def _compare_file(bench: Bench, path: Path) -> Iterator[Fault]:
    stem = path.name.removesuffix("_ref.csv")
    expected, given = _columns(path), path.with_name(f"{stem}_in.csv")
    inputs = _columns(given) if given.is_file() else {}
    options = _options(path.with_name(f"{stem}_ref.opt"))
    names = [name for name in expected if name != "time" and name in bench.description.by_name]
    got = _run_rows(bench, expected["time"], inputs, names)
    tolerance = options.get("RelTol", _TOLERANCE)
    errors = ((name, _worst(got[name], expected[name])) for name in names)
    wrong = (f"{name} by {worst:.1e}" for name, worst in errors if not worst <= tolerance)
    what = f"{path.name}: outputs differ by more than {tolerance:g} of their size: "
    yield "reference-results", some(wrong, what)


def _worst(got: list[float], expected: list[float]) -> float:
    size = max(map(abs, expected)) or 1.0
    return max(abs(a - b) for a, b in zip(got, expected, strict=True)) / size


def _run_rows(bench: Bench, times: list[float], inputs: Columns, names: list[str]) -> dict[str, list[float]]:
    """Step from row to row, with inputs held over each step as in the rules of the cross-check."""
    variables = [bench.description.by_name[name] for name in names]
    rows = []
    with bench.instance() as instance:
        bench.enter(instance, start=times[0])
        _set_inputs(bench, instance, inputs, times[0])
        instance.need("ExitInitializationMode")
        rows.append(instance.reals(variables))
        for begin, end in itertools.pairwise(times):
            _set_inputs(bench, instance, inputs, begin)
            instance.advance(begin, end - begin)
            rows.append(instance.reals(variables))
    return {name: [row[k] for row in rows] for k, name in enumerate(names)}


def _set_inputs(bench: Bench, instance: Instance, inputs: Columns, time: float) -> None:
    driven = [v for v in bench.inputs if v.name in inputs]
    if refused(instance.set_reals(driven, [_at(inputs, v.name, time) for v in driven])):
        raise CallError(f"inputs at {time:g} s were rejected{instance.last_message()}")


def _at(columns: Columns, name: str, time: float) -> float:
    times, values = columns["time"], columns[name]
    right = min(max(bisect_right(times, time), 1), len(times) - 1)
    left = right - 1
    share = min(max((time - times[left]) / (times[right] - times[left]), 0.0), 1.0)
    return values[left] + share * (values[right] - values[left])


def _columns(path: Path) -> dict[str, list[float]]:
    with path.open(newline="", encoding="utf-8") as stream:
        header, *rows = [row for row in csv.reader(stream) if row]
    return {name.strip().strip('"'): [float(row[k]) for row in rows] for k, name in enumerate(header)}


def _options(path: Path) -> dict[str, float]:
    if not path.is_file():
        return {}
    found = re.findall(r"(?m)^\s*(\w+)\s*[,=]\s*([-+0-9.eE]+)\s*$", path.read_text(encoding="utf-8"))
    return {name: float(value) for name, value in found}
