"""Records of several builds are fitted together: builds are left out, and their spread is stated."""

from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from eightpost.__main__ import main
from eightpost.ident import fit_shock
from eightpost.ident.shock.law_fit import left_out_groups
from eightpost.ident.shock.runs import prepare_runs
from eightpost.rig.dyno_conditions import DynoConditions
from eightpost.shock import Lpf1, Port, read_shock
from tests.ident.dyno_records import DIGRESSIVE, SHARES, curve_of, record_of


def law(compression=1.0, rebound=1.0):
    return Lpf1(curve_of(DIGRESSIVE * np.where(SHARES > 0.0, compression, rebound)), 3e-3, port=Port(gas_preload=150.0))


def record(truth, seed, build):
    return record_of(truth, seed, duration=6.0, noise=4.0, conditions=DynoConditions(build=build))


SCALES = {"a": (0.93, 1.02), "b": (1.0, 1.0), "c": (1.06, 0.97), "d": (1.01, 1.01)}


@pytest.fixture(scope="module")
def tests():
    """Two runs of each of four builds."""
    return [record(law(*scales), 2 * k + i, build) for k, (build, scales) in enumerate(SCALES.items()) for i in (0, 1)]


@pytest.mark.nightly
def test_the_spread_between_builds_is_that_of_their_curves(tests):
    spread = fit_shock(tests, "lpf1").between_builds
    assert spread.builds == tuple(SCALES) and spread.runs == (2, 2, 2, 2)
    truth = np.array(list(SCALES.values()))
    for name, column in (("compression_scale", truth[:, 0]), ("rebound_scale", truth[:, 1])):
        assert spread.percent(name) == pytest.approx(100.0 * column.std(ddof=1), abs=0.4)
    fast = np.argmin(np.abs(spread.velocity - 0.4))
    expected = np.std([law(*scales).curve.force(float(spread.velocity[fast])) for scales in SCALES.values()], ddof=1)
    assert spread.deviation[fast] == pytest.approx(expected, rel=0.1)


@pytest.mark.nightly
def test_the_recipe_of_the_dissertation_states_the_spread_between_builds_fitted_with_it(tests):
    spread = fit_shock(tests[:4], "lpf1", recipe="boggs").between_builds
    assert spread.builds == ("a", "b")
    for build, force, own in zip("ab", spread.force, (tests[:2], tests[2:4]), strict=True):
        curve = fit_shock(own, "lpf1", recipe="boggs").shock.law.curve
        expected = [curve.force(v) for v in spread.velocity.tolist()]
        assert force == pytest.approx(expected, abs=1e-3 * np.ptp(expected)), build


def test_builds_that_do_not_differ_have_almost_no_spread():
    same = [record(law(), k, build) for k, build in enumerate("ab")]
    spread = fit_shock(same, "lpf1").between_builds
    assert max(spread.percent(name) for name in spread.scales) < 0.5
    assert np.median(spread.deviation) < 0.005 * np.ptp(spread.force)


def test_runs_of_one_build_or_of_unknown_builds_have_no_spread(tests):
    assert prepare_runs(tests[:2]).builds == ("a",)
    unknown = [replace(test, conditions=DynoConditions()) for test in tests[:4:2]]
    fit = fit_shock(unknown, "polylinear", segment=(1.0, 3.0))
    assert fit.between_builds is None and "between_builds" not in fit.shock.fit


def test_each_build_is_left_out_with_all_its_runs(tests):
    runs = prepare_runs(tests)
    ends = np.cumsum([0, *(f.rows.size for f in runs.filters)])
    parts = left_out_groups(runs, [p.build for p in runs.prepared])
    assert len(parts) == len(SCALES)
    for number, part in enumerate(parts):
        assert [(p.start, p.stop) for p in part.parts] == [(ends[k], ends[k + 1]) for k in (2 * number, 2 * number + 1)]
        assert not part.kept[ends[2 * number] : ends[2 * number + 2]].any()
        assert part.kept.sum() == ends[-1] - (ends[2 * number + 2] - ends[2 * number])


def test_builds_are_left_out_only_if_others_have_their_speeds(tests):
    runs = prepare_runs(tests[:4])
    assert runs.has_repeated_builds
    slow = [replace(test, series=_slower(test.series)) if test.conditions.build == "b" else test for test in tests[:4]]
    assert prepare_runs(slow).has_repeated_motions and not prepare_runs(slow).has_repeated_builds
    assert not prepare_runs(tests[:2]).has_repeated_builds


def _slower(series):
    found = series
    for name, unit in (("velocity", "m/s"), ("displacement", "m"), ("force", "N")):
        found = found.with_channel(name, unit, 0.4 * series[name])
    return found


@pytest.mark.slow
def test_the_command_pools_files_of_named_builds_and_stores_their_spread(tests, tmp_path):
    files = []
    for test in tests[::2][:2]:
        path = tmp_path / f"run_{test.conditions.build}.csv"
        series = test.series
        columns = np.column_stack([series.time, series["displacement"], series["velocity"], series["force"]])
        header = "time [s],displacement [m],velocity [m/s],force [N]"
        np.savetxt(path, columns, delimiter=",", header=header, comments="", fmt="%.9g")
        files.append(str(path))
    output = tmp_path / "pooled.json"
    words = ["fit", *files, "--build", "run_a.csv=first", "--build", "run_b.csv=second"]
    words += ["--law", "lpf1"]
    shown = CliRunner().invoke(main, [*words, "-o", str(output)])
    assert shown.exit_code == 0, shown.output
    assert "2 builds (first, second): the static force differs from build to build by" in " ".join(shown.output.split())
    fit = read_shock(output).fit
    assert fit["between_builds"]["builds"] == ["first", "second"]
    assert len(fit["between_builds"]["standard_deviation [N]"]) == len(fit["between_builds"]["velocity [m/s]"])
    assert fit["between_builds"]["parameters"]["rebound_scale"]["unit"] == "1"


def test_a_build_of_a_file_that_is_not_given_is_refused(tmp_path):
    shown = CliRunner().invoke(main, ["fit", "missing.csv", "--build", "front", "--build", "other.csv=rear"])
    assert shown.exit_code != 0
    assert "write FILE=NAME with one of the files: missing.csv" in " ".join(shown.output.split())


def peak_velocities(folder, build, speeds=(0.05, 0.1, 0.25, 0.5, 0.8)):
    """Write the table of a build, in which the gas is a point at zero speed in both strokes."""
    curve, rows = law(*SCALES[build]).curve, [(0.0, 150.0, 150.0)]
    rows += [(v, curve.force(v) + 150.0, curve.force(-v) + 150.0) for v in speeds]
    lines = [",".join(f"{value:.6g}" for value in row) for row in rows]
    path = folder / f"{build}.csv"
    path.write_text("\n".join(["speed [m/s],compression [N],rebound [N]", *lines]) + "\n", encoding="utf-8")
    return path


def test_peak_velocity_tables_of_several_builds_give_their_mean_and_their_spread(tmp_path):
    paths = [peak_velocities(tmp_path, build) for build in SCALES]
    words = [word for path in paths for word in ("--build", f"{path.name}={path.stem}")]
    done = CliRunner().invoke(main, ["fit", *map(str, paths), *words, "-o", str(tmp_path / "shock.json")])
    assert done.exit_code == 0, done.output
    shock = read_shock(tmp_path / "shock.json")
    for velocity in (0.5, -0.5):
        forces = [law(*scales).curve.force(velocity) for scales in SCALES.values()]
        assert shock.law.curve.force(velocity) == pytest.approx(np.mean(forces), rel=1e-4)
    spread = shock.fit["between_builds"]
    assert spread["builds"] == list(SCALES) and len(shock.inputs) == len(SCALES)
    for name, velocity in (("compression_scale", 0.5), ("rebound_scale", -0.5)):
        forces = np.array([law(*scales).curve.force(velocity) for scales in SCALES.values()])
        found = spread["parameters"][name]["standard_deviation"]
        assert found == pytest.approx(forces.std(ddof=1) / abs(forces.mean()), rel=0.02)
    assert "4 builds (a, b, c, d)" in done.output


def test_a_peak_velocity_table_without_its_build_among_others_is_refused(tmp_path):
    paths = [peak_velocities(tmp_path, build) for build in "abc"]
    words = ["--build", "a.csv=a", "--build", "b.csv=b", "-o", str(tmp_path / "shock.json")]
    done = CliRunner().invoke(main, ["fit", *map(str, paths), *words])
    assert done.exit_code == 2 and "c.csv has no build" in done.output
