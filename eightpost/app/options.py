"""Values, options and outputs that several verbs share. A library loads when a value is read, not for help."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import inf, isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import click

from eightpost.errors import InputError, ParameterError
from eightpost.outputs import Kind, check_file, check_folder, is_input, recorded

if TYPE_CHECKING:
    from eightpost.signals import ChannelMap

Function = TypeVar("Function", bound=Callable[..., Any])


def warn(text: str) -> None:
    """Print a warning on standard error."""
    click.echo(f"{click.style('warning:', fg='yellow')} {text}", err=True)


class Verb(click.Command):
    """A verb, whose outputs never replace its inputs. An old spelling of an option still works, with a warning."""

    def __init__(self, *args: Any, renamed: Mapping[str, str] | None = None, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.renamed = dict(renamed or {})  #: New spelling of each old one.

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Read the command line with the new spellings."""
        return super().parse_args(ctx, [self._current(word) for word in args])

    def invoke(self, ctx: click.Context) -> Any:
        """Check the outputs, and record all files that the verb reads: none of them is replaced."""
        with recorded([*self._inputs(ctx), *ctx.meta.get(_MAPS, ())]):
            check_outputs()
            return super().invoke(ctx)

    def _inputs(self, ctx: click.Context) -> list[Path]:
        given = [ctx.params[parameter.name or ""] for parameter in self.params if type(parameter.type) is FilePath]
        return [path for one in given for path in (one if isinstance(one, tuple) else (one,)) if path is not None]

    def _current(self, word: str) -> str:
        option, equals, value = word.partition("=")
        if option not in self.renamed:
            return word
        warn(f"{option} is now spelled {self.renamed[option]}; the next version will not accept {option}")
        return f"{self.renamed[option]}{equals}{value}"


class VerbGroup(click.Group):
    """A verb with sub-verbs, listed in the order of the work; without one of them, it prints its help."""

    command_class = Verb

    def list_commands(self, ctx: click.Context) -> list[str]:
        """List the sub-verbs in the order of their definition."""
        return list(self.commands)


class FilePath(click.Path):
    """A path of a file or folder; an empty one, as of a shell variable that is not set, is not the current folder."""

    def __init__(self, **options: Any) -> None:
        super().__init__(path_type=Path, **options)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the path."""
        if value == "":
            self.fail("the name of a file or folder is empty; write '.' for the current folder", param, ctx)
        return super().convert(value, param, ctx)


class LawName(click.Choice):  # type: ignore[type-arg]
    """The name of a shock law."""

    def __init__(self) -> None:
        from eightpost.shock import LAWS

        super().__init__(list(LAWS))

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the name; laws and the choice of earlier versions are refused as such."""
        from eightpost.shock.laws import FORMER, law_title

        known = ", ".join(map(str, self.choices))
        if value == "auto":
            self.fail(f"the choice among laws was removed; omit --law, or choose from {known}", param, ctx)
        if value in FORMER:
            self.fail(f"the law {law_title(value)} is no longer supported; choose from {known}", param, ctx)
        return super().convert(value, param, ctx)


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
        number = self._number(value, option)
        if self.positive and not number > 0.0:
            raise ParameterError(f"{option} must be above 0, not {value!r}")
        if not number <= self.most:
            raise ParameterError(f"{option} must be at most {self.most:g} {self.unit}, not {value!r}")
        return number

    def _number(self, text: str, option: str) -> float:
        from eightpost import units

        if self.bare and (number := _plain(text)) is not None:
            warn(f"{option} {text} has no unit; write {option} '{text} {self.unit}', which the next version requires")
            return number
        if _plain(text) is not None:
            raise InputError(f"{option} {text!r} has no unit; add it: '{text} {self.unit}' if it is in {self.unit}")
        try:
            return float(units.convert(*units.quantity(text), self.unit))
        except InputError as error:
            raise InputError(f"{option} {text!r}: {error}") from error


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


#: Entry of a context's `meta` with the files of channel maps, which are read before the verb is called.
_MAPS = f"{__name__}.maps"


class ChannelMapFile(click.ParamType):  # type: ignore[type-arg]
    """A TOML file with a channel map, which the verb receives as the map."""

    name = "file"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> ChannelMap:
        """Return the content of the file."""
        from eightpost.signals import ChannelMap

        if isinstance(value, ChannelMap):
            return value
        if ctx:
            ctx.meta.setdefault(_MAPS, []).append(Path(value))
        return ChannelMap.read(Path(value))


def map_option(page: str, files: str = "files") -> Callable[[Function], Function]:
    """Return the option --map.

    Args:
        page: Page that describes the map.
        files: Name of the files that it applies to.
    """
    help_text = f"Channel map ({page}); default: the channel names in the {files}."
    return click.option("--map", "channel_map", type=ChannelMapFile(), metavar="TOML", help=help_text)


#: Unit of channels; the verb receives pairs of channel and unit.
UNITS = click.option("--units", multiple=True, type=Assignment("CHANNEL=UNIT"), metavar="CHANNEL=UNIT",
                     help="Unit of a channel whose header names none, e.g. force=lbf; may be repeated.")  # fmt: skip


#: Columns of channels; the verb receives pairs of channel and column.
COLUMNS = click.option("--channel", "columns", multiple=True, type=Assignment("CHANNEL=COLUMN"),
                       metavar="CHANNEL=COLUMN",
                       help="Column to read a channel from if several could be it, e.g. force='Load 2', or by "
                       "number in a file without a header, e.g. force=3; may be repeated.")  # fmt: skip


def flip_option(example: str) -> Callable[[Function], Function]:
    """Return the option --flip, with an example of a channel."""
    help_text = (
        f"Reverse the sign of a channel, e.g. {example}; may be repeated. It replaces the signs that a file states; "
        "`none` reverses no channel."
    )
    return click.option("--flip", multiple=True, metavar="CHANNEL", help=help_text)


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


WORKERS = click.option("--workers", type=click.IntRange(min=1), metavar="N",
                       help="Number of processes that run setups; default: one per processor.")  # fmt: skip

SCHEDULER = click.option("--scheduler", metavar="ADDRESS",
                         help="Address of a Dask cluster that runs the setups, e.g. tcp://host:8786 "
                         "(docs/how_to/scale.md); default: this machine.")  # fmt: skip

RANK = click.option("--rank", metavar="MEASURE",
                    help="Measure that ranks the setups, smallest first; default: the objective of the "
                    "study.")  # fmt: skip


#: Option --car-seed of the commands with a virtual rig.
car_seed_option = click.option("--car-seed", type=click.IntRange(min=0), metavar="N",
    help="Seed of the parameters of the flexible car; another number is another car. Default: its base "
    "parameters.")  # fmt: skip


def seed_option(default: int, text: str) -> Callable[[Function], Function]:
    """Return the option --seed."""
    kind = click.IntRange(min=0)
    return click.option("--seed", type=kind, metavar="N", default=default, show_default=True, help=text)
