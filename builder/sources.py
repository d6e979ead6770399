"""Where the FMUs' sources are: fmus/ of the checkout, or the copy inside an installed wheel."""

from __future__ import annotations

from pathlib import Path

from eightpost.errors import FmuError

_PACKAGE = Path(__file__).parent


def source_folder() -> Path:
    """Return the folder that holds common/, shock_lpnl2/, vehicle_ss/ and the others.

    Raises:
        FmuError: It is not there; the installation is broken.
    """
    for folder in (_PACKAGE / "fmus", _PACKAGE.parent / "fmus"):
        if (folder / "vehicle_ss" / "interface.toml").is_file():
            return folder
    raise FmuError(f"no fmus/ folder beside or inside {_PACKAGE}; install eightpost again")


def shock_kinds() -> tuple[str, ...]:
    """Return the interfaces of shocks: the folders fmus/shock_<law>/."""
    return tuple(sorted(path.parent.name for path in source_folder().glob("shock_*/interface.toml")))
