"""`python -m builder.check.compile_sources <unpacked FMU>`: builds its binary for this platform as fmpy does."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from fmpy.build import build_platform_binary

if __name__ == "__main__":
    tempfile.tempdir = str(Path.cwd())  # the parent removes the folder, also when the compiler was ended
    build_platform_binary(sys.argv[1])
