"""Help texts load no numerical library, and name the choices and defaults of the library."""

from __future__ import annotations

import subprocess
import sys
from typing import get_args

import click
import pytest

import cosim
from builder.build import TARGETS
from cosim.study.choice import rig_day
from cosim.study.running import workers
from eightpost.__main__ import every_verb
from eightpost.app.options import Setting
from eightpost.ident.shock.law_fit import GasTreatment, RecipeName, Robust
from eightpost.ident.vehicle.plan import RECIPES
from eightpost.shock import LAWS
from eightpost.virtual.program import PROGRAMS, TRUTHS

SLOW = ("numpy", "scipy", "matplotlib", "numba", "llvmlite", "pint", "arro3", "plotly", "pydantic", "fmpy", "jinja2")

#: All verbs run in one process, so that a library loaded by any of them is found.
EVERY_HELP = """
import sys
from eightpost.__main__ import every_verb, main
for verb in every_verb():
    print(f"== {verb}")
    main([*verb.split(), "--help"], standalone_mode=False)
    for module in %r:
        assert module not in sys.modules, f"{verb} --help loads {module}"
"""


def test_no_help_text_loads_a_numerical_library() -> None:
    ran = subprocess.run(
        [sys.executable, "-c", EVERY_HELP % (SLOW,)], capture_output=True, text=True, encoding="utf-8", check=False
    )
    assert ran.returncode == 0, ran.stderr
    assert all(f"== {verb}\nUsage: " in ran.stdout for verb in every_verb())


def option(verb: str, name: str) -> click.Parameter | Setting:
    """Return an option, or the setting without hyphens."""
    command = every_verb()[verb]
    return command.settings.get(name) or next(parameter for parameter in command.params if name in parameter.opts)


@pytest.mark.parametrize(("verb", "name", "taken"), [
    ("fit", "--law", tuple(LAWS)), ("fit", "recipe", get_args(RecipeName)), ("fit", "robust", get_args(Robust)),
    ("fit", "--gas", get_args(GasTreatment)), ("identify", "recipe", tuple(RECIPES)),
    ("virtual rig", "--car", tuple(TRUTHS)), ("virtual rig", "--program", PROGRAMS), ("build", "--target", TARGETS),
    ("run", "--algorithm", tuple(cosim.SCHEMES)),
])  # fmt: skip
def test_an_option_offers_the_choices_of_the_library(verb: str, name: str, taken: tuple[str, ...]) -> None:
    found = option(verb, name)
    kind = found.kind if isinstance(found, Setting) else found.type
    assert isinstance(kind, click.Choice)
    assert tuple(kind.choices) == taken


@pytest.mark.parametrize(("verb", "name", "default"), [
    ("study select", "--total", rig_day.TOTAL), ("study select", "pool", rig_day.POOL),
    ("study run", "patience", f"{workers.PATIENCE:g} s"),
])  # fmt: skip
def test_an_option_has_the_default_of_the_library(verb: str, name: str, default: object) -> None:
    assert option(verb, name).default == default
