"""A law's own functions are compiled, cached on disk, and compiled again when a law's file changes."""

from __future__ import annotations

from importlib.util import module_from_spec, spec_from_file_location

import numpy as np
import pytest

from eightpost.shock import Lpnl2
from eightpost.shock.compiled import _number_of, law_numbers, record_loop, stepped_force

OWN = (1.3e-3, 400.0, 900.0)


@pytest.fixture
def record(curve):
    velocity = np.sin(np.linspace(0.0, 30.0, 400))
    return Lpnl2(curve, *OWN), velocity, np.full(399, 1e-3)


def test_the_compiled_law_is_the_scalar_law(record):
    law, velocity, step = record
    found = stepped_force(Lpnl2, law.valve._replace(curve=law.curve.numbers()), OWN, velocity, step)
    lagged = [law.static_force(velocity[0])]
    for start, end, h in zip(velocity[:-1], velocity[1:], step, strict=True):
        lagged.append(law.advance(lagged[-1], start, end, h))
    expected = [law.response(f, v, 0.0).force for f, v in zip(lagged, velocity, strict=True)]
    np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-8)


def test_the_machine_code_is_found_on_disk_the_second_time(record):
    law, velocity, step = record
    valve = law.valve._replace(curve=law.curve.numbers())
    stepped_force(Lpnl2, valve, OWN, velocity, step)
    again = record_loop.__wrapped__()
    again(law_numbers([law]), velocity, step, np.empty((velocity.size, 2)), np.empty(velocity.size))
    assert sum(again.stats.cache_hits.values()) == 1
    assert not again.stats.cache_misses


def test_the_cache_key_changes_when_a_file_changes(tmp_path):
    path = tmp_path / "law.py"
    numbers = []
    for factor in (1, 2):
        path.write_text(f"def core(x):\n    return {factor} * x\n")
        module = module_from_spec(spec_from_file_location("law", path))
        module.__spec__.loader.exec_module(module)
        numbers.append(_number_of({module.core}))
    assert numbers[0] != numbers[1]
    assert min(numbers) > 0
