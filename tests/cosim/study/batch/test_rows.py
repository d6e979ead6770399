"""A study has the same rows from batches and from FMUs, and uses batches only where they agree."""

import zipfile
from dataclasses import asdict, replace

import pytest

from cosim.study import Build, Measure, Vehicle
from eightpost.machine import library
from cosim.study.running.batch_check import LARGEST_DIFFERENCE, with_batch
from cosim.study.running.batch_check import random_setups as random_setups_of_study
from cosim.study.running.batches import Batches, BatchRun
from cosim.study.running.error_model import ErrorModel
from cosim.study.running.evaluator import Coupling, Evaluator
from cosim.study.statistics import STATISTICS
from eightpost.corners import CORNERS
from eightpost.errors import FmuError

from .batched import COUPLING, LAWS, in_lanes, random_builds, random_setups, study_of

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


@pytest.fixture(scope="module")
def study(fmus):
    return study_of(fmus, random_builds(fmus, LAWS, 8, seed=5), measures=tuple(measures()))


@pytest.fixture(scope="module")
def evaluator(study):
    return Evaluator(study)


@pytest.mark.nightly
def test_rows_have_the_columns_marks_and_values_of_the_fmus(study, evaluator):
    setups = random_setups(study, 11, seed=3)
    coupling = replace(COUPLING, errors=errors(study))
    found = evaluator.rows(setups, replace(coupling, batch="exact"))
    for setup, row in zip(setups, found, strict=True):
        right = evaluator.row(setup, coupling)
        assert set(row) == set(right)
        for name in set(right) - {"seconds"}:
            if isinstance(right[name], float):
                assert row[name] == pytest.approx(right[name], rel=1e-12, abs=1e-14), name
            else:
                assert row[name] == right[name], name


@pytest.mark.slow
def test_the_time_beyond_a_shocks_fitted_range_is_that_of_the_fmus(fmus):
    beyond = {"motion_ratio": 4.0, "compression_scale": 0.05, "rebound_scale": 0.05}
    builds = {"within": Build(fmus["polylinear"], {}), "beyond": Build(fmus["polylinear"], beyond)}
    study = study_of(fmus, builds)
    setup = study.space.setup(5)
    found, through_fmus = in_lanes(study, [setup]), Evaluator(study).run(setup, study.drives[0], COUPLING)
    shares = dict(zip(CORNERS, found.beyond[:, 0] / found.settled, strict=True))
    assert shares == pytest.approx(through_fmus.share_beyond_fit, abs=1e-9)
    assert {setup.builds[corner] for corner, share in shares.items() if share > 0.01} == {"beyond"}


def test_every_build_of_the_bank_is_compared(study, evaluator):
    setups = random_setups_of_study(study, Batches(evaluator, COUPLING.scheme, COUPLING.step, "exact"))
    assert {build for setup in setups for build in setup.builds.values()} == set(study.bank)


def test_a_study_states_the_largest_difference_on_random_setups(evaluator):
    found = with_batch(evaluator, COUPLING)
    assert found.batch == "exact"
    assert found.batch_difference is not None and found.batch_difference <= LARGEST_DIFFERENCE
    assert f"{found.batch_difference:.1e} of its scale, on 6 random setups with 8 of 8 builds" in found.notes[-1]
    assert Coupling.from_json(asdict(found)) == found


@pytest.mark.parametrize("which", [0, -1])
def test_a_measure_that_is_not_a_number_is_a_difference(evaluator, monkeypatch, which):
    runs, name = Batches.runs, list(evaluator.study.measures)[which].name

    def without_a_value(batches, setups):
        for setup, found, seconds in runs(batches, setups):
            changed = {d: BatchRun({**run.values, name: float("nan")}, run.summary) for d, run in found.items()}
            yield setup, changed, seconds

    monkeypatch.setattr(Batches, "runs", without_a_value)
    found = with_batch(evaluator, COUPLING)
    assert found.batch == "" and "the batch does not agree with them" in found.notes[-1]
    assert found.batch_difference is None


#: An operator changed in a source of the batch: every change must be found by the comparison with the FMUs.
DEFECTS = {
    "polynomial": ("curve.h", "* fourth + coefficients[k]", "* fourth - coefficients[k]"),
    "lag": ("port.c", "(end - start) * lag->ramp", "(end + start) * lag->ramp"),
    "weight of the lag": ("port.c", "(1.0 - alpha) * f", "(1.0 + alpha) * f"),
    "gas spring": ("port.c", "p->gas_preload + p->gas", "p->gas_preload - p->gas"),
    "modes": ("advance.h", "f->first_re[k] * b[k] + f->first_im", "f->first_re[k] * b[k] - f->first_im"),
    "parabola": ("march.c", "step->newer - (s->past", "step->newer + (s->past"),
    "slope": ("march.c", "(b - a) * step->per_second, 0.5", "(b + a) * step->per_second, 0.5"),
    "direct term": ("vehicle.c", "y += car->direct", "y -= car->direct"),
    "sum of a measure": ("sums.c", "to[SUM] += apart;", "to[SUM] -= apart;"),
    "filter": ("filter.c", "c[1] * x - c[4] * y", "c[1] * x + c[4] * y"),
}


@pytest.mark.nightly
@pytest.mark.parametrize(
    "defect", ["lag", *(pytest.param(d, marks=pytest.mark.nightly) for d in DEFECTS if d != "lag")]
)
def test_a_batch_that_differs_from_the_fmus_is_not_used(study, defect, monkeypatch):
    name, old, new = DEFECTS[defect]
    right = library.sources()
    assert right[name].count(old.encode()) == 1
    changed = {**right, name: right[name].replace(old.encode(), new.encode())}
    monkeypatch.setattr(library, "sources", lambda: changed)
    monkeypatch.setattr(library, "_FLAGS", ("-O1", *library._FLAGS[2:]))
    found = with_batch(Evaluator(study), COUPLING)
    assert found.batch == ""
    assert "through the FMUs" in found.notes[-1]


def test_a_study_without_a_compiler_runs_through_the_fmus(evaluator, monkeypatch):
    def none(*_, **__):
        raise FmuError("no C compiler was found")

    monkeypatch.setattr("cosim.study.running.batches.compiled", none)
    found = with_batch(evaluator, COUPLING)
    assert found.batch == "" and "no C compiler was found" in found.notes[-1]


def test_another_scheme_and_other_fmus_run_through_the_fmus(study, evaluator, python_fmus):
    implicit = with_batch(evaluator, replace(COUPLING, scheme="implicit"))
    assert implicit.batch == "" and "implicit" in implicit.notes[-1]
    bank = {**dict(list(study.bank.items())[:2]), "in Python": Build(python_fmus["lpnl2"])}
    mixed = replace(study, bank=bank, corners=dict.fromkeys(CORNERS, tuple(bank)))
    found = with_batch(Evaluator(mixed), COUPLING)
    assert found.batch == "exact" and "run through the FMUs: in Python" in found.notes[-1]
    alone = replace(mixed, bank={"in Python": bank["in Python"]}, corners=dict.fromkeys(CORNERS, ("in Python",)))
    found = with_batch(Evaluator(alone), COUPLING)
    assert found.batch == "" and "every setup runs through the FMUs: in Python" in found.notes[-1]


def test_an_fmu_without_sources_runs_through_the_fmus(fmus, study, tmp_path):
    secret = tmp_path / "car.fmu"
    with zipfile.ZipFile(fmus["seven_dof"]) as archive, zipfile.ZipFile(secret, "w") as copy:
        for name in archive.namelist():
            if not name.startswith("sources/"):
                copy.writestr(name, archive.read(name))
    found = with_batch(Evaluator(replace(study, vehicle=Vehicle(secret))), COUPLING)
    assert found.batch == "" and "car.fmu contains no sources" in found.notes[-1]


@pytest.mark.slow
def test_an_fmu_of_a_former_law_runs_through_the_fmus(fmus, study, tmp_path):
    """Its kind, which no folder of fmus/ has now, is written into an FMU of LPF1."""
    former = tmp_path / "former.fmu"
    with zipfile.ZipFile(fmus["lpf1"]) as archive, zipfile.ZipFile(former, "w") as copy:
        for name in archive.namelist():
            content = archive.read(name)
            is_text = name in ("modelDescription.xml", "sources/interface.h")
            copy.writestr(name, content.replace(b"shock_lpf1", b"shock_maxwell") if is_text else content)
    bank = {"former": Build(former), "lpf1": Build(fmus["lpf1"])}
    mixed = replace(study, bank=bank, corners=dict.fromkeys(CORNERS, tuple(bank)))
    found, evaluator = with_batch(Evaluator(mixed), COUPLING), Evaluator(mixed)
    assert found.batch == "exact"
    assert "former: former.fmu is shock_maxwell, a law that has no batch" in found.notes[-1]
    rows = evaluator.rows([mixed.space.find(dict.fromkeys(CORNERS, name)) for name in bank], found)
    first, second = ({n: v for n, v in r.items() if isinstance(v, float) and n != "seconds"} for r in rows)
    assert first == pytest.approx(second, rel=1e-12, abs=1e-14)


def test_setups_that_diverge_or_are_refused_say_what_the_fmus_say(fmus, study):
    bad = {
        "refused": Build(fmus["lpnl2"], {"lag_full_force": 2000.0, "lag_zero_force": 1000.0}),
        "wild": Build(fmus["polylinear"], {"compression_scale": 400.0, "rebound_scale": 400.0}),
    }
    bank = {**dict(list(study.bank.items())[:2]), **bad}
    mixed = replace(study, bank=bank, corners=dict.fromkeys(CORNERS, tuple(bank)))
    setups = [mixed.space.find(dict.fromkeys(CORNERS, name)) for name in bank]
    evaluator = Evaluator(mixed)
    found = evaluator.rows(setups, replace(COUPLING, batch="exact"))
    right = [evaluator.row(setup, COUPLING) for setup in setups]
    assert [row["status"] for row in found] == ["done", "done", "failed", "failed"]
    assert [row["message"] for row in found] == [row["message"] for row in right]


def test_a_batch_whose_setups_all_end_early_changes_nothing_of_the_next_one(fmus, study):
    good = next(iter(study.bank))
    wild = {f"wild {k}": Build(fmus["polylinear"], {"compression_scale": 1e9 + k}) for k in range(8)}
    bank = {good: study.bank[good], **wild}
    mixed = replace(study, bank=bank, corners=dict.fromkeys(CORNERS, tuple(bank)))
    setups = [mixed.space.find({**dict.fromkeys(CORNERS, good), "lf": name}) for name in (*wild, good)]
    evaluator, coupling = Evaluator(mixed), replace(COUPLING, errors=errors(mixed))
    *ended, row = evaluator.rows(setups, replace(coupling, batch="exact"))
    assert {one["status"] for one in ended} == {"failed"}
    right = evaluator.row(setups[-1], coupling)
    numbers = [name for name, value in right.items() if isinstance(value, float) and name != "seconds"]
    assert [row[n] for n in numbers] == pytest.approx([right[n] for n in numbers], rel=1e-12, abs=1e-14)


def test_the_random_setups_are_the_same_for_every_call(study, evaluator):
    batches = Batches(evaluator, COUPLING.scheme, COUPLING.step)
    found = random_setups_of_study(study, batches)
    assert found == random_setups_of_study(study, batches) and len({setup.index for setup in found}) == len(found) == 6
