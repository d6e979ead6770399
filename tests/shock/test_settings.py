"""A shock over its settings: interpolation, rising curves, the section of the shock file, validity."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eightpost.errors import ParameterError
from eightpost.shock import Axis, Hysteresis, Lpf1, Settings, Shock, Term, read_shock, write_shock
from eightpost.shock.file import setting_text
from eightpost.shock.settings import is_tested, node_weights
from eightpost.validity import Validity, judged
from eightpost.verdict import Grade, Reason, Verdict

from .example_curve import curve as polynomials
from .example_curve import example_settings, knot_curve

GOOD = Reason("r", "fit of the shock", Grade.USABLE, "s", "1 %", "a.csv", "nothing")
NODES = st.lists(st.integers(0, 40), min_size=2, max_size=6, unique=True).map(lambda n: tuple(sorted(map(float, n))))


def law():
    return Lpf1(knot_curve(), 1.3e-3)


def settings(seed=0, size=300.0):
    return example_settings(("time_constant",), [(size, 25), (0.1, 2)], seed=seed, deviation=5.0)


@given(NODES, st.floats(-10.0, 50.0), st.tuples(*[st.floats(-3.0, 3.0)] * 3))
def test_within_the_nodes_every_parabola_is_reproduced_and_beyond_them_its_tangent(nodes, value, coefficients):
    a, b, c = coefficients if len(nodes) > 2 else (*coefficients[:2], 0.0)
    found = float(np.dot(node_weights(nodes, value), [a + b * x + c * x * x for x in nodes]))
    end = min(max(value, nodes[0]), nodes[-1])
    expected = a + b * end + c * end * end + (value - end) * (b + 2.0 * c * end)
    assert found == pytest.approx(expected, abs=1e-7, rel=1e-9)


@given(st.integers(0, 50), st.floats(-5.0, 30.0), st.floats(-2.0, 8.0), st.floats(250.0, 400.0))
def test_the_curve_rises_at_every_setting_and_is_that_of_its_slopes(seed, rebound, compression, temperature):
    at = settings(seed, size=3000.0).law_at(law(), (rebound, compression, temperature))
    curve = at.curve
    assert min(curve.knot_slope) >= 0.0
    rises = 0.5 * (np.add(curve.knot_slope[1:], curve.knot_slope[:-1])) * np.diff(curve.knot_velocity)
    assert np.diff(curve.knot_force) == pytest.approx(rises, abs=1e-6)
    assert at.time_constant > 0.0


@given(st.integers(0, 50), st.floats(-5.0, 30.0), st.floats(-2.0, 8.0), st.floats(250.0, 400.0))
def test_the_lagged_part_of_hysteresis_is_between_zero_and_the_curve_at_every_setting(seed, rebound, compression, warm):
    """`Hysteresis` refuses anything else: the law is then passive."""
    curve, random = knot_curve(), np.random.default_rng(seed)
    shared = tuple((random.uniform(0.0, 1.0, 25) * curve.knot_slope).tolist())
    base = Hysteresis(curve, shared, (4e-3, 2e-3, 5e-3))
    found = settings(seed, size=3000.0)
    terms = tuple(
        Term(term.axes, tuple((*row[:25], *random.normal(0.0, 3000.0, 25), *row[25:]) for row in term.deviations))
        for term in found.terms
    )
    found = replace(found, parameters=("lagged_slope", "time_constant"), terms=terms)
    at = found.law_at(base, (rebound, compression, warm))
    assert min(at.lagged_slope) >= 0.0
    assert all(part <= whole for part, whole in zip(at.lagged_slope, at.curve.knot_slope, strict=True))


def test_at_the_reference_the_law_is_the_measured_one():
    assert settings().law_at(law(), settings().reference) == law()


def test_at_a_measured_setting_the_slopes_are_the_measured_ones():
    found = settings().law_at(law(), (12.0, 3.0, 320.0)).curve.knot_slope
    one, two, both = (settings().terms[k].deviations[row][:25] for k, row in ((0, 2), (1, 1), (3, 5)))
    expected = np.maximum(np.array(law().curve.knot_slope) + one + np.array(two) + both, 0.0)
    assert found == pytest.approx(expected)


def test_a_shock_file_keeps_the_settings(tmp_path):
    shock = Shock("two adjusters", law(), settings=settings())
    write_shock(shock, tmp_path / "shock.json")
    assert read_shock(tmp_path / "shock.json") == shock


def test_a_shock_file_without_settings_has_no_section_for_them(tmp_path):
    write_shock(Shock("plain", law()), tmp_path / "shock.json")
    assert "settings" not in json.loads((tmp_path / "shock.json").read_text())


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda s: s["axes"][0].update(reference=6.0), "the reference 6.0 must be one of the nodes"),
        (lambda s: s["axes"][0].update(nodes=[5.0, 0.0, 12.0, 20.0]), "nodes must be ascending"),
        (lambda s: s["axes"][0].update(name="low speed"), "letters, digits and _"),
        (lambda s: s["terms"][0].update(axes=["bump"]), "unknown axis 'bump'"),
        (lambda s: s["terms"][0].update(axes=["jounce", "bump"]), "unknown axis 'bump'"),
        (lambda s: s["terms"][0]["deviations"].pop(), "must have 4 rows of 27 numbers"),
        (lambda s: s["terms"][0]["deviations"][0].__setitem__(3, "soft"), "0.3: must be a number, not 'soft'"),
        (lambda s: s.update(tested=[]), "each tested combination must have 3 values"),
        (lambda s: s.update(half_width=[]), "half_width must have a row"),
        (lambda s: s.update(parameters=["stiffness"]), "stiffness"),
        (lambda s: s.update(axes={"name": "rebound"}), "settings.axes: must be a list, not"),
        (lambda s: s.update(terms=[1.0]), "terms.0: must be an object, not 1.0"),
        (lambda s: s["axes"][0].update(unit=1), "axes.0.unit: must be a text, not 1"),
        (lambda s: s["axes"][0].update(lowest="0"), "lowest: must be a number, not '0'"),
        (lambda s: s["axes"][0].update(highest=True), "highest: must be a number, not True"),
        (lambda s: s.update(tested=[1.0, 2.0]), "tested.0: must be a list, not 1.0"),
        (lambda s: s["axes"][0].update(name=s["axes"][1]["name"]), "the axes must have different names"),
    ],
)
def test_a_wrong_entry_of_the_settings_is_refused_by_name(tmp_path, change, message):
    path = tmp_path / "shock.json"
    write_shock(Shock("two adjusters", law(), settings=settings()), path)
    document = json.loads(path.read_text())
    change(document["settings"])
    path.write_text(json.dumps(document))
    with pytest.raises(ParameterError, match=message):
        read_shock(path)


def test_a_curve_without_knots_has_no_settings():
    with pytest.raises(ValueError, match="must have knots"):
        Shock("polynomials", Lpf1(polynomials(), 1e-3), settings=settings())


@pytest.mark.parametrize(
    ("clicks", "temperature", "grade"),
    [
        ({}, None, Grade.USABLE),
        ({"rebound": 7}, None, Grade.USABLE),
        ({"rebound": 16, "compression": 3}, None, Grade.USABLE),
        ({}, 333.0, Grade.USABLE),
        ({"rebound": 24}, None, Grade.LIMITED),
        ({"compression": 7}, None, Grade.UNKNOWN),
        ({"rebound": 3, "compression": 3}, None, Grade.UNKNOWN),
        ({"rebound": 7}, 333.0, Grade.UNKNOWN),
    ],
)
def test_the_verdict_on_a_setting_says_measured_extrapolated_or_untested(clicks, temperature, grade):
    shock = Shock("two adjusters", law(), settings=settings()).at(clicks=clicks, temperature=temperature)
    assert shock.settings is None
    assert shock.validity.verdict.grade is grade


def test_a_shock_at_a_setting_is_judged_there_and_unknown_if_the_settings_were_edited(tmp_path):
    write_shock(
        judged(Shock("two adjusters", law(), validity=Validity(Verdict([GOOD])), settings=settings())),
        tmp_path / "s.json",
    )
    there = read_shock(tmp_path / "s.json").at(clicks={"rebound": 12})
    write_shock(there, tmp_path / "there.json")
    found = read_shock(tmp_path / "there.json").validity
    assert [reason.rule for reason in found.verdict.reasons] == ["r", "within the measured settings"]
    assert found == there.validity and found.judged is not None
    content = json.loads((tmp_path / "s.json").read_text())
    content["settings"]["terms"][0]["deviations"][2][4] += 1.0
    (tmp_path / "s.json").write_text(json.dumps(content))
    edited = read_shock(tmp_path / "s.json").at(clicks={"rebound": 12}).validity
    assert edited.verdict.grade is Grade.UNKNOWN
    assert [reason.about for reason in edited.verdict.reasons] == ["file", "setting"]


def test_an_untested_combination_has_a_wider_band_than_a_tested_one():
    found = settings()
    one_at_a_time = replace(found, tested=found.tested[:-2], half_width=found.half_width[:-2])
    tested, untested = (
        np.array(shock.at(clicks={"rebound": 12, "compression": 3}).fit["curve_band"]["half_width [N]"])
        for shock in (Shock("tested", law(), settings=found), Shock("untested", law(), settings=one_at_a_time))
    )
    assert (untested >= tested).all() and untested.sum() > 2.0 * tested.sum()


@pytest.mark.parametrize(("clicks", "scatter"), [(12, 5.0), (14, 7.5), (20, 15.0)])
def test_the_scatter_between_two_settings_is_interpolated(clicks, scatter):
    """The squares of all parts of the band are added."""
    widths = [(15.0 if row == (20.0, 0.0, 320.0) else 5.0,) * 25 for row in settings().tested]
    bands = [
        np.array(shock.at(clicks={"rebound": clicks}).fit["curve_band"]["half_width [N]"])
        for half_width in (widths, [(0.0,) * 25] * len(widths))
        for shock in [Shock("s", law(), settings=replace(settings(), half_width=tuple(half_width)))]
    ]
    assert np.sqrt(bands[0] ** 2 - bands[1] ** 2) == pytest.approx(scatter)


def test_a_setting_beyond_the_stops_and_an_unknown_adjuster_are_refused():
    shock = Shock("two adjusters", law(), settings=settings())
    with pytest.raises(ParameterError, match="rebound = 26 is beyond the adjuster's stops, 0 to 25"):
        shock.at(clicks={"rebound": 26})
    with pytest.raises(ParameterError, match="unknown setting 'bump'; this shock has: rebound, compression"):
        shock.at(clicks={"bump": 2})
    with pytest.raises(ParameterError, match="was measured at one setting"):
        Shock("plain", law()).at(clicks={"rebound": 2})


def test_a_combination_is_tested_only_if_all_its_measured_neighbours_are():
    found = settings()
    assert is_tested(found, (16.0, 3.0, 320.0))
    assert not is_tested(found, (10.0, 3.0, 320.0)) or (5.0, 3.0, 320.0) in found.tested
    assert not is_tested(found, (2.0, 3.0, 320.0))


def test_a_hysteresis_law_of_which_a_setting_leaves_no_force_is_still_a_law():
    """Slopes of zero leave forces of the size of rounding, which are no sign of cells that are not quadratic."""
    base = Hysteresis(knot_curve(), (0.0,) * 25, (4e-3, 2e-3, 5e-3))
    axis = Axis("rebound", (0.0, 5.0), 0.0)
    term = Term(("rebound",), ((0.0,) * 26, (*(-slope for slope in base.curve.knot_slope), 0.0)))
    flat = Settings((axis,), (), (term,), ((0.0,), (5.0,)), ((0.0,) * 25,) * 2).law_at(base, (9.0,))
    assert max(abs(force) for force in flat.curve.knot_force) < 1e-9


SETTINGS = [
    {"rebound": 5}, {"rebound": 14}, {"rebound": 24}, {"rebound": 12, "compression": 3},
    {"rebound": 2, "compression": 2}, {"compression": 7},
]  # fmt: skip


@pytest.mark.parametrize("temperature", [None, 333.0, 360.0])
def test_a_shock_at_its_settings(temperature, unchanged):
    shock = Shock("two adjusters", law(), settings=settings(size=60.0))
    found = {str(setting): shock.at(clicks=setting, temperature=temperature) for setting in SETTINGS}
    unchanged({name: {
        "force": np.array(one.law.curve.knot_force), "slope": np.array(one.law.curve.knot_slope),
        "lag": one.law.time_constant, "band": np.array(one.fit["curve_band"]["half_width [N]"]),
        "preload": one.law.port.gas_preload, "conditions": one.conditions,
        "verdict": [str(reason) for reason in one.validity.verdict.reasons],
    } for name, one in found.items()})  # fmt: skip


def test_the_axes_of_settings(unchanged):
    found, values = settings(), (-1.0, 0.0, 2.0, 5.0, 11.0, 20.0, 24.0, 300.0, 333.0)
    nodes = ((0.0, 5.0), (0.0, 5.0, 12.0), (0.0, 5.0, 12.0, 20.0))
    unchanged({
        "axes": {axis.name: {
            "whole": axis.is_whole, "variable": axis.variable, "choices": np.array(axis.choices()),
            "values": [f"{v:g}: beyond {axis.beyond(v):g}, interval {axis.interval(v)}, intervals beyond "
                       f"{axis.intervals_beyond(v):.6g}, neighbours {axis.neighbours(v)}" for v in values],
        } for axis in found.axes},
        "weights": [np.array(node_weights(each, v)) for each in nodes for v in values[:7]],
        "factors": found.factors, "count": found.deviation_count,
        "tested": " ".join(str(is_tested(found, (r, c, t))) for r in (0.0, 5.0, 9.0, 16.0)
                   for c in (0.0, 3.0) for t in (320.0, 330.0)),
        "text": [setting_text(found, s) for s in ((5.0, 0.0, 320.0), (9.0, 3.0, 333.3))],
        "summary": str(Shock("two adjusters", law(), settings=found)),
    })  # fmt: skip
