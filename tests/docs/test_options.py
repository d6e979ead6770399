"""Every option and argument of every verb is described in its help text and on a page."""

import importlib
import re
from pathlib import Path

import click
import pytest

from eightpost.__main__ import every_verb
from eightpost.app.options import Quantity
from tests.language import EXPRESSIONS, NO_BEGINNING

ROOT = Path(__file__).parents[2]
#: Generated from the help texts, so that it proves nothing about them.
COMMANDS_PAGE = ROOT / "docs" / "reference" / "commands.md"
PAGES = {
    path: path.read_text(encoding="utf-8")
    for path in (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))
    if path != COMMANDS_PAGE
}


COMMANDS = every_verb()

#: Options of all verbs, by what a user types.
OPTIONS = {
    f"{verb} {max(option.opts, key=len)}": (verb, option)
    for verb, command in COMMANDS.items()
    for option in command.params
    if isinstance(option, click.Option)
}
#: Settings of all verbs, by what a user types.
SETTINGS = {
    f"{verb} --set {name}": (verb, one) for verb, command in COMMANDS.items() for name, one in command.settings.items()
}

#: Placeholders of values that have a unit; all other numbers with a fraction have one too, or state their range.
QUANTITIES = {"DB", "FREQUENCY", "HZ", "LENGTH", "PERCENT", "PRESSURE", "RATE", "SECONDS", "SPEED", "TIME"}

#: A unit in brackets, a quoted value with its unit, or the range of a dimensionless number.
UNIT = re.compile(r"\[(Hz|s|m|%|dB)\b|\[%|'-?[\d.]+ [a-zA-Z%][\w./%]*[',]|-?\d to \d")


def takes_quantity(option: click.Option) -> bool:
    metavar = set(re.findall(r"\w+", option.metavar or ""))
    return isinstance(option.type, click.types.FloatParamType) or bool(metavar & QUANTITIES)


def help_of(verb: str, option: click.Option) -> str:
    """Return the text that `--help` prints of an option, with its default."""
    record = option.get_help_record(click.Context(COMMANDS[verb]))
    assert record is not None
    return record[1]


def test_the_options_of_all_verbs_are_found():
    """Otherwise the tests below would pass without a case."""
    assert {verb for verb, _ in OPTIONS.values()} == set(COMMANDS) - {"new", "units"}
    assert SETTINGS


def test_there_are_at_most_120_options():
    """The tool of the dissertation is not counted, nor are settings, which are rarely needed."""
    assert len([name for name in OPTIONS if not name.startswith("reproduce")]) <= 120


def test_an_option_has_a_help_text_that_is_no_fragment():
    texts = {name: option.help for name, (_, option) in OPTIONS.items()}
    texts |= {name: one.text for name, (_, one) in SETTINGS.items()}
    for name, text in texts.items():
        assert text and len(text.split()) > 1, f"{name} has no help text"
        assert text[0].isupper(), f"{name}: begin it with a capital: {text}"
        assert not NO_BEGINNING.match(text), f"{name}: begin it with a noun or a verb: {text}"
        assert text.endswith("."), f"{name}: end it with a full stop: {text}"


def test_an_option_that_may_be_left_out_names_its_default():
    assert [name for name, (_, one) in SETTINGS.items() if not one.several and "default" not in one.title.lower()] == []
    assert [
        name
        for name, (verb, option) in OPTIONS.items()
        if not (option.is_flag or option.required or option.multiple) and "default" not in help_of(verb, option).lower()
    ] == []


def test_an_option_that_takes_a_quantity_names_a_unit_or_an_example_with_one():
    found = {name: help_of(verb, option) for name, (verb, option) in OPTIONS.items() if takes_quantity(option)}
    found |= {
        name: f"{one.text} '{one.default}'"
        for name, (_, one) in SETTINGS.items()
        if isinstance(one.kind, Quantity | click.types.FloatParamType)
    }
    assert {"fit --set cutoff", "run --step", "study run --set patience", "virtual rig --set frequency"} <= set(found)
    assert not {"fit --set name", "study run --workers", "run --fmu"} & set(found)
    assert [f"{name}: {text}" for name, text in found.items() if not UNIT.search(text.replace("default: ", "'"))] == []


@pytest.mark.parametrize(("text", "accepted"), [
    ("Sine frequency [Hz].", True), ("Maximum error [% of the standard deviation].", True),
    ("Gas pressure, e.g. '150 psi'.", True), ("Peak velocity, e.g. '10 in/s'.", True),
    ("Share of the setups, 0 to 1.", True), ("Sine frequency.", False), ("Sine frequency, e.g. 2.", False),
    ("Name in the file, e.g. '14 '.", False),
])  # fmt: skip
def test_a_unit_is_recognized(text, accepted):
    assert bool(UNIT.search(text)) is accepted


def test_an_option_is_mentioned_on_a_page_about_its_verb():
    """The page names the verb too, because verbs have options of the same name."""
    pages = {
        verb: [text for text in PAGES.values() if re.search(rf"(eightpost |`){words}\b", text)]
        for verb in COMMANDS
        for words in [verb.replace("study run", "study")]
    }
    missing = []
    for name, (verb, option) in OPTIONS.items():
        spellings = "|".join(map(re.escape, (*option.opts, *option.secondary_opts)))
        if not any(re.search(rf"(?<![\w-])({spellings})(?![\w-])", text) for text in pages[verb]):
            missing.append(name)
    for name, (verb, one) in SETTINGS.items():
        if not any(re.search(rf"--set {one.name}(?![\w-])", text) for text in pages[verb]):
            missing.append(name)
    assert missing == []


def test_a_help_text_explains_every_argument():
    words = [
        (verb, word)
        for verb, command in COMMANDS.items()
        for argument in command.params
        if isinstance(argument, click.Argument)
        for word in re.findall(r"\w+", argument.metavar or argument.human_readable_name)
    ]
    assert len(words) > 20
    assert [(verb, word) for verb, word in words if not re.search(rf"\b{word}s?\b", COMMANDS[verb].help)] == []


def test_a_help_text_is_plain_english():
    texts = {f"eightpost {verb}": command.help for verb, command in COMMANDS.items()}
    texts |= {name: help_of(verb, option) for name, (verb, option) in OPTIONS.items()}
    assert [
        f"{name}: {match[0]}"
        for name, text in texts.items()
        for pattern in EXPRESSIONS
        if (match := re.search(pattern, text))
    ] == []


def test_the_page_of_commands_is_up_to_date():
    made = importlib.import_module("docs.make.make_commands").page()
    assert made == COMMANDS_PAGE.read_text(encoding="utf-8"), "run: python docs/make/make_commands.py"
