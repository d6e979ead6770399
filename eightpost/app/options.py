"""Verbs from their signatures: the default of a parameter declares its option, setting or argument.

A verb is a function with the decorator `verb`::

    @verb
    def fit(
        ctx: click.Context,
        dyno_files: tuple[Path, ...] = argument("DYNO..."),
        law: str | None = option("Shock law to fit; default: hysteresis.", kind=LawName()),
        cutoff: float | None = setting("Cut-off frequency of the low-pass; default '50 Hz'.", kind=Quantity("Hz")),
    ) -> None:

The annotation gives the type, and whether the option may be repeated. Settings are rarely needed: all settings of a
verb are given with `--set NAME=VALUE`. A verb of many options has one parameter for them, of a dataclass whose fields
declare them: `asked: FitOptions = group(FitOptions)`. This is click below a table, because typer and cyclopts take
0.1 s more for a help text. A library loads when a value is read, not for help.
"""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import wraps
from math import inf, isfinite
from pathlib import Path
from typing import Any, Literal

import click

from eightpost.app.former import former_option
from eightpost.errors import InputError, ParameterError, choice_of, suggestion
from eightpost.extras import MissingExtraError
from eightpost.outputs import Kind, check_file, check_folder, is_input, recorded


def warn(text: str) -> None:
    """Print a warning on standard error."""
    click.echo(f"{click.style('warning:', fg='yellow')} {text}", err=True)


#: Entry of a context's `meta` with the names of the settings that the command line states.
STATED = f"{__name__}.stated"

#: Entry of a context's `meta` with the files of channel maps, which are read before the verb is called.
MAPS = f"{__name__}.maps"

#: Entry of a context's `meta` with the units of channels that the command line states.
UNITS = f"{__name__}.units"


# ---- Declarations ---------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Declared:
    """Declaration of a parameter, which stands as its default in the signature of a verb."""

    role: Literal["argument", "option", "setting", "group"]
    text: str  #: Help text; of an argument, its name in the usage.
    spellings: tuple[str, ...] = ()  #: Spellings; by default, the name of the parameter.
    kind: Any = None  #: Type, or the tuple of choices; None: by the annotation.
    default: Any = None  #: Default; `...` if the option must be given.
    metavar: str | None = None
    nargs: int = 1


def option(
    text: str, *spellings: str, kind: Any = None, default: Any = None, metavar: str | None = None, nargs: int = 1
) -> Any:
    """Declare an option: help text, spellings (`-o`, or another name than the parameter's), type and default."""
    return _Declared("option", text, spellings, kind, default, metavar, nargs)


def setting(text: str, name: str = "", *, kind: Any = None, default: Any = None, nargs: int = 1) -> Any:
    """Declare a rarely needed option, which is given as `--set NAME=VALUE`; by default with the parameter's name."""
    return _Declared("setting", text, (name,) if name else (), kind, default, None, nargs)


def argument(name: str, *, kind: Any = None, required: bool = True) -> Any:
    """Declare a positional argument."""
    return _Declared("argument", name, (), kind, ... if required else None)


def group(kind: type[Any]) -> Any:
    """Declare the parameters that the fields of a dataclass declare; the verb gets an object of it."""
    return _Declared("group", "", kind=kind)


def _kind(declared: _Declared, annotation: str) -> Any:
    if isinstance(declared.kind, tuple):
        return Choice(declared.kind)
    kinds = {"Path": FilePath(), "int": click.INT, "float": Number(), "str": click.STRING, "bool": click.BOOL}
    return declared.kind or kinds[annotation.removesuffix(" | None")]


def _repeated(annotation: str) -> tuple[str, bool]:
    """Return the annotation of one value, and whether several are accepted: `tuple[Path, ...]`."""
    several = annotation.startswith("tuple[") and annotation.endswith(", ...]")
    return (annotation[len("tuple[") : -len(", ...]")], True) if several else (annotation, False)


def _parameter(name: str, declared: _Declared, annotation: str) -> click.Parameter:
    one, several = _repeated(annotation)
    required = declared.default is ...
    default = None if required else declared.default
    kind = _kind(declared, one)
    if declared.role == "argument":
        return click.Argument([name], type=kind, metavar=declared.text, required=required, nargs=-1 if several else 1)
    named = any(spelling.startswith("--") for spelling in declared.spellings)
    spellings = [*declared.spellings, *([] if named else [f"--{name.replace('_', '-')}"]), name]
    if one == "bool":
        return click.Option(spellings, is_flag=True, help=declared.text)
    return click.Option(
        spellings, type=kind, metavar=declared.metavar, required=required, default=default, help=declared.text,
        show_default=default is not None, multiple=several or hasattr(kind, "merged"), nargs=declared.nargs,
        callback=getattr(kind, "merged", None),
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Setting:
    """A rarely needed option of a verb, which `--set NAME=VALUE` gives."""

    name: str  #: Name as users write it, with hyphens.
    parameter: str  #: Parameter of the function.
    text: str  #: Help text.
    kind: Any  #: Type of the value.
    default: Any
    several: bool = False  #: Whether it may be repeated.
    nargs: int = 1  #: Number of values, which are separated by commas.

    @property
    def title(self) -> str:
        """Return the name with the default, for a help text."""
        return f"{self.text} [default: {_shown(self.default)}]" if self.default is not None else self.text

    @property
    def _as_option(self) -> click.Option:
        """Return an option that types of values name in their messages."""
        shown = click.Option([f"--{self.name}"])
        shown.opts = [f"--set {self.name}="]
        return shown

    def value(self, text: str) -> Any:
        """Return a value from its text.

        Raises:
            InputError: The text is no such value.
        """
        parts = [part.strip() for part in text.split(",")] if self.nargs > 1 else [text]
        if len(parts) != self.nargs:
            raise InputError(f"--set {self.name}={text}: give {self.nargs} values, separated by commas")
        try:
            values = tuple(self.kind.convert(part, self._as_option, None) for part in parts)
        except click.BadParameter as error:
            raise InputError(f"--set {self.name}={text}: {error.message}") from error
        return values if self.nargs > 1 else values[0]


def _shown(default: Any) -> str:
    return {True: "yes", False: "no"}.get(default, str(default)) if isinstance(default, bool) else str(default)


def _flat(function: Callable[..., None]) -> Iterator[tuple[str, _Declared, str]]:
    """Yield name, declaration and annotation of each parameter that has a declaration, and of each field of a group."""
    for name, parameter in inspect.signature(function).parameters.items():
        declared = parameter.default
        if isinstance(declared, _Declared) and declared.role == "group":
            entries: tuple[Any, ...] = fields(declared.kind)
            yield from ((entry.name, entry.default, entry.type) for entry in entries)
        elif isinstance(declared, _Declared):
            yield name, declared, parameter.annotation


def _setting(name: str, declared: _Declared, annotation: str) -> Setting:
    one, several = _repeated(annotation)
    own = declared.spellings[0] if declared.spellings else name.replace("_", "-")
    kind = _kind(declared, one)
    return Setting(own, name, declared.text, kind, declared.default, several, declared.nargs)


def verb(function: Callable[..., None]) -> Verb:
    """Return the verb of a function; its parameters without a declaration keep their defaults."""
    parameters = inspect.signature(function).parameters
    groups = {
        name: parameter.default.kind
        for name, parameter in parameters.items()
        if isinstance(parameter.default, _Declared) and parameter.default.role == "group"
    }

    @wraps(function)
    def call(*context: click.Context, **values: Any) -> None:
        for name, kind in groups.items():
            values[name] = kind(**{entry.name: values.pop(entry.name) for entry in fields(kind)})
        function(*context, **values)

    flat = list(_flat(function))
    return Verb(
        function.__name__,
        callback=click.pass_context(call) if "ctx" in parameters else call,
        params=[_parameter(*entry) for entry in flat if entry[1].role != "setting"],
        help=inspect.getdoc(function),
        settings=[_setting(*entry) for entry in flat if entry[1].role == "setting"],
    )


# ---- Verbs ----------------------------------------------------------------------------------------------------------


class Verb(click.Command):
    """A verb, whose outputs never replace its inputs. An old spelling of an option still works, with a warning."""

    def __init__(self, *args: Any, settings: Sequence[Setting] = (), **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.settings = {entry.name: entry for entry in settings}  #: Settings by name.
        if settings:
            self.params.append(_set_option(self.settings))

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Read the command line with the current spellings of options."""
        path = ctx.command_path.split(" ", 1)[-1]
        return super().parse_args(ctx, list(self.current(path, args)))

    def current(self, path: str, args: Sequence[str]) -> Iterator[str]:
        """Yield the words with the current spellings; warn of each old one."""
        own = {spelling for parameter in self.params for spelling in (*parameter.opts, *parameter.secondary_opts)}
        words = iter(args)
        for word in words:
            name, equals, value = word.partition("=")
            if not name.startswith("--") or name in own or name in ("--help", "--"):
                yield word
                continue
            given = iter([value]) if equals else words
            current = former_option(path, name, given) or self._of_setting(name, given)
            if current is None:
                yield word
                continue
            warn(f"{name} is now spelled {' '.join(map(_quoted, current))}; the next version will not accept {name}")
            yield from current

    def _of_setting(self, name: str, values: Iterator[str]) -> tuple[str, ...] | None:
        """Return the current spelling of a setting that was an option; flags are yes, or no with the prefix `no-`."""
        name = name.removeprefix("--")
        entry = self.settings.get(name) or self.settings.get(name.removeprefix("no-"))
        if entry is None:
            return None
        if entry.kind is click.BOOL:
            return "--set", f"{entry.name}={'yes' if name == entry.name else 'no'}"
        return "--set", f"{entry.name}={', '.join(next(values, '') for _ in range(entry.nargs))}"

    def invoke(self, ctx: click.Context) -> Any:
        """Check the outputs, and record all files that the verb reads: none of them is replaced."""
        if self.settings:
            stated = ctx.params.pop("settings")
            ctx.meta[STATED] = {name for name, _ in stated}
            ctx.params |= self._set(stated)
        kinds = {parameter.name: parameter.type for parameter in self.params}
        kinds |= {entry.parameter: entry.kind for entry in self.settings.values()}
        given = [ctx.params[name] for name, kind in kinds.items() if name and type(kind) is FilePath]
        inputs = [path for one in given for path in (one if isinstance(one, tuple) else (one,)) if path is not None]
        from eightpost.units import following_files, note_file

        with recorded([*inputs, *ctx.meta.get(MAPS, ())]), following_files():
            note_file(ctx.meta.get(UNITS, ()))
            check_outputs()
            try:
                return super().invoke(ctx)
            except MissingExtraError as error:
                raise InputError(f"{ctx.command_path.split(' ', 1)[-1]}: {error}") from error

    def _set(self, stated: Sequence[tuple[str, str]]) -> dict[str, Any]:
        """Return the values of all settings by the name of the parameter."""
        values: dict[str, Any] = {}
        for name, text in stated:
            if name not in self.settings:
                raise InputError(f"--set {name}: there is no such setting; {suggestion(name, self.settings)}")
            entry = self.settings[name]
            value = entry.value(text)
            values[name] = (*values.get(name, ()), value) if entry.several else value
        return {
            entry.parameter: values.get(name, () if entry.several else _default(entry))
            for name, entry in self.settings.items()
        }

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options, and below them the settings."""
        super().format_options(ctx, formatter)
        if self.settings:
            with formatter.section("Settings, each given with --set NAME=VALUE"):
                formatter.write_dl([(name, entry.title) for name, entry in self.settings.items()])


def _default(entry: Setting) -> Any:
    return entry.value(entry.default) if isinstance(entry.default, str) else entry.default


def _set_option(settings: Mapping[str, Setting]) -> click.Option:
    return click.Option(
        ["--set", "settings"], type=Assignment("NAME=VALUE"), metavar="NAME=VALUE", multiple=True,
        help=f"Setting that is rarely needed ({', '.join(settings)}); may be repeated.",
    )  # fmt: skip


def _quoted(word: str) -> str:
    return f"'{word}'" if set(word) & set(" []") else word


@dataclass(frozen=True, slots=True)
class Entry:
    """A verb in the list of all verbs."""

    text: str  #: First sentence of its help.
    place: str = ""  #: Module in `eightpost.app` and function, e.g. `fit:fit`; empty for a group.
    members: Mapping[str, Entry] = field(default_factory=dict)  #: Verbs of a group.
    usual: str = ""  #: Verb of a group that is meant if none is named.


class VerbGroup(click.Group):
    """A list of verbs, each imported when it is called, because its libraries take seconds to load."""

    def __init__(self, *args: Any, entries: Mapping[str, Entry], usual: str = "", **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.entries, self.usual = entries, usual

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Name the usual verb if the command line names none."""
        if self.usual and args and args[0] not in (*self.entries, *ctx.help_option_names):
            if "." not in args[0] and not Path(args[0]).exists() and not args[0].startswith("-"):
                ctx.fail(f"there is no verb {args[0]!r}; {suggestion(args[0], self.entries)}")
            args = [self.usual, *args]
        return super().parse_args(ctx, args)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the verb; for a misspelled one, name similar verbs."""
        if args and args[0] not in self.entries and not args[0].startswith("-"):
            ctx.fail(f"there is no verb {args[0]!r}; {suggestion(args[0], self.entries)}")
        return super().resolve_command(ctx, args)

    def list_commands(self, ctx: click.Context) -> list[str]:
        """List the verbs in the order of the work."""
        return list(self.entries)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import a verb."""
        entry = self.entries.get(cmd_name)
        if entry is None:
            return None
        if entry.members:
            return VerbGroup(cmd_name, entries=entry.members, usual=entry.usual, help=entry.text)
        module, function = entry.place.split(":")
        command: click.Command = getattr(importlib.import_module(f"eightpost.app.{module}"), function)
        command.name = cmd_name
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the verbs without importing them."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, entry.text) for name, entry in self.entries.items()])


# ---- Types of values ------------------------------------------------------------------------------------------------


class FilePath(click.Path):
    """A path of a file or folder; an empty one, as of a shell variable that is not set, is not the current folder."""

    def __init__(self, **options: Any) -> None:
        super().__init__(path_type=Path, **options)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the path."""
        if value == "":
            self.fail("the name of a file or folder is empty; write '.' for the current folder", param, ctx)
        return super().convert(value, param, ctx)


class Choice(click.Choice):  # type: ignore[type-arg]
    """One of several words, in capitals or not; `3.0` is also 3."""

    def __init__(self, choices: Sequence[str]) -> None:
        super().__init__(choices, case_sensitive=False)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the word."""
        try:
            return self.word(value)
        except ParameterError as error:
            self.fail(str(error), param, ctx)

    def word(self, value: object) -> str:
        """Return the word of a value."""
        return choice_of("value", value, self.choices)


class LawName(Choice):
    """The name of a shock law, as its title or its identifier."""

    def __init__(self) -> None:
        from eightpost.shock import LAWS

        super().__init__(list(LAWS))

    def word(self, value: object) -> str:
        """Return the name; laws and the choice of earlier versions are refused as such."""
        from eightpost.shock.laws import named_law

        return named_law(value)


class OutputFile(FilePath):
    """A file to write, which is checked before the verb computes anything (`eightpost.outputs`).

    Args:
        kind: Kind of the file.
        default: Function that returns the file from the options before this one if it is not given; None: no default.
        is_folder: Function that returns from all options whether a folder is written instead; None: never.
    """

    def __init__(
        self,
        kind: Kind,
        *,
        default: Callable[[Mapping[str, Any]], Path] | None = None,
        is_folder: Callable[[Mapping[str, Any]], bool] | None = None,
    ) -> None:
        super().__init__()
        self.name = "path" if is_folder else "file"
        self.kind, self.default, self.is_folder = kind, default, is_folder

    def check(self, path: Path, option: str, given: Mapping[str, Any]) -> None:
        """Check that the file can be written without loss."""
        if self.is_folder and self.is_folder(given):
            check_folder(path)
        else:
            check_file(path, self.kind, option)


class OutputFolder(FilePath):
    """A folder to write into, which is checked before the verb computes anything (`eightpost.outputs`)."""

    def __init__(self, files: Mapping[str, Kind] | None = None) -> None:
        super().__init__()
        self.name = "folder"
        self.files = files or {}  #: Kinds of the files that are written there, by name, as far as the names are known.

    def check(self, path: Path, _option: str, _given: Mapping[str, Any]) -> None:
        """Check that the folder can be written into without loss."""
        check_folder(path, self.files)


def check_outputs() -> None:
    """Check all outputs of the running verb, and set those that are not given.

    Every verb begins with it. A verb that computes for long calls it again when it has read its inputs, because they
    name further inputs.
    """
    context = click.get_current_context()
    given = context.params
    for parameter in context.command.params:
        kind, name = parameter.type, parameter.name or ""
        if isinstance(kind, OutputFile | OutputFolder):
            if given[name] is None and isinstance(kind, OutputFile) and kind.default:
                path = kind.default(given)
                given[name] = path.with_stem(f"{path.stem}_{kind.kind.document or 'new'}") if is_input(path) else path
            if given[name] is not None:
                kind.check(given[name], parameter.opts[0], given)


class Number(click.FloatRange):
    """A finite number in a range: no comparison with NaN finds it outside, and every result would pass."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the number."""
        number = super().convert(value, param, ctx)
        if not isfinite(number):
            self.fail(f"{value!r} is not a finite number", param, ctx)
        return number


class Quantity(click.ParamType):  # type: ignore[type-arg]
    """A value with its unit, such as '10 mm', which the verb receives in one unit.

    Args:
        unit: Unit that the verb receives.
        bare: Whether a number without a unit is accepted, with a warning: the old spelling of some options.
        positive: Whether the value must be above 0.
        most: Largest value, in the unit that the verb receives.
    """

    name = "quantity"

    def __init__(self, unit: str, *, bare: bool = False, positive: bool = False, most: float = inf) -> None:
        self.unit, self.bare, self.positive, self.most = unit, bare, positive, most

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Return the value in the unit of the option."""
        if isinstance(value, float):
            return value
        option = max(param.opts, key=len) if param else self.name
        option += "" if option.endswith("=") else " "
        number = self._number(value, option)
        if self.positive and not number > 0.0:
            raise ParameterError(f"{option.strip(' =')} must be above 0, not {value!r}")
        if not number <= self.most:
            raise ParameterError(f"{option.strip(' =')} must be at most {self.most:g} {self.unit}, not {value!r}")
        return number

    def _number(self, text: str, option: str) -> float:
        from eightpost import units

        if self.bare and (number := _plain(text)) is not None:
            warn(f"{option}{text} has no unit; write {option}'{text} {self.unit}', which the next version requires")
            return number
        if _plain(text) is not None:
            raise InputError(f"{option}{text!r} has no unit; add it: '{text} {self.unit}' if it is in {self.unit}")
        try:
            return float(units.convert(*units.quantity(text), self.unit))
        except InputError as error:
            raise InputError(f"{option}{text!r}: {error}") from error


def _plain(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


class Assignment(click.ParamType):  # type: ignore[type-arg]
    """`NAME=VALUE`, which the verb receives as a pair."""

    name = "assignment"

    def __init__(self, form: str) -> None:
        self.form = form  #: Names of both sides.

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[str, str]:
        """Return both sides of the first equals sign."""
        if isinstance(value, tuple):
            return value
        left, _, right = value.partition("=")
        if not (left and right):
            self.fail(f"{value!r}: write it as {self.form}", param, ctx)
        return left, right


#: File beside the report of each kind. A run writes no report into the folder of a study, so the study comes first.
_BESIDE_REPORT = {"study": "results.parquet", "run": "result.json"}


def check_report_folder(folder: Path, kind: Literal["run", "study"]) -> None:
    """Check that the report in an output folder does not replace that of the other kind.

    Raises:
        InputError: The folder has the report of the other kind.
    """
    page = folder / "report.html"
    owner = next((owner for owner, name in _BESIDE_REPORT.items() if (folder / name).is_file()), kind)
    if page.is_file() and owner != kind:
        raise InputError(
            f"{page} is the report of a {owner}, and the report of the {kind} would replace it; choose another folder "
            "with -o, or delete that file first"
        )


class Workers(click.ParamType):  # type: ignore[type-arg]
    """A number of processes, or the address of a Dask cluster."""

    name = "workers"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int | str:
        """Return the number or the address."""
        if isinstance(value, int):
            return value
        if ":" in str(value):
            return str(value)
        if not value.isdecimal() or not int(value):
            self.fail(f"{value!r} is neither a number of processes nor an address such as tcp://host:8786", param, ctx)
        return int(value)


WORKERS: Any = option(
    "Number of processes that run setups, or address of a Dask cluster, e.g. tcp://host:8786 (docs/how_to/scale.md); "
    "default: one process per processor.",
    "--workers", kind=Workers(), metavar="N|ADDRESS",
)  # fmt: skip

RANK: Any = option(
    "Measure that ranks the setups, smallest first; default: the objective of the study.", "--rank", metavar="MEASURE",
)  # fmt: skip
