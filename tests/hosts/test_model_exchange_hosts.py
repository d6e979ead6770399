"""Model exchange in FMPy with CVode, against co-simulation, and in CasADi."""

from itertools import pairwise

import fmpy
import numpy as np
import pytest

from eightpost.archive import extract_archive
from eightpost.shock import LAWS

NAMES = (*LAWS, "quarter_car", "seven_dof")
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
    assert outputs
    options = {"stop_time": STEP * COUNT, "output_interval": STEP, "input": signals, "output": outputs}
    if "start_at_equilibrium" in units:
        options["start_values"] = {"start_at_equilibrium": False}
    stepped = fmpy.simulate_fmu(str(fmus[name]), fmi_type="CoSimulation", **options)
    found = fmpy.simulate_fmu(str(fmus[name]), fmi_type="ModelExchange", relative_tolerance=1e-8, **options)
    for n in outputs:
        assert np.abs(found[n][1:] - stepped[n][1:]).max() <= 2e-5 * max(np.abs(stepped[n]).max(), 1e-3), n


#: Steps of differences by the unit of an input: small beside the widths of the shocks' curve; vehicles are linear.
INPUT_STEPS = {"m/s": 4e-4, "m": 1e-3, "N": 10.0, "N.m": 10.0}
#: Range of the points by the unit of an input.
INPUT_RANGES = {"m/s": 0.9, "m": 0.02, "N": 300.0, "N.m": 300.0}


def romberg(function, z, k, step):
    """Return the derivative by one variable: central differences with steps halved three times, extrapolated."""
    rows = []
    for level in range(4):
        h, ends = step / 2**level, []
        for side in (-h, h):
            there = z.copy()
            there[k] += side
            ends.append(function(there))
        rows.append((ends[1] - ends[0]) / (2.0 * h))
    for order in (4.0, 16.0, 64.0):
        rows = [(order * fine - coarse) / (order - 1.0) for coarse, fine in pairwise(rows)]
    return rows[0]


def derivatives(function, z, steps):
    """Return derivatives (p, n) and whether there is no kink near the point: other steps then give the same."""
    found, finer = (
        np.array([romberg(function, z, k, share * step) for k, step in enumerate(steps)]).T for share in (1.0, 0.6)
    )
    sizes = np.abs(found * steps).max(axis=1, keepdims=True)
    return found, bool(np.all(np.abs(found - finer) * steps <= 2e-9 * sizes))


class Casadi:
    """An FMU in CasADi: derivatives of the states and outputs as one function of states and inputs."""

    def __init__(self, casadi, fmu, folder):
        extract_archive(fmu, folder)
        dae = casadi.DaeBuilder(fmu.stem, str(folder))
        units = {v.name: v.unit for v in fmpy.read_model_description(str(folder)).modelVariables}
        self.f = dae.create("f", ["x", "u"], ["ode", "y"] if dae.nx() else ["y"])
        self.states = dae.nx()
        nominal = np.array([float(dae.nominal(n)) for n in dae.x()])
        self.ranges = np.concatenate([nominal, [INPUT_RANGES[units[n]] for n in dae.u()]])
        self.steps = np.concatenate([0.01 * nominal, [INPUT_STEPS[units[n]] for n in dae.u()]])

    def __call__(self, z):
        found = self.f(z[: self.states], z[self.states :])
        return np.concatenate([np.array(part).ravel() for part in (found if self.f.n_out() > 1 else [found])])

    def jacobian(self, z):
        parts = [np.zeros(self.f.size_out(k)) for k in range(self.f.n_out())]
        blocks = self.f.jacobian()(z[: self.states], z[self.states :], *parts)
        return np.block([[b.full() for b in blocks[2 * k : 2 * k + 2]] for k in range(self.f.n_out())])


@pytest.mark.repeated("hysteresis-2", "seven_dof-3")
@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.slow if n == "seven_dof" else ()) for n in NAMES])
def test_casadis_jacobian_is_exact_away_from_kinks(fmus, fmus3, tmp_path, name, fmi):
    """CasADi sets states by value reference in event mode; its Jacobian is that of directional derivatives."""
    casadi = pytest.importorskip("casadi", reason="casadi is not installed (pip install casadi)")
    model = Casadi(casadi, {2: fmus, 3: fmus3}[fmi][name], tmp_path / "unpacked")
    rng, smooth = np.random.default_rng(0), 0
    for z in rng.uniform(-1.0, 1.0, (20, model.ranges.size)) * model.ranges:
        expected, is_smooth = derivatives(model, z, model.steps)
        if is_smooth:
            smooth += 1
            sizes = np.abs(expected * model.steps).max(axis=1, keepdims=True)
            assert np.all(np.abs(model.jacobian(z) - expected) * model.steps <= 1e-8 * sizes)
    assert smooth >= 15
