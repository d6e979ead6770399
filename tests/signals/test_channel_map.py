"""Channel maps select, name, scale and flip columns; errors in them are found."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from eightpost.errors import MissingChannelError
from eightpost.signals import ChannelMap, read_series
from tests.unchanged import refusals

DATA = "clock [ms],Vel,Load [N],note\n0,1,10,a\n1,2,20,b\n"
MAP = """
[time]
source = "clock"
[channels.velocity]
source = "Vel"
unit = "in/s"
gain = -2.0
offset = 1
[channels.force]
source = "Load"
"""


def files(folder: Path, mapping: str) -> tuple[Path, Path]:
    data, toml = folder / "run.csv", folder / "map.toml"
    data.write_text(DATA)
    toml.write_text(mapping)
    return data, toml


def test_gain_and_offset_apply_in_the_columns_unit_and_other_columns_are_not_read(tmp_path):
    data, toml = files(tmp_path, MAP)
    series = read_series(data, channel_map=ChannelMap.read(toml))
    assert series.names == ("velocity", "force")
    np.testing.assert_allclose(series.time, [0.0, 0.001])
    np.testing.assert_allclose(series["velocity"], [-0.0254, -0.0762])


def test_a_flipped_channel_is_the_negative(tmp_path):
    data, toml = files(tmp_path, MAP)
    channel_map = ChannelMap.read(toml)
    turned = read_series(data, channel_map=channel_map.flipped(["velocity"]))
    np.testing.assert_allclose(turned["velocity"], [0.0254, 0.0762])
    with pytest.raises(MissingChannelError, match=r"'load'.*velocity, force"):
        channel_map.flipped(["load"])


WRONG = (
    "chanels = 1",
    "[channels.force]\nsource = 'F'\nscale = 2",
    "[channels.force]\nunit = 'N'",
    "[channels.force]\nsource = 3",
    "[channels.force]\nsource = 'F'\ngain = true",
    "[channels.force]\nsource = 'F'\noffset = nan",
    "[channels]\nforce = 'F'",
    "[time]\nsource = 't'\nrate = 5",
    "[channels.time]\nsource = 't'",
    "bridge = '20'",
    "bridge = -1",
    "schema = 2",
    "[channels",
    "[channels.force]\nsource = 'F'\n[channels.force]\nsource = 'G'",
)


def test_an_error_in_the_map_names_file_line_and_key(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, unchanged: Callable[..., None]
) -> None:
    monkeypatch.chdir(tmp_path)

    def read(mapping: str) -> ChannelMap:
        return ChannelMap.read(files(Path(), mapping)[1])

    unchanged(refusals({mapping.replace("\n", " / "): partial(read, mapping) for mapping in WRONG}))


def test_a_missing_column_is_reported_with_file_key_and_existing_columns(tmp_path):
    data, toml = files(tmp_path, MAP.replace('"Load"', '"Lode"'))
    message = r"run\.csv, line 1, channel 'channels\.force of .*map\.toml': there is no column 'Lode'.*Vel, Load"
    with pytest.raises(MissingChannelError, match=message):
        read_series(data, channel_map=ChannelMap.read(toml))
