"""docs/reference/dropin.md has every line once, and the tests that it names exist."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "reference" / "dropin.md").read_text(encoding="utf-8")
NAMED = sorted(set(re.findall(r"`((?:tests|benchmarks)/[\w/]+\.py)(?:::(\w+))?`", PAGE)))


def test_the_table_has_every_line_once():
    assert [int(n) for n in re.findall(r"^\| (\d+) \|", PAGE, flags=re.MULTILINE)] == list(range(1, 28))


def test_every_named_test_exists():
    assert len(NAMED) > 50
    files = {path: (ROOT / path).read_text(encoding="utf-8") for path, _ in NAMED if (ROOT / path).is_file()}
    assert [
        f"{path}::{test}"
        for path, test in NAMED
        if path not in files or (test and not re.search(rf"^def {test}\(", files[path], flags=re.MULTILINE))
    ] == []
