"""Write docs/reference/commands.md from the commands themselves: `python docs/make/make_commands.py`.

The page has a section for each verb, with the help text and the list of options that `eightpost VERB --help` prints.
An option of several verbs is described at the first of them.
"""

import inspect
import re
import textwrap
from pathlib import Path

import click

from eightpost.__main__ import VERBS, main
from eightpost.app.options import Verb

PAGE = Path(__file__).resolve().parents[1] / "reference" / "commands.md"

_WIDTH = 120

#: Number of words of a meaning that is repeated.
_SHORT = 8

_INTRODUCTION = """# Commands

<!-- all blocks: run by tests/docs/test_command_examples.py -->

All commands of `eightpost` by reader and in the order of the work, with all their options and settings, as
`eightpost VERB --help` prints them. A setting is rarely needed and is given with `--set NAME=VALUE`. Spellings of the
last version still work, with a warning that names the new one.
This page is generated: `python docs/make/make_commands.py` writes it.

A quantity is given with its unit, e.g. `--step '1 ms'`, unless the option names the unit. Exit codes: 0 if the
command succeeded, 1 if its result is not acceptable or it did not complete, 2 if the input is wrong.

"""


def page() -> str:
    """Return the text of the page."""
    context = click.Context(main, info_name="eightpost")
    commands = [main.get_command(context, verb) for verb in VERBS]
    sections = [_section(command, click.Context(command, context, command.name)) for command in commands]
    return _once(_INTRODUCTION + _options(main, context) + "".join(sections))


def _once(text: str) -> str:
    """Return the page with every option that an earlier section has, with the same text, as a link to that section."""
    lines, section, first = [], "", dict[str, str]()
    for line in text.splitlines(keepends=True):
        if line.startswith("#"):
            section = line.strip("# \n")
        name, _, meaning = line.partition("`: ")
        if len(meaning.split()) > _SHORT and first.setdefault(line, section) != section:
            lines.append(f"{name}`: as for [{first[line]}](#{first[line].replace(' ', '-')}).\n")
        else:
            lines.append(line)
    return "".join(lines)


def _section(command: click.Command, context: click.Context, level: str = "##") -> str:
    """Return the section of one verb: usage, help text, examples and options, then those of its sub-verbs."""
    name = context.command_path.removeprefix("eightpost ")
    usage = " ".join([context.command_path, *command.collect_usage_pieces(context)])
    own = f"\n{level} {name}\n\n```text\n{usage}\n```\n\n{_text(command.help)}"
    if not isinstance(command, click.Group):
        return own + _options(command, context)
    below = [command.get_command(context, verb) for verb in command.list_commands(context)]
    return own.rstrip("\n") + "\n" + "".join(_section(c, click.Context(c, context, c.name), f"{level}#") for c in below)


def _text(help_text: str) -> str:
    """Return a help text as Markdown; a block that click must not rewrap is code."""
    blocks = []
    for block in inspect.cleandoc(help_text).split("\n\n"):
        if block.startswith("\b\n"):
            title, *lines = block.splitlines()[1:]
            code = "\n".join(line.strip() for line in lines)
            language = "sh" if code.startswith("eightpost ") else "text"
            blocks.append(f"{title}\n\n```{language}\n{code}\n```")
        else:
            blocks.append(textwrap.fill(_linked(" ".join(block.split())), _WIDTH, break_on_hyphens=False))
    return "".join(f"{block}\n\n" for block in blocks)


def _options(command: click.Command, context: click.Context) -> str:
    """Return the list of a command's options and settings."""
    options = [option for option in command.params if isinstance(option, click.Option)]
    rows = [option.get_help_record(context) for option in options if option.opts != ["--set"]]
    if isinstance(command, Verb):
        rows += [(f"--set {name}", entry.title) for name, entry in command.settings.items()]
    return "".join(f"- `{name}`: {_linked(' '.join(text.split()))}\n" for name, text in rows)


def _linked(text: str) -> str:
    """Return a text whose pages are links, and whose angle brackets are not HTML."""
    return re.sub(r"docs/(\w+)/ ?(\w+\.md)", _link, text.replace("<", r"\<"))


def _link(match: re.Match[str]) -> str:
    """Return the link from the page of commands to another page."""
    folder, name = match.groups()
    return f"[{name}]({name if folder == PAGE.parent.name else f'../{folder}/{name}'})"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
