"""A study has the same rows from the machine and from FMUs, and uses the machine only where they agree."""

import zipfile
from concurrent.futures import Future
from dataclasses import asdict, replace

import pytest

from cosim.components.fmu_component import FmuComponent
from cosim.session.result import difference
from cosim.study import Build, Measure, Term, Vehicle
from cosim.study.measures import STATISTICS, Filtered
from cosim.study.running import workers as running_workers
from cosim.study.running.batches import Batches, ErrorModel
from cosim.study.running.coupling import Compared, coupling_for
from cosim.study.running.evaluator import Check, Coupling, Evaluator, MachineCoupling, coupling_of
from cosim.study.running.machine import read_vehicle
from cosim.study.running.sweep import run_study
from cosim.study.running.workers import Chunk, ProcessWorkers
from eightpost.corners import CORNERS
from eightpost.errors import FmuError
from eightpost.machine import NotInBatchError, car
from eightpost.schema import checked

from ..conftest import WorkersHere
from .lanes import COUPLING, FINE, LAWS, on_machine, random_builds, random_setups, study_of

TIRES = tuple(f"car.{corner}.tire_force" for corner in CORNERS)
OPTIONS = {"percentile": {"percent": 3.0}, "share": {"from": -0.05, "to": 0.02}}


def measures():
    """Return a measure of every statistic, and some with weights, a band or a section."""
    for name in STATISTICS:
        channels = {"work": ("lf.force", "car.lf.velocity"), "share": ("car.lf.velocity",)}.get(name, TIRES)
        yield Measure(name, channels, name, options=OPTIONS.get(name, {}))
    yield Measure("warp", TIRES, weights=(1.0, -1.0, -1.0, 1.0))
    yield Measure("band", TIRES, band=(1.0, 5.0))
    yield Measure("low band", ("car.front.ride_height",), "mean", band=(0.0, 2.0))
    for name in ("peak", "share", "percentile"):
        yield Measure(f"{name} in a band", ("car.lf.velocity",), name, band=(1.0, 5.0), options=OPTIONS.get(name, {}))
    yield Measure("joint in a band", TIRES, "joint_rms", weights=(1.0, 2.0, 1.0, 1.0), band=(1.0, 5.0))
    yield Measure("work in a band", ("lf.force", "car.lf.velocity"), "work", band=(0.5, 20.0))
    yield Measure("section", ("car.rr.hub_acceleration",), section=(0.7, 1.3))


def errors(study):
    """Return an error model with gains of one, so that all local errors reach the columns."""
    ends = tuple(f"{corner}.{end}" for corner in study.corners for end in ("velocity", "force"))
    ones = (1.0,) * len(ends)
    return ErrorModel(ends, {"a": ones}, {m.name: ones for m in study.measures})


def at(coupling, step, study):
    """Return a coupling with the machine at a step."""
    return replace(coupling, machine=MachineCoupling(step, errors(study), 0.1))


@pytest.fixture(scope="module")
def study(fmus):
    return study_of(fmus, random_builds(fmus, LAWS, 8, seed=5), measures=tuple(measures()))


@pytest.fixture(scope="module")
def evaluator(study):
    return Evaluator(study)


@pytest.mark.slow
def test_rows_have_the_columns_marks_and_values_of_the_fmus(study, evaluator):
    setups = random_setups(study, 3, seed=3)
    found = evaluator.rows(setups, at(COUPLING, FINE, study))
    fine = replace(COUPLING, step=FINE, errors=errors(study))
    for setup, row in zip(setups, found, strict=True):
        right = evaluator.row(setup, fine)
        assert set(row) == set(right)
        values = {measure.name for measure in study.measures}
        for name in set(right) - {"seconds", "coupling_error_percent"} - {f"coupling error of {m}" for m in values}:
            if name in values:
                one_row = 1.01 / 376.0 if "share" in name else 0.0
                assert row[name] == pytest.approx(right[name], rel=1e-4, abs=one_row), name
            else:
                assert row[name] == right[name], name


@pytest.mark.slow
def test_the_time_beyond_a_shocks_fitted_range_is_that_of_the_fmus(fmus):
    beyond = {"motion_ratio": 4.0, "compression_scale": 0.05, "rebound_scale": 0.05}
    builds = {"within": Build(fmus["polylinear"], {}), "beyond": Build(fmus["polylinear"], beyond)}
    study = study_of(fmus, builds)
    setup = study.space.setup(5)
    found = on_machine(study, [setup], step=2e-3)
    through_fmus = Evaluator(study).run(setup, study.drives[0], replace(COUPLING, step=2e-3))
    shares = dict(zip(CORNERS, found.beyond[:, 0] / 376.0, strict=True))
    assert shares == pytest.approx(through_fmus.share_beyond_fit, abs=4.1 / 376.0)
    assert {setup.builds[corner] for corner, share in shares.items() if share > 0.01} == {"beyond"}


@pytest.fixture(autouse=True)
def _given_coupling_through_fmus(monkeypatch):
    """Choosing it takes long, and has tests of its own."""
    monkeypatch.setattr("cosim.study.running.coupling.choose_coupling", lambda _: replace(COUPLING, notes=("given",)))


@pytest.fixture(scope="module")
def chosen(evaluator):
    return coupling_for(evaluator)


@pytest.mark.slow
def test_a_study_states_its_step_and_what_it_was_compared_with(chosen, study):
    machine = chosen.machine
    assert machine is not None and machine.stated_error <= study.accuracy
    assert all(check.agrees for check in machine.checks)
    compared = {build for check in machine.checks for build in study.space.setup(check.setup).builds.values()}
    assert compared == set(study.bank)
    assert f"{1e3 * machine.step:.4g} ms {machine.stated_error:.2g} %" in chosen.notes[0]
    assert checked(Coupling, asdict(chosen)) == chosen


@pytest.mark.slow
def test_the_stated_error_of_a_setup_is_about_its_difference_from_a_fine_step(chosen, evaluator, study):
    """Of setups on which the step was not chosen."""
    setups = random_setups(study, 6, seed=77)
    recorded = sorted(evaluator.decisive(setups[0]))
    coarse, fine = (Batches(evaluator, step, recorded) for step in (chosen.machine.step, FINE))
    for (_, run, _), (_, right, _) in zip(coarse.runs(setups), fine.runs(setups), strict=True):
        stated = chosen.machine.errors.of(run["track"].local)[0]
        apart = difference(run["track"].channels().window(0.5, 2.0), right["track"].channels().window(0.5, 2.0))
        assert max(apart.values()) < 2.0 * stated < 12.0 * max(apart.values())


def test_a_machine_that_differs_from_the_fmus_by_more_than_both_errors_does_not_agree():
    assert Check(7, 0.3, 0.1, 0.1, 0.3).agrees and not Check(7, 0.31, 0.1, 0.1, 0.3).agrees


#: An operator changed in a source of the machine: every change must be found by the comparison with the FMUs.
DEFECTS = {
    "polynomial": ("curve.h", "* fourth + coefficients[k]", "* fourth - coefficients[k]"),
    "lag": ("port.h", "port->left * from->lagged + port->faded", "port->left * from->lagged - port->faded"),
    "weight of the lag": ("port.h", "f + lag_weight(p, f)", "f - lag_weight(p, f)"),
    "gas spring": ("port.h", "force + p->gas_stiffness", "force - p->gas_stiffness"),
    "modes": ("machine.c", "car->turn[k][0] * x - car->turn[k][1] * y", "car->turn[k][0] * x + car->turn[k][1] * y"),
    "middle": ("machine.c", "velocity + (0.3125 * velocity", "velocity + (-0.3125 * velocity"),
}


@pytest.mark.nightly
@pytest.mark.parametrize("defect", DEFECTS)
def test_a_machine_that_differs_from_the_fmus_is_not_used(study, defect, monkeypatch):
    name, old, new = DEFECTS[defect]
    right = car.sources()
    assert right[name].count(old.encode()) == 1
    changed = {**right, name: right[name].replace(old.encode(), new.encode())}
    monkeypatch.setattr(car, "sources", lambda: changed)
    found = coupling_for(Evaluator(study))
    assert found.machine is None and "through the FMUs" in found.notes[-1]


@pytest.mark.slow
def test_a_study_without_a_compiler_runs_through_the_fmus(evaluator, monkeypatch):
    def none(*_, **__):
        raise FmuError("no C compiler was found")

    monkeypatch.setattr("eightpost.machine.run.compiled", none)
    found = coupling_for(evaluator)
    assert found.machine is None and "no C compiler was found" in found.notes[-1]


@pytest.mark.slow
def test_builds_of_fmus_without_a_machine_run_through_the_fmus(fmus, study, tmp_path):
    """The kind of a former law, which no folder of fmus/ has now, is written into an FMU of LPF1."""
    former = tmp_path / "former.fmu"
    with zipfile.ZipFile(fmus["lpf1"]) as archive, zipfile.ZipFile(former, "w") as copy:
        for name in archive.namelist():
            content = archive.read(name)
            is_text = name in ("modelDescription.xml", "sources/interface.h")
            copy.writestr(name, content.replace(b"shock_lpf1", b"shock_maxwell") if is_text else content)
    bank = {**dict(list(study.bank.items())[:2]), "former": Build(former)}
    mixed = replace(study, bank=bank, corners=dict.fromkeys(CORNERS, tuple(bank)))
    reason = "former: former.fmu is shock_maxwell, a law that has no batch"
    batches = Batches(Evaluator(mixed), 2e-3)
    assert batches.left_out == (reason,)
    assert [batches.has(mixed.space.find(dict.fromkeys(CORNERS, name))) for name in bank] == [True, True, False]
    found = coupling_for(Evaluator(mixed))
    assert found.machine is not None and found.notes[-1] == "given"
    assert f"setups with these builds run through the FMUs: {reason}" in found.notes
    alone = replace(mixed, bank={"former": bank["former"]}, corners=dict.fromkeys(CORNERS, ("former",)))
    found = coupling_for(Evaluator(alone))
    assert found.machine is None and found.notes[-1] == f"every setup runs through the FMUs: {reason}"


def test_an_fmu_without_sources_has_no_machine(fmus, study, tmp_path):
    secret = tmp_path / "car.fmu"
    with zipfile.ZipFile(fmus["seven_dof"]) as archive, zipfile.ZipFile(secret, "w") as copy:
        for name in archive.namelist():
            if not name.startswith("sources/"):
                copy.writestr(name, archive.read(name))
    with pytest.raises(NotInBatchError, match=r"car\.fmu contains no sources"):
        Batches(Evaluator(replace(study, vehicle=Vehicle(secret))), 2e-3)


def test_setups_that_diverge_or_are_refused_say_what_the_fmus_say(fmus, study):
    bad = {
        "refused": Build(fmus["lpnl2"], {"lag_full_force": 2000.0, "lag_zero_force": 1000.0}),
        "wild": Build(fmus["polylinear"], {"compression_scale": 4000.0, "rebound_scale": 4000.0}),
    }
    bank = {**dict(list(study.bank.items())[:2]), **bad}
    mixed = replace(study, bank=bank, corners=dict.fromkeys(CORNERS, tuple(bank)))
    setups = [mixed.space.find(dict.fromkeys(CORNERS, name)) for name in bank]
    evaluator = Evaluator(mixed)
    found = evaluator.rows(setups, at(COUPLING, 2e-3, mixed))
    right = [evaluator.row(setup, COUPLING) for setup in setups[2:]]
    assert [row["status"] for row in found] == ["done", "done", "failed", "failed"]
    assert [row["message"] for row in found[2:]] == [row["message"] for row in right]


def test_a_batch_whose_setups_all_end_early_changes_nothing_of_the_next_one(fmus, study):
    good = next(iter(study.bank))
    wild = {f"wild {k}": Build(fmus["polylinear"], {"compression_scale": 1e9 + k}) for k in range(2)}
    bank = {**study.bank, **wild}
    mixed = replace(study, bank=bank, corners=dict.fromkeys(CORNERS, tuple(bank)))
    usual = dict.fromkeys(CORNERS, good)
    setups = [mixed.space.find(usual | {corner: name}) for name in wild for corner in CORNERS] + [
        mixed.space.find(usual)
    ]
    coupling = at(COUPLING, 2e-3, mixed)
    *ended, row = Evaluator(mixed).rows(setups, coupling)
    assert {one["status"] for one in ended} == {"failed"}
    (right,) = Evaluator(mixed).rows(setups[-1:], coupling)
    numbers = [name for name, value in right.items() if isinstance(value, float) and name != "seconds"]
    assert [row[n] for n in numbers] == [right[n] for n in numbers]


def test_friction_at_a_port_without_a_shock_is_refused(fmus, study):
    """It would be left out."""
    car = read_vehicle(FmuComponent(fmus["seven_dof"], "car"), fmus["seven_dof"], {"lf.friction_force": 50.0})
    elsewhere = tuple(replace(port, force=6) for port in car.ports)
    with pytest.raises(NotInBatchError, match="friction or a spring at a port that no shock is coupled to"):
        on_machine(study, random_setups(study, 1), car=replace(car, ports=elsewhere))


@pytest.mark.slow
def test_the_traces_of_a_study_are_those_of_its_rows(evaluator, study):
    setup, coupling = random_setups(study, 1, seed=4)[0], at(COUPLING, 2e-3, study)
    ((_, series),) = evaluator.series([setup], coupling)
    (row,) = evaluator.rows([setup], coupling)
    run = Filtered(series["track"])
    for measure in study.measures:
        assert measure.drawn_from(run, start=study.settling) == pytest.approx(row[measure.name], rel=1e-9), measure.name


# ---- Where setups run -----------------------------------------------------------------------------------------------


class Processes:
    """Worker processes that only record what they would run."""

    def __init__(self, count, patience):
        self.patience, Processes.calls = patience, []

    def submit(self, function, _study, _coupling, indices):
        Processes.calls.append(function.__name__)
        done = Future()
        done.set_result([{"setup": index} for index in indices])
        return done

    def end_unresponsive(self):
        return False

    def close(self, *, wait):
        Processes.calls.append("close")


@pytest.fixture
def processes(monkeypatch):
    monkeypatch.setattr(running_workers, "Pool", Processes)
    Processes.calls = []
    return Processes


def numbers_of(study, workers):
    """Return the numbers of the setups that the workers run in chunks of two, and how many ran in parallel."""
    chunks = [Chunk(k, (k, k + 1)) for k in range(0, 4, 2)]
    found = [
        ([row["setup"] for row in rows], workers.count)
        for _, rows in workers.rows(study, at(COUPLING, 4e-3, study), chunks, lambda: False)
    ]
    workers.close()
    return found


@pytest.fixture
def here(fmus):
    """Return a function that makes three or another number of workers for a study that built its FMUs."""
    return lambda study, count=3: ProcessWorkers(count, evaluator=Evaluator(study), built=[fmus["lpnl2"].parent])


def test_a_study_on_the_machine_runs_in_this_process(few, processes, here):
    assert numbers_of(few, here(few)) == [([0, 1], 1), ([2, 3], 1)] and not processes.calls


def test_a_long_study_goes_on_in_worker_processes(few, processes, here, monkeypatch):
    monkeypatch.setattr(running_workers, "_ALONE", 0.0)
    assert numbers_of(few, here(few)) == [([0, 1], 1), ([2, 3], 3)] and processes.calls == ["rows", "close"]
    assert numbers_of(few, here(few, 1)) == [([0, 1], 1), ([2, 3], 1)] and not processes.calls[2:]


def test_a_stop_ends_the_runs_in_this_process(few, processes, here):
    rows = here(few).rows(few, at(COUPLING, 4e-3, few), [Chunk(0, (0,))], lambda: True)
    assert not list(rows) and not processes.calls


def test_code_that_may_crash_runs_in_worker_processes(few, processes, here):
    """An FMU that the study did not build, or a measure of the user's own; so does a study without an evaluator."""
    mine = replace(few, measures=(*few.measures, Measure("mine", TIRES, function=f"{__file__}:level")))
    for study, workers in (
        (few, ProcessWorkers(3, evaluator=Evaluator(few))),
        (mine, here(mine)),
        (few, ProcessWorkers(3)),
    ):
        processes.calls.clear()
        assert workers.count == 3
        numbers_of(study, workers)
        assert processes.calls == ["rows", "rows", "close"]


def level(response):
    return float(response.total.std())


# ---- The best setup of a study --------------------------------------------------------------------------------------


@pytest.fixture
def few(fmus):
    """Return a study of four setups."""
    builds = random_builds(fmus, ["lpnl2"], 2, seed=91)
    tires = Measure("tires", TIRES)
    alike = (("lf", "rf"), ("lr", "rr"))
    return study_of(fmus, builds, measures=(tires,), objective=(Term("tires"),), alike=alike)


@pytest.mark.slow
def test_the_best_setup_is_compared_with_the_fmus_and_a_resumed_study_keeps_it(few, tmp_path):
    result = run_study(few, tmp_path, WorkersHere())
    checks = coupling_of(result).machine.checks
    assert int(result.setups[result.ranking()[0]]) in {check.setup for check in checks}
    assert coupling_of(run_study(few, tmp_path, WorkersHere())).machine.checks == checks


@pytest.mark.slow
def test_if_the_best_setup_differs_all_setups_run_through_the_fmus(few, tmp_path, monkeypatch):
    def apart(_, setup, machine):
        return Compared(Check(setup.index, 3.0, 0.1, 0.1, 0.3), 1e-3, "gauss-seidel")

    chosen = MachineCoupling(4e-3, errors(few), 0.1)
    monkeypatch.setattr(WorkersHere, "choose", lambda *_: replace(COUPLING, machine=chosen))
    monkeypatch.setattr("cosim.study.running.sweep.check_setup", apart)
    result = run_study(few, tmp_path, WorkersHere())
    coupling = coupling_of(result)
    assert coupling.machine is None and "the machine differs from them by 3 %" in coupling.notes[-1]
    setup = few.space.setup(int(result.setups[0]))
    assert result.values("tires")[0] == pytest.approx(Evaluator(few).row(setup, coupling)["tires"], rel=1e-12)
