"""`eightpost page`."""

from __future__ import annotations

from pathlib import Path

import click
from rich.console import Console
from rich.markup import escape

from eightpost.app.options import FilePath, OutputFile, Verb
from eightpost.outputs import PAGE


@click.command(cls=Verb)
@click.argument("source", metavar="SOURCE", type=FilePath())
@click.option("--vehicle", type=FilePath(), metavar="FILE",
              help="File or FMU of the quarter car that drives over the bump. Default: the car of "
                   "examples/corner.toml.")  # fmt: skip
@click.option("-o", "--output", metavar="FILE",
              type=OutputFile(PAGE, default=lambda given: Path(f"{given['source'].stem}.html")),
              help="HTML file to write. Default: SOURCE with the suffix .html, in the current folder.")  # fmt: skip
@click.pass_context
def page(ctx: click.Context, source: Path, vehicle: Path | None, output: Path) -> None:
    """Write a page on which a shock and a quarter car run live.

    SOURCE is a shock file (written by `eightpost fit`) or the native FMU of a shock. On the page, a reader turns the
    parameters of the shock, drives it on a dynamometer or by hand, and drives a quarter car over a bump. The page is
    one file and needs no network; the C code of the FMUs runs in it as WebAssembly. The exit code is 1 if the shock is
    not usable (docs/reference/verdict.md); its page is written nevertheless.

    \b
    Examples:
      eightpost page shock.json
      eightpost page dist/shock.fmu --vehicle examples/corner.toml -o shock.html
    """
    from builder.live_page import write_live_page
    from eightpost.app.show import show_verdict
    from eightpost.examples_folder import examples_folder

    console = Console(soft_wrap=True, highlight=False)
    with console.status("compiling"):
        written = write_live_page(source, output, vehicle=vehicle or examples_folder() / "corner.toml")
    show_verdict(console, written.verdict)
    size = written.path.stat().st_size
    console.print(f"wrote {escape(str(written.path))}: {len(written.controls)} parameters to turn, {size / 1e6:.1f} MB")
    ctx.exit(0 if written.verdict.is_acceptable else 1)
