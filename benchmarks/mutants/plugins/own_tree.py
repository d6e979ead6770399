"""Plugin that makes sure that the tests import the sources of their own copy of the checkout."""

from __future__ import annotations

from pathlib import Path

import builder
import cosim
import eightpost

for _package in (builder, cosim, eightpost):
    if not Path(str(_package.__file__)).is_relative_to(Path.cwd()):
        raise RuntimeError(f"{_package.__name__} is imported from {_package.__file__}, not from {Path.cwd()}")
