"""The contents of exported files: tables of shocks in every format, vehicles and responses."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import loadmat

from eightpost.errors import ParameterError
from eightpost.ident.export import write_response_mat, write_response_uff, write_vehicle_mat
from eightpost.ident.shock_table import TABLE_FORMATS, TableSetting, table_points
from eightpost.shock import Polylinear
from tests.drawn import rounded, timed
from tests.limits import limit_of

from .test_exports import response, vehicle
from .test_shock_tables import curve, knot_curve, succeeded, written


def content_of(path: Path) -> dict[str, Any]:
    """Return the variables of a .mat file."""
    found = loadmat(path, simplify_cells=True)
    values = {name: value for name, value in found.items() if not name.startswith("__") and name != "eightpost"}
    return {name: np.abs(value) if np.iscomplexobj(value) else value for name, value in values.items()}


TABLES = [(name, False) for name in TABLE_FORMATS]
TABLES += [(name, True) for name, form in TABLE_FORMATS.items() if form.has_settings]


@pytest.mark.parametrize(("name", "over"), TABLES)
def test_a_table_of_shocks(name: str, over: bool, tmp_path: Path, unchanged: Callable[..., None]) -> None:
    shocks = [written(tmp_path, f"c{k}", scale) for k, scale in ((8, 1.8), (0, 1.0))][: 2 if over else 1]
    path = tmp_path / f"table.{TABLE_FORMATS[name].suffix.lstrip('.')}"
    words = ["--over", "clicks=8,0"] if over else []
    said = succeeded(*shocks, *words, "--format", name, "-o", path, "--set", "error=3")
    lines = said.replace(str(tmp_path), "").replace(" note ", "\n").splitlines() if name == "csv" else []
    if path.suffix == ".mat":
        unchanged(content_of(path), relative=1e-4)
        return
    rows = [row for row in path.read_text().splitlines() if name == "csv" or ": " not in row]  # the same remarks
    unchanged({"said": lines, "file": timed(rounded("\n".join(rows)))}, relative=1e-4)


def test_points_of_a_table(unchanged: Callable[..., None]) -> None:
    laws = [Polylinear(knot_curve()), Polylinear(curve())]
    unchanged({
        **{f"{error:g}": list(table_points(laws, error=error)) for error in (0.05, 1e-2, 1e-3)},
        **{f"{speed} m": list(table_points(laws, error=1e-2, speed=speed)) for speed in (0.2, 2.0)},
    }, relative=1e-4)  # fmt: skip


def test_the_errors_that_a_table_may_have(unchanged: Callable[..., None]) -> None:
    def is_refused(error: float) -> bool:
        try:
            table_points([Polylinear(curve())], error=error)
        except ParameterError:
            return True
        return False

    unchanged([limit_of(is_refused, 1e-8, 1e-2), limit_of(is_refused, 1e-2, 5.0)], relative=1e-3)


def test_a_setting_is_converted_to_the_unit_of_its_axis(unchanged: Callable[..., None]) -> None:
    setting = TableSetting.parse("temperature [degC]=20,45.5", 1)
    unchanged([setting.axis, np.array(setting.in_unit("K")), np.array(TableSetting.parse("a=1,2", 2).in_unit("K"))])


def test_a_vehicle_and_a_response(tmp_path: Path, unchanged: Callable[..., None]) -> None:
    small = response(0.5 * np.arange(1, 4)).select(inputs=["lf.road", "roll_moment"], outputs=["lf.velocity"])
    write_vehicle_mat(tmp_path / "car.mat", vehicle(0.008))
    write_response_mat(tmp_path / "h.mat", small)
    write_response_uff(tmp_path / "h.uff", small)
    unchanged({"car": content_of(tmp_path / "car.mat"), "response": content_of(tmp_path / "h.mat")}, relative=1e-4)
    unchanged(rounded((tmp_path / "h.uff").read_text()), "uff", relative=1e-4)
