"""The command line: `eightpost` or `python -m eightpost`.

Exit codes: 0 done, 1 not acceptable or not completed, 2 wrong input.
"""

from __future__ import annotations

import eightpost.name_clash  # noqa: F401 - first: it checks where all other modules would be imported from

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

from eightpost import __version__, completion
from eightpost.app.former import FORMER_VERBS, current_verb
from eightpost.app.options import Entry, Verb, VerbGroup, warn
from eightpost.errors import EightpostError, InputError
from eightpost.report.console import print_error
from eightpost.workers.supervision import supervised, tell

_NAME = "eightpost"

#: The verbs by reader, in the order of the work, with the first sentence of their help. The function of a verb has its
#: name, in the module of `eightpost.app` of its name or of its group, unless `@module:function` follows; `>` names the
#: usual verb of a group.
_LIST = """
Start
new@start | Write a starter folder, with files to be replaced by your own.
demo | Run the whole workflow on shipped data.
app@start | Open a window in the browser: drop dynamometer and rig files, fit, couple, and run studies.
doctor | Check the installation: versions, extras, caches, a coupled run, the compiler.
Shocks and cars from measurements
inspect | Show what a file contains, and everything suspicious in it.
fit | Fit a shock law to dynamometer records: one, several runs together, or one shock over its adjusters.
identify | Identify a vehicle from rig tests.
validate@identify | Validate fitted shocks or an identified vehicle on held-out records.
report@fit | Write a page about shocks: their dynamometer records and fitted laws, by build; or about a study.
FMUs for simulation
build@exchange | Build an FMU from each source, for co-simulation and model exchange.
check@exchange | Check FMUs of any maker: the rules of the FMI standard, and known causes of failed imports.
run | Run a system of coupled FMUs.
export@exchange | Export models, frequency responses, shock curves and systems for other tools.
Setups and the rig
study>run | Run every setup of shocks that a study allows, rank them, and choose: `eightpost study FILE` runs it.
  run@study:study | Run every setup of shocks that a study allows, and rank them.
  optimise | Search for the best setups of a study whose bank is too large to run them all.
  shapes@study_hardware | Find the shock curves to aim at: the best shapes for a study, also ones that nobody has built.
  whatif | Show what a click more or less at a corner would do to every measure of a study.
  sensitivity | Show which corner matters for which measure of a study.
  robust | Compute how sure a study's choice is with an uncertainty file of your own.
  select@study_hardware | Select setups of a study to confirm on the rig.
  confirm@study_hardware | Update how sure a study's choice is with rig runs of some of its setups.
  compare@study_hardware | Compare runs, or a study's prediction with rig measurements.
  clicks@study_hardware | Find the clicks at which a shock comes closest to a target curve.
drivefile | Iterate the commands of the rig until it reproduces channels measured on the track \
(docs/how_to/drivefile.md).
  start@virtual | Compute the first drive file from a track record.
  next@virtual:next_drive | Compute the next drive file from the rig's record of the last one.
  simulate@virtual | Play the drive files on the virtual rig, as `next` would with a rig.
virtual | Test a shock on the virtual dynamometer, or a car on the virtual rig; the data are SYNTHETIC.
  dyno | Test a physical shock on the virtual dynamometer; the data are SYNTHETIC.
  rig | Test a car on the virtual rig; the data are SYNTHETIC.
"""


def _sections(text: str) -> dict[str, dict[str, Entry]]:
    """Return the verbs of a list by section and name; those of a group are indented."""
    sections: dict[str, dict[str, Entry]] = {}
    title = group = ""
    members: dict[str, Entry] = {}
    for line in text.strip().splitlines():
        head, bar, summary = line.partition(" | ")
        if not bar:
            title, sections[line] = line, {}
            continue
        named, _, usual = head.strip().partition(">")
        name, _, place = named.partition("@")
        if head.startswith(" "):
            members[name] = Entry(summary, _place(place or group, name))
        else:
            group, members = name, {}
            sections[title][name] = Entry(summary, _place(place or name, name), members, usual)
    return sections


def _place(place: str, name: str) -> str:
    return place if ":" in place else f"{place}:{name}"


SECTIONS: Mapping[str, Mapping[str, Entry]] = _sections(_LIST)

#: All verbs; a setting and the evidence about the dissertation are not listed.
VERBS: Mapping[str, Entry] = {name: entry for section in SECTIONS.values() for name, entry in section.items()} | {
    "units": Entry("Choose the units of all results once: us or si.", "start:units"),
    "reproduce": Entry("Reproduce the dissertation's figures, tables and equations.", "start:reproduce"),
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
    print_error(text)


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
    # Matrices are small here: on a busy machine, threads that waited for each other took two thirds of `identify`.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    completion.tell = tell
    # Notes and errors repeat what components log; direct output would disturb the progress bar.
    level = logging.WARNING if verbose else logging.CRITICAL
    logging.basicConfig(level=level, format="%(message)s", handlers=[RichHandler(console=Console(stderr=True))])
    for package in ("eightpost", "builder", "cosim"):  # other libraries log their search for fonts, and byte code
        logging.getLogger(package).setLevel(logging.DEBUG if verbose else logging.NOTSET)
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
