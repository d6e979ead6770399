"""The report page: it states whether a run can be used, and its numbers match the run."""

import base64
import gzip
import html
import json
import re
from dataclasses import replace

import lxml.html
import numpy as np
import pytest
from scipy.signal import welch

import cosim
from cosim import Bond, Connection, Result, Scenario, System
from cosim.report import page as page_module
from cosim.report import write_report
from cosim.report.drawing import arrows, graph, groups
from cosim.report.page import _drive_digest
from cosim.session.verdict import BondEnergy, Coupled
from eightpost import __version__
from eightpost.errors import OutputError
from eightpost.report.page import LEVELS, traces
from eightpost.report.tables import figure
from eightpost.signals import Drivefile, TimeSeries

from .page_content import content_of, drawn, manifest_lines, stores

__all__ = ["stores"]

SPECIAL = 'a <b>&"quoted"\'</script>'


class _Page:
    """The text, addresses and script elements of a page."""

    def __init__(self, content):
        self.content, tree = content, lxml.html.fromstring(content)
        self.addresses = tree.xpath("//@href | //@src | //@action | //@data | //@srcset")
        self.ids = set(tree.xpath("//@id"))
        self.scripts = {
            e.get("id", "code" if e.tag == "script" else e.tag): e.text for e in tree.iter("script", "style")
        }
        self.text = " ".join(" ".join(tree.xpath("//text()[not(parent::script or parent::style)]")).split())

    @property
    def manifest(self):
        return json.loads(self.scripts["manifest"])

    @property
    def numbers(self):
        return gzip.decompress(base64.b64decode(self.scripts["numbers"]))

    def samples(self, row):
        """Samples of a channel, unpacked as in page.js."""
        channel = self.manifest["channels"][row]
        steps = np.frombuffer(self.numbers, "<u2", self.manifest["time"]["count"], channel["at"])
        levels = np.cumsum(steps.astype(np.int64)) % (LEVELS + 1)
        return channel["low"] + (channel["high"] - channel["low"]) * levels / LEVELS


def _read(result, system, scenario, **options):
    return _Page(page_module.page(result, system, scenario, **{"title": "a run"} | options))


def _drive(stop):
    time = np.arange(0.0, stop + 0.005, 0.01)
    return Drivefile(TimeSeries.from_channels(time, {"push": ("N", 100.0 * np.sin(9.0 * time))}))


@pytest.fixture(scope="module")
def oscillator(make):
    """A mass that a drive pushes and a damper slows: one bond."""

    def build(mass="mass", damper="damper", bond="joint"):
        components = {
            mass: make.integrator(source="mass.fmu"),
            damper: make.gain(-20.0, "m/s", "N", source="damper.fmu"),
        }
        joint = Bond(bond, Connection(f"{mass}.y", f"{damper}.u"), Connection(f"{damper}.y", f"{mass}.u"))
        system = System(components, (joint,), sums=frozenset({f"{mass}.u"}))
        return system, Scenario(2.0, _drive(2.0), targets={"push": f"{mass}.u"}, settling=0.5, record_step=4e-3)

    return build


@pytest.fixture(scope="module")
def run(oscillator):
    """Result with a stated error, system and scenario of the oscillator."""
    system, scenario = oscillator()
    result = cosim.run(system, scenario, step=4e-3, engine="python")
    stated = {"mass.y": 0.12, "damper.y": 0.34}
    return replace(result, stated_error=stated, converged=True, models={}), system, scenario


def test_the_page_loads_no_resources_and_its_security_policy_forbids_loading(run):
    page = _read(*run)
    assert all(address.startswith("#") for address in page.addresses)
    assert "default-src 'none'" in page.content
    for name in ("style", "code"):
        assert not re.search(r"https?://|@import|\burl\(|\bfetch\(|XMLHttpRequest|\bimport\(", page.scripts[name])


def test_every_link_points_to_an_element_of_the_page(run):
    page = _read(*run)
    assert page.addresses and {address.removeprefix("#") for address in page.addresses} <= page.ids


def test_statistics_after_settling_match_numpy_in_both_unit_systems(run):
    result, system, scenario = run
    content = page_module.page(result, system, scenario, title="a run")
    values = result.series["damper.y"][result.series.time >= scenario.settling - 1e-9]
    row = next(r for r in re.findall(r"<tr>.*?</tr>", content, re.S) if "<code>damper.y</code></td><td><span" in r)
    for statistic in (np.mean, np.std, np.min, np.max):
        assert f'<span class="si">{figure(float(statistic(values)))}</span>' in row
        assert f'<span class="us">{figure(float(statistic(values)) / 4.4482216152605)}</span>' in row
    assert f'<span class="si">{figure(0.0034 * float(np.std(values)), 2)}</span>' in row
    assert ">0.34</td>" in row


def test_spectra_match_scipy(run):
    result, system, scenario = run
    page = _read(result, system, scenario)
    settled = result.settled()
    frequency, density = welch(settled.values, fs=250.0, window="hann", nperseg=len(settled), detrend="constant")
    place = page.manifest["frequency"]
    np.testing.assert_allclose(
        np.frombuffer(page.numbers, "<f8", place["count"], place["at"]), frequency[1:], rtol=1e-6
    )
    for row, channel in enumerate(page.manifest["channels"]):
        packed = np.frombuffer(page.numbers, "<f4", place["count"], channel["density"])
        np.testing.assert_allclose(packed, density[row, 1:], rtol=1e-5)


def test_packed_traces_match_the_samples_to_a_65535th_of_their_range(run):
    result, system, scenario = run
    page = _read(result, system, scenario)
    for row, values in enumerate(result.series.values):
        assert np.abs(page.samples(row) - values).max() <= 0.51 * np.ptp(values) / LEVELS


def test_decimated_traces_keep_the_minimum_and_maximum_of_every_interval(monkeypatch, run):
    result, system, scenario = run
    monkeypatch.setattr(page_module, "traces", lambda series: traces(series, capacity=200))
    page = _read(result, system, scenario)
    kept = traces(result.series, capacity=200)
    assert f"Decimated: this page holds the minimum and the maximum of every {kept.samples} samples" in page.text
    time, values = result.series.time, result.series["damper.y"]
    row = result.series.names.index("damper.y")
    for first in range(0, time.size, kept.samples):
        part, pair = values[first : first + kept.samples], kept.values[row, kept.time >= time[first] - 1e-12][:2]
        assert {pair.min(), pair.max()} == {part.min(), part.max()}
    assert kept.values.size <= 200


@pytest.mark.nightly
def test_the_page_of_a_long_run_with_many_channels_is_below_12_mb(make):
    time, rng = np.arange(120_001) * 1e-3, np.random.default_rng(1)
    channels = {f"part.y{k}": ("N", rng.standard_normal(time.size)) for k in range(60)}
    series = TimeSeries.from_channels(time, channels)
    result, system = _blank(series), System({"part": make.gain()}, constants={"part.u": 1.0})
    content = page_module.page(result, system, Scenario(120.0), title="long")
    assert len(content) < 12e6
    assert "Decimated:" in content


def _blank(series, **fields):
    """Result that has only a series."""
    empty = {
        "converged": True, "notes": (), "algorithm": "gauss-seidel", "order": ("part",), "step": 1e-3, "steps": 1,
        "seconds": 0.1, "equilibrium_sweeps": 1, "energy": {}, "held_direct": (), "identities": {"part": "guid"},
    }  # fmt: skip
    return Result(series=series, **empty | fields)


def test_special_characters_in_names_are_escaped(oscillator):
    system, scenario = oscillator(SPECIAL.replace(".", ""), 'l"<&' + "o" * 120 + "ng", "bond <i>&</i>")
    result = cosim.run(system, scenario, step=4e-3, engine="python")
    content = page_module.page(result, system, scenario, title=SPECIAL)
    page = _Page(content)
    assert [c["name"] for c in page.manifest["channels"]] == list(result.series.names)
    for name in (SPECIAL, *system.components, *(bond.name for bond in system.bonds), *result.series.names):
        assert " ".join(name.split()) in page.text
        assert name not in content
    assert content.count("</script>") == content.count("<script")


@pytest.mark.repeated(2)
@pytest.mark.parametrize(
    ("change", "kind", "words"),
    [
        ({}, "usable", r"^Usable: [a-z ]+ small\.$"),
        ({"tolerance": 0.2}, "usable-within-limits", r"^Usable within limits: [a-z ]+ larger than requested\.$"),
        ({"stated_error": {}}, "unknown", r"^Unknown: the coupling error is not stated\.$"),
        ({"partial": True}, "not-usable", r"^Not usable: the run ended early\.$"),
    ],
)  # fmt: skip
def test_the_page_begins_with_one_sentence_that_states_the_verdict(run, change, kind, words):
    result, system, scenario = run
    content = page_module.page(replace(result, **change), system, scenario, title="a run")
    (sentence,) = re.findall(r'<div id="verdict" class="verdict ([a-z-]+)">\s*<p>(.*?)</p>', content, re.S)
    summary = html.unescape(re.sub(r"<.*?>", "", sentence[1])).replace("\N{NO-BREAK SPACE}", " ")
    assert sentence[0] == kind
    assert re.search(words, summary), summary
    verdict = replace(result, **change).verdict
    assert summary == f"{verdict.headline}: {verdict.decisive[0].statement}."  # as a terminal says it
    assert content.index('id="verdict"') < content.index("<h2")


def test_missing_content_is_reported(make):
    series = TimeSeries.from_channels([0.0, 0.1], {"part.y": ("N", [1.0, 2.0])})
    system = System({"part": make.gain()}, constants={"part.u": 1.0})
    text = _read(_blank(series), system, Scenario(0.1)).text
    for message in (
        "There are no notes.", "The system has no bonds", "No component is connected with another.",
        "There are too few samples for spectra.", "The run states no coupling error", "1 component, 0 bonds",
    ):  # fmt: skip
        assert message in text


def test_a_run_without_channels_still_has_a_page(make):
    series = TimeSeries(np.array([0.0, 0.1]), np.empty((0, 2)), (), ())
    system = System({"part": make.gain()}, constants={"part.u": 1.0})
    assert "No channels were recorded." in _read(_blank(series), system, Scenario(0.1)).text


def test_identical_groups_are_drawn_once_and_all_listed(make):
    components, bonds = {}, []
    for k in range(100):
        components[f"mass{k}"], components[f"damper{k}"] = make.integrator(), make.gain(1.0, "m/s", "N")
        ends = Connection(f"mass{k}.y", f"damper{k}.u"), Connection(f"damper{k}.y", f"mass{k}.u", -1.0)
        bonds.append(Bond(f"joint{k}", *ends))
    system = System(components, tuple(bonds))
    (group,) = groups(tuple(components), arrows(system, Scenario(1.0)), {})
    assert group.components == ("mass0", "damper0")
    assert len(group.alike) == 99
    series = TimeSeries.from_channels([0.0, 1.0], {"mass0.y": ("m/s", [0.0, 1.0])})
    page = _read(_blank(series, identities=dict.fromkeys(components, "guid")), system, Scenario(1.0))
    assert page.content.count("<svg") == 1
    assert "Drawn once for 100 groups that are alike" in page.text
    assert all(f"joint{k} mass{k}.y damper{k}.u 1 0" in page.text for k in range(100))


def test_files_are_listed_with_their_digest_and_generation_tool(run, fmus):
    result, system, scenario = run
    page = _read(result, system, scenario, files={"mass": fmus["quarter_car"]})
    assert page.text.count(f"eightpost {__version__}, version") == 1
    assert re.search(r"\b[0-9a-f]{64}\b", page.text)


def test_the_digest_of_a_drive_depends_on_its_content_only():
    first, same, other = _drive(1.0), _drive(1.0), _drive(2.0)
    assert _drive_digest(first) == _drive_digest(same) != _drive_digest(other)


def test_a_failed_write_leaves_the_old_page_unchanged(run, tmp_path, monkeypatch):
    path = tmp_path / "report.html"
    path.write_text("<html>old")
    monkeypatch.setattr("pathlib.Path.replace", _refuse)
    with pytest.raises(OutputError, match="disk full"):
        write_report(path, *run)
    assert path.read_text() == "<html>old"
    assert [p.name for p in tmp_path.iterdir()] == ["report.html"]


def _refuse(*_):
    raise OSError("disk full")


def test_a_report_is_written_as_one_utf_8_file(run, tmp_path):
    path = write_report(tmp_path / "out" / "report.html", *run, title="Rüttelprüfstand")
    assert [p.name for p in path.parent.iterdir()] == ["report.html"]
    assert "<h1>Rüttelprüfstand</h1>" in path.read_text(encoding="utf-8")


# ---- Kept pages and drawings ----------------------------------------------------------------------------------------


@pytest.fixture
def whole(run):
    """The run with everything that a page can show."""
    result, system, scenario = run
    stated = {"mass.y": 0.12, "damper.y": float("inf")}
    joint = Coupled(1e-3, 0.5, 2.0, 800.0, 0.5, 800.0)
    result = replace(
        result, stated_error=stated, energy={"joint": BondEnergy(-9.0, 100.0)}, coupled={"joint": joint}, seconds=1.5,
        stepping_seconds=0.25, partial=True, notes=("a note of 3 %",), held_direct=("damper.y",), iterations=7,
        rejected_steps=2, largest_step=8e-3, scheme="implicit", parameters={"mass": {"scale": 1.5}},
        algorithm="automatic", settling=0.4,
    )  # fmt: skip
    return result, system, replace(scenario, stop=1.5, drive_start=0.25)


def test_a_page_is_unchanged(whole, stores, unchanged):
    content = content_of(page_module.page(*whole, title="a run"))
    result = whole[0]
    unchanged(content)
    manifest, _ = page_module._packed(result, traces(result.series), page_module.spectra(result.settled()))
    unchanged({"manifest": manifest_lines(manifest), "arrays": stores[0].arrays}, "numbers")
    within = replace(result, settling=5.0, stated_error={"damper.y": 0.5, "mass.y": 1.5}, decisive=("damper.y",))
    unchanged({"tiles": list(page_module.tiles(within)), "notes": page_module.notes(within)}, "within settling")


def _car(make):
    """A component with three neighbours: sums, gains, units, constants, its own outputs, and neighbours that join."""

    def table(inputs, outputs):
        ends = ((inputs, "input"), (outputs, "output"))
        return make.table(*(make.variable(n, way, unit) for units, way in ends for n, unit in units.items()))

    ports = table(
        {"force": "N", "heave": "in", "aero": "lbf", "own": "N"}, {"velocity": "m/s", "place": "in", "y": "N"}
    )
    shock = table({"v": "in/s", "x": "m", "u": "N", "t": "degC"}, {"f": "N"})
    long = "a component with a name that is too long to be drawn"
    components = {"car": make.component(ports, None), "front": make.component(shock, None),
                  long: make.component(shock, None), "leaf": make.gain(), "alone": make.gain()}  # fmt: skip
    bonds = (
        Bond("front bond", Connection("car.velocity", "front.v", -1.0), Connection("front.f", "car.force"),
             Connection("car.place", "front.x", 0.5)),
        Bond("rear bond", Connection("car.velocity", f"{long}.v"), Connection(f"{long}.f", "car.force", -2.5)),
    )  # fmt: skip
    joined = (
        Connection("front.f", f"{long}.u", -1.0), Connection(f"{long}.f", "leaf.u"),
        Connection("leaf.y", "front.u"), Connection("car.y", "car.own"), Connection("car.place", f"{long}.x"),
    )  # fmt: skip
    constants = {"car.aero": 12.5, "alone.u": 0.0, "front.t": 20.0, f"{long}.t": 30.0}
    system = System(components, bonds, joined, constants=constants, sums=frozenset({"car.force"}))
    time = np.array([0.0, 1.0])
    drive = Drivefile(TimeSeries.from_channels(time, {"road": ("m", time)}))
    return system, Scenario(1.0, drive, targets={"road": "car.heave"})


def test_a_drawing_is_unchanged(make, unchanged):
    system, scenario = _car(make)
    found = groups(tuple(system.components), arrows(system, scenario), {"car": "car.fmu", "front": "shock.fmu"})
    drawings = [graph(group, {"car": "a car with a long name.fmu"}) for group in found]
    unchanged([line for drawing in drawings for line in drawn(drawing)])


def test_more_components_than_a_drawing_shows_are_counted_in_it(make):
    hub = make.component(make.table(make.variable("y", "output", "N")), None)
    components = {"hub": hub} | {f"leaf{k}": make.gain() for k in range(27)}
    system = System(components, connections=tuple(Connection("hub.y", f"leaf{k}.u") for k in range(27)))
    (group,) = groups(tuple(components), arrows(system, Scenario(1.0)), {})
    shown = graph(group, {})
    assert "leaf23" in shown and "leaf24" not in shown and "and 3 more" in shown


def test_channels_have_panels_colours_and_dashes(unchanged):
    time = np.array([0.0, 1.0])
    names = [f"c{k}.force" for k in range(30)] + [f"c.q{k}" for k in range(6)]
    series = TimeSeries.from_channels(time, dict.fromkeys(names, ("N", time)))
    unchanged({
        panel.quantity: [panel.opened, *(f"{line.row} {line.color} {line.dash} {line.drawn}" for line in panel.lines)]
        for panel in page_module.panels(series)
    })  # fmt: skip
