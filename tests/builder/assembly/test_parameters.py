"""Parameters, states and gains of an assembly act as those of its parts."""

from dataclasses import replace

import numpy as np
import pytest

from builder.assembly import assemble
from cosim import FmuComponent
from cosim.system_file import read_case
from eightpost.shock import write_shock

from .hosts import difference, host, master, observed


@pytest.mark.nightly
def test_setting_the_parameters_of_one_corner_equals_using_another_fmu_there(
    car, made, system_file, shocks, build_here, tmp_path
):
    law = shocks["lpnl2"].law
    other = replace(law, time_constant=0.004, curve=replace(law.curve, compression=(1490.0, 500.0, 80.0, 5.0)))
    write_shock(replace(shocks["lpnl2"], law=other), tmp_path / "other.json")
    (swapped,) = build_here([tmp_path / "other.json"], tmp_path)
    swapped_case = read_case(system_file, fmus={"rr": swapped.path})
    path = made(swapped_case, "swapped")
    starts = {n: v.start for n, v in FmuComponent(path, "car").variables.items() if n.startswith("rr.")}
    parameters = {n: v for n, v in starts.items() if v is not None and not n.endswith("coupling_error")}
    parameters = {n: float(v) for n, v in parameters.items()}
    found = host(car, 0.004, parameters=parameters)
    assert np.array_equal(found, host(path, 0.004))
    assert not np.allclose(found, host(car, 0.004))
    expected, _ = master(swapped_case, 0.0005, drive_step=0.004, outputs=observed(FmuComponent(path, "car")))
    assert difference(found, expected).max() < 1e-9


def test_a_tunable_parameter_set_between_steps_takes_effect_in_the_next_step(car):
    names = ["lf.force", "car.lf.velocity"]
    at_once = host(car, 0.004, parameters={"lf.rebound_scale": 1.5}, outputs=names)
    later = host(car, 0.004, later={"lf.rebound_scale": 1.5}, outputs=names)
    assert difference(later, at_once).max() < 1e-12
    assert not np.allclose(later, host(car, 0.004, outputs=names))


@pytest.mark.nightly
def test_a_unit_conversion_on_a_connection_is_a_gain(case, made, toolchain, tmp_path, car):
    wires = tuple(
        replace(wire, gain=0.25 * wire.gain, factor=4.0, offset=0.0) if wire.source == "lf.force" else wire
        for wire in case.wiring.wires
    )
    path = assemble(replace(case.wiring, wires=wires), tmp_path / "converted.fmu", toolchain=toolchain).path
    assert np.array_equal(host(path, 0.004), host(car, 0.004))
