"""FMUs of shocks over their settings: clicks and temperature change the running FMU as they change the law."""

from dataclasses import replace

import numpy as np
import pytest

from builder.build import build
from builder.native_fmu import _c_sources
from builder.product import shock_product
from cosim import Bond, FmuComponent, GaussSeidel, Scenario, System, run
from eightpost.errors import FmuError
from eightpost.shock import write_shock
from eightpost.shock.settings import is_tested
from eightpost.signals import TimeSeries
from eightpost.signals.drivefile import Drivefile

from .shock_over_settings import SHOCKS, shock_of

NAMES = ("clicks.rebound", "clicks.compression", "temperature")
REPORTED = ("force", "beyond_settings", "untested_settings")


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Return the FMU of a law and target; the temperature is an input if it is requested."""
    folder, kept = tmp_path_factory.mktemp("settings"), {}

    def call(name, target="native", *, temperature_input=False, fmi="2"):
        key = (name, target, temperature_input, fmi)
        if key not in kept:
            write_shock(shock_of(name), folder / f"{name}.json")
            where = folder / "_".join(map(str, key))
            (item,) = build(
                [folder / f"{name}.json"], where, target=target, temperature_input=temperature_input, fmi=fmi
            )
            kept[key] = item.path
        return kept[key]

    return call


def settings_and_moves(count=60):
    random = np.random.default_rng(2)
    setting = (5.0, 0.0, 320.0)
    for k in range(count):
        changed = k % 10 == 5
        if changed:
            setting = (float(random.integers(0, 26)), float(random.integers(0, 5)), float(random.uniform(290.0, 350.0)))
        yield setting, changed, 10.0 ** random.uniform(-5.0, -2.0), float(random.uniform(-1.3, 1.3))


@pytest.mark.repeated
@pytest.mark.slow
@pytest.mark.parametrize("temperature_input", [False, True])
@pytest.mark.parametrize("target", ["native", "python"])
@pytest.mark.parametrize("name", SHOCKS)
def test_the_fmu_follows_the_law_at_every_setting_and_reports_where_it_is(built, name, target, temperature_input):
    shock = shock_of(name)
    fmu = FmuComponent(built(name, target, temperature_input=temperature_input), name)
    fmu.begin(0.0, 10.0, {})
    fmu.end_initialization()
    state, time = shock.law.start(0.0), 0.0
    for setting, changed, step, velocity in settings_and_moves():
        if changed:
            for variable, value in zip(NAMES, setting, strict=True):
                fmu.set((variable,), (value,))
        law = shock.settings.law_at(shock.law, setting)
        state = law.follow(state, velocity, velocity, step)
        fmu.set(("velocity",), (velocity,))
        fmu.step(time, step)
        time += step
        force, beyond, untested = fmu.get(REPORTED)
        assert force == pytest.approx(law.response(state, velocity, 0.0).force, rel=1e-11, abs=1e-9)
        assert beyond == pytest.approx(
            max(axis.intervals_beyond(value) for axis, value in zip(shock.settings.axes, setting, strict=True))
        )
        assert untested == (0.0 if is_tested(shock.settings, setting) else 1.0)


@pytest.mark.repeated
@pytest.mark.parametrize(
    ("parameters", "rule"),
    [
        ({}, "within the settings of a shock"),
        ({"clicks.rebound": 21.0}, "beyond the settings of a shock"),
        ({"temperature": 400.0}, "far beyond the settings of a shock"),
        ({"clicks.compression": 3.0, "temperature": 345.0}, "untested settings of a shock"),
    ],
)
def test_the_verdict_of_a_run_states_where_the_setting_is(built, fmus, parameters, rule):
    components = {"car": FmuComponent(fmus["quarter_car"], "car"), "shock": FmuComponent(built("lpnl2"), "shock")}
    system = System(
        components, [Bond.between("car", "shock")], constants={"car.aero_force": 0.0}, parameters={"shock": parameters}
    )
    drive = Drivefile(TimeSeries.from_channels(np.linspace(0.0, 0.2, 21), {"road": ("m", np.zeros(21))}))
    result = run(system, Scenario(0.2, drive), step=1e-3, algorithm=GaussSeidel())
    reasons = result.verdict.about("settings of the shocks").reasons
    assert [reason.rule for reason in reasons] == [rule]
    assert reasons[0].origin == "component shock"


def test_the_interface_and_the_code_without_settings_do_not_mention_them():
    plain = replace(shock_of("lpf1"), settings=None)
    product = shock_product(plain, "plain")
    assert not [v.name for v in product.interface.variables if v.name in (*NAMES, *REPORTED[1:])]
    sources = _c_sources(product, product.interface, "0")
    assert "settings_data.h" not in sources
    assert b"HAS_SETTINGS" not in sources["interface.h"]


def test_a_temperature_that_was_not_varied_cannot_be_an_input():
    plain = replace(shock_of("lpf1"), settings=None)
    with pytest.raises(FmuError, match="no temperature that could be an input"):
        shock_product(plain, "plain", temperature_input=True)
