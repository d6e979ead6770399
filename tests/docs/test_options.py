"""Every option and argument of every verb is described in its help text and on a page."""

import importlib.util
import re
from pathlib import Path

import click
import pytest

from eightpost.__main__ import VERBS, main
from tests.language import EXPRESSIONS, NO_BEGINNING

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def with_sub_verbs(verb, command):
    """Yield a command and its sub-verbs, by their names."""
    yield verb, command
    if isinstance(command, click.Group):
        for name, below in command.commands.items():
            yield from with_sub_verbs(f"{verb} {name}", below)


COMMANDS = dict(case for verb in VERBS for case in with_sub_verbs(verb, main.get_command(click.Context(main), verb)))

OPTIONS = [
    pytest.param(verb, option, id=f"{verb} {max(option.opts, key=len)}")
    for verb, command in COMMANDS.items()
    for option in command.params
    if isinstance(option, click.Option)
]

#: Placeholders of values that have a unit; all other numbers with a fraction have one too, or state their range.
QUANTITIES = {"DB", "FREQUENCY", "HZ", "LENGTH", "PERCENT", "PRESSURE", "RATE", "SECONDS", "SPEED", "TIME"}

#: A unit in brackets, a quoted value with its unit, or the range of a dimensionless number.
UNIT = re.compile(r"\[(Hz|s|m|%|dB)\b|\[%|'-?[\d.]+ [a-zA-Z%][\w./%]*'|-?\d to \d")


def takes_quantity(option: click.Option) -> bool:
    metavar = set(re.findall(r"\w+", option.metavar or ""))
    return isinstance(option.type, click.types.FloatParamType) or bool(metavar & QUANTITIES)


def help_of(verb: str, option: click.Option) -> str:
    """Return the text that `--help` prints of an option, with its default."""
    record = option.get_help_record(click.Context(COMMANDS[verb]))
    assert record is not None
    return record[1]


@pytest.mark.parametrize(("verb", "option"), OPTIONS)
def test_an_option_has_a_help_text_that_is_no_fragment(verb, option):
    text = option.help
    assert text and len(text.split()) > 1, f"{verb} {option.opts[-1]} has no help text"
    assert text[0].isupper(), f"begin it with a capital: {text}"
    assert not NO_BEGINNING.match(text), f"begin it with a noun or a verb: {text}"
    assert text.endswith("."), f"end it with a full stop: {text}"


@pytest.mark.parametrize(("verb", "option"), OPTIONS)
def test_an_option_that_may_be_left_out_names_its_default(verb, option):
    if option.is_flag or option.required or option.multiple:
        return
    assert "default" in help_of(verb, option).lower()


@pytest.mark.parametrize(("verb", "option"), [case for case in OPTIONS if takes_quantity(case.values[1])])
def test_an_option_that_takes_a_quantity_names_a_unit_or_an_example_with_one(verb, option):
    default = f"'{option.default}'" if option.show_default else ""
    assert UNIT.search(f"{option.help} {default}"), f"name the unit: {option.help}"


def test_the_options_that_take_quantities_are_found():
    """Otherwise the test above would pass without a case."""
    found = {case.id for case in OPTIONS if takes_quantity(case.values[1])}
    assert {
        "dyno --gas",
        "fit --cutoff",
        "identify --rate",
        "rig --frequency",
        "run --step",
        "study --patience",
    } <= found
    assert not {"fit --name", "study --workers", "run --fmu"} & found


@pytest.mark.parametrize(
    ("text", "accepted"),
    [
        ("Sine frequency [Hz].", True),
        ("Maximum error [% of the standard deviation].", True),
        ("Gas pressure, e.g. '150 psi'.", True),
        ("Peak velocity, e.g. '10 in/s'.", True),
        ("Share of the setups, 0 to 1.", True),
        ("Sine frequency.", False),
        ("Sine frequency, e.g. 2.", False),
        ("Name in the file, e.g. '14 '.", False),
    ],
)
def test_a_unit_is_recognized(text, accepted):
    assert bool(UNIT.search(text)) is accepted


@pytest.mark.parametrize(("verb", "option"), OPTIONS)
def test_an_option_is_mentioned_on_a_page(verb, option):
    text = "\n".join(path.read_text(encoding="utf-8") for path in PAGES)
    for name in option.opts:
        assert re.search(rf"(?<![\w-]){re.escape(name)}(?![\w-])", text), f"no page mentions {verb} {name}"


@pytest.mark.parametrize("verb", COMMANDS)
def test_a_help_text_explains_every_argument(verb):
    for argument in COMMANDS[verb].params:
        if isinstance(argument, click.Argument):
            for word in re.findall(r"\w+", argument.metavar or argument.human_readable_name):
                assert re.search(rf"\b{word}s?\b", COMMANDS[verb].help), f"{verb} --help does not explain {word}"


@pytest.mark.parametrize("verb", COMMANDS)
def test_a_help_text_is_plain_english(verb):
    command = COMMANDS[verb]
    texts = [command.help, *(help_of(verb, option) for option in command.params if isinstance(option, click.Option))]
    found = [match[0] for text in texts for pattern in EXPRESSIONS if (match := re.search(pattern, text))]
    assert found == []


def test_the_page_of_commands_is_up_to_date():
    spec = importlib.util.spec_from_file_location(
        "eightpost_docs_make_commands", ROOT / "docs" / "make" / "make_commands.py"
    )
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    page = (ROOT / "docs" / "reference" / "commands.md").read_text(encoding="utf-8")
    assert module.page() == page, "run: python docs/make/make_commands.py"
