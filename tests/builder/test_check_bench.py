"""What the probes of check derive from a description: steps of a run, amplitudes and other values of variables."""

from __future__ import annotations

import math
import random
from typing import Any

import pytest
from lxml import etree

from builder.check.probes import bench as probes
from builder.check.probes.bench import amplitude, change_of, differ, inside, other_value, status_name
from eightpost.fmi import Variable, read_description


def _variable(unit: str, causality: str = "input", **given: float) -> Variable:
    texts = {name: str(value) for name, value in given.items()}
    return Variable(0, "u", "0", "Real", causality, "continuous", None, "", {"unit": unit, **texts})


@pytest.mark.parametrize(
    ("experiment", "internal", "expected"),
    [
        ({"stopTime": "10", "stepSize": "0.01"}, "", (0.0, 0.01, 300, 1000)),
        ({"startTime": "1", "stopTime": "1.5", "stepSize": "0.1"}, "", (1.0, 0.1, 5, 5)),
        ({"stopTime": "3.0", "stepSize": "0.01"}, "", (0.0, 0.01, 300, 300)),
        ({"stopTime": "20"}, "", (0.0, 0.02, 300, 1000)),
        ({"stopTime": "1", "stepSize": "2"}, "", (0.0, 2.0, 300, 1000)),
        ({"stopTime": "1", "stepSize": "1"}, "", (0.0, 1.0, 1, 1)),
        ({"stopTime": "x", "stepSize": "y"}, "", (0.0, 1e-3, 300, 1000)),
        ({"stopTime": "1e9", "stepSize": "1e-3"}, "", (0.0, 1e-3, 300, 1_000_000_000)),
        ({}, "", (0.0, 1e-3, 300, 1000)),
        ({"stopTime": "1"}, "1e-4", (0.0, 1e-3, 300, 1000)),
        ({"stopTime": "1"}, "1e-6", (0.0, 1e-4, 300, 10_000)),
        ({"stopTime": "1"}, "1e-7", (0.0, 1e-5, 300, 10_000)),
        ({"stopTime": "1"}, "0.25", (0.0, 0.25, 4, 4)),
        ({"stopTime": "1"}, "-1", (0.0, 1e-3, 300, 1000)),
        ({"stopTime": "1"}, "z", (0.0, 1e-3, 300, 1000)),
    ],
)
def test_the_steps_of_a_run_are_those_of_the_default_experiment(
    experiment: dict[str, str], internal: str, expected: tuple[float, ...]
) -> None:
    root = etree.Element("fmiModelDescription", fmiVersion="2.0")
    etree.SubElement(root, "CoSimulation", modelIdentifier="x", fixedInternalStepSize=internal)
    etree.SubElement(root, "DefaultExperiment", experiment)
    timing = probes._timing(read_description(root))
    assert (timing.start, timing.step, timing.count, timing.whole) == pytest.approx(expected, rel=1e-12)
    assert timing.at(3) == timing.start + 3 * timing.step


@pytest.mark.parametrize(
    ("variable", "size"),
    [
        *(
            (_variable(unit), size)
            for unit, size in (("m/s", 0.2), ("m", 0.005), ("N", 200.0), ("N.m", 200.0), ("rad", 0.01))
        ),
        (_variable("K", start=300.0), 30.0),
        (_variable("K", start=-300.0), 30.0),
        (_variable("1", start=0.5), 0.1),
        (_variable("1", start=2.0), 0.2),
        (_variable("m", start=1.0, min=0.998), 0.002),
        (_variable("m", start=1.0, max=1.001, min=0.0), 0.001),
        (_variable("m", start=1.0, max=1.0), 0.005),
    ],
)
def test_an_amplitude_is_that_of_the_unit_within_the_range(variable: Variable, size: float) -> None:
    assert amplitude(variable) == pytest.approx(size)
    assert change_of(variable) == pytest.approx(1e-3 * size)
    start, high = variable.number("start") or 0.0, variable.number("max")
    values = [other_value(variable, random.Random(seed)) for seed in range(100)]
    assert max(abs(value - start) for value in values) <= size
    assert max(abs(value - start) for value in values) > 0.9 * size
    assert all(high is None or value <= high for value in values)


@pytest.mark.parametrize(
    ("unit", "start", "size"),
    [("N/m", 0.0, 1e3), ("N/m2", 0.0, 1e5), ("s", 0.0, 0.1), ("s", -4.0, 0.4), ("N/m", 5.0, 0.5)],
)
def test_a_parameter_changes_by_a_tenth_or_by_the_size_of_its_unit(unit: str, start: float, size: float) -> None:
    variable = _variable(unit, "parameter", start=start)
    values = [other_value(variable, random.Random(seed)) for seed in range(200)]
    assert 0.95 * size < max(abs(value - start) for value in values) <= size
    assert change_of(variable) == pytest.approx(1e-3 * (abs(start) or size))


def test_a_value_is_moved_into_its_range() -> None:
    variable = _variable("m", start=0.0, min=-1.0, max=2.0)
    assert [inside(variable, value) for value in (-3.0, -1.0, 0.5, 2.0, 7.0)] == [-1.0, -1.0, 0.5, 2.0, 2.0]
    assert inside(_variable("m"), 1e300) == 1e300


@pytest.mark.parametrize(
    ("first", "second", "difference"),
    [
        ([[1.0, 2.0], [4.0, -8.0]], [[1.0, 2.0], [4.0, -8.0]], 0.0),
        ([[1.0, 2.0], [4.0, -8.0]], [[1.0, 2.4], [3.8, -8.0]], 0.05),
        ([[0.0]], [[0.25]], 0.25),
        ([[math.nan]], [[math.nan]], 0.0),
        ([[1.0]], [[math.inf]], math.inf),
        ([[math.nan]], [[1.0]], math.inf),
    ],
)
def test_runs_differ_by_a_share_of_the_largest_value_of_an_output(first: Any, second: Any, difference: float) -> None:
    assert differ(first, second) == pytest.approx(difference)


def test_a_status_has_the_name_of_the_standard() -> None:
    names = ["fmi2OK", "fmi2Warning", "fmi2Discard", "fmi2Error", "fmi2Fatal", "fmi2Pending"]
    assert [status_name(status) for status in range(-1, 7)] == [
        "the unknown status -1", *names, "the unknown status 6"
    ]  # fmt: skip
