"""What is not plain technical English: fragments in argument descriptions, and words and phrases that no manual uses.

    python -m tests.language [PATH ...]

Prints every finding in the given files or folders (default: the whole project) as path:line: text.
"""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("eightpost", "builder", "cosim", "fmus", "dissertation", "benchmarks", "tests", "examples")
_ABOUT_LANGUAGE = {Path(__file__), ROOT / "tests" / "docs" / "test_language.py"}
DOCUMENTS = ("README.md", "CONTRIBUTING.md", "docs", "fmus")

#: A description of an argument begins with a noun phrase or a verb phrase, so with none of these.
NO_BEGINNING = re.compile(
    r"(after|and|are|as|at|before|beside|between|by|for|from|has|have|how|if|in|into|is|it|its|like|not|of|on|or|out|"
    r"over|per|than|that|their|theirs|them|then|these|they|this|those|to|under|until|what|when|where|which|who|whose|"
    r"with|without)\b",
    re.IGNORECASE,
)

#: Expressions that a native engineer would not use, and what to write.
EXPRESSIONS = {
    r"\bhangs? on\b": "depends on",
    r"\bbetters\b": "dominates, is better than",
    r"\bmend(s|ed|ing)?\b": "correct, repair",
    r"\bweigh(s|ed)? down\b": "down-weighted",
    r"\bgives? no sign\b": "is not responding",
    r"\bgoes on where it\b": "resumes where it stopped",
    r"\b(is|are) said\b": "is reported, is stated",
    r"\b(was|were) said\b": "was reported, was stated",
    r"\bsaid of\b": "reported about, stated for",
    r"\btold (from|apart|by|with)\b": "distinguished from, reported with",
    r"\b(is|are|be) told\b": "is reported",
    r"\bthe least\b(?![- ](squares|recently))": "the smallest, the minimum",
    r"\bthe greatest\b": "the largest, the maximum",
    r"\bat the (least|greatest)\b": "at the minimum, at the maximum",
    r"\banew\b": "again",
    r"\btheirs\b": "name the things",
    r"\b(none|no more) it is\b": "use the usual word order",
    r"\bas people say it\b": "display name",
    r"\bhold(s|ing)? (it )?against\b": "compare with",
    r"\bheld against\b": "compared with",
    r"\bheld from (falling|rising)\b": "constrained to be monotonic",
    r"\bheld to rise\b": "constrained to be monotonic",
    r"\bhardly (hangs|any)\b": "barely, almost no",
    r"\bof no use\b": "not useful",
    r"\bby and by\b": "gradually",
    r"\bis (a )?none\b": "is not ..., does not exist",
    r"\bare none\b": "do not exist",
    r"\bthere are none of\b": "there is no",
    r"\bcomes? to (an|its|the) end\b": "ends",
    r"\b(begins?|began) with none\b": "is empty at first",
    r"\bfor (its|their|his) own part\b": "leave it out",
    r"\bwherefrom\b|\bwhereof\b|\bthereof\b|\bthereby\b|\bwherein\b": "use short sentences",
    r"\bof a sudden\b": "suddenly",
    r"\bwell-known to all\b": "leave it out",
    r"\bno (other|more) such\b": "no other",
    r"\bso that none\b": "so that no ...",
    r"\bup to now\b": "so far",
    r"\bgo(es|ing)? by\b": "use, follow",
    r"\bwent by\b": "used, followed",
    r"\b(?:it|they|that) (?:is|are) (?:long )?gone\b": "no longer exists",
    r"\bstands? beside\b": "is next to, is shown with",
    r"\blies? beside\b": "is in the same folder as",
    r"\btold apart\b": "distinguished",
    r"\b(where )?there (is|are) none\b": "say what is missing",
    r"\b(as it stands|as they stand|as people read)\b": "leave it out",
    r"\b(bears? witness|next to no|none like another|takes the place of)\b": "use the usual verb",
    r"\b(brought (forward|into step)|handed round|hangs? together)\b": "say what is done",
    r"\b(the wrong way round|turns? round|the other way round)\b": "has the wrong sign, reverses, is reversed",
    r"\b(says? no unit|comes? twice|without a word|worth a word)\b": "has no unit, occurs twice, without a message",
    r"\b(by how much|errs by|so many-th|seconds on)\b": "use the quantity's name",
    r"\bhold(s|ing)? (\w+ )?against\b": "compare with",
    r"\b(this very|gives? way|rings on|what blurs|what came|is parted|lays? through|out of line)\b": "use the term",
    r"\bto the byte\b": "byte for byte",
}

#: Any of them: far faster than each one in turn, because all begin at a word boundary, which is looked for once.
_ANY = re.compile(r"\b(?:" + "|".join(pattern.removeprefix(r"\b") for pattern in EXPRESSIONS) + ")")

_SECTIONS = re.compile(r"^(Args|Attributes|Returns|Raises|Yields|Source|Sources|Example|Examples|Note)s?:$")
_ENTRY = re.compile(r"^    (\*{0,2}\w+(?:, \*{0,2}\w+)*)(?: \(.*?\))?: +(\S.*)$")


@dataclass(frozen=True)
class Finding:
    """A place where the text is not plain English."""

    path: Path  #: File, relative to the project's root.
    line: int  #: Line number.
    text: str  #: Explanation.

    def __str__(self) -> str:
        return f"{self.path}:{self.line}: {self.text}"


def fragments(path: Path) -> Iterator[Finding]:
    """Yield the descriptions of arguments and attributes of a Python file that are fragments."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef | ast.Module):
            for line, name, text in _descriptions(node):
                if NO_BEGINNING.match(text):
                    yield Finding(path.relative_to(ROOT), line, f"the description of {name} is a fragment: {text}")


def expressions(path: Path) -> Iterator[Finding]:
    """Yield the expressions of a text file that no manual uses."""
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        for pattern, better in EXPRESSIONS.items() if _ANY.search(line) else ():
            if match := re.search(pattern, line):
                yield Finding(path.relative_to(ROOT), number, f"{match[0]!r}: write {better}: {line.strip()}")


def python_files(folders: tuple[str, ...] = PACKAGES) -> list[Path]:
    """Return the project's Python files."""
    return sorted(path for folder in folders for path in (ROOT / folder).rglob("*.py") if path not in _ABOUT_LANGUAGE)


def text_files() -> list[Path]:
    """Return all files whose text is checked: Python, C, pages."""
    sources = [path for suffix in ("*.c", "*.h") for path in (ROOT / "fmus").rglob(suffix)]
    pages = [ROOT / name for name in DOCUMENTS if name.endswith(".md")]
    pages += [path for name in DOCUMENTS if not name.endswith(".md") for path in (ROOT / name).rglob("*.md")]
    return python_files() + sorted(sources) + sorted(path for path in pages if path.exists())


def _descriptions(node: ast.AST) -> Iterator[tuple[int, str, str]]:
    """Yield line, name and description of each entry of the sections Args and Attributes of a docstring."""
    body = getattr(node, "body", [])
    if not (body and isinstance(body[0], ast.Expr) and isinstance(body[0].value, ast.Constant)):
        return
    docstring, section = body[0].value, ""
    if not isinstance(docstring.value, str):
        return
    indent = " " * docstring.col_offset
    for offset, line in enumerate(docstring.value.splitlines()):
        stripped = line.removeprefix(indent)
        if match := _SECTIONS.match(stripped):
            section = match[1]
        elif section in ("Args", "Attributes") and (entry := _ENTRY.match(stripped)):
            yield docstring.lineno + offset, entry[1], entry[2]


def _chosen(paths: list[str]) -> list[Path]:
    wanted = [Path(path).resolve() for path in paths]
    files = text_files()
    return [path for path in files if not wanted or any(path == one or one in path.parents for one in wanted)]


def main() -> int:
    """Print the findings in the files or folders that are named."""
    found: list[Finding] = []
    for path in _chosen(sys.argv[1:]):
        found += [*expressions(path), *(fragments(path) if path.suffix == ".py" else ())]
    print("\n".join(map(str, found)))
    print(f"{len(found)} findings", file=sys.stderr)
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())
