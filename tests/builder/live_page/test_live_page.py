"""The live page: its WebAssembly modules give the numbers of the native FMUs, and a reader can turn everything."""

import base64
import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from fmpy import extract
from fmpy.fmi2 import FMU2Slave
from fmpy.model_description import read_model_description

from builder import toolchain
from builder.assembly import assemble
from builder.live_page import CAR, SHOCK, Control, _read_models, _shock_controls, write_live_page
from eightpost.__main__ import main
from eightpost.errors import FmuError
from eightpost.shock import LAWS
from eightpost.wiring import Wire, Wiring

SCRIPT = Path(__file__).resolve().parents[3] / "builder" / "live_page" / "script" / "fmu.js"
STEP, COUNT = 1e-3, 400

#: Runs the page's own class Fmu outside a browser: the elements of the page and its decompression are replaced.
NODE = """
const question = JSON.parse(require("fs").readFileSync(0, "utf8"));
const document = {{ getElementById: () => ({{ textContent: JSON.stringify({{ model: question.references }}) }}) }};
const unpacked = async () => Buffer.from(question.module, "base64");
{script}
Fmu.load("model").then((fmu) => {{
  const found = fmu.simulate(question.parameters, question.inputs, question.step, question.outputs);
  for (const name of question.outputs) found[name] = Array.from(found[name]);
  console.log(JSON.stringify(found));
}}).catch((error) => console.log(JSON.stringify({{ message: error.message }})));
"""


def in_node(model, parameters, inputs, outputs):
    """Simulate a model with the page's code in node."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("needs node on the PATH")
    question = {
        "module": base64.b64encode(model.module).decode(),
        "references": {v.name: v.reference for v in model.interface.variables},
        "parameters": parameters, "inputs": {name: list(values) for name, values in inputs.items()},
        "outputs": outputs, "step": STEP,
    }  # fmt: skip
    program = NODE.format(script=SCRIPT.read_text(encoding="utf-8"))
    ran = subprocess.run([node, "-e", program], input=json.dumps(question), capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr
    return json.loads(ran.stdout)


def natively(path, parameters, inputs, outputs):
    """Simulate the native FMU with fmpy: the same ramps."""
    description = read_model_description(path)
    references = {v.name: v.valueReference for v in description.modelVariables}
    fmu = FMU2Slave(
        guid=description.guid, unzipDirectory=extract(path), instanceName="native",
        modelIdentifier=description.coSimulation.modelIdentifier,
    )  # fmt: skip
    fmu.instantiate()
    fmu.setupExperiment(startTime=0.0)
    fmu.enterInitializationMode()
    start = parameters | {name: values[0] for name, values in inputs.items()}
    fmu.setReal([references[name] for name in start], list(start.values()))
    fmu.exitInitializationMode()
    driven, read = [references[name] for name in inputs], [references[name] for name in outputs]
    rows, time = [fmu.getReal(read)], 0.0
    for now, following in zip(
        np.transpose(list(inputs.values())), np.transpose(list(inputs.values()))[1:], strict=False
    ):
        fmu.setReal(driven, list(now))
        fmu.setRealInputDerivatives(driven, [1] * len(driven), list((following - now) / STEP))
        fmu.doStep(time, STEP)
        time += STEP
        rows.append(fmu.getReal(read))
    fmu.terminate()
    fmu.freeInstance()
    return dict(zip(outputs, np.transpose(rows), strict=True))


def motion(rng):
    """A rough ride: velocities over the whole curve, and the displacement that belongs to them."""
    velocity = np.cumsum(rng.normal(0.0, 0.08, COUNT))
    velocity -= velocity.mean()
    return {"velocity": velocity, "displacement": np.cumsum(velocity) * STEP}


def within(found, expected):
    scale = np.abs(expected).max()
    return np.abs(np.asarray(found) - expected).max() <= 1e-12 * scale


@pytest.fixture(scope="module", params=LAWS)
def law(request):
    return request.param


@pytest.mark.repeated
@pytest.mark.slow
@pytest.mark.parametrize("curve", ["polynomials", "knots"])
def test_the_shock_of_the_page_gives_the_numbers_of_the_native_fmu(fmus, law, curve, knots):
    model, *_ = _read_models(fmus[law], fmus["quarter_car"])
    parameters = {"rebound_scale": 1.3, "motion_ratio": 0.8} | (knots if curve == "knots" else {})
    outputs = ["force", "static_force", "dissipated_power"]
    inputs = motion(np.random.default_rng(5))
    found, expected = in_node(model, parameters, inputs, outputs), natively(fmus[law], parameters, inputs, outputs)
    assert all(within(found[name], expected[name]) for name in outputs)


@pytest.mark.nightly
def test_the_car_of_the_page_gives_the_numbers_of_the_assembled_fmu(fmus, tmp_path):
    wires = [(CAR, SHOCK, "velocity"), (CAR, SHOCK, "displacement"), (SHOCK, CAR, "force")]
    wires = tuple(Wire(f"{source}.{name}", f"{target}.{name}") for source, target, name in wires)
    parts = {CAR: fmus["quarter_car"], SHOCK: fmus["lpnl2"]}
    native = assemble(Wiring("car", parts, wires, step=1e-3, stop=1.0), tmp_path / "car.fmu").path
    road = {"car.road": 0.02 * np.sin(np.arange(COUNT) * 0.05) ** 2}
    parameters, outputs = {"shock.compression_scale": 0.7}, ["car.tire_force", "car.velocity", "shock.force"]
    found = in_node(_read_models(fmus["lpnl2"], fmus["quarter_car"])[1], parameters, road, outputs)
    expected = natively(native, parameters, road, outputs)
    assert all(within(found[name], expected[name]) for name in outputs)


def test_a_refusal_of_the_fmu_reaches_the_page_with_its_reason(fmus):
    model, *_ = _read_models(fmus["lpnl2"], fmus["quarter_car"])
    found = in_node(model, {"lag_full_force": 1e4}, motion(np.random.default_rng(1)), ["force"])
    assert "lag_zero_force must be greater than lag_full_force" in found["message"]


@pytest.mark.repeated
def test_every_tunable_parameter_but_the_curve_has_a_control_that_can_reach_its_start_and_nothing_that_is_refused(
    shocks, fmus, law
):
    interface = _read_models(fmus[law], fmus["quarter_car"])[0].interface
    controls = {control.name: control for control in _shock_controls(interface)}
    tunable = {v.name: v for v in interface.variables if v.variability == "tunable" and not v.name.startswith("curve.")}
    assert controls.keys() == tunable.keys()
    for name, variable in tunable.items():
        control = controls[name]
        assert control.low <= variable.start <= control.high and control.low < control.high
        assert variable.minimum is None or control.low >= variable.minimum
        assert variable.maximum is None or control.high <= variable.maximum


def test_a_control_knows_both_units():
    control = Control.of("speed", "Speed of the car", "m/s", (3.0, 90.0), 30.0, shown=("mph", "km/h"))
    assert control.us == ("mph", pytest.approx(2.2369, rel=1e-4))
    assert control.si == ("km/h", pytest.approx(3.6))
    assert control.is_logarithmic


@pytest.mark.parametrize(
    ("shock", "vehicle", "reason"),
    [
        ("quarter_car", "quarter_car", "is a vehicle; give a shock file"),
        ("lpnl2", "seven_dof", "is not a quarter car with one port"),
        ("lpnl2", "lpf1", "is not a quarter car with one port"),
    ],
)
def test_files_that_are_not_a_shock_and_a_quarter_car_are_refused(fmus, shock, vehicle, reason):
    with pytest.raises(FmuError, match=reason):
        _read_models(fmus[shock], fmus[vehicle])


def test_without_zig_the_error_names_the_package(fmus, tmp_path, monkeypatch):
    monkeypatch.setattr(toolchain, "_zig", lambda: None)
    monkeypatch.setattr(toolchain.shutil, "which", lambda name: f"/usr/bin/{name}")
    monkeypatch.setattr(toolchain, "_first_line", lambda command: "a compiler")
    with pytest.raises(FmuError, match=r'pip install "eightpost\[build\]"'):
        write_live_page(fmus["lpnl2"], tmp_path / "page.html", vehicle=fmus["quarter_car"])
    assert not (tmp_path / "page.html").exists()


@pytest.fixture(scope="module")
def written(model_files, tmp_path_factory):
    """The page of the LPNL2 shock, written by the command."""
    path = tmp_path_factory.mktemp("page") / "shock.html"
    source = next(file for file in model_files if file.stem == "lpnl2")
    ran = CliRunner().invoke(main, ["page", str(source), "-o", str(path)])
    assert ran.exit_code == 0, ran.output
    assert "Unknown: how good the fit is was not recorded" in ran.output and "10 parameters to turn" in ran.output
    return path


@pytest.fixture(scope="module")
def opened(browser, written):
    browser.events.clear()
    browser.call("Emulation.setDeviceMetricsOverride", width=1366, height=768, deviceScaleFactor=1, mobile=False)
    browser.call("Page.navigate", url=written.as_uri())
    browser.until(
        "document.body && (document.body.dataset.ready || document.getElementById('trouble')?.hidden === false)"
    )
    assert browser.evaluate("document.getElementById('trouble').hidden")
    return browser


def turn(browser, name, place):
    browser.evaluate(
        f"(() => {{ const knob = document.querySelector('input[data-name=\"{name}\"]'); knob.value = {place};"
        " knob.dispatchEvent(new Event('input')); })()"
    )


def test_a_turned_knob_changes_the_loop_and_the_tire_force_and_the_button_restores_both(opened):
    loop, tire = "eightpost.runs.dynamometer.now.rebound", "eightpost.runs.bump.now.lowest"
    before = opened.evaluate(f"[{loop}, {tire}]")
    turn(opened, "rebound_scale", 900)
    after = opened.evaluate(f"[{loop}, {tire}]")
    assert after[0] < 1.5 * before[0] < 0.0 and after[1] != before[1]
    opened.evaluate("document.getElementById('reset').click()")
    assert opened.evaluate(f"[{loop}, {tire}]") == before


def test_the_static_curve_has_the_gas_force_and_lies_inside_the_loop(opened):
    turn(opened, "gas_preload", 1000)
    force = opened.evaluate("eightpost.runs.dynamometer.now.curve.force[20]")  # at velocity 0
    ends = opened.evaluate("[0, 200].map((k) => eightpost.runs.dynamometer.now.force[k])")
    assert min(ends) < force < max(ends)
    assert force > 200.0  # N of the preload
    opened.evaluate("document.getElementById('reset').click()")


def test_values_that_the_fmu_refuses_show_its_reason_until_they_are_allowed_again(opened):
    turn(opened, "lag_full_force", 1000)
    turn(opened, "lag_zero_force", 0)
    assert "lag_zero_force must be greater" in opened.evaluate("document.getElementById('refused').textContent")
    opened.evaluate("document.getElementById('reset').click()")
    assert opened.evaluate("document.getElementById('refused').hidden")


def test_the_shock_moved_by_hand_leaves_a_trail_of_its_own_force(opened):
    opened.evaluate("eightpost.hand.aim(0.02)")
    opened.until("eightpost.hand.trail.length > 20")
    assert opened.evaluate("eightpost.hand.trail.some(([velocity, force]) => velocity > 0.05 && force > 100)")
    opened.evaluate("eightpost.hand.aim(0)")
    opened.until("!eightpost.hand.moves")


def test_units_switch_every_control_and_the_page_loads_nothing_and_logs_no_error(opened):
    opened.evaluate("document.querySelector('input[name=units][value=si]').click()")
    assert opened.evaluate("document.querySelector('output[data-name=speed]').textContent").endswith("km/h")
    opened.evaluate("document.getElementById('play').click()")
    requests = [e["params"]["request"]["url"] for e in opened.events if e.get("method") == "Network.requestWillBeSent"]
    assert all(url.startswith(("file:", "data:", "blob:")) for url in requests)
    assert not [e for e in opened.events if e.get("method") in ("Log.entryAdded", "Runtime.exceptionThrown")]


def test_on_a_telephone_the_knobs_stay_in_reach_of_the_plot(opened, written):
    opened.call("Emulation.setDeviceMetricsOverride", width=390, height=844, deviceScaleFactor=1, mobile=True)
    opened.call("Page.navigate", url=written.as_uri())
    opened.until("document.body && document.body.dataset.ready")
    box = "document.querySelector('{}').getBoundingClientRect()"
    plot, knobs = (
        opened.evaluate(f"[{box.format(one)}.top, {box.format(one)}.bottom]") for one in ("#velocity-plot", "aside")
    )
    assert plot[0] < knobs[0] - 120 and knobs[1] <= 844  # most of the loop is above them before anybody scrolls
    opened.evaluate("document.querySelector('#velocity-plot').scrollIntoView()")
    plot = opened.evaluate(f"[{box.format('#velocity-plot')}.top, {box.format('#velocity-plot')}.bottom]")
    assert -1 <= plot[0] < plot[1] <= knobs[0]
    opened.call("Emulation.setDeviceMetricsOverride", width=1366, height=768, deviceScaleFactor=1, mobile=False)
