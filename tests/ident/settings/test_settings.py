"""Fit of a shock over its settings: a left-out file, bands, combinations, the inverse problem, tables, commands."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import hypothesis
import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import strategies as st

from eightpost.__main__ import main
from eightpost.errors import FileFormatError, InputError, ParameterError
from eightpost.ident.shock import plots
from eightpost.ident.shock.clicks import TargetCurve, best_clicks, read_target
from eightpost.ident.shock.dynamics import dynamics_for
from eightpost.ident.shock.force import gas_columns, limits_for
from eightpost.ident.shock.law_fit import joint_model
from eightpost.ident.shock.problem import FitProblem
from eightpost.ident.shock.runs import Runs, prepare_runs
from eightpost.ident.shock.settings import _counting, _prediction, _preload, effects_of, fit_settings, held_out_percent
from eightpost.ident.shock.settings_table import SettingsTable, read_settings_table
from eightpost.ident.shock.simulation import simulate
from eightpost.ident.validation.shock_tests import evaluate
from eightpost.rig.dyno_test import DynoTest
from eightpost.shock import Axis, Lpf1, Polylinear, Port, Settings, Shock, Term, read_shock, write_shock
from eightpost.signals import TimeSeries
from eightpost.verdict import Grade
from tests.ident.dyno_records import RATE, curve_of, motion, record_of
from tests.ident.dyno_records import SHARES as KNOTS

EXAMPLES = Path(__file__).resolve().parents[3] / "examples" / "settings"


def true_law(rebound, temperature=320.0, seed=0):
    """A digressive law: rebound softens by clicks progressively, everything by temperature, the gas force rises."""
    random = np.random.default_rng(seed)
    knee, soft = random.uniform(0.05, 0.2), random.uniform(0.3, 0.7)
    slope = 1200.0 + 5000.0 / (1.0 + (0.8 * KNOTS / knee) ** 2)
    share = np.where(KNOTS < 0.0, 1.0 - soft * (1.0 - (1.0 - rebound / 28.0) ** 2), 1.0)
    warm = 1.0 - 0.004 * (temperature - 320.0)
    port = Port(gas_preload=200.0 + 1.5 * (temperature - 320.0), gas_stiffness=900.0)
    return Lpf1(curve_of(slope * share * warm), 1.5e-3, port=port)


def record(law, seed, noise=3.0, temperature=320.0):
    test = record_of(law, seed % 5, noise=noise, noise_seed=seed)
    heat = np.full(len(test.series), temperature)
    return replace(test, series=test.series.with_channel("temperature", "K", heat))


def table(axes, settings, tests):
    files = tuple(Path(f"file{k}.csv") for k in range(len(tests)))
    return SettingsTable("shock", "lpf1", "estimate", tuple(axes), tuple(settings), tuple((t,) for t in tests), files)


def rebound_table(clicks=(0.0, 7.0, 14.0, 21.0, 28.0), seed=0):
    axis = Axis("rebound", clicks, clicks[len(clicks) // 2], counted="from full hard", lowest=0.0, highest=28.0)
    tests = [record(true_law(c, seed=seed), 10 * seed + k) for k, c in enumerate(clicks)]
    return table([axis], [(c,) for c in clicks], tests)


@pytest.fixture(scope="module")
def rebound():
    return fit_settings(rebound_table())


def forces(law, velocity):
    return np.array([law.curve.force(v) for v in velocity])


def test_every_inner_file_is_predicted_by_the_others_almost_as_well_as_it_is_fitted(rebound):
    outer, inner = [rebound.predicted[k] for k in (0, -1)], rebound.predicted[1:-1]
    assert outer == [None, None]
    assert all(p < one.percent + 0.5 for p, one in zip(inner, rebound.fits[1:-1], strict=True))


@pytest.mark.parametrize(
    ("predicted", "grade", "worst"),
    [((None, 2.5, None), Grade.USABLE, "1"), ((1.0, 8.0, 3.0), Grade.LIMITED, "1"),
     ((16.0, 8.0, 3.0), Grade.NOT_USABLE, "0"), ((None, None), None, "")],
)  # fmt: skip
def test_the_verdict_reads_the_setting_that_the_others_predict_worst(predicted, grade, worst):
    groups = [SimpleNamespace(names=(str(k),)) for k in range(len(predicted))]
    reasons = list(_prediction(groups, predicted))
    assert [(reason.grade, reason.origin) for reason in reasons] == ([(grade, worst)] if grade else [])


@pytest.mark.nightly
def test_the_bands_cover_the_true_curves_of_random_systems_between_the_measured_settings():
    covered = []
    for seed in range(8):
        fit = fit_settings(rebound_table((0.0, 9.0, 18.0, 28.0), seed=seed))
        for clicks in (4.0, 13.0, 23.0):
            found = fit.shock.at(clicks={"rebound": clicks})
            band = found.fit["curve_band"]
            velocity = np.array(band["velocity [m/s]"])
            inner = np.abs(velocity) < 0.6
            error = forces(found.law, velocity) - forces(true_law(clicks, seed=seed), velocity)
            covered.append(np.mean(np.abs(error)[inner] <= np.array(band["half_width [N]"])[inner]))
    assert np.mean(covered) > 0.93


@pytest.mark.nightly
def test_clicks_and_temperature_are_separated_and_the_gas_force_is_linear_in_temperature():
    axes = (Axis("rebound", (0.0, 14.0, 28.0), 14.0), Axis("temperature", (300.0, 320.0, 350.0), 320.0, unit="K"))
    settings = [(0.0, 320.0), (14.0, 320.0), (28.0, 320.0), (14.0, 300.0), (14.0, 350.0)]
    tests = [record(true_law(*setting), k, temperature=setting[1]) for k, setting in enumerate(settings)]
    shock = fit_settings(table(axes, settings, tests)).shock
    velocity = np.linspace(-0.6, 0.6, 61)
    truth = forces(true_law(14.0, 335.0), velocity)
    warm = shock.at(temperature=335.0)
    assert np.std(forces(warm.law, velocity) - truth) < 0.01 * truth.std()
    assert warm.law.port.gas_preload - shock.law.port.gas_preload == pytest.approx(22.5, abs=8.0)
    assert shock.at(clicks={"rebound": 20}, temperature=335.0).validity.verdict.grade is Grade.UNKNOWN


def test_a_full_grid_gives_the_interaction_and_one_at_a_time_gives_none():
    axes = (Axis("a", (0.0, 1.0), 0.0), Axis("b", (0.0, 1.0, 2.0), 0.0))
    settings = [(a, b) for a in (0.0, 1.0) for b in (0.0, 1.0, 2.0)]
    values = np.array([[1.0 + 2.0 * a + 3.0 * b + 5.0 * a * b] for a, b in settings])
    grid = effects_of(axes, settings, values)
    assert [term.axes for term in grid.terms] == [("a",), ("b",), ("a", "b")]
    assert np.array(grid.terms[2].deviations).ravel() == pytest.approx([0.0, 0.0, 0.0, 0.0, 5.0, 10.0])
    single = [0, 1, 2, 3]
    alone = effects_of(axes, [settings[k] for k in single], values[single])
    assert [term.axes for term in alone.terms] == [("a",), ("b",)]
    assert not alone.left.any()


def test_adjusters_that_change_together_are_refused_by_name():
    axes = (Axis("rebound", (0.0, 5.0), 0.0), Axis("compression", (0.0, 3.0), 0.0))
    with pytest.raises(InputError, match="do not separate the effects of rebound, compression"):
        effects_of(axes, [(0.0, 0.0), (5.0, 3.0)], np.zeros((2, 26)))


@hypothesis.settings(max_examples=60, deadline=None)
@hypothesis.given(st.sets(st.tuples(*[st.integers(0, 4)] * 2), min_size=2, max_size=12), st.integers(0, 99))
def test_scattered_settings_are_reproduced_or_refused_by_name(places, seed):
    """The settings are on no grid: most combinations of their clicks were not measured."""
    measured = sorted((float(a), float(b)) for a, b in places)
    axes = tuple(
        Axis(name, nodes, nodes[len(nodes) // 2])
        for name, nodes in zip(
            "ab", (tuple(sorted(set(column))) for column in zip(*measured, strict=True)), strict=True
        )
    )
    values = np.random.default_rng(seed).standard_normal((len(measured), 26))
    values[:] = [[a * row + b * (1.0 + row) for row in values[0]] for a, b in measured]  # effects that add
    try:
        found = effects_of(axes, measured, values)
    except InputError as error:
        assert "do not separate the effects of" in str(error)
        return
    whole = Settings(axes, (), found.terms, tuple(measured), ((0.0,) * 25,) * len(measured))
    for setting, value in zip(measured, values, strict=True):
        assert np.add(found.reference, whole.deviations(setting)) == pytest.approx(value, abs=1e-8)


def two_adjusters():
    """A shock with rebound and compression adjusters whose effects are known exactly."""
    base = true_law(14.0)
    random = np.random.default_rng(1)
    effects = []
    for side in (-1.0, 1.0):
        per_click = np.where(side * KNOTS > 0.0, random.uniform(20.0, 60.0, 25), 0.0)
        effects.append(per_click)
    axes = tuple(Axis(name, (0.0, 10.0, 20.0), 10.0, lowest=0.0, highest=20.0) for name in ("rebound", "compression"))
    terms = tuple(
        Term((axis.name,), tuple((*(-(node - 10.0) * effect).tolist(), 0.0) for node in axis.nodes))
        for axis, effect in zip(axes, effects, strict=True)
    )
    tested = tuple((float(r), float(c)) for r in (0, 10, 20) for c in (0, 10, 20))
    return Shock("two", base, settings=Settings(axes, (), terms, tested, ((2.0,) * 25,) * 9))


@pytest.mark.parametrize("clicks", [(3, 17), (10, 10), (20, 0), (13, 6)])
def test_the_inverse_problem_finds_the_clicks_of_a_curve_among_all_combinations(clicks):
    shock = two_adjusters()
    setting = dict(zip(("rebound", "compression"), clicks, strict=True))
    velocity = np.linspace(-0.7, 0.7, 41)
    target = TargetCurve("target", velocity, forces(shock.at(clicks=setting).law, velocity) + 80.0)
    answer = best_clicks(shock, target, level="free")
    assert answer.best.setting == clicks
    assert answer.combinations == 441
    assert answer.is_reachable and answer.best.rms < 1e-6
    assert np.diff([choice.rms for choice in answer.choices]).min() > -1e-9


def test_a_constant_force_between_shock_and_target_is_noted():
    shock = two_adjusters()
    velocity = np.linspace(-0.7, 0.7, 41)
    stiffest = shock.at(clicks={"rebound": 0, "compression": 0}).law
    target = TargetCurve("target", velocity, forces(stiffest, velocity) + 200.0)
    fixed = {"rebound": 0.0, "compression": 0.0}
    assert any("constant force of -200 N" in note for note in best_clicks(shock, target, fixed=fixed).notes)


def test_more_combinations_than_can_be_computed_are_refused_with_their_number(monkeypatch):
    target = TargetCurve("target", np.array([-0.1, 0.1]), np.array([-1.0, 1.0]))
    monkeypatch.setattr("eightpost.ident.shock.clicks.MOST_COMBINATIONS", 440)
    with pytest.raises(ParameterError, match=r"441 combinations of settings, more than 440; fix an adjuster"):
        best_clicks(two_adjusters(), target)
    monkeypatch.setattr("eightpost.ident.shock.clicks.MOST_COMBINATIONS", 441)
    assert best_clicks(two_adjusters(), target).combinations == 441


def test_a_fixed_adjuster_keeps_its_clicks():
    shock = two_adjusters()
    velocity = np.linspace(-0.7, 0.7, 41)
    target = TargetCurve("target", velocity, forces(shock.at(clicks={"rebound": 4, "compression": 15}).law, velocity))
    assert best_clicks(shock, target, fixed={"compression": 2.0}).best.setting == (4.0, 2.0)


def test_a_target_is_read_in_its_own_units_and_without_its_gas_force(tmp_path):
    path = tmp_path / "target.csv"
    path.write_text("Velocity [mm/s],Force [kN]\n-200,-0.4\n0,0.1\n200,0.9\n")
    target = read_target(path)
    assert target.velocity == pytest.approx([-0.2, 0.0, 0.2])
    assert target.force == pytest.approx([-500.0, 0.0, 800.0])
    assert "100 N at zero velocity" in target.notes[0]
    path.write_text("Velocity,Force [kN]\n-200,-0.4\n0,0.1\n200,0.9\n")
    with pytest.raises(InputError, match="has no unit"):
        read_target(path)


@pytest.mark.parametrize(
    ("counted", "is_doubtful"),
    [("from full hard", False), ("from closed", False), ("from full soft", True), ("from open", True), ("", False)],
)
def test_clicks_that_act_against_their_counting_are_a_doubt(counted, is_doubtful):
    """More clicks lower the force of both adjusters."""
    shock = two_adjusters()
    axes = tuple(replace(axis, counted=counted) for axis in shock.settings.axes)
    for axis in axes:
        found = [*_counting(axis, replace(shock.settings, axes=axes), shock.law, "shock")]
        assert len(found) == is_doubtful
        if is_doubtful:
            assert found[0].statement == f"{axis.name} acts against its counting, {counted}"
            stiff, soft = (
                np.ptp(shock.at(clicks={axis.name: clicks, other: 10}).law.curve.knot_force)
                for clicks in (0, 20)
                for other in {"rebound", "compression"} - {axis.name}
            )
            assert found[0].figure == (f"the force range changes from {stiff:.0f} N at 0 to {soft:.0f} N at 20 clicks")


def test_the_held_out_error_is_that_without_the_level_of_the_record():
    """Forces that are 10 % too large have a tenth of the force's standard deviation as their error."""
    law = replace(true_law(14.0), port=Port())
    made = record(law, 1)
    made = replace(made, series=made.series.with_channel("force", "N", simulate(law, made.series)))
    runs = prepare_runs([made])
    hard = Port(compression_scale=1.1, rebound_scale=1.1, gas_preload=900.0)
    assert held_out_percent(replace(law, port=hard), runs) == pytest.approx(10.0, rel=0.003)


def test_the_gas_preload_is_a_straight_line_over_the_temperature_and_no_adjuster_changes_it():
    axes = (Axis("rebound", (0.0, 5.0), 0.0), Axis("temperature", (300.0, 320.0, 350.0), 320.0, unit="K"))
    settings = [(0.0, 300.0), (5.0, 300.0), (0.0, 320.0), (5.0, 350.0)]
    groups = [SimpleNamespace(setting=setting) for setting in settings]
    measured = np.array([168.0, 172.0, 200.0, 245.0])  # 200 N and 1.5 N/K, with an error of 2 N at 300 K
    assert _preload(axes, groups, measured) == pytest.approx([170.0, 170.0, 200.0, 245.0])
    assert _preload(axes[:1], groups, measured) == pytest.approx([196.25] * 4)


def test_a_file_with_another_level_of_force_is_a_doubt_with_its_difference_from_the_mean(rebound):
    """100 N more in one of five files: 80 N above their mean."""
    usual = rebound_table()
    (last,) = usual.tests[-1]
    higher = DynoTest(last.series.with_channel("force", "N", last.series["force"] + 100.0))
    other = fit_settings(replace(usual, tests=(*usual.tests[:-1], (higher,))))
    assert not any("level of the force" in reason.statement for reason in rebound.verdict.reasons)
    (found,) = [reason for reason in other.verdict.reasons if "level of the force" in reason.statement]
    level, _, rest = found.figure.partition(" N ")
    share = 100.0 * float(level) / float(np.std(higher.series["force"]))
    assert float(level) == pytest.approx(80.0, abs=6.0) and rest.startswith("from the mean of the files")
    assert float(rest.split(", ")[1].split(" %")[0]) == pytest.approx(share, rel=0.005)
    assert found.origin == "file4.csv"


@pytest.mark.nightly
@pytest.mark.parametrize("seed", range(8))
def test_any_files_give_a_shock_with_the_stated_error_at_every_measured_setting_or_are_refused(seed):
    """Any curves, also ones that fall: the error of the shock at a setting, without its level, is that of the table."""
    random = np.random.default_rng(seed)
    clicks = tuple(sorted(random.choice(20, int(random.integers(2, 5)), replace=False).astype(float).tolist()))
    velocity, tests = motion(seed % 5)["velocity"][::4], []
    for _ in clicks:
        v = velocity * random.uniform(0.05, 1.0)
        force = random.uniform(100.0, 900.0) * np.tanh(v / random.uniform(5e-3, 0.2)) + random.uniform(-800.0, 5e3) * v
        channels = {"velocity": ("m/s", v), "force": ("N", force + random.normal(0.0, 3.0, v.size))}
        tests.append(DynoTest(TimeSeries.from_channels(np.arange(v.size) / RATE, channels)))
    axis = Axis("rebound", clicks, clicks[1])
    law = ("hysteresis", "lpf1", "lpnl2", "polylinear")[seed % 4]
    fit = fit_settings(table([axis], [(c,) for c in clicks], tests), law=law, robust="none")
    for value, test, stated in zip(clicks, tests, fit.fits, strict=True):
        shown = evaluate(fit.shock.at(clicks={"rebound": value}), test)
        assert 100.0 * np.std(shown.error) / shown.deviation == pytest.approx(stated.percent, abs=0.2)


@pytest.mark.repeated
@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("clicks.rebound = 7", "clicks.bump = 7"), "no section .adjuster.bump."),
        (("clicks.rebound = 7", "clicks.rebound = 40"), "beyond the adjuster's stops, 0.0 to 28.0"),
        (("clicks.rebound = 7", "clicks.rebound = 7.5"), "not a whole number"),
        (("reference = 14", "reference = 15"), "not the setting of a file; there are: 0, 7, 14, 21, 28"),
        (("[adjuster.rebound]", "[adjuster.'low speed']"), "letters, digits and _"),
        (("lowest = 0", "lowermost = 0"), "is not an entry"),
        (('path = "rebound_07.csv"', 'path = "missing.csv"'), "there is no such file"),
    ],
)
def test_a_wrong_entry_of_a_table_is_reported_with_the_file(tmp_path, change, message):
    text = (EXAMPLES / "rebound.toml").read_text()
    assert change[0] in text
    text = text.replace(*change).replace('path = "rebound', f'path = "{EXAMPLES.as_posix()}/rebound')
    (tmp_path / "table.toml").write_text(text)
    with pytest.raises(InputError, match=message):
        read_settings_table(tmp_path / "table.toml")


def test_a_peak_velocity_table_among_the_files_is_named_as_such(tmp_path):
    rows = ("speed [m/s],compression [N],rebound [N]", "0.1,300,-400", "0.2,500,-600", "0.3,600,-700")
    (tmp_path / "peaks.csv").write_text("\n".join(rows))
    files = "".join(f'[[file]]\npath = "peaks.csv"\nclicks.bump = {clicks}\n' for clicks in (0, 4))
    (tmp_path / "table.toml").write_text(f"schema = 1\n[adjuster.bump]\n{files}")
    with pytest.raises(FileFormatError, match=r"peaks.csv: is a peak-velocity table, without time"):
        read_settings_table(tmp_path / "table.toml")


@pytest.mark.nightly
def test_the_temperature_of_a_file_comes_from_its_channel_or_from_the_table(tmp_path):
    text = (EXAMPLES / "rebound.toml").read_text().replace('path = "rebound', f'path = "{EXAMPLES.as_posix()}/rebound')
    text = text.replace("[[file]]", "[temperature]\n\n[[file]]", 1)
    (tmp_path / "table.toml").write_text(text)
    with pytest.raises(FileFormatError, match="temperature has the same setting in all files"):
        read_settings_table(tmp_path / "table.toml")
    text = text.replace("clicks.rebound = 28", 'clicks.rebound = 14\ntemperature = "80 degC"')
    (tmp_path / "table.toml").write_text(text)
    warm = read_settings_table(tmp_path / "table.toml").axes[1]
    assert warm.nodes[1] == pytest.approx(353.15)
    assert 310.0 < warm.nodes[0] < 325.0


def test_the_click_map_has_the_measured_curves_and_the_forces_at_the_measured_settings(rebound, monkeypatch):
    drawn = []
    monkeypatch.setattr(plots, "save", lambda figure, _path, **_options: drawn.append(figure))
    plots.plot_click_map(rebound.shock, "unused.png")
    curves, forces = drawn[0].axes
    nodes = rebound.shock.settings.axes[0].nodes
    measured = [line for line in curves.lines if line.get_label().endswith("measured")]
    assert [float(line.get_label().split()[0]) for line in measured] == list(nodes)
    for line, clicks in zip(measured, nodes, strict=True):
        curve = rebound.shock.at(clicks={"rebound": clicks}).law.curve
        speed, force = (np.asarray(line.get_data()[k]) for k in (0, 1))
        assert force == pytest.approx([curve.force(v) for v in speed], abs=1e-6)
    dots = [line for line in forces.lines if line.get_marker() == "o"]
    assert dots and all(list(line.get_xdata()) == list(nodes) for line in dots)


@pytest.mark.slow
def test_the_commands_fit_five_files_plot_the_click_map_and_find_the_clicks(tmp_path):
    output = tmp_path / "shock.json"
    shown = CliRunner().invoke(
        main, ["fit", str(EXAMPLES / "rebound.toml"), "-o", str(output), "--plot", str(output.with_suffix(".png"))]
    )
    assert shown.exit_code == 0, shown.output
    assert "rebound 14" in shown.output
    assert (tmp_path / "shock.png").stat().st_size > 20_000
    shock = read_shock(output)
    write_shock(shock.at(clicks={"rebound": 10}), tmp_path / "target.json")
    words = [
        "study",
        "clicks",
        str(output),
        "--curve",
        str(tmp_path / "target.json"),
        "--plot",
        str(tmp_path / "best.png"),
    ]
    shown = CliRunner().invoke(main, words)
    assert shown.exit_code == 0, shown.output
    assert "the target can be reached: rebound 10" in shown.output
    assert (tmp_path / "best.png").stat().st_size > 10_000


def test_the_jacobian_of_all_settings_is_the_difference_of_their_weighted_residuals():
    """Without a law of its own, the force is linear in every parameter."""
    groups = [prepare_runs([record(true_law(clicks), 1)]) for clicks in (0.0, 28.0)]
    gas, _ = gas_columns(Runs.of([runs.first for runs in groups]), "estimate")
    model = joint_model(groups, gas, dynamics_for(Polylinear, limits_for(groups[0].measured, RATE)))
    random = np.random.default_rng(0)
    model = model.weighted(random.uniform(0.1, 1.0, model.runs.target.size))
    x, none = random.standard_normal(model.size), np.zeros(model.size)
    problem = FitProblem(model)
    moved = problem.residual(x) - problem.residual(none)
    np.testing.assert_allclose(problem.jacobian(none) @ x, moved, atol=1e-9 * np.abs(moved).max())
