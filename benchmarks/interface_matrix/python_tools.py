"""Tools of the matrix that are Python packages."""

from __future__ import annotations

import contextlib
import csv
import io
import shutil
import tempfile
from pathlib import Path
from typing import Any

import fmpy
import numpy as np

from benchmarks.interface_matrix.direct import EULER_STEP, FINE_STEP, STEP, Array, Subject, co_simulation
from benchmarks.interface_matrix.programs import UnsuitableError
from eightpost.archive import extract_archive


def _fmpy(subject: Subject, kind: str, **options: Any) -> Array:
    result: Any = fmpy.simulate_fmu(
        str(subject.path),
        fmi_type=kind,
        start_time=0.0,
        stop_time=STEP * subject.count,
        output=list(subject.outputs),
        **options,
    )
    return np.array([[row[name] for name in subject.outputs] for row in result])


def fmpy_steps(subject: Subject) -> Array:
    """Run co-simulation in FMPy."""
    return _fmpy(subject, "CoSimulation", input=subject.signals, output_interval=STEP)


def fmpy_cvode(subject: Subject) -> Array:
    """Run model exchange in FMPy with CVode, which sees inputs at output points and restarts at events only."""
    options: dict[str, Any] = {"relative_tolerance": 1e-8, "output_interval": STEP, "record_events": False}
    return _fmpy(subject, "ModelExchange", input=subject.held_signals, solver="CVode", **options)


def fmpy_euler(subject: Subject) -> Array:
    """Run model exchange in FMPy with forward Euler, whose step is the output interval, whatever `step_size` is."""
    options: dict[str, Any] = {"step_size": EULER_STEP, "output_interval": EULER_STEP}
    rows = _fmpy(subject, "ModelExchange", input=subject.signals, solver="Euler", **options)
    return rows[:: round(STEP / EULER_STEP)]


def own_master(subject: Subject) -> Array:
    """Step an FMU with the component of `eightpost run`."""
    from cosim import FmuComponent  # noqa: PLC0415

    component = FmuComponent(subject.path, "reference")
    component.begin(0.0, STEP * subject.count, {})
    component.end_initialization()
    rows = [component.get(subject.outputs)]
    for time, held in zip(subject.times[:-1].tolist(), subject.values.tolist(), strict=False):
        component.set(subject.inputs, held)
        component.step(time, STEP)
        rows.append(component.get(subject.outputs))
    component.finish()
    return np.array(rows)


def held_force(subject: Subject) -> Array:
    """Run loop A of `cosim.HeldForce`."""
    from cosim import HeldForce  # noqa: PLC0415

    if "velocity" not in subject.inputs:
        raise UnsuitableError("shocks only")
    with HeldForce(subject.path) as law:
        rows = [law.start(0.0, 0.0, 0.0)]
        for time, (velocity, displacement) in zip(subject.times[:-1].tolist(), subject.values.tolist(), strict=False):
            rows.append(law.step(time, STEP, velocity, displacement))
    return np.array(rows, dtype=float).reshape(-1, 1)


def casadi(subject: Subject) -> Array:
    """Integrate model exchange by CasADi's Runge-Kutta method."""
    import casadi as ca  # noqa: PLC0415

    with tempfile.TemporaryDirectory() as folder:
        extract_archive(subject.path, Path(folder))
        builder = ca.DaeBuilder("one", folder)
        names = (["x", "u"], ["ode", "y"]) if builder.nx() else (["x", "u"], ["y"])
        function = builder.create("f", *names)
        order = [subject.inputs.index(name) for name in builder.u()]
        place = [builder.y().index(name) for name in subject.outputs]
        x, t = ca.MX.sym("x", builder.nx()), ca.MX.sym("t")
        ends = ca.MX.sym("u", 2 * builder.nu())
        now = ends[: builder.nu()] + t / STEP * (ends[builder.nu() :] - ends[: builder.nu()])
        options = {"number_of_finite_elements": round(STEP / FINE_STEP)}
        problem = {"x": x, "p": ends, "t": t, "ode": function(x, now)[0]}
        step = ca.integrator("step", "rk", problem, 0.0, STEP, options)
        inputs = subject.values[:, order]
        states = [np.zeros(builder.nx())]
        for k in range(subject.count):
            ahead = step(x0=states[-1], p=np.concatenate([inputs[k], inputs[k + 1]]))
            states.append(np.array(ahead["xf"]).ravel())
        rows = [np.array(function(*pair)[-1]).ravel()[place] for pair in zip(states, inputs, strict=True)]
    return np.array(rows)


def _pathsim(subject: Subject, block: Any, source: Any, step: float) -> Array:
    from pathsim import Connection, Simulation  # noqa: PLC0415
    from pathsim.blocks import Scope  # noqa: PLC0415
    from pathsim.solvers import RK4  # noqa: PLC0415

    scope = Scope()
    wires = [Connection(source[0 : len(subject.inputs)], block[list(subject.inputs)])]
    wires += [Connection(block[list(subject.outputs)], scope[0 : len(subject.outputs)])]
    simulation = Simulation([source, block, scope], wires, dt=step, Solver=RK4, log=False)
    simulation.run(STEP * (subject.count + 1), adaptive=False)
    _, rows = scope.read()
    each = round(STEP / step)
    return np.array(rows).T[::each][: subject.count + 2]


def pathsim_exchange(subject: Subject) -> Array:
    """Integrate model exchange by PathSim's Runge-Kutta method."""
    from pathsim.blocks import DynamicalFunction  # noqa: PLC0415
    from pathsim_fmi import ModelExchangeFMU  # noqa: PLC0415

    class Direct(ModelExchangeFMU):  # type: ignore[misc, unused-ignore]
        """A block whose outputs depend on its inputs; PathSim concludes that they do not if the slope at rest is 0."""

        def __len__(self) -> int:
            return 1

    source = DynamicalFunction(lambda _, t: subject.at(min(t, STEP * subject.count)))
    return _pathsim(subject, Direct(str(subject.path)), source, FINE_STEP)[: subject.count + 1]


def pathsim_steps(subject: Subject) -> Array:
    """Run co-simulation in PathSim, which records the end of a step at its start."""
    from pathsim.blocks import DynamicalFunction  # noqa: PLC0415
    from pathsim_fmi import CoSimulationFMU  # noqa: PLC0415

    source = DynamicalFunction(lambda _, t: subject.at(min(t, STEP * subject.count)))
    rows = _pathsim(subject, CoSimulationFMU(str(subject.path), dt=STEP), source, STEP)
    return np.vstack([co_simulation(subject)[:1], rows[: subject.count]])


def cofmupy(subject: Subject) -> Array:
    """Step one FMU with CoFMUPy's master."""
    from cofmupy.master.default_master import DefaultMaster  # noqa: PLC0415

    unit = {"id": "one", "name": "one", "path": str(subject.path), "initialization": {}}
    master = DefaultMaster([unit], {}, [("one",)], cosim_method="gauss_seidel")
    master.init_simulation(input_dict={})
    rows = []
    for held in subject.values[:-1].tolist():
        given = {name: [value] for name, value in zip(subject.inputs, held, strict=True)}
        found = master.do_step(STEP, {"one": given}, record_outputs=False)["one"]
        rows.append([float(np.ravel(found[name])[0]) for name in subject.outputs])
    return np.vstack([co_simulation(subject)[:1], rows])


def fmu_container(subject: Subject) -> Array:
    """Put the FMU into a container of the FMU Manipulation Toolbox, and step that directly."""
    from fmu_manipulation_toolbox.assembly import Assembly  # noqa: PLC0415

    with tempfile.TemporaryDirectory() as name, contextlib.redirect_stdout(io.StringIO()):
        folder = Path(name)
        shutil.copy(subject.path, folder / subject.path.name)
        routes = [("INPUT", "", n, subject.path.name, n) for n in subject.inputs]
        routes += [("OUTPUT", subject.path.name, n, "", n) for n in subject.outputs]
        with (folder / "one.csv").open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file, delimiter=";", lineterminator="\n")
            writer.writerow(["rule", "from_fmu", "from_port", "to_fmu", "to_port"])
            writer.writerow(["FMU", subject.path.name, "", "", ""])
            writer.writerows(routes)
        made = Assembly("one.csv", default_step_size=STEP, fmu_directory=folder)
        made.make_fmu(fmi_version=subject.fmi)
        container = Subject(folder / "one.fmu", subject.fmi, subject.count)
        return _reordered(container, subject)


def _reordered(container: Subject, subject: Subject) -> Array:
    """Return the outputs of a container with the inputs and outputs of a subject in another order."""
    order = [subject.inputs.index(n) for n in container.inputs]
    container.__dict__["values"] = subject.values[:, order]
    place = [container.outputs.index(n) for n in subject.outputs]
    return co_simulation(container)[:, place]
