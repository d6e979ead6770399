"""Spellings of the last version, which still work with a warning; the next version will not accept them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence

#: Words of each verb of the last version.
FORMER_VERBS: Mapping[str, tuple[str, ...]] = {
    "settings": ("fit",),
    "vehicle": ("inspect",),
    "linearity": ("inspect",),
    "page": ("report", "--live"),
    "ssp": ("export",),
    "dyno": ("virtual", "dyno"),
    "rig": ("virtual", "rig"),
    **{
        name: ("study", name)
        for name in ("clicks", "optimise", "shapes", "whatif", "sensitivity", "robust", "confirm", "select", "compare")
    },
}

#: Function from the value of an option to the words that replace the option and its value.
_Words = Callable[[str], tuple[str, ...]]


def _renamed(name: str) -> _Words:
    return lambda value: (name, value)


def _units(value: str) -> tuple[str, ...]:
    channel, _, unit = value.partition("=")
    return "--channel", f"{channel}=[{unit}]"


def _flip(value: str) -> tuple[str, ...]:
    if value == "none":
        return "--channel", "force=+"
    file, _, channel = value.rpartition("=")
    return "--channel", f"{file}:{channel}=-" if file else f"{channel}=-"


_EVERYWHERE: Mapping[str, _Words] = {
    "--units": _units,
    "--flip": _flip,
    "--map": _renamed("--channel"),
    "--scheduler": _renamed("--workers"),
}

#: Options by verb; an option that became a setting needs no entry.
_OF_VERB: Mapping[str, Mapping[str, _Words]] = {
    "build": {"--assemble": lambda value: (value,)},
    "validate": {"--report": _renamed("--output")},
    "report": {"--vehicle": _renamed("--car")},
}


def former_option(verb: str, name: str, values: Iterator[str]) -> tuple[str, ...] | None:
    """Return the words that replace an option of the last version, or None if it has no other spelling.

    Args:
        verb: Current words of the verb.
        name: Option, with its hyphens.
        values: Words after it, of which its value is taken.
    """
    words = _OF_VERB.get(verb, {}).get(name) or _EVERYWHERE.get(name)
    return words(next(values, "")) if words else None


def current_verb(args: Sequence[str], *, report: Callable[[str], None]) -> list[str]:
    """Return a command line with the current words of its verb, and report an old spelling."""
    place = next((i for i, word in enumerate(args) if not word.startswith("-")), None)
    if place is None or args[place] not in FORMER_VERBS:
        return list(args)
    former, rest = args[place], list(args[place + 1 :])
    words = " ".join(FORMER_VERBS[former])
    report(f"`eightpost {former}` is now `eightpost {words}`; the next version will not accept the old words")
    if former in ("vehicle", "linearity"):
        rest = _inspection(former, rest)
    return [*args[:place], *FORMER_VERBS[former], *rest]


def _inspection(former: str, args: Sequence[str]) -> list[str]:
    """Return the options of `inspect` for those of `vehicle` and `linearity`, which always wrote a folder."""
    words, current = iter(args), []
    parameter = factors = ""
    for word in words:
        if word == "--output":
            current += ["--set", f"channel={next(words, '')}"]
        elif word == "--vary":
            parameter = next(words, "")
        elif word == "--factors":
            factors = f"={next(words, '')}"
        else:
            current.append(word)
    if not {"-h", "--help", "-o"} & set(args):
        current += ["-o", former]
    return [*current, *(["--vary", f"{parameter}{factors}"] if parameter else [])]
