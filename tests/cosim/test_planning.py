"""Numbering of the components for the loop, for any wiring and any stepping order."""

from __future__ import annotations

from itertools import accumulate, pairwise
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cosim import Scenario, System
from cosim.session.setup import Layout, _lay_out
from cosim.systems.coupling import Coupling
from cosim.systems.system import Connection

NAMES = "abcdefg"

#: `make` has no state, so all examples can share it.
same_make = settings(suppress_health_check=[HealthCheck.function_scoped_fixture])

Wiring = tuple[list[int | None], list[str]]

#: For each component the index of its source or None; and the stepping order.
wirings = st.tuples(
    st.lists(st.none() | st.integers(0, len(NAMES) - 1), min_size=len(NAMES), max_size=len(NAMES)),
    st.permutations(NAMES),
)


def for_any_wiring(test: Any) -> Any:
    """Run a test for many wirings."""
    return same_make(given(wiring=wirings)(test))


def laid_out(make: Any, wiring: Wiring) -> tuple[Layout, dict[str, str]]:
    """Layout, and the source of each component's input."""
    sources, order = wiring
    takes = {name: NAMES[k] for name, k in zip(NAMES, sources, strict=True) if k is not None}
    system = System(
        {name: make.integrator("N", "N") for name in NAMES},
        connections=tuple(Connection(f"{source}.y", f"{name}.u") for name, source in takes.items()),
        constants={f"{name}.u": 0.0 for name in NAMES if name not in takes},
    )
    return _lay_out(Coupling(system, Scenario(1.0), every_step=(), recorded=()), order), takes


@pytest.mark.nightly
@for_any_wiring
def test_no_component_depends_on_an_earlier_one_of_its_level_and_levels_are_maximal(make: Any, wiring: Wiring) -> None:
    layout, takes = laid_out(make, wiring)
    bounds = list(accumulate((count for counts in layout.levels for count in counts), initial=0))
    assert bounds[-1] == len(NAMES)
    begins = set(accumulate(layout.groups, initial=0))
    for first, last in pairwise(bounds):
        level = layout.parts[first:last]
        for k, name in enumerate(level):
            assert takes.get(name) not in level[:k]
        if first not in begins:
            before = layout.parts[bounds[bounds.index(first) - 1] : first]
            assert takes[level[0]] in before


@for_any_wiring
def test_connected_components_are_adjacent_and_keep_the_stepping_order(make: Any, wiring: Wiring) -> None:
    layout, takes = laid_out(make, wiring)
    home = {
        name: g
        for g, (first, last) in enumerate(pairwise(accumulate(layout.groups, initial=0)))
        for name in layout.parts[first:last]
    }
    assert sorted(home) == sorted(NAMES)
    assert all(home[name] == home[source] for name, source in takes.items())
    for g in set(home.values()):
        group = [name for name in layout.parts if home[name] == g]
        assert group == [name for name in wiring[1] if home[name] == g]
