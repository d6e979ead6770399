"""The command line: `eightpost` or `python -m eightpost`.

Exit codes: 0 done, 1 not acceptable or not completed, 2 wrong input.
"""

from __future__ import annotations

from eightpost import name_clash  # noqa: F401 - first: it checks where all other modules would be imported from

# isort: split
import importlib
import logging
import os
import sys
from functools import partial
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.logging import RichHandler
from rich.markup import escape

from eightpost import __version__, completion
from eightpost.errors import EightpostError, InputError, suggestion
from eightpost.workers.supervision import supervised, tell

_NAME = "eightpost"

#: The verbs in the order of the work, with the first sentence of their help; a verb is imported when it is called,
#: because its libraries take seconds to load.
VERBS = {
    "dyno": "Test a physical shock on the virtual dynamometer.",
    "inspect": "Show the content of a dynamometer or rig file, and everything suspicious in it.",
    "fit": "Fit a shock law to a dynamometer file.",
    "settings": "Fit a shock over its adjusters and temperature.",
    "clicks": "Find the clicks at which a shock comes closest to a target curve.",
    "report": "Write a page about shocks: their dynamometer records and fitted laws, by build.",
    "validate": "Validate fitted shocks or an identified vehicle on held-out records.",
    "rig": "Test a car on the virtual rig; the data are SYNTHETIC.",
    "linearity": "Judge where a linear model can predict a car on the rig: coherence against response energy.",
    "identify": "Identify a vehicle from rig tests.",
    "drivefile": "Iterate the commands of the rig until it reproduces channels measured on the track.",
    "vehicle": "Show modes and frequency responses of a vehicle, and the effect of a parameter on them.",
    "export": "Export models, frequency responses and shock curves for other tools.",
    "build": "Build an FMU from each source, for co-simulation and model exchange.",
    "page": "Write a page on which a shock and a quarter car run live.",
    "check": "Check FMUs of any maker: the rules of the FMI standard, and known causes of failed imports.",
    "run": "Run a system of coupled FMUs.",
    "ssp": "Write a system of coupled FMUs as an SSP 1.0 package for other tools.",
    "study": "Run every setup of shocks that a study allows, and rank them.",
    "optimise": "Search for the best setups of a study whose bank is too large to run them all.",
    "shapes": "Find the shock curves to aim at: the best shapes for a study, also ones that nobody has built.",
    "whatif": "Show what a click more or less at a corner would do to every measure of a study.",
    "sensitivity": "Show which corner matters for which measure of a study.",
    "robust": "Compute how sure a study's choice is with an uncertainty file of your own.",
    "confirm": "Update how sure a study's choice is with rig runs of some of its setups.",
    "select": "Select setups of a study to confirm on the rig.",
    "compare": "Compare runs, or a study's prediction with rig measurements.",
    "reproduce": "Reproduce the dissertation's figures, tables and equations.",
    "demo": "Run the whole workflow on shipped data.",
    "new": "Write a starter folder, with files to be replaced by your own.",
    "app": "Open a window in the browser: drop files, fit, couple, and run studies.",
    "doctor": "Check the installation: versions, extras, caches, a coupled run, the compiler.",
}


class _Verbs(click.Group):
    """Command group that turns the project's own errors into a message and an exit code; others show a traceback."""

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        """Run the program; a verb in a supervised process, which cannot end unnoticed."""
        work = partial(super().__call__, *args, **kwargs)
        is_program = not args and "args" not in kwargs and f"_{_NAME.upper()}_COMPLETE" not in os.environ
        if is_program and not VERBS.keys().isdisjoint(sys.argv[1:]):
            os._exit(supervised(work, _complain))  # the command's own process has cleaned up
        return work()

    def invoke(self, ctx: click.Context) -> Any:
        try:
            with completion.marks_removed(click.exceptions.Exit):
                return super().invoke(ctx)
        except EightpostError as error:
            _complain(". ".join((str(error), *getattr(error, "__notes__", ()))))
            ctx.exit(2 if isinstance(error, InputError) else 1)
        except OSError as error:  # for example a full disk or a folder without write permission
            _complain(f"{error.filename or 'file system'}: {error.strerror or error}")
            ctx.exit(2)
        except MemoryError:
            _complain("there is not enough memory for this command: use smaller files, or close other programs")
            ctx.exit(2)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the verb; for a misspelled one, name similar verbs."""
        if args and args[0] not in VERBS and not args[0].startswith("-"):
            ctx.fail(f"there is no verb {args[0]!r}; {suggestion(args[0], VERBS)}")
        return super().resolve_command(ctx, args)

    def list_commands(self, ctx: click.Context) -> list[str]:
        """List the verbs in the order of the work."""
        return list(VERBS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import a verb."""
        if cmd_name not in VERBS:
            return None
        command: click.Command = getattr(importlib.import_module(f"eightpost.app.{cmd_name}"), cmd_name)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the verbs without importing them."""
        with formatter.section("Commands"):
            formatter.write_dl(list(VERBS.items()))


#: Maximum number of characters of a message that are shown: a damaged file may contain a name of several megabytes.
_SHOWN = 4000


def _complain(text: str) -> None:
    """Print an error."""
    if len(text) > _SHOWN:
        text = f"{text[: _SHOWN // 2]} ... {text[-_SHOWN // 2 :]}"
    text = "".join(letter if letter.isprintable() or letter in "\n\t" else repr(letter)[1:-1] for letter in text)
    Console(stderr=True, soft_wrap=True).print(f"[bold red]error:[/] {escape(text)}", highlight=False)


def _check_names() -> None:
    """Refuse names of files that are no text, e.g. LC_ALL=C with PYTHONUTF8=0: no document could contain them."""
    for name in (*sys.argv[1:], str(Path.cwd())):
        try:
            name.encode()
        except UnicodeEncodeError as error:
            raise InputError(
                f"the name {name!r} is not text in the encoding {sys.getfilesystemencoding()}, which this process uses "
                "for names of files: set PYTHONUTF8=1 or a UTF-8 locale, or rename the file"
            ) from error


@click.group(cls=_Verbs, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name=_NAME)
@click.option("-v", "--verbose", is_flag=True, help="Show the log messages of components.")
def main(verbose: bool) -> None:
    """Shock and vehicle FMUs, and the co-simulation that couples them.

    \b
    Each verb reads the files that earlier verbs wrote:
      eightpost fit dyno.csv --law lpnl2 -o shock.json
      eightpost build shock.json car.toml -o dist/
      eightpost check dist/shock.fmu
      eightpost run examples/seven_dof.toml -o out/
    """
    _check_names()
    completion.tell = tell
    # Notes and errors repeat what components log; direct output would disturb the progress bar.
    level = logging.DEBUG if verbose else logging.CRITICAL
    logging.basicConfig(level=level, format="%(message)s", handlers=[RichHandler(level, Console(stderr=True))])
    logger = logging.getLogger(completion.__name__)
    logger.setLevel(logging.WARNING)
    if not logger.handlers:
        logger.addHandler(_Warnings())


class _Warnings(logging.Handler):
    """Handler that prints warnings as commands do."""

    def emit(self, record: logging.LogRecord) -> None:
        """Print a warning on standard error."""
        from eightpost.app.options import warn  # noqa: PLC0415 -- most commands do not need it

        warn(record.getMessage())


if __name__ == "__main__":
    main(prog_name=_NAME)
