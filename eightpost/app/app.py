"""`eightpost app`."""

from __future__ import annotations

from pathlib import Path

import click
from rich.console import Console

from eightpost.app.options import OutputFolder, Verb


@click.command(cls=Verb)
@click.argument("folder", type=OutputFolder(), default=Path())
@click.option("--port", type=click.IntRange(0, 65535), default=0, metavar="N",
              help="Port on this machine; default: a free one.")  # fmt: skip
@click.option("--no-browser", is_flag=True, help="Print the link only.")
def app(folder: Path, port: int, no_browser: bool) -> None:
    """Open a window in the browser: drop dynamometer and rig files, fit, couple, and run studies.

    FOLDER receives the files that are dropped and what the commands write; default: the current folder. Only this
    machine's browser can open the window, by the link with its token. Ctrl-C ends it, and the commands that it runs.

    \b
    Examples:
      eightpost app
      eightpost app car7 --no-browser
    """
    from eightpost.window.server import serve

    console = Console()

    def tell(link: str) -> None:
        console.print(f"eightpost is at {link}\nCtrl-C ends it.", highlight=False, soft_wrap=True, markup=False)

    serve(folder, port, browser=not no_browser, tell=tell)
