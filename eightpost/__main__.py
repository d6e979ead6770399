"""The command line: `eightpost` or `python -m eightpost`.

Exit codes: 0 done, 1 not acceptable or not completed, 2 wrong input.
"""

from __future__ import annotations

from eightpost import name_clash  # noqa: F401 - first: it checks where all other modules would be imported from

# isort: split
import logging
import os
import sys
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.logging import RichHandler
from rich.markup import escape

from eightpost import __version__, completion
from eightpost.app.former import FORMER_VERBS, current_verb
from eightpost.app.options import Entry, Verb, VerbGroup, warn
from eightpost.errors import EightpostError, InputError
from eightpost.workers.supervision import supervised, tell

_NAME = "eightpost"

#: The verbs by reader, in the order of the work, with the first sentence of their help.
SECTIONS: Mapping[str, Mapping[str, Entry]] = {
    "Start": {
        "new": Entry("Write a starter folder, with files to be replaced by your own.", "new:new"),
        "demo": Entry("Run the whole workflow on shipped data.", "demo:demo"),
        "app": Entry(
            "Open a window in the browser: drop dynamometer and rig files, fit, couple, and run studies.", "app:app"
        ),
        "doctor": Entry(
            "Check the installation: versions, extras, caches, a coupled run, the compiler.", "doctor:doctor"
        ),
    },
    "Shocks and cars from measurements": {
        "inspect": Entry("Show what a file contains, and everything suspicious in it.", "inspect:inspect"),
        "fit": Entry(
            "Fit a shock law to dynamometer records: one, several runs together, or one shock over its adjusters.",
            "fit:fit",
        ),
        "identify": Entry("Identify a vehicle from rig tests.", "identify:identify"),
        "validate": Entry("Validate fitted shocks or an identified vehicle on held-out records.", "validate:validate"),
        "report": Entry(
            "Write a page about shocks: their dynamometer records and fitted laws, by build; or about a study.",
            "report:report",
        ),
    },
    "FMUs for simulation": {
        "build": Entry("Build an FMU from each source, for co-simulation and model exchange.", "build:build"),
        "check": Entry(
            "Check FMUs of any maker: the rules of the FMI standard, and known causes of failed imports.", "check:check"
        ),
        "run": Entry("Run a system of coupled FMUs.", "run:run"),
        "export": Entry(
            "Export models, frequency responses, shock curves and systems for other tools.", "export:export"
        ),
    },
    "Setups and the rig": {
        "study": Entry(
            "Run every setup of shocks that a study allows, rank them, and choose: `eightpost study FILE` runs it.",
            members={
                "run": Entry("Run every setup of shocks that a study allows, and rank them.", "study:study"),
                "optimise": Entry(
                    "Search for the best setups of a study whose bank is too large to run them all.",
                    "study:optimise",
                ),
                "shapes": Entry(
                    "Find the shock curves to aim at: the best shapes for a study, also ones that nobody has built.",
                    "study_curves:shapes",
                ),
                "whatif": Entry(
                    "Show what a click more or less at a corner would do to every measure of a study.", "study:whatif"
                ),
                "sensitivity": Entry("Show which corner matters for which measure of a study.", "study:sensitivity"),
                "robust": Entry(
                    "Compute how sure a study's choice is with an uncertainty file of your own.", "study:robust"
                ),
                "select": Entry("Select setups of a study to confirm on the rig.", "study_rig:select"),
                "confirm": Entry(
                    "Update how sure a study's choice is with rig runs of some of its setups.", "study_rig:confirm"
                ),
                "compare": Entry("Compare runs, or a study's prediction with rig measurements.", "study_rig:compare"),
                "clicks": Entry(
                    "Find the clicks at which a shock comes closest to a target curve.", "study_curves:clicks"
                ),
            },
            usual="run",
        ),
        "drivefile": Entry(
            "Iterate the commands of the rig until it reproduces channels measured on the track "
            "(docs/how_to/drivefile.md).",
            members={
                "start": Entry("Compute the first drive file from a track record.", "drivefile:start"),
                "next": Entry(
                    "Compute the next drive file from the rig's record of the last one.", "drivefile:next_drive"
                ),
                "simulate": Entry(
                    "Play the drive files on the virtual rig, as `next` would with a rig.", "drivefile:simulate"
                ),
            },
        ),
        "virtual": Entry(
            "Test a shock on the virtual dynamometer, or a car on the virtual rig; the data are SYNTHETIC.",
            members={
                "dyno": Entry(
                    "Test a physical shock on the virtual dynamometer; the data are SYNTHETIC.", "virtual:dyno"
                ),
                "rig": Entry("Test a car on the virtual rig; the data are SYNTHETIC.", "virtual:rig"),
            },
        ),
    },
}

#: All verbs; a setting and the evidence about the dissertation are not listed.
VERBS: Mapping[str, Entry] = {name: entry for section in SECTIONS.values() for name, entry in section.items()} | {
    "units": Entry("Choose the units of all results once: us or si.", "units:units"),
    "reproduce": Entry("Reproduce the dissertation's figures, tables and equations.", "reproduce:reproduce"),
}


def every_verb() -> dict[str, Verb]:
    """Return all verbs by their words, such as `study optimise`."""
    found: dict[str, Verb] = {}
    groups: list[tuple[str, _Verbs | VerbGroup]] = [("", main)]
    for prefix, group in groups:
        for name in group.entries:
            command = group.get_command(click.Context(group), name)
            if isinstance(command, VerbGroup):
                groups.append((f"{name} ", command))
            elif isinstance(command, Verb):
                found[f"{prefix}{name}"] = command
    return found


class _Verbs(VerbGroup):
    """All verbs. The project's own errors become a message and an exit code; others show a traceback."""

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        """Run the program; a verb in a supervised process, which cannot end unnoticed."""
        work = partial(super().__call__, *args, **kwargs)
        is_program = not args and "args" not in kwargs and f"_{_NAME.upper()}_COMPLETE" not in os.environ
        if is_program and not {*VERBS, *FORMER_VERBS}.isdisjoint(sys.argv[1:]):
            os._exit(supervised(work, _complain))  # the command's own process has cleaned up
        return work()

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Read the command line with the current words of its verb."""
        verbose = [word for word in args if word in ("-v", "--verbose")]  # anywhere on the command line
        rest = [word for word in args if word not in verbose]
        return super().parse_args(ctx, [*verbose[:1], *current_verb(rest, report=warn)])

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

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the verbs by reader, without importing them."""
        for title, entries in SECTIONS.items():
            with formatter.section(title):
                formatter.write_dl([(name, entry.text) for name, entry in entries.items()])
        formatter.write_paragraph()
        formatter.write_text(
            "Units of results: eightpost units us|si. The dissertation's figures: eightpost reproduce. Words on the "
            "screen: docs/reference/glossary.md."
        )


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


@click.group(cls=_Verbs, entries=VERBS, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name=_NAME)
@click.option(
    "-v", "--verbose", is_flag=True, help="Show all details of the result, and the log messages of components."
)
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
        warn(record.getMessage())


if __name__ == "__main__":
    main(prog_name=_NAME)
