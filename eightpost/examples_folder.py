"""Location of the examples that are shipped with the package."""

from __future__ import annotations

from pathlib import Path

from eightpost.errors import InputError


def examples_folder() -> Path:
    """Return the folder of examples: that of the checkout, or its copy in an installed wheel.

    Raises:
        InputError: The folder does not exist; the installation is broken.
    """
    package = Path(__file__).resolve().parent
    for folder in (package / "examples", package.parent / "examples"):
        if (folder / "seven_dof.toml").is_file():
            return folder
    raise InputError(f"there is no examples/ folder in {package} or in its parent folder; reinstall eightpost")
