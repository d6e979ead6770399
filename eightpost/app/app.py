"""`eightpost app`."""

from __future__ import annotations

from pathlib import Path

import click
from rich.console import Console

from eightpost.app.options import OutputFolder, argument, option, setting, verb


@verb
def app(
    folder: Path = argument("[FOLDER]", kind=OutputFolder(), required=False),
    port: int = setting("Port on this machine; 0: a free one.", kind=click.IntRange(0, 65535), default=0),
    no_browser: bool = option("Print the link only."),
) -> None:  # fmt: skip
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

    serve(folder or Path(), port, browser=not no_browser, tell=tell)
