"""A law's own functions are compiled, cached on disk, and compiled again when a law's file changes."""

from __future__ import annotations

from importlib.util import module_from_spec, spec_from_file_location

import numpy as np
import pytest

from eightpost.ident.shock.lag import lag
from eightpost.ident.shock.stepped import _lagged_columns
from eightpost.shock import Maxwell
from eightpost.shock.compiled import _number_of, machine, stepped_force


@pytest.fixture
def record(curve):
    velocity = np.sin(np.linspace(0.0, 30.0, 400))
    return Maxwell(curve, 4e6), velocity, np.full(399, 1e-3)


def test_the_compiled_law_is_the_scalar_law(record):
    law, velocity, step = record
    found = stepped_force(Maxwell, law.valve._replace(curve=law.curve.numbers()), (4e6,), velocity, step)
    lagged = [law.static_force(velocity[0])]
    for start, end, h in zip(velocity[:-1], velocity[1:], step, strict=True):
        lagged.append(law.advance(lagged[-1], start, end, h))
    np.testing.assert_allclose(found, lagged, rtol=1e-11, atol=1e-8)


def test_the_machine_code_is_found_on_disk_the_second_time(record):
    law, velocity, step = record
    valve = law.valve._replace(curve=law.curve.numbers())
    stepped_force(Maxwell, valve, (4e6,), velocity, step)
    again = machine.__wrapped__(Maxwell)
    again(valve, (4e6,), velocity, step, np.empty(velocity.size))
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


def test_a_varying_lag_with_a_constant_time_constant_is_the_lag():
    columns = np.random.default_rng(3).normal(size=(300, 4))
    found = _lagged_columns(columns, np.full(300, 1.3e-3), 5e-4)
    np.testing.assert_allclose(found, lag(columns, 1.3e-3, 5e-4), rtol=1e-10, atol=1e-12)


def test_no_lag_leaves_the_columns_as_they_are():
    columns = np.random.default_rng(4).normal(size=(50, 2))
    np.testing.assert_allclose(_lagged_columns(columns, np.zeros(50), 1e-3), columns, rtol=1e-8, atol=1e-8)
