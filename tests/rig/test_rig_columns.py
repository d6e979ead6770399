"""Columns with a team's own names: recognition of rig records, and the proposed channel map."""

import numpy as np
import pytest
from click.testing import CliRunner

from eightpost.__main__ import main
from eightpost.corners import CORNERS
from eightpost.errors import MissingChannelError
from eightpost.rig import read_dyno_test, read_rig_test
from eightpost.rig.columns import propose_map
from eightpost.rig.rig_test import CHANNEL_UNITS
from eightpost.signals import ChannelMap
from eightpost.signals.faults import Origin
from eightpost.signals.raw_record import RawRecord

TEAM = dict(zip(CORNERS, ("FL", "FR", "RL", "RR"), strict=True))


def record(**columns):
    """Return a record of columns with their units."""
    values = tuple(np.arange(3.0) for _ in columns)
    return RawRecord(Origin(), tuple(columns), tuple(columns.values()), values)


def four(pattern, unit=None):
    """Return columns of four corners and a unit."""
    return {pattern.format(corner): unit for corner in TEAM.values()}


@pytest.mark.parametrize(("pattern", "unit", "kind"), [
    ("WL {} Pos", "mm", "road"),
    ("WheelLoader{}Position", None, "road"),
    ("road {} cmd", "in", "road_command"),
    ("WL {} Load", "kN", "tire_force"),
    ("Wheel {} load", "lbf", "tire_force"),
    ("AL {} Load", "kN", "aero"),
    ("Aero_{}_Force_Demand", None, "aero_command"),
    ("aeroloader {} stroke", None, "aero_position"),
    ("Damper {} Load", "N", "force"),
    ("Damper Load {} target", "N", "force"),
    ("damperPot{}", None, "displacement"),
    ("shock {} speed", None, "velocity"),
    ("DMP_{}_V", "in/s", "velocity"),
    ("Hub {}", "g", "hub_acceleration"),
    ("Wheel {} accel", None, "hub_acceleration"),
    ("Body {}", "m/s2", "chassis_acceleration"),
])  # fmt: skip
def test_a_column_is_recognised_by_its_words_and_its_unit(pattern, unit, kind):
    found = propose_map(record(Time="s", **four(pattern, unit), **four("x {}")))
    assert found.columns == {f"{corner}.{kind}": (pattern.format(name),) for corner, name in TEAM.items()}
    assert all(name in CHANNEL_UNITS for name in found.columns)


@pytest.mark.parametrize(("column", "corner"), [
    ("Front Left Pot", "lf"), ("right front pot", "rf"), ("Pot VR", "rf"), ("LR pot", "lr"), ("Rear Right Pot", "rr"),
])  # fmt: skip
def test_corners_have_usual_names(column, corner):
    found = propose_map(record(**{column: "mm"}, **four("x {}"), **four("y {}")))
    assert found.columns == {f"{corner}.displacement": (column,)}


def test_ride_heights_belong_to_axles_and_other_columns_to_nothing():
    others = {"RideHeightRear": None, "RH Front": "in", "Hub FL temp": "degC", "Body roll": "deg", "WL Pos": "mm",
              "Shock FL rate": "blorps"}  # fmt: skip
    found = propose_map(record(**others, **four("x {}"), **four("y {}")))
    assert found.columns == {"rear.ride_height": ("RideHeightRear",), "front.ride_height": ("RH Front",)}


def test_a_file_with_fewer_than_two_columns_at_a_corner_is_no_rig_record():
    both = {**four("Hub {}", "g"), **four("Body {}", "g")}
    assert propose_map(record(**both)).per_corner == 2
    assert propose_map(record(**{name: unit for name, unit in both.items() if name != "Body RL"})) is None


def test_the_proposal_is_a_channel_map_with_ambiguous_columns_as_comments(tmp_path):
    columns = {"Elapsed Time": "s", **four("Hub {}", "g"), **four("Body {}", "g"), "Hub FL 2": "g"}
    (tmp_path / "map.toml").write_text(propose_map(record(**columns)).toml())
    read = ChannelMap.read(tmp_path / "map.toml")
    assert read.time.source == "Elapsed Time"
    assert {n: p.source for n, p in read.channels.items() if n[0] == "r"}["rr.chassis_acceleration"] == "Body RR"
    assert len(read.channels) == 7 and "lf.hub_acceleration" not in read.channels
    text = (tmp_path / "map.toml").read_text()
    assert '# "lf.hub_acceleration" = { source = "Hub FL" }\n# "lf.hub_acceleration" = { source = "Hub FL 2" }' in text


@pytest.fixture
def unmapped(tmp_path):
    """Return a rig file without a map."""
    header = ["Time (s)", *four("WL {} Pos (mm)"), *four("WL {} Load (kN)")]
    rows = [",".join(f"{0.01 * i + k * i % 7:.3f}" for k in range(len(header))) for i in range(500)]
    (tmp_path / "lap.csv").write_text("\n".join([",".join(header), *rows]))
    return tmp_path / "lap.csv"


def test_inspect_proposes_a_map_for_a_rig_file_without_one_and_shows_it_with_one(unmapped):
    found = CliRunner().invoke(main, ["-v", "inspect", str(unmapped)])
    assert found.exit_code == 2
    assert '"lf.road" = { source = "WL FL Pos" }' in found.output
    assert "it has 2 or more columns at each corner; write its" in " ".join(found.output.split())
    lines = ['[channels]\n"lf.road" = { source = "WL FL Pos" }\n"rf.force" = { source = "WL RL Load", gain = -1.0 }']
    (unmapped.parent / "rig_map.toml").write_text("\n".join(lines))
    shown = " ".join(CliRunner().invoke(main, ["-v", "inspect", str(unmapped)]).output.split())
    assert "rig_map.toml): lf.road WL FL Pos, rf.force -WL RL Load" in shown
    assert "columns that are not read: WL FR Pos, WL RL Pos, WL RR Pos, WL FL Load, WL FR Load, WL RR Load" in shown


def test_inspect_writes_the_proposed_map_and_replaces_none(unmapped):
    words = ["inspect", str(unmapped), "-o", str(unmapped.parent)]
    elsewhere = unmapped.parent / "maps"
    shown = CliRunner().invoke(main, [*words[:3], str(elsewhere)]).output
    assert " ".join(shown.split()).endswith(f"and inspect again with --channel {elsewhere / 'rig_map.toml'}")
    found = CliRunner().invoke(main, words)
    assert found.exit_code == 2 and " ".join(found.output.split()).endswith("and inspect again")
    path = unmapped.parent / "rig_map.toml"
    assert ChannelMap.read(path).channels["lf.road"].source == "WL FL Pos"
    path.write_text("# edited\n")
    again = CliRunner().invoke(main, words)
    assert again.exit_code == 2 and "rig_map.toml exists and is not replaced" in " ".join(again.output.split())
    assert path.read_text() == "# edited\n"


def test_a_rig_file_without_a_map_is_named_as_such_by_other_readers(unmapped):
    with pytest.raises(
        MissingChannelError, match=r"looks like a rig record.*, not a dynamometer's; `eightpost inspect`"
    ):
        read_dyno_test(unmapped)
    with pytest.raises(MissingChannelError, match=r"no channel of a rig.* map; `eightpost inspect .* -o FOLDER`"):
        read_rig_test(unmapped)
