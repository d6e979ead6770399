"""Model exchange in FMPy with CVode, against co-simulation, and in CasADi, which is skipped if not installed."""

import fmpy
import numpy as np
import pytest

from eightpost.archive import extract_archive

NAMES = ("lpf1", "lpnl2", "maxwell", "polylinear", "quarter_car", "seven_dof")
STEP, COUNT = 1e-3, 100


@pytest.mark.parametrize("name", NAMES)
def test_fmpy_with_cvode_gives_the_outputs_of_co_simulation_for_held_inputs(fmus, name):
    """Constant inputs that jump once at the start: both interpret them alike. The tolerance of CVode is 1e-8."""
    description = fmpy.read_model_description(str(fmus[name]), validate=True)
    sizes = {"m/s": 0.3, "m": 0.005, "N": 400.0, "N.m": 300.0}
    starts = {v.name: 0.0 for v in description.modelVariables if v.causality == "input"}
    units = {v.name: v.unit for v in description.modelVariables}
    signals = np.zeros(2, dtype=[("time", float), *((n, float) for n in starts)])
    signals["time"] = [0.0, STEP * COUNT]
    for n in starts:
        signals[n] = sizes[units[n]]
    outputs = [v.name for v in description.modelVariables if v.causality == "output"]
    options = {"stop_time": STEP * COUNT, "output_interval": STEP, "input": signals, "output": outputs}
    if "start_at_equilibrium" in units:
        options["start_values"] = {"start_at_equilibrium": False}
    stepped = fmpy.simulate_fmu(str(fmus[name]), fmi_type="CoSimulation", **options)
    found = fmpy.simulate_fmu(str(fmus[name]), fmi_type="ModelExchange", relative_tolerance=1e-8, **options)
    for n in outputs:
        assert np.abs(found[n][1:] - stepped[n][1:]).max() <= 2e-5 * max(np.abs(stepped[n]).max(), 1e-3), n


def differences(function, x, u, change):
    """Return outputs by state and input (p, n + m), central differences."""
    columns, z = [], np.concatenate([x, u])
    for k, h in enumerate(change):
        ends = []
        for side in (-1.0, 1.0):
            there = z.copy()
            there[k] += side * h
            ends.append(np.concatenate([np.array(e).ravel() for e in function(there[: x.size], there[x.size :])]))
        columns.append((ends[1] - ends[0]) / (2.0 * h))
    return np.array(columns).T


@pytest.mark.parametrize("name", NAMES)
def test_casadi_gets_the_derivatives_and_the_jacobian(fmus, tmp_path, name):
    """CasADi sets states by value reference in event mode; its Jacobian is that of directional derivatives."""
    casadi = pytest.importorskip("casadi", reason="casadi is not installed (pip install casadi)")
    extract_archive(fmus[name], tmp_path / name)
    dae = casadi.DaeBuilder(name, str(tmp_path / name))
    f = dae.create("f", ["x", "u"], ["ode", "y"] if dae.nx() else ["y"])
    rng = np.random.default_rng(0)
    x = rng.uniform(-0.1, 0.1, dae.nx()) * np.array([float(dae.nominal(n)) for n in dae.x()])
    u = rng.uniform(0.01, 0.2, dae.nu())
    jacobian = f.jacobian()
    blocks = jacobian(x, u, *[casadi.DM(*f.size_out(k)) for k in range(f.n_out())])
    found = np.block([[np.array(casadi.DM(b)) for b in blocks[2 * k : 2 * k + 2]] for k in range(f.n_out())])
    change = np.concatenate([1e-4 * np.maximum(np.abs(x), 1.0), np.full(u.size, 1e-4)])
    expected = differences(lambda a, b: f(a, b) if f.n_out() > 1 else [f(a, b)], x, u, change)
    sizes = np.abs(expected * change).max(axis=1, keepdims=True)
    assert np.all(np.abs(found - expected) * change <= 1e-5 * sizes)
