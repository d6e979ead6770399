"""Writing of a page on which a shock and a quarter car with it run live."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from builder.live_page.controls import BUMP, DYNAMOMETER, Control, shock_controls, to_json
from builder.live_page.models import CAR, SHOCK, Model, read_models
from eightpost.extras import needs
from eightpost.outputs import PAGE, check_file
from eightpost.validity import Validity
from eightpost.verdict import Verdict

with needs("build", "writing a live page"):
    from eightpost.report import page as html

#: Scripts in the order of their dependencies.
_SCRIPTS = ("fmu", "controls", "dynamometer", "hand", "bump", "drawing", "page")

_PLACES = (("dynamometer", "Dynamometer"), ("bump", "Quarter car over a bump"), ("about", "About this page"))


@dataclass(frozen=True)
class LivePage:
    """A page that was written."""

    path: Path  #: HTML file.
    controls: tuple[Control, ...]  #: Parameters of the shock that the page can change.
    verdict: Verdict  #: Verdict that the shock's FMU carries.


def write_live_page(shock: str | Path, path: str | Path, *, vehicle: str | Path) -> LivePage:
    """Write a page in one file, which needs no network: the FMUs' C code runs in it as WebAssembly.

    The numbers on the page are those of the native FMUs: the same C code without fused operations.

    Args:
        shock: Shock file (.json), or native FMU of a shock.
        path: HTML file to write; an existing file is replaced only when the page is complete.
        vehicle: File of a quarter car (.toml, .json), or its native FMU.

    Raises:
        FmuError: A file cannot be used, or the compiler zig is not installed, or it fails.
        InputError: A file cannot be read.
    """
    check_file(Path(path), PAGE)
    models = read_models(Path(shock), Path(vehicle))
    verdict = Validity.from_json(json.loads(models.validity)).verdict if models.validity else Verdict()
    controls = shock_controls(models.shock.interface)
    content = {
        SHOCK: _references(models.shock),
        CAR: _references(models.car),
        "prefix": f"{SHOCK}.",
        "controls": {"shock": to_json(controls), "dynamometer": to_json(DYNAMOMETER), "bump": to_json(BUMP)},
        "units": {unit: _shown(unit) for unit in ("m/s", "m", "N", "J", "s")},
    }
    text = html.page(
        "builder.live_page",
        [f"script/{name}.js" for name in _SCRIPTS],
        title=Path(shock).stem,
        verdict=verdict,
        places=_PLACES,
        subtitle=models.title,
        vehicle=Path(vehicle).name,
        groups=[
            ("dynamometer", "Motion", DYNAMOMETER),
            ("bump", "Road", BUMP),
            ("shock", "Shock", controls),
        ],
        data={
            "models": content,
            "shock-module": _packed(models.shock),
            "car-module": _packed(models.car),
        },
    )
    return LivePage(html.write_page(path, text), controls, verdict)


def _references(model: Model) -> dict[str, int]:
    return {variable.name: variable.reference for variable in model.interface.variables}


def _packed(model: Model) -> str:
    return html.compressed(model.module)


def _shown(unit: str) -> dict[str, Any]:
    control = Control.of(unit, unit, unit, (0.0, 1.0), 0.0)
    return {"us": control.us, "si": control.si}
