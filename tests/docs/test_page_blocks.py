"""Every code block of every page is run by a test, or says why not; its commands, options, files and imports exist."""

from __future__ import annotations

import ast
import importlib
import json
import re
import textwrap
import tomllib
from pathlib import Path
from xml.etree import ElementTree

import click
import pytest

from eightpost.__main__ import main
from eightpost.errors import FileFormatError
from tests.docs.page_blocks import FILES, ROOT, Block, all_blocks, blocks, commands

ALL = all_blocks()

#: Programs that are not part of the project; their commands are read by nobody here.
OTHERS = {"cc", "dask", "git", "lint-imports", "pip", "pyrefly", "pytest", "ruff", "unzip", "cd", "."}


def of(*languages: str) -> list[Block]:
    """Return the blocks of languages, which must exist."""
    found = [block for block in ALL if block.language in languages]
    assert found
    return found


def test_blocks_are_found():
    assert len(ALL) > 150
    assert {"run", "run elsewhere", "not run", "file", "output", "equation"} <= {block.kind for block in ALL}


def test_every_block_is_run_or_marked():
    """The coverage of the pages is complete: no block is of an unknown kind."""
    unknown = [f"{block.place} [{block.language}]" for block in ALL if block.kind == "unknown"]
    assert unknown == [], "give the block a language, or a comment: see tests/docs/page_blocks.py"


def test_a_block_that_is_not_run_has_a_reason():
    reasons = {block.note.removeprefix("not run: ") for block in ALL if block.kind == "not run"}
    assert reasons and all(len(reason.split()) > 2 for reason in reasons)


def test_a_block_that_a_test_runs_names_one_and_every_named_test_exists():
    named = {block.place: re.findall(r"tests/[\w/]+\.py", block.note) for block in ALL if block.note}
    assert any(named.values())
    assert [block.place for block in ALL if block.note.startswith("run by ") and not named[block.place]] == []
    assert [(place, path) for place, paths in named.items() for path in paths if not (ROOT / path).is_file()] == []


def check_eightpost(words: list[str]) -> None:
    """Parse a command as the command line does; nothing is run."""
    command: click.Command = main
    context = click.Context(main, info_name="eightpost")
    words = list(words)
    while isinstance(command, click.Group) and words and not words[0].startswith("-"):
        name = words.pop(0)
        if name not in command.list_commands(context) and command.usual:
            words, name = [name, *words], command.usual
        found = command.get_command(context, name)
        assert found is not None, f"eightpost has no verb {name}"
        command, context = found, click.Context(found, context, info_name=name)
    if not isinstance(command, click.Group):
        try:
            command.make_context(command.name, words)
        except FileFormatError as error:  # a file of the reader's own
            assert "there is no such file" in str(error)


def check_command(words: list[str]) -> None:
    program, *rest = words
    name = Path(program).name or program
    if name == "eightpost":
        check_eightpost(rest)
    elif name == "make":
        targets = set(re.findall(r"^(\w+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
        assert {word for word in rest if "=" not in word} <= targets
    elif name == "python" and rest[0] == "-m":
        if rest[1] == "eightpost":
            check_eightpost(rest[2:])
        elif rest[1].split(".")[0] in ("benchmarks", "tests"):
            path = ROOT.joinpath(*rest[1].split("."))
            assert path.with_suffix(".py").is_file() or (path / "__main__.py").is_file(), rest[1]
        else:
            assert rest[1] in ("pip", "venv", "pytest"), rest[1]
    elif name == "python":
        assert (ROOT / rest[0]).is_file(), f"there is no {rest[0]}"
    else:
        assert name in OTHERS, f"{name}: no program of this project; add it to OTHERS if it is meant"
    for word in rest:
        if word.startswith(("examples/", "docs/", "benchmarks/", "tests/")) and "*" not in word:
            assert (ROOT / word).exists(), f"there is no {word}"


def test_the_commands_of_a_block_exist_with_their_options_and_files():
    wrong = []
    for block in of("sh"):
        if block.kind != "run elsewhere":
            found = list(commands(block))
            assert found, block.place
            for words in found:
                try:
                    check_command(words)
                except (AssertionError, click.ClickException, ValueError) as error:
                    wrong.append(f"{block.place}: {' '.join(words)}: {error}")
    assert wrong == []


@pytest.mark.parametrize("line", [
    "eightpost fitt examples/data/dyno_A.csv", "eightpost fit examples/data/dyno_A.csv --lew lpf1",
    "eightpost fit examples/data/dyno_A.csv --law lpf9", "eightpost rig --test random --duration '5 kg'",
    "eightpost run examples/no_such_system.toml", "python benchmarks/no_such_script.py",
    "python -m benchmarks.no_such_benchmark", "make no_such_target", "no_such_program",
])  # fmt: skip
def test_a_command_that_does_not_exist_is_found(line):
    (words,) = commands(Block("page.md", 1, "sh", line, ""))
    with pytest.raises((AssertionError, click.ClickException, ValueError)):
        check_command(words)


def import_names(node: ast.AST) -> None:
    """Import what an import statement names."""
    if isinstance(node, ast.ImportFrom) and not node.level:
        module = importlib.import_module(node.module)
        for alias in node.names:
            if not hasattr(module, alias.name):
                importlib.import_module(f"{node.module}.{alias.name}")
    elif isinstance(node, ast.Import):
        for alias in node.names:
            importlib.import_module(alias.name)


def test_the_names_that_a_python_block_imports_exist():
    missing = []
    for block in of("python"):
        for node in ast.walk(ast.parse(textwrap.dedent(block.text))):
            try:
                import_names(node)
            except ImportError as error:
                missing.append(f"{block.place}: {error}")
    assert missing == []


def parse_file(block: Block) -> None:
    """Parse a file that a page shows."""
    if block.language == "toml":
        tomllib.loads(block.text)
    elif block.language == "json":
        json.loads(block.text if block.text.startswith("{") else f"{{{block.text}}}")
    else:
        ElementTree.fromstring(block.text)


def test_a_file_on_a_page_has_the_syntax_of_its_format():
    wrong = []
    for block in of(*FILES):
        try:
            parse_file(block)
        except (ValueError, ElementTree.ParseError) as error:
            wrong.append(f"{block.place}: {error}")
    assert wrong == []


@pytest.mark.parametrize("text", [
    "from eightpost.shock import no_such_law", "import eightpost.no_such_module",
])  # fmt: skip
def test_a_name_that_does_not_exist_is_found(text):
    with pytest.raises(ImportError):
        import_names(ast.parse(text).body[0])


@pytest.mark.parametrize(("language", "text"), [("toml", "a ="), ("json", '"a": 1,'), ("xml", "<a>")])
def test_a_file_of_wrong_syntax_is_found(language, text):
    with pytest.raises((ValueError, ElementTree.ParseError)):
        parse_file(Block("page.md", 1, language, text, ""))


def test_a_mark_is_read_from_the_line_before_a_block(tmp_path, monkeypatch):
    monkeypatch.setattr("tests.docs.page_blocks.ROOT", tmp_path)
    page = tmp_path / "page.md"
    page.write_text(
        "<!-- not run: needs MATLAB here -->\n```matlab\nx\n```\n\n```sh\nmake demo  # all\n```\n\n    indented\n\n"
        "```{toctree}\npage\n```\n"
    )
    first, second, third = blocks(page)
    assert (first.kind, second.kind, third.kind) == ("not run", "run", "unknown")
    assert list(commands(second)) == [["make", "demo"]]
