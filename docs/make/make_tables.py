"""Rewrite the tables in docs that are generated from the code: `python docs/make/make_tables.py`.

The variables in docs/reference/ports.md come from the interface.toml files, the rules in docs/reference/verdict.md from
the modules that define them, those in docs/reference/check.md from builder/check/rules.txt, the words in
docs/reference/glossary.md from eightpost/report/glossary.txt.
"""

import importlib
import re
import tomllib
from itertools import groupby
from pathlib import Path

from eightpost.report.page import glossary
from eightpost.verdict import Grade, Rule

DOCS = Path(__file__).resolve().parents[1]
FMUS = DOCS.parent / "fmus"

#: Pages that have generated tables.
PAGES = ("reference/check.md", "reference/glossary.md", "reference/ports.md", "reference/verdict.md")

#: Marker in the page -> file whose rows the table shows. "laws" stands for all of fmus/shock_<law>/.
SOURCES = {
    "shock": FMUS / "common" / "shock.toml",
    "vehicle_ss": FMUS / "vehicle_ss" / "interface.toml",
    "assembly": FMUS / "assembly" / "interface.toml",
}

#: Names of grades on the page of verdicts.
_SHORT = {Grade.LIMITED: "limited"}

#: Levels of rules of `check`, and the titles of their lists.
LEVELS = {"error": "Errors", "drop-in": "Drop-in", "hint": "Hints"}

_REGION = re.compile(
    r"(?P<start><!-- (?P<kind>table|rules|checks) (?P<name>[\w.,:; -]+?) -->\n).*?(?P<end><!-- end -->)", re.DOTALL
)
_HEADER = "| variable | reference | causality | unit | display | start, range | meaning |\n" + "|---" * 7 + "|\n"


def rewrite(page: str) -> str:
    """Return the page with every marked region replaced by the table of its interface."""
    return _REGION.sub(lambda match: match["start"] + _region(match["kind"], match["name"]) + match["end"], page)


def _region(kind: str, name: str) -> str:
    if kind == "rules":
        return rules(name)
    if kind == "checks":
        return checks(name.split("; "))
    if name == "words":
        return words()
    return laws() if name == "laws" else table(SOURCES[name])


def rules(module: str) -> str:
    """Return the rules that a module defines as lists, one for each subject, without notes and what is in order."""
    found = [rule for rule in importlib.import_module(module).RULES if rule.grade != Grade.USABLE]
    subjects = dict.fromkeys(rule.about for rule in found)
    lists = {about: _by_grade([rule for rule in found if rule.about == about]) for about in subjects}
    if len(lists) == 1:  # the heading of the page's section says what they are about
        return next(iter(lists.values()))
    return "\n".join(f"{about[0].upper()}{about[1:]}:\n\n{text}" for about, text in lists.items())


def _by_grade(found: list[Rule]) -> str:
    """Return a list of rules, in which successive ones of the same grade are a list of their own."""
    lines = []
    for grade, several in groupby(found, key=lambda rule: rule.grade):
        name, conditions = _SHORT.get(grade, grade), [rule.condition for rule in several]
        alone = len(conditions) == 1
        lines += [f"- {name}: {conditions[0]}"] if alone else [f"- {name}:", *(f"    - {text}" for text in conditions)]
    return "\n".join([*lines, ""])


def checks(titles: list[str]) -> str:
    """Return the rules of `check` under some titles of builder/check/rules.txt as lists, one for each level."""
    text = (DOCS.parent / "builder" / "check" / "rules.txt").read_text(encoding="utf-8")
    sections = {part.partition("\n")[0]: part.splitlines()[1:] for part in text.split("\n# ")}
    rows = [line.split(" | ") for title in titles for line in sections[title] if line]
    lists = []
    for level, heading in LEVELS.items():
        lines = [f"- `{row[0]}`: {row[2]}" for row in rows if row[1] == level]
        lists += ["\n".join([f"{heading}:", "", *lines, ""])] if lines else []
    return "\n".join(lists)


def words() -> str:
    """Return the list of all words of the glossary."""
    rows = glossary(common=True).items()
    return "".join(f"- *{word.replace(' | ', ', ')}*: {text}\n" for word, text in rows)


def laws() -> str:
    """Return every law's interface: its description, and the variables that it adds to those of all shocks."""
    return "".join(map(_law, sorted(FMUS.glob("shock_*/interface.toml"))))


def _law(source: Path) -> str:
    interface, kind = tomllib.loads(source.read_text(encoding="utf-8")), source.parent.name
    text = f"### {kind}\n\n{interface['description']}: [equations and limits](../../fmus/{kind}/README.md).\n\n"
    return text + (f"{table(source)}\n" if "variable" in interface else "It has no further variables.\n\n")


def table(source: Path) -> str:
    """Return the table of the rows of one file as Markdown."""
    rows = tomllib.loads(source.read_text(encoding="utf-8"))["variable"]
    return _HEADER + "".join(f"| {' | '.join(_cells(row))} |\n" for row in rows)


def _cells(row: dict) -> list[str]:
    size = row.get("size", 4 if "<corner>" in row["name"] else 1)
    name = f"{row['name']}[1] to [{size}]" if "size" in row and "<mode>" not in row["name"] else row["name"]
    first = row["reference"]
    reference = str(first) if size == 1 else f"{first} to {first + size - 1}"
    causality = ", ".join(row[key] for key in ("type", "causality", "variability") if key in row)
    description = row["description"].replace("|", r"\|")
    units = [row.get("unit", ""), row.get("display", "")]
    limits = ", ".join(filter(None, (_start(row), _range(row))))
    return [f"`{name}`", reference, causality, *units, limits, description]


def _start(row: dict) -> str:
    if "start" not in row:
        return "0" if row["causality"] == "input" else ""
    start = row["start"]
    if isinstance(start, str):
        return "shock file"
    return str(start).lower() if isinstance(start, bool) else f"{start:g}"


def _range(row: dict) -> str:
    low, high = row.get("min"), row.get("max")
    if low is None and high is None:
        return ""
    return f"{low:g} to {high:g}" if high is not None else f"from {low:g}"


if __name__ == "__main__":
    for name in PAGES:
        path = DOCS / name
        path.write_text(rewrite(path.read_text(encoding="utf-8")), encoding="utf-8")
