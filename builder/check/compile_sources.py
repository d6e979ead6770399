"""Command that compiles an unpacked FMU with FMPy: `python -m builder.check.compile_sources FOLDER`."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from fmpy.build import build_platform_binary

if __name__ == "__main__":
    tempfile.tempdir = str(Path.cwd())  # the parent process removes this folder even if the compiler was killed
    build_platform_binary(sys.argv[1])
