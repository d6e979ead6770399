"""The C compiler that compiles sources of FMUs on this machine."""

from __future__ import annotations

import importlib.util
import os
import shutil
import sys

from eightpost.errors import FmuError
from eightpost.extras import install_command


def find_compiler() -> list[str]:
    """Return the command of the system's C compiler, else that of zig in PyPI's ziglang.

    Raises:
        FmuError: There is neither of them.
    """
    for name in (os.environ.get("CC", ""), "cc", "gcc", "clang"):
        if name and (found := shutil.which(name)):
            return [found]
    if importlib.util.find_spec("ziglang"):
        return [sys.executable, "-P", "-m", "ziglang", "cc"]  # -P: do not import files of the FMU
    advice = install_command("build")
    raise FmuError(f"no C compiler was found; install one: {advice}")
