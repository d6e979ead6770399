"""What the scripts that make pages share: regions of a page, and calls of the command line."""

from __future__ import annotations

import re
import subprocess
import sys


def placed(page: str, name: str, table: str) -> str:
    """Return the page with a marked region replaced."""
    pattern = re.compile(rf"(<!-- {name} -->\n).*?(<!-- end -->)", re.DOTALL)
    return pattern.sub(lambda match: f"{match[1]}{table}\n{match[2]}", page)


def call(*arguments: object, may_fail: bool = False) -> None:
    """Run a command of eightpost; with `may_fail`, exit code 1 (a negative verdict) is accepted."""
    words = [str(argument) for argument in arguments]
    print("eightpost", *words, flush=True)
    code = subprocess.run([sys.executable, "-m", "eightpost", *words], check=False).returncode
    if code > (1 if may_fail else 0):
        raise SystemExit(f"eightpost {words[0]} exited with {code}")
