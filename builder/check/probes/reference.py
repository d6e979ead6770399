"""Probe of the reference results in extra/ (files of the FMI cross-check: NAME_ref.csv, NAME_in.csv, NAME_ref.opt)."""

from __future__ import annotations

import csv
import itertools
import re
from bisect import bisect_right
from collections.abc import Iterator, Mapping
from pathlib import Path

from builder.check.probes.bench import Bench, Results, Skip, step
from builder.check.probes.instance import CallError, Instance, refused
from builder.check.rules import RULES, Finding, listed

_TOLERANCE = 1e-3
Columns = Mapping[str, list[float]]


def probe_reference(bench: Bench) -> Results:
    """Compute every reference result again and compare."""
    found = sorted(bench.folder.glob("extra/**/*_ref.csv"))
    if not found:
        yield Skip("there are no reference results in extra/")
    for path in found:
        try:
            yield from _compare(bench, path)
        except (CallError, ValueError, KeyError, IndexError, OSError) as error:
            yield RULES["reference-results"].finding(f"{path.name}: {error}")


def _compare(bench: Bench, path: Path) -> Iterator[Finding]:
    stem = path.name.removesuffix("_ref.csv")
    expected = _columns(path)
    inputs = _columns(path.with_name(f"{stem}_in.csv")) if path.with_name(f"{stem}_in.csv").is_file() else {}
    options = _options(path.with_name(f"{stem}_ref.opt"))
    names = [name for name in expected if name != "time" and name in bench.description.by_name]
    got = _run(bench, expected["time"], inputs, names)
    tolerance = options.get("RelTol", _TOLERANCE)
    wrong = {name: worst for name in names if not (worst := _worst(got[name], expected[name])) <= tolerance}
    if wrong:
        shown = listed([f"{name} by {worst:.1e}" for name, worst in wrong.items()])
        yield RULES["reference-results"].finding(
            f"{path.name}: outputs differ by more than {tolerance:g} of their size: {shown}"
        )


def _worst(got: list[float], expected: list[float]) -> float:
    size = max(map(abs, expected)) or 1.0
    return max(abs(a - b) for a, b in zip(got, expected, strict=True)) / size


def _run(bench: Bench, times: list[float], inputs: Columns, names: list[str]) -> dict[str, list[float]]:
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
            step(instance, begin, end - begin)
            rows.append(instance.reals(variables))
    return {name: [row[k] for row in rows] for k, name in enumerate(names)}


def _set_inputs(bench: Bench, instance: Instance, inputs: Columns, time: float) -> None:
    driven = [v for v in bench.inputs if v.name in inputs]
    values = [_at(inputs, v.name, time) for v in driven]
    status = instance.set_reals(driven, values)
    if refused(status):
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
