"""Conversion of results to pandas and xarray, which are optional."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from eightpost.extras import needs

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

#: Values with the names of their dimensions and their unit: `(("time",), force, "N")`.
Labelled = tuple[Sequence[str], Any, str]


def data_frame(
    columns: Mapping[str, Any], index: Any, name: str, units: Mapping[str, str] | None = None
) -> pd.DataFrame:
    """Return a pandas DataFrame.

    Args:
        columns: Values (N,) by column.
        index: Values (N,) of the index.
        name: Name of the index.
        units: Units by column; they are in `DataFrame.attrs["units"]`.

    Raises:
        MissingExtraError: pandas is not installed.
    """
    with needs("notebook", "to_pandas"):
        import pandas  # noqa: PLC0415 -- an optional extra
    frame: pd.DataFrame = pandas.DataFrame(
        {column: np.array(values) if isinstance(values, np.ndarray) else values for column, values in columns.items()},
        index=pandas.Index(index, name=name),
    )
    frame.attrs["units"] = dict(units or {})
    return frame


def dataset(
    variables: Mapping[str, Labelled], coordinates: Mapping[str, Labelled], attributes: Mapping[str, Any] | None = None
) -> xr.Dataset:
    """Return an xarray Dataset; units are in the attribute `units` of each variable.

    Args:
        variables: Variables by name.
        coordinates: Coordinates by name.
        attributes: Attributes of the dataset.

    Raises:
        MissingExtraError: xarray is not installed.
    """
    with needs("notebook", "to_xarray"):
        import xarray  # noqa: PLC0415 -- an optional extra
    made: xr.Dataset = xarray.Dataset(
        {name: _variable(values) for name, values in variables.items()},
        coords={name: _variable(values) for name, values in coordinates.items()},
        attrs=dict(attributes or {}),
    )
    return made


def _variable(values: Labelled) -> tuple[Sequence[str], Any, dict[str, str]]:
    dimensions, content, unit = values
    return tuple(dimensions), content, {"units": unit} if unit else {}
