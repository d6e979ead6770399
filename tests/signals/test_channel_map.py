"""Channel maps select, name, scale and flip columns; errors in them are found."""

from pathlib import Path

import numpy as np
import pytest

from eightpost.errors import FileFormatError, MissingChannelError
from eightpost.signals import ChannelMap, read_series

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


@pytest.mark.parametrize(
    ("mapping", "message"),
    [
        ("chanels = 1", "unknown key 'chanels'"),
        ("[channels.force]\nsource = 'F'\nscale = 2", r"unknown key 'channels\.force\.scale'; allowed keys: source"),
        ("[channels.force]\nunit = 'N'", r"'channels\.force' has no 'source'"),
        ("[channels.force]\nsource = 3", r"'channels\.force\.source' must be a text, not 3"),
        ("[channels.force]\nsource = 'F'\ngain = true", r"'channels\.force\.gain' must be a finite number, not True"),
        ("[channels]\nforce = 'F'", r"'channels\.force' must be a table"),
        ("[time]\nsource = 't'\nrate = 5", r"unknown key 'time\.rate'"),
        ("[channels.time]\nsource = 't'", r"'channels\.time' must be the table 'time'"),
        ("[channels", "cannot be read as TOML"),
    ],
)
def test_an_error_in_the_map_names_file_and_key(tmp_path, mapping, message):
    _, toml = files(tmp_path, mapping)
    with pytest.raises(FileFormatError, match=r"map\.toml.*" + message):
        ChannelMap.read(toml)


def test_a_missing_column_is_reported_with_file_key_and_existing_columns(tmp_path):
    data, toml = files(tmp_path, MAP.replace('"Load"', '"Lode"'))
    message = r"run\.csv, line 1, channel 'channels\.force of .*map\.toml': there is no column 'Lode'.*Vel, Load"
    with pytest.raises(MissingChannelError, match=message):
        read_series(data, channel_map=ChannelMap.read(toml))
