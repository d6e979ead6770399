"""Location of the FMUs' sources: fmus/ of the checkout, or the copy inside an installed wheel."""

from __future__ import annotations

from pathlib import Path

from eightpost.errors import FmuError

_PACKAGE = Path(__file__).parent


def source_folder() -> Path:
    """Return the folder that contains common/, shock_lpnl2/, vehicle_ss/ and so on.

    Raises:
        FmuError: The folder does not exist; the installation is broken.
    """
    for folder in (_PACKAGE / "fmus", _PACKAGE.parent / "fmus"):
        if (folder / "vehicle_ss" / "interface.toml").is_file():
            return folder
    raise FmuError(f"there is no fmus/ folder inside or next to {_PACKAGE}; reinstall eightpost")


def shock_kinds() -> tuple[str, ...]:
    """Return the names of the shock interfaces: the folders fmus/shock_<law>/."""
    return tuple(sorted(path.parent.name for path in source_folder().glob("shock_*/interface.toml")))
