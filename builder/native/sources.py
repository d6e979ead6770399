"""The C sources of one FMU: unchanged common files and files of the model, and generated tables."""

from __future__ import annotations

from builder.interface import Interface
from builder.native.tables import interface_header, interface_source, layout
from builder.native.vehicle_data import kept_numbers, vehicle_data
from builder.product import Product
from builder.sources import source_folder
from eightpost.shock import Shock
from eightpost.vehicle.modal import modal_form

COMMON = (
    "component.h",
    "derivatives.c",
    "elementary.c",
    "elementary.h",
    "exchange.c",
    "fmu_state.c",
    "fresh.h",
    "instance.h",
    "lifecycle.c",
    "logging.c",
    "message.c",
    "message.h",
    "names.h",
    "refusals.c",
    "state_check.c",
    "step.c",
    "variables.c",
    "wide.h",
)
SHOCK = ("curve.h", "lag.h", "shock.c", "shock.h")


def c_sources(product: Product, visible: Interface, guid: str) -> dict[str, bytes]:
    """Return file name -> content of sources/; `visible` contains the variables that a host can see.

    Raises:
        FmuError: The vehicle has no modal form.
    """
    folder = source_folder()
    model = {"model.c": (folder / product.sources / "model.c").read_bytes()}
    states, generated = 0, {}
    if isinstance(product.source, Shock):
        model |= {name: (folder / "common" / name).read_bytes() for name in SHOCK}
    else:
        space = product.source.coupled()
        form = modal_form(space)
        states = kept_numbers(form, product.interface)
        model["phi.h"] = (folder / product.sources / "phi.h").read_bytes()
        generated = {"vehicle_data.h": vehicle_data(space, form, product.interface)}
    plan = layout(product.interface, states)
    generated |= {
        "interface.h": interface_header(plan, product.identifier, guid),
        "interface.c": interface_source(plan, visible.variables),
    }
    common = {name: (folder / "common" / name).read_bytes() for name in COMMON}
    return common | model | {name: text.encode() for name, text in generated.items()}
