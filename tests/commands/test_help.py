"""Help texts load no numerical library, and name the choices and defaults of the library."""

from __future__ import annotations

import subprocess
import sys
from inspect import signature
from typing import get_args

import click
import pytest

import cosim
from builder.build import TARGETS
from builder.check import Scope
from cosim.study.choice import selection
from cosim.study.running import workers
from eightpost.__main__ import VERBS, main
from eightpost.ident.shock.law_fit import GasTreatment, RecipeName, Robust
from eightpost.ident.vehicle.plan import RECIPES
from eightpost.shock import LAWS
from eightpost.virtual.program import PROGRAMS, TRUTHS

SLOW = ("numpy", "scipy", "matplotlib", "numba", "llvmlite", "pint", "pyarrow", "plotly", "pydantic", "fmpy", "jinja2")

#: All verbs run in one process, so that a library loaded by any of them is found.
EVERY_HELP = """
import sys
from eightpost.__main__ import VERBS, main
for verb in VERBS:
    print(f"== {verb}")
    main([verb, "--help"], standalone_mode=False)
    for module in %r:
        assert module not in sys.modules, f"{verb} --help loads {module}"
"""


def test_no_help_text_loads_a_numerical_library() -> None:
    ran = subprocess.run(
        [sys.executable, "-c", EVERY_HELP % (SLOW,)], capture_output=True, text=True, encoding="utf-8", check=False
    )
    assert ran.returncode == 0, ran.stderr
    assert all(f"== {verb}\nUsage: " in ran.stdout for verb in VERBS)


def option(verb: str, name: str) -> click.Parameter:
    command = main.get_command(click.Context(main), verb)
    assert command is not None
    return next(parameter for parameter in command.params if name in parameter.opts)


@pytest.mark.parametrize(
    ("verb", "name", "taken"),
    [
        ("fit", "--law", tuple(LAWS)),
        ("fit", "--recipe", get_args(RecipeName)),
        ("fit", "--robust", get_args(Robust)),
        ("fit", "--gas", get_args(GasTreatment)),
        ("identify", "--recipe", tuple(RECIPES)),
        ("rig", "--car", tuple(TRUTHS)),
        ("rig", "--program", PROGRAMS),
        ("build", "--target", TARGETS),
        ("run", "--algorithm", tuple(cosim.SCHEMES)),
    ],
)
def test_an_option_offers_the_choices_of_the_library(verb: str, name: str, taken: tuple[str, ...]) -> None:
    kind = option(verb, name).type
    assert isinstance(kind, click.Choice)
    assert tuple(kind.choices) == taken


@pytest.mark.parametrize(
    ("verb", "name", "default"),
    [
        ("select", "--total", selection.TOTAL),
        ("select", "--pool", selection.POOL),
        ("study", "--patience", f"{workers.PATIENCE:g} s"),
        ("check", "--standard", Scope.ALL.value),
    ],
)
def test_an_option_has_the_default_of_the_library(verb: str, name: str, default: object) -> None:
    assert option(verb, name).default == default


@pytest.mark.parametrize("verb", VERBS)
def test_a_verb_takes_its_options(verb: str) -> None:
    command = main.get_command(click.Context(main), verb)
    assert command is not None and command.callback is not None
    parameters = signature(command.callback)
    context = ["context"] if "ctx" in parameters.parameters else []
    parameters.bind(*context, **{parameter.name: None for parameter in command.params if parameter.name is not None})
