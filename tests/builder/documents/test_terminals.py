"""Terminals: one port per corner, with the flow direction of the force as in the standard."""

from __future__ import annotations

import io

from fmu_manipulation_toolbox.terminals import Terminals

from builder.interface import vehicle_interface
from builder.page import terminals_and_icons
from eightpost.vehicle import Channel, StateSpace

from .members import TERMINALS, kinds_of


def test_a_vehicle_has_one_port_per_corner_whose_force_flows_in(archives):
    found = kinds_of(archives["seven_dof"][TERMINALS])
    assert list(found) == ["lf", "rf", "lr", "rr"]
    for corner, members in found.items():
        assert members["velocity"] == (f"{corner}.velocity", "signal")
        assert members["displacement"] == (f"{corner}.displacement", "signal")
        assert members["force"] == (f"{corner}.force", "inflow")
    assert list(kinds_of(archives["quarter_car"][TERMINALS])) == ["port"]


def test_fmutool_connects_a_shock_to_a_corner(archives):
    shock = next(iter(Terminals.from_xml_source(io.BytesIO(archives["lpnl2"][TERMINALS]))))
    corner = Terminals.from_xml_source(io.BytesIO(archives["seven_dof"][TERMINALS])).terminals["rr"]
    assert shock == corner  # terminals of the same kind
    assert set(corner.connect(shock)) == {(f"rr.{name}", name) for name in ("velocity", "displacement", "force")}


def test_a_vehicle_without_displacements_has_ports_without_displacements():
    model = StateSpace(
        [[0.0]], [[1.0]], [[1.0]], [[0.0]], (Channel("lf.force", "N"),), (Channel("lf.velocity", "m/s"),)
    )
    assert list(kinds_of(terminals_and_icons(vehicle_interface(model)))["lf"]) == ["velocity", "force"]
